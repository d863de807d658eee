"""The numbers of many points of the feed at once: many times as fast as decoding them one by one.

A message is cut where its points begin, which the service writes in the same way for all. A point in MessagePack is a
head with the identity, a body of numbers, and a tail with status, sources and flags. Heads and tails repeat from second
to second, so each is decoded once and then found by its bytes. In a body every number has the same place as in all
bodies with the same fields, so a layout learned from one of them reads thousands as columns of one array. Whatever does
not look like that is left to ``live_points``, which reads anything the contract allows; what both give is the same
(``tests/unit/test_web_points.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein_service.messages import FUSED_FIELDS
from aeroskein_service.web.known_parts import UNKNOWN, KnownParts

__all__ = ["BODY", "NUMBERS", "START", "TAIL", "QuickReader", "Sorted", "cut"]

# What a picture needs, in order; a covariance has three.
NUMBERS: Final = (
    "time_s", "lat_deg", "lon_deg", "altitude_m", "ground_speed_mps", "track_angle_deg", "vertical_rate_mps",
    "input_received_s", "position_cov_m2",
)  # fmt: skip
COLUMNS: Final = len(NUMBERS) + 2
# How a point begins that has every field but ``renamed_to``: a map of so many, its version and product.
START: Final = b"\xde" + (len(FUSED_FIELDS) - 1).to_bytes(2, "big") + b"\xa7version\x01\xa7product"
# The first fields of the body and of the tail, as MessagePack strings.
BODY: Final = b"\xa3seq"
TAIL: Final = b"\xa6status"
_SIZES: Final = {0xCB: 8, 0xCF: 8, 0xCE: 4}  # float64, uint64, uint32: numbers of fixed size
_FLOAT, _NULL, _ARRAY = 0xCB, 0xC0, 0x90
_FEW: Final = 4  # points of one length that are not worth columns
_LAYOUTS: Final = 64  # layouts remembered; there are as many as patterns of absent fields


class _Head(msgspec.Struct, gc=False):
    epoch: int


_HEADS: Final = msgspec.msgpack.Decoder(_Head)
_NO_POINTS: Final = b"\x90"


def cut(payload: bytes) -> tuple[int, list[bytes]] | None:
    """Epoch and points of a message of the feed, each without ``START``; None where it is built in another way."""
    head, *points = payload.split(START)
    n = len(points)
    count = b"\xdc" + min(n, 0xFFFF).to_bytes(2, "big")
    if not n or not head.endswith(count):
        return None
    try:
        return _HEADS.decode(head.removesuffix(count) + _NO_POINTS).epoch, points
    except msgspec.MsgspecError:
        return None


class _Layout(NamedTuple):
    """Where the numbers stand in bodies of one kind."""

    template: NDArray[np.uint8]
    fixed: NDArray[np.int64]
    dtype: np.dtype[Any]
    places: tuple[tuple[int, str], ...]

    def fits(self, bodies: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Which bodies have every byte between the numbers as the template has it."""
        same: NDArray[np.bool_] = (bodies[:, self.fixed] == self.template[self.fixed]).all(axis=1)
        return same

    def read(self, bodies: NDArray[np.uint8]) -> NDArray[np.float64]:
        """The numbers of all bodies, ``(COLUMNS, n)``; NaN where a field is null."""
        made = np.full((COLUMNS, len(bodies)), np.nan)
        rows = np.ascontiguousarray(bodies).view(self.dtype)[:, 0]
        for column, name in self.places:
            made[column] = rows[name]
        return made


