"""The numbers of many points of the feed at once: many times as fast as decoding them one by one.

The service writes all points in the same way. In MessagePack a point is a head with the identity, a body of numbers,
and a tail with status, sources and flags. Heads and tails repeat from second to second, so each is decoded once and
then found by its bytes. In a body every number has the same place as in all bodies with the same fields, so a layout
learned from one of them reads thousands as columns of one array. All messages that wait are read in one pass, in which
no point is an object. Whatever does not look like that is left to the owner of the reader, who decodes it field by
field and may take anything the contract allows; what both give is the same (``tests/unit/test_web_points.py``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein_service.messages import FUSED_FIELDS
from aeroskein_service.web.known_parts import LONGEST, UNKNOWN, WORD, KnownParts, Rows, Words, padded, windows

__all__ = ["BODY", "START", "TAIL", "QuickReader", "Read"]

# How a point begins that has every field but ``renamed_to``: a map of so many, its version and product.
START: Final = b"\xde" + (len(FUSED_FIELDS) - 1).to_bytes(2, "big") + b"\xa7version\x01\xa7product"
# The rest of the head: its fields, behind whose names a value of one of the sizes below stands.
IDENTITY: Final = ("track", "track_number", "address", "callsign", "mode_a", "epoch")
# The first fields of the body and of the tail, as MessagePack strings.
BODY: Final = b"\xa3seq"
TAIL: Final = b"\xa6status"
VECTOR: Final = "position_cov_m2"  # the number that has three columns
_FORMATS: Final = {0xCB: ">f8", 0xCF: ">u8", 0xCE: ">u4"}  # numbers of fixed size
_NULL, _ARRAY = 0xC0, 0x90
_CACHED: Final = 20_000  # different tails remembered
_LAYOUTS: Final = 64  # layouts remembered; there are as many as patterns of absent fields
_LONGEST_BODY: Final = 512
LIKELY: Final = 6  # bytes of ``START`` that stand nowhere else but by a rare chance, which costs time only
_PADDING: Final = bytes(_LONGEST_BODY + 2 * LONGEST)  # a head and a body may be looked for behind the last point


def _value_sizes() -> NDArray[np.int64]:
    """Bytes of a value by its first byte: strings below 32 bytes, integers that are not negative, null."""
    sizes = np.ones(256, dtype=np.int64)
    sizes[0xA0:0xC0] = np.arange(1, 33)
    sizes[0xCC:0xD0] = (2, 3, 5, 9)
    return sizes


_SIZES: Final = _value_sizes()


class _Head(msgspec.Struct, gc=False):
    epoch: int


_HEADS: Final = msgspec.msgpack.Decoder(_Head)
_NO_POINTS: Final = b"\x90"


class _Layout(NamedTuple):
    """Where the numbers stand in bodies of one kind."""

    size: int
    mask: Words  # ones where a body of this kind is like all others
    template: Words
    dtype: np.dtype[Any]
    places: tuple[tuple[int, str], ...]

    def rows(self, data: bytes, begins: Rows) -> tuple[NDArray[np.bool_], NDArray[Any]]:
        """Which bytes from where they begin are such a body, and those as records."""
        bodies = windows(data, begins, self.dtype.itemsize)
        words = bodies.view(np.uint64).reshape(len(begins), -1)
        fits: NDArray[np.bool_] = ((words & self.mask) == self.template).all(axis=1)
        return fits, (bodies if fits.all() else bodies[fits]).view(self.dtype)


def _learn(body: bytes, names: Sequence[str]) -> _Layout | None:
    """The layout of bodies like this one; None where it holds anything but numbers of fixed size."""
    size = -(-len(body) // WORD) * WORD
    mask = np.zeros(size, dtype=np.uint8)
    mask[: len(body)] = 0xFF
    offsets: list[int] = []
    formats: list[str] = []
    places: list[tuple[int, str]] = []
    at = 0
    while at < len(body):
        if body[at] & 0xE0 != 0xA0:
            return None
        end = at + 1 + (body[at] & 0x1F)
        field, at = body[at + 1 : end].decode("ascii", "replace"), end
        count = 1
        if at < len(body) and body[at] & 0xF0 == _ARRAY:
            count, at = body[at] & 0x0F, at + 1
        column = names.index(field) if field in names else None
        if column is not None and count > (3 if field == VECTOR else 1):
            return None
        for index in range(count):
            if at < len(body) and body[at] == _NULL:
                at += 1
                continue
            form = _FORMATS.get(body[at]) if at < len(body) else None
            if form is None or at + 1 + int(form[-1]) > len(body):
                return None
            if column is not None:
                places.append((column + index, f"n{column + index}"))
                offsets.append(at + 1)
                formats.append(form)
            mask[at + 1 : at + 1 + int(form[-1])] = 0
            at += 1 + int(form[-1])
    if not places or len(body) > _LONGEST_BODY or len(dict(places)) < len(places):
        return None
    dtype = np.dtype({"names": [name for _, name in places], "formats": formats, "offsets": offsets, "itemsize": size})
    template = np.frombuffer(body.ljust(size, b"\0"), dtype=np.uint64) & mask.view(np.uint64)
    return _Layout(len(body), mask.view(np.uint64), template, dtype, tuple(places))


class Read:
    """Points as columns, in their order.

    Attributes
    ----------
    epochs : dict of int to int
        Epochs of the messages that could be cut into points, by index of the payload.
    left : list of int
        The payloads that are built in another way.
    message : (n,) int64
        Which payload each point came in.
    places : (n,) int64
        What its head stands for; ``UNKNOWN`` where it has to be read field by field, until ``fill``.
    tails : (n, k) int64
        What its tail says.
    numbers : (columns, n) float64
        In the order of the reader's names; NaN where null.
    """

    def __init__(self, data: bytes, payloads: Sequence[bytes]) -> None:
        begins = _starts(data)
        ends = np.cumsum([len(payload) for payload in payloads], dtype=np.int64)
        message = np.searchsorted(ends, begins, side="right")
        self.epochs, self.left = _opened(data, begins, message, ends)
        if self.left:
            kept = ~np.isin(message, self.left)
            begins, message = begins[kept], message[kept]
        self.message = message
        self.places = np.full(len(begins), UNKNOWN)
        self.tails: Rows = np.zeros((len(begins), 0), dtype=np.int64)
        self.numbers: NDArray[np.float64] = np.zeros((0, len(begins)))
        self._data = data
        # A point ends where the next one of its message begins.
        self.begins, self.ends = begins, np.minimum(np.append(begins[1:], len(data))[: len(begins)], ends[message])
        self.bodies = _behind_head(data, begins)
        self.tails_at = np.full(len(begins), -1)

    def __len__(self) -> int:
        return len(self.message)

    def unknown(self) -> list[int]:
        """The points that have to be read field by field."""
        rows: list[int] = np.flatnonzero(self.places == UNKNOWN).tolist()
        return rows

    def point(self, row: int) -> bytes:
        """All bytes of a point."""
        return self._data[self.begins[row] : self.ends[row]]

    def head(self, row: int) -> bytes:
        """The bytes of its head."""
        return self._data[self.begins[row] : self.bodies[row]]

    def tail(self, row: int) -> bytes:
        """The bytes of its tail."""
        return self._data[self.tails_at[row] : self.ends[row]]

    def fill(self, row: int, place: int, tail: tuple[int, ...], numbers: tuple[Any, ...]) -> None:
        """What reading a point field by field has found, which ``QuickReader.learn`` then remembers."""
        self.places[row], self.tails[row], self.numbers[:, row] = place, tail, numbers


class QuickReader:
    """Reads the points of one product; remembers layouts, and what heads and tails stand for.

    Parameters
    ----------
    names : sequence of str
        The numbers that are wanted, ``position_cov_m2`` last, which has three columns.
    tail : int
        How many numbers stand for a tail.
    """

    def __init__(self, names: Sequence[str], tail: int) -> None:
        assert names[-1] == VECTOR
        self._names = tuple(names)
        self._layouts: list[_Layout] = []
        self._heads = KnownParts()
        self._tails = KnownParts()
        self._said: Rows = np.full((1, tail), UNKNOWN)  # by place; the first row stands for what is not known

    def read(self, payloads: Sequence[bytes]) -> Read:
        """What points are about and their numbers, in columns; ``Read.unknown`` are to be filled, then ``learn``."""
        data = b"".join((*payloads, _PADDING))
        read = Read(data, payloads)
        read.numbers, read.tails_at = self._bodies(data, read.bodies, read.ends)
        read.tails = np.repeat(self._said[:1], len(read), axis=0)
        rows = np.flatnonzero(read.tails_at >= 0)
        heads = _found(self._heads, data, read.begins[rows], read.bodies[rows])
        tails = _found(self._tails, data, read.tails_at[rows], read.ends[rows])
        known = (heads != UNKNOWN) & (tails != UNKNOWN)
        read.places[rows[known]] = heads[known]
        read.tails[rows[known]] = self._said[tails[known]]
        return read

    def learn(self, read: Read, rows: Iterable[int]) -> None:
        """Remember the heads and tails of points that have been filled."""
        heads: dict[int, bytes] = {}
        tails: dict[bytes, int] = {}
        for row in rows:
            if read.tails_at[row] >= 0 and read.places[row] != UNKNOWN:
                heads[int(read.places[row])] = read.head(row)
                tails[read.tail(row)] = row
        self._heads.put(list(heads), list(heads.values()))
        self._learn_tails({part: read.tails[row] for part, row in tails.items() if len(part) <= LONGEST})

    def _learn_tails(self, tails: dict[bytes, Rows]) -> None:
        tails = {part: said for part, said in tails.items() if part not in self._tails}
        if not tails:
            return
        if len(self._said) + len(tails) > _CACHED:
            self._tails, self._said = KnownParts(), self._said[:1]
        first = len(self._said)
        self._said = np.concatenate([self._said, np.array(list(tails.values()))])
        self._tails.put(range(first, len(self._said)), list(tails))

    def forget(self, place: int) -> None:
        """Forget the head that stands for a place."""
        self._heads.forget(place)

    def _bodies(self, data: bytes, begins: Rows, ends: Rows) -> tuple[NDArray[np.float64], Rows]:
        """The numbers of bodies, and where their tails begin; -1 where a layout is unknown."""
        numbers = np.full((len(self._names) + 2, len(begins)), np.nan)
        tails = np.full(len(begins), -1)
        rows = np.arange(len(begins))
        tried = 0
        while len(rows):
            if tried == len(self._layouts):
                first = int(rows[0])
                learned = self._learned(data[int(begins[first]) : int(ends[first])])
                if learned is None:
                    # Odd ones are read field by field; one of them a second may teach a layout to come.
                    break
                self._layouts.append(learned)
            layout = self._layouts[tried]
            fits, records = layout.rows(data, begins[rows])
            found: Any = slice(None) if fits.all() and len(rows) == len(begins) else rows[fits]
            for column, name in layout.places:
                numbers[column, found] = records[name]
            tails[found] = begins[found] + layout.size
            rows = rows[~fits]
            tried += 1
        return numbers, tails

    def _learned(self, rest: bytes) -> _Layout | None:
        size = rest.find(TAIL)
        if len(self._layouts) >= _LAYOUTS or not rest.startswith(BODY) or size < 0:
            return None
        return _learn(rest[:size], self._names)


def _starts(data: bytes) -> Rows:
    """Where ``START`` may stand: what else begins like it is refused with the head that it belongs to."""
    array = np.frombuffer(data, dtype=np.uint8)
    found = np.flatnonzero(array[: -len(_PADDING)] == START[0])
    for k in range(1, LIKELY):
        found = found[array[found + k] == START[k]]
    return found


def _behind_head(data: bytes, begins: Rows) -> Rows:
    """Where heads end, as far as they are any."""
    array = np.frombuffer(data, dtype=np.uint8)
    at = begins + len(START)
    for name in IDENTITY:
        at = at + _SIZES[array[at]] + (1 + len(name))
    return at + _SIZES[array[at]]


def _found(parts: KnownParts, data: bytes, begins: Rows, ends: Rows) -> Rows:
    lengths = ends - begins
    return parts.find(padded(data, begins, lengths), lengths)


def _opened(data: bytes, begins: Rows, message: Rows, ends_of: Rows) -> tuple[dict[int, int], list[int]]:
    """Epochs of messages, and those that are no list of so many points as have been found in them."""
    counts = np.bincount(message, minlength=len(ends_of)).tolist()
    firsts = np.append(begins, len(data))[np.searchsorted(message, np.arange(len(ends_of)))]
    epochs: dict[int, int] = {}
    left: list[int] = []
    begin = 0
    for k, (count, first, end) in enumerate(zip(counts, firsts.tolist(), ends_of.tolist(), strict=True)):
        head, many = data[begin:first], b"\xdc" + min(count, 0xFFFF).to_bytes(2, "big")
        begin = end
        if count and head.endswith(many):
            try:
                epochs[k] = _HEADS.decode(head.removesuffix(many) + _NO_POINTS).epoch
                continue
            except msgspec.MsgspecError:
                pass
        left.append(k)
    return epochs, left
