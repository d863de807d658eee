"""Byte strings found thousands at once: the parts of points that repeat from second to second.

Each string has a place, a small number that its owner chose. Rows of bytes are looked up by a 64-bit hash among the
sorted hashes of those that are known, and then compared byte by byte, so a collision of hashes finds nothing wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["UNKNOWN", "KnownParts", "Rows", "Words", "padded"]

UNKNOWN: Final = -1
WORD: Final = 8  # bytes
LONGEST: Final = 256  # bytes of a string; a longer one is never found
FIRST_PLACES: Final = 256
_FACTORS: Final = np.random.default_rng(1).integers(0, 2**64, LONGEST // WORD + 1, dtype=np.uint64) | np.uint64(1)
# The bytes of a word that belong to a string of which it holds so many.
_MASKS: Final = np.array([(1 << 8 * n) - 1 for n in range(WORD + 1)], dtype=np.uint64)

Words = NDArray[np.uint64]
Rows = NDArray[np.int64]


class KnownParts:
    """Strings by place."""

    def __init__(self) -> None:
        self._words: Words = np.zeros((0, LONGEST // WORD), dtype=np.uint64)
        self._lengths = np.zeros(0, dtype=np.int64)
        self._hash: Words = np.zeros(0, dtype=np.uint64)
        self._order = np.zeros(0, dtype=np.int64)
        self._sorted: Words = self._hash
        self._changed = False

    def put(self, places: Sequence[int], parts: Sequence[bytes]) -> None:
        """Strings at places, instead of those that were there."""
        fits = [k for k, part in enumerate(parts) if 0 < len(part) <= LONGEST]
        if not fits:
            return
        rows = np.array([places[k] for k in fits])
        self._reserve(int(rows.max()) + 1)
        joined = b"".join(parts[k].ljust(LONGEST, b"\0") for k in fits)
        self._words[rows] = np.frombuffer(joined, dtype=np.uint64).reshape(len(fits), -1)
        self._lengths[rows] = [len(parts[k]) for k in fits]
        self._hash[rows] = _hashes(self._words[rows], self._lengths[rows])
        self._changed = True

    def forget(self, place: int) -> None:
        """Find the string at a place no more."""
        if place < len(self._lengths):
            self._lengths[place] = 0

    def __contains__(self, part: bytes) -> bool:
        rows = np.frombuffer(part.ljust(LONGEST, b"\0")[:LONGEST], dtype=np.uint64).reshape(1, -1)
        return bool(self.find(rows, np.array([len(part)]))[0] != UNKNOWN)

    def find(self, words: Words, lengths: Rows) -> Rows:
        """The places of strings.

        Parameters
        ----------
        words : (n, w) uint64
            The strings, see ``padded``.
        lengths : (n,) int64
            Of the strings. [bytes]

        Returns
        -------
        (n,) int64
            ``UNKNOWN`` where there is none.
        """
        if self._changed:
            used = np.flatnonzero(self._lengths)
            self._order = used[np.argsort(self._hash[used])]
            self._sorted, self._changed = self._hash[self._order], False
        if not len(self._order):
            return np.full(len(words), UNKNOWN)
        width = words.shape[1]
        hashes = _hashes(words, lengths)
        places = self._order[np.minimum(np.searchsorted(self._sorted, hashes), len(self._order) - 1)]
        same = (self._lengths[places] == lengths) & (self._words[places, :width] == words).all(axis=1)
        return np.where(same, places, UNKNOWN)

    def _reserve(self, capacity: int) -> None:
        before = len(self._lengths)
        if capacity > before:
            more = max(capacity, 2 * before, FIRST_PLACES) - before
            self._words = np.concatenate([self._words, np.zeros((more, LONGEST // WORD), dtype=np.uint64)])
            self._lengths = np.concatenate([self._lengths, np.zeros(more, dtype=np.int64)])
            self._hash = np.concatenate([self._hash, np.zeros(more, dtype=np.uint64)])


def padded(data: bytes, begins: Rows, lengths: Rows) -> Words:
    """Strings out of one buffer, filled up with zeros to whole words.

    Parameters
    ----------
    data : bytes
        Goes on for ``LONGEST`` bytes behind the last string.
    begins, lengths : (n,) int64
        Where the strings begin, and their lengths; beyond ``LONGEST`` they are cut. [bytes]

    Returns
    -------
    (n, w) uint64
        As wide as the longest of them.
    """
    longest = min(int(lengths.max(initial=1)), LONGEST)
    width = -(-longest // WORD)
    words = windows(data, begins, WORD * width).view(np.uint64).reshape(len(begins), width)
    there = np.clip(lengths[:, None] - WORD * np.arange(width), 0, WORD)
    masked: Words = words & _MASKS[there]
    return masked


def _hashes(words: Words, lengths: Rows) -> Words:
    """A 64-bit hash of each string: its words and length, each times a factor, added up; zeros behind add nothing."""
    made: Words = words @ _FACTORS[: words.shape[1]] + lengths.astype(np.uint64) * _FACTORS[-1]
    return made


def windows(data: bytes, begins: Rows, size: int) -> NDArray[Any]:
    """Copies of ``size`` bytes each from where they begin, as ``(n,)`` raw items."""
    at_every_byte = np.ndarray((len(data) - size + 1,), dtype=f"V{size}", buffer=data, strides=(1,))
    taken: NDArray[Any] = at_every_byte[begins]
    return taken
