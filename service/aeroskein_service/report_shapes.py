"""Report batches whose reports all have one shape become columns without a Python object for each report.

A sensor's program packs its reports the same way every time: the same fields in the same order, numbers of the same
size. Then every byte that is no value is equal in all of them, and the values stand in fixed places, so a batch is a
matrix of bytes and a field is some columns of it. The shape is learned from the first report that has it and checked
against every byte of every other; what does not fit is left to the typed decoder, which knows all of MessagePack.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aeroskein.cleaning import BAD_ADDRESS_MARK
from aeroskein.plots import Ints, Plots
from aeroskein_service.report_columns import FLAGS, NUMBERS, QUALITIES, Texts, parse_callsign, parse_mode_a

__all__ = ["Rows", "Shape", "plots_of", "rows_of"]

# Shapes remembered, for all sensors together; a sensor has a few.
SHAPES: Final = 256

Bytes = NDArray[np.uint8]

# MessagePack's numbers with a fixed size: type of the value and its bytes.
_SIZED: Final = {0xCA: (">f4", 4), 0xCB: (">f8", 8), 0xCC: ("u1", 1), 0xCD: (">u2", 2), 0xCE: (">u4", 4)}
_NULL: Final = 0xC0
_FALSE: Final = 0xC2
_KINDS: Final = (
    dict.fromkeys(NUMBERS, "fui")
    | dict.fromkeys(QUALITIES, "i")
    | dict.fromkeys((name for name, _ in FLAGS), "b")
    | {"address": "S", "callsign": "S", "mode_a": "S", "local_track": "ui"}
)
_CALLSIGNS: Final[Texts[bytes, bytes]] = Texts(lambda text: parse_callsign(text.decode("ascii")), b"")
_MODES_A: Final[Texts[bytes, int]] = Texts(lambda text: parse_mode_a(text.decode("ascii")), -1)
_NIBBLES: Final = np.full(256, 255, dtype=np.uint8)
for _digit in range(16):
    _NIBBLES[[ord(f"{_digit:x}"), ord(f"{_digit:X}")]] = _digit


class Shape(NamedTuple):
    """One way to pack a report.

    Attributes
    ----------
    fixed, mask : (size,) uint8
        What every report of this shape has, and which bits of it that goes for.
    doubles : tuple of str
        The number fields that are float64, as almost all are: they are read together.
    places : (len(doubles) * 8,) int64
        Where their bytes stand.
    fields : dict
        Where the value of each other field stands, and its type.
    """

    fixed: Bytes
    mask: Bytes
    doubles: tuple[str, ...]
    places: Ints
    fields: dict[str, tuple[int, str]]


class Rows(NamedTuple):
    """The reports of one batch: a shape, and a row of bytes for each report."""

    shape: Shape
    matrix: Bytes


_KNOWN: Final[dict[int, list[Shape]]] = {}


def rows_of(reports: bytes) -> Rows | None:
    """A packed list of reports as rows of one shape; None where they have none.

    Parameters
    ----------
    reports : bytes
        The MessagePack array, whole.
    """
    many, at = _array_header(reports)
    if many == 0 or (len(reports) - at) % many:
        return None
    matrix = np.frombuffer(reports, dtype=np.uint8, offset=at).reshape(many, -1)
    known = _KNOWN.setdefault(matrix.shape[1], [])
    for shape in known:
        if _fits(matrix, shape):
            return Rows(shape, matrix)
    learned = _shape_of(matrix[0].tobytes())
    if learned is None or not _fits(matrix, learned):
        return None
    if sum(map(len, _KNOWN.values())) >= SHAPES:
        _KNOWN.clear()
    _KNOWN.setdefault(matrix.shape[1], []).append(learned)
    return Rows(learned, matrix)


def _array_header(packed: bytes) -> tuple[int, int]:
    """How many items, and where the first one begins; none where it is no array."""
    first = packed[0] if packed else 0
    if 0x90 <= first <= 0x9F:
        return first & 15, 1
    if first == 0xDC:
        return int.from_bytes(packed[1:3], "big"), 3
    return 0, 1


def _fits(matrix: Bytes, shape: Shape) -> bool:
    return not ((matrix ^ shape.fixed) & shape.mask).any()


def _shape_of(report: bytes) -> Shape | None:
    """The shape of one report; None where a value has no fixed place, or a known field another kind of value."""
    first = report[0]
    if 0x80 <= first <= 0x8F:
        many, at = first & 15, 1
    elif first == 0xDE:
        many, at = int.from_bytes(report[1:3], "big"), 3
    else:
        return None
    mask = bytearray(b"\xff" * len(report))
    fields: dict[str, tuple[int, str]] = {}
    for _ in range(many):
        if at >= len(report) or not 0xA0 <= report[at] <= 0xBF:
            return None
        length = report[at] & 31
        name, at = report[at + 1 : at + 1 + length].decode("ascii", "replace"), at + 1 + length
        place = _value(report, at, mask)
        if place is None:
            return None
        at, kind = place.end, place.kind
        if kind and name in _KINDS:
            if kind.lstrip(">")[0] not in _KINDS[name]:
                return None
            fields[name] = place.start, kind
        elif name in _KINDS:
            fields.pop(name, None)
    if at != len(report):
        return None
    doubles = {name: fields.pop(name)[0] for name in NUMBERS if fields.get(name, (0, ""))[1] == ">f8"}
    places = (np.array(list(doubles.values()), dtype=np.int64)[:, None] + np.arange(8)).ravel()
    fixed, may = np.frombuffer(report, dtype=np.uint8), np.frombuffer(bytes(mask), dtype=np.uint8)
    return Shape(fixed, may, tuple(doubles), places, fields)


class _Place(NamedTuple):
    """Where a value stands; a null has no kind."""

    start: int
    end: int
    kind: str


def _value(report: bytes, at: int, mask: bytearray) -> _Place | None:
    """The value at a place; clears the bits of it that may differ. None where it has no fixed size."""
    code = report[at] if at < len(report) else 0xC1
    if code in _SIZED:
        kind, size = _SIZED[code]
        mask[at + 1 : at + 1 + size] = bytes(size)
        return _Place(at + 1, at + 1 + size, kind)
    if code <= 0x7F:
        mask[at] = 0x80
        return _Place(at, at + 1, "i1")
    size = code & 31
    # ASCII only: anything else is for the typed decoder to judge.
    if 0xA0 < code <= 0xBF and report[at + 1 : at + 1 + size].isascii():
        mask[at + 1 : at + 1 + size] = b"\x80" * size
        return _Place(at + 1, at + 1 + size, f"S{size}")
    if code in (_FALSE, _FALSE + 1):
        mask[at] = 0xFE
        return _Place(at, at + 1, "b")
    return _Place(at, at + 1, "") if code == _NULL else None


def plots_of(shape: Shape, matrix: Bytes) -> tuple[Plots, NDArray[np.bool_] | None, NDArray[np.bool_] | None]:
    """Columns of rows of one shape, unchecked; and whose callsign and Mode A code were dropped, None where nobody's.

    A number that was sent as NaN becomes infinite, which no check accepts.
    """
    n = len(matrix)
    numbers = matrix.take(shape.places, axis=1).view(">f8").T.astype(np.float64, order="C")
    if np.isnan(numbers).any():
        numbers[np.isnan(numbers)] = np.inf
    columns: dict[str, Any] = dict(zip(shape.doubles, numbers, strict=True))
    bad_callsign = bad_mode_a = None
    flags = np.zeros(n, dtype=np.uint8)
    bits = dict(FLAGS)
    for name, (start, kind) in shape.fields.items():
        if kind == "b":
            flags |= (matrix[:, start] & 1) * np.uint8(bits[name])
        elif name == "address":
            columns[name] = _addresses(matrix[:, start : start + int(kind[1:])])
        elif kind[0] == "S":
            texts = np.ascontiguousarray(matrix[:, start : start + int(kind[1:])]).tobytes()
            size = int(kind[1:])
            cut = [texts[at : at + size] for at in range(0, len(texts), size)]
            if name == "callsign":
                columns[name], bad_callsign = _CALLSIGNS.of(cut, b"")
            else:
                columns[name], bad_mode_a = _MODES_A.of(cut, -1)
        else:
            size = np.dtype(kind).itemsize
            values = np.ascontiguousarray(matrix[:, start : start + size]).view(kind)[:, 0]
            if name in NUMBERS:
                values = values.astype(np.float64)
                values[np.isnan(values)] = np.inf
            columns[name] = values
    return Plots.of(n, flags=flags, **columns), bad_callsign, bad_mode_a


def _addresses(digits: Bytes) -> NDArray[np.int32]:
    """24-bit addresses of ``(n, 6)`` hex digits; the mark for bad ones where they are something else."""
    if digits.shape[1] != 6:
        return np.full(len(digits), BAD_ADDRESS_MARK, dtype=np.int32)
    nibbles = _NIBBLES[digits]
    made = nibbles.astype(np.int32) @ (1 << np.arange(20, -1, -4, dtype=np.int32))
    return np.where((nibbles == 255).any(axis=1), BAD_ADDRESS_MARK, made).astype(np.int32)
