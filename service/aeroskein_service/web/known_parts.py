"""Byte strings to numbers, thousands at once: the parts of points that repeat from second to second.

Strings of one length are a matrix of bytes. A row is found by a 64-bit hash of it among the sorted hashes of those that
are known, and then compared byte by byte, so a collision of hashes finds nothing wrong.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["UNKNOWN", "KnownParts"]

UNKNOWN: Final = -1
LONGEST: Final = 512  # bytes of a string; a longer one is never found
# What is new is sorted in when it is a tenth of what there is, or after so many searches: sorting costs as much as one.
SEARCHES: Final = 8
_FACTORS: Final = np.random.default_rng(1).integers(0, 2**64, LONGEST // 8, dtype=np.uint64) | np.uint64(1)
Bytes = NDArray[np.uint8]


class _Alike:
    """The strings of one length."""

    def __init__(self, length: int) -> None:
        self.numbers: dict[bytes, int] = {}
        self._length = length
        self._new = 0
        self._searches = 0
        self._sort()

    def _sort(self) -> None:
        rows = np.frombuffer(b"".join(self.numbers), dtype=np.uint8).reshape(len(self.numbers), self._length)
        hashes = _hashes(rows)
        order = np.argsort(hashes)
        self._hashes, self._rows = hashes[order], rows[order]
        self._values = np.fromiter(self.numbers.values(), dtype=np.int64, count=len(self.numbers))[order]
        self._new = self._searches = 0

    def add(self, part: bytes, number: int) -> None:
        self.numbers[part] = number
        self._new += 1

    def remove(self, part: bytes) -> None:
        if self.numbers.pop(part, None) is not None:
            self._new = len(self.numbers) + 1

    def find(self, rows: Bytes) -> NDArray[np.int64]:
        self._searches += 1
        if self._new and (self._searches >= SEARCHES or 10 * self._new > len(self.numbers)):
            self._sort()
        if not len(self._values):
            return np.full(len(rows), UNKNOWN, dtype=np.int64)
        hashes = _hashes(rows)
        place = np.minimum(np.searchsorted(self._hashes, hashes), len(self._hashes) - 1)
        same = self._hashes[place] == hashes
        same[same] = (self._rows[place[same]] == rows[same]).all(axis=1)
        return np.where(same, self._values[place], UNKNOWN)


class KnownParts:
    """Strings with a number each."""

    def __init__(self) -> None:
        self._alike: dict[int, _Alike] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, part: bytes, number: int) -> None:
        """Remember one, or give one another number from the next sorting on."""
        if 0 < len(part) <= LONGEST:
            alike = self._alike.get(len(part))
            if alike is None:
                alike = self._alike[len(part)] = _Alike(len(part))
            self._count += part not in alike.numbers
            alike.add(part, number)

    def remove(self, part: bytes) -> None:
        """Forget one, at once."""
        alike = self._alike.get(len(part))
        if alike is not None and part in alike.numbers:
            alike.remove(part)
            self._count -= 1

    def find(self, rows: Bytes) -> NDArray[np.int64]:
        """The numbers of strings.

        Parameters
        ----------
        rows : (n, length) uint8
            Strings of one length.

        Returns
        -------
        (n,) int64
            ``UNKNOWN`` where there is none, or not yet.
        """
        alike = self._alike.get(rows.shape[1])
        return np.full(len(rows), UNKNOWN, dtype=np.int64) if alike is None else alike.find(rows)


def _hashes(rows: Bytes) -> NDArray[np.uint64]:
    """A 64-bit hash of each row: its words, each times a factor of its own, added up."""
    words = -(-rows.shape[1] // 8)
    padded = np.zeros((len(rows), 8 * words), dtype=np.uint8)
    padded[:, : rows.shape[1]] = rows
    made: NDArray[np.uint64] = (padded.view("<u8") * _FACTORS[:words]).sum(axis=1, dtype=np.uint64)
    return made