def _learn(body: bytes) -> _Layout | None:
    """The layout of bodies like this one; None where it holds anything but numbers of fixed size."""
    fixed = np.ones(len(body), dtype=np.bool_)
    names: list[str] = []
    offsets: list[int] = []
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
        column = NUMBERS.index(field) if field in NUMBERS else None
        for index in range(count):
            if at < len(body) and body[at] == _NULL:
                at += 1
                continue
            size = _SIZES.get(body[at]) if at < len(body) else None
            if size is None or at + 1 + size > len(body):
                return None
            if column is not None:
                if body[at] != _FLOAT or column + index >= COLUMNS:
                    return None
                names.append(f"n{column + index}")
                offsets.append(at + 1)
                places.append((column + index, names[-1]))
            fixed[at + 1 : at + 1 + size] = False
            at += 1 + size
    if not names:
        return None
    dtype = np.dtype({"names": names, "formats": [">f8"] * len(names), "offsets": offsets, "itemsize": len(body)})
    return _Layout(np.frombuffer(body, dtype=np.uint8), np.flatnonzero(fixed), dtype, tuple(places))


class Sorted(NamedTuple):
    """Points as columns, in their order; ``heads`` is ``UNKNOWN`` where a point has to be read field by field."""

    heads: NDArray[np.int64]
    tails: NDArray[np.int64]
    numbers: NDArray[np.float64]


class QuickReader:
    """Reads points; remembers the layouts it has learned, and the heads and tails it has been told."""

    def __init__(self) -> None:
        self.heads = KnownParts()
        self.tails = KnownParts()
        self._layouts: dict[int, list[_Layout]] = {}
        self._count = 0

    def sort(self, points: Sequence[bytes]) -> Sorted:
        """What points are about and their numbers, in columns.

        Parameters
        ----------
        points : sequence of n bytes
            As ``cut`` gives them.

        Returns
        -------
        Sorted
            ``heads`` and ``tails`` (n,) are the numbers they were told with; ``numbers`` (COLUMNS, n) are in the order
            of ``NUMBERS``, NaN where null.
        """
        n = len(points)
        made = Sorted(np.full(n, UNKNOWN), np.full(n, UNKNOWN), np.full((COLUMNS, n), np.nan))
        lengths = np.fromiter(map(len, points), dtype=np.int64, count=n)
        for length, many in zip(*np.unique(lengths, return_counts=True), strict=True):
            if many > _FEW:
                self._sort_alike(points, np.flatnonzero(lengths == length), made)
        return made

    def _sort_alike(self, points: Sequence[bytes], rows: NDArray[np.int64], made: Sorted) -> None:
        """Points of one length; most have their parts at the same places as the first."""
        first = points[rows[0]]
        begin = first.find(BODY)
        end = first.find(TAIL, begin)
        if not 0 < begin < end:
            return
        joined = b"".join([points[row] for row in rows.tolist()])
        block = np.frombuffer(joined, dtype=np.uint8).reshape(len(rows), len(first))
        like = (block[:, begin : begin + len(BODY)] == np.frombuffer(BODY, dtype=np.uint8)).all(axis=1)
        like &= (block[:, end : end + len(TAIL)] == np.frombuffer(TAIL, dtype=np.uint8)).all(axis=1)
        heads, tails = self.heads.find(block[:, :begin]), self.tails.find(block[:, end:])
        like &= (heads != UNKNOWN) & (tails != UNKNOWN)
        known = np.zeros(len(points), dtype=np.bool_)
        self._read_alike(block[like, begin:end], rows[like], made.numbers, known)
        read = known[rows]
        made.heads[rows[read]], made.tails[rows[read]] = heads[read], tails[read]

    def _read_alike(
        self, block: NDArray[np.uint8], rows: NDArray[np.int64], numbers: NDArray[np.float64], known: NDArray[np.bool_]
    ) -> None:
        """Bodies of one length, by the layouts known for it and those still to be learned."""
        length = block.shape[1]
        for layout in self._layouts.get(length, []):
            fits = layout.fits(block)
            if fits.any():
                numbers[:, rows[fits]] = layout.read(block[fits])
                known[rows[fits]] = True
                block, rows = block[~fits], rows[~fits]
            if not len(rows):
                return
        while len(rows) and self._count < _LAYOUTS:
            learned = _learn(block[0].tobytes())
            if learned is None:
                return
            self._layouts.setdefault(length, []).append(learned)
            self._count += 1
            fits = learned.fits(block)
            numbers[:, rows[fits]] = learned.read(block[fits])
            known[rows[fits]] = True
            block, rows = block[~fits], rows[~fits]
