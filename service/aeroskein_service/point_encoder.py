"""Fused points to bytes: one row of columns becomes one map of the contract.

MessagePack gives every number a fixed place if floats are always written with nine bytes, so the numbers of all points
are laid into one array of records at once; what changes rarely, the identity in front and the status and sources
behind, comes from caches. ``benchmarks/bench_codec.py`` measures what that saves. A null changes the length, so there
is one record layout for each pattern of present fields. JSON goes through msgspec.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array
from aeroskein.points import FusedPoints, Product
from aeroskein_service.keys import track_label
from aeroskein_service.messages import (
    CONTENT_TYPES,
    FEED_POINTS,
    FLAG_NAMES,
    FUSED_FIELDS,
    JSON,
    STATUS_NAMES,
    VERSION,
    Encoding,
    FusedPoint,
)

__all__ = ["PointEncoder", "encode_feed"]

# Identities and tails remembered: two products of 20,000 tracks with room; 150 bytes each.
CACHE_ENTRIES: Final = 100_000

_pack: Final = msgspec.msgpack.Encoder().encode
_json: Final = msgspec.json.Encoder().encode

# MessagePack markers: map of up to 65,535 fields, null, float64, uint64, uint32, arrays of two and three.
_MAP16, _NULL, _FLOAT, _UINT64, _UINT32 = b"\xde", b"\xc0", b"\xcb", b"\xcf", b"\xce"
_ARRAY = {2: b"\x92", 3: b"\x93"}

# Fields with a fixed place, in order: how many numbers, and whether they may be null.
_PLACED: Final[tuple[tuple[str, str, int], ...]] = (
    ("seq", ">u8", 1),
    ("time_s", ">f8", 1),
    ("published_s", ">f8", 1),
    ("lat_deg", ">f8", 1),
    ("lon_deg", ">f8", 1),
    ("altitude_m", ">f8", 1),
    ("height_m", ">f8", 1),
    ("ground_speed_mps", ">f8", 1),
    ("track_angle_deg", ">f8", 1),
    ("vertical_rate_mps", ">f8", 1),
    ("position_cov_m2", ">f8", 3),
    ("velocity_cov_m2ps2", ">f8", 3),
    ("element", ">u8", 1),
    ("span_s", ">f8", 2),
    ("rejected", ">u4", 1),
    ("input_received_s", ">f8", 1),
)
_MARKERS: Final = {">f8": _FLOAT, ">u8": _UINT64, ">u4": _UINT32}
_NUMBERS: Final = ("lat_deg", "lon_deg", "altitude_m", "height_m", "ground_speed_mps", "track_angle_deg",
                   "vertical_rate_mps", "input_received_s")  # fmt: skip
_VECTORS: Final = ("position_cov_m2", "velocity_cov_m2ps2", "span_s")
_NULLABLE: Final = (*_NUMBERS, *_VECTORS, "element")

_IDENTITY: Final = np.dtype(
    [
        ("track_number", "<i8"),
        ("label", "<i4"),
        ("address", "<i4"),
        ("renamed_to", "<i4"),
        ("mode_a", "<i2"),
        ("callsign", "S8"),
    ]
)


class _Layout(NamedTuple):
    """Where each number stands when these fields are present."""

    dtype: np.dtype[Any]
    template: bytes
    present: tuple[tuple[str, tuple[str, ...]], ...]


@lru_cache(maxsize=256)
def _layout(absent: int) -> _Layout:
    """The record for one pattern; bit ``i`` of ``absent`` says that ``_NULLABLE[i]`` is null."""
    missing = {name for bit, name in enumerate(_NULLABLE) if absent >> bit & 1}
    template = b""
    names: list[str] = []
    formats: list[str] = []
    offsets: list[int] = []
    present = []
    for name, kind, count in _PLACED:
        template += _pack(name)
        if name in missing:
            template += _NULL
            continue
        template += _ARRAY[count] if count > 1 else b""
        places = tuple(f"{name}{index}" for index in range(count))
        for _ in places:
            template += _MARKERS[kind]
            formats.append(kind)
            offsets.append(len(template))
            template += bytes(int(kind[-1]))
        names.extend(places)
        present.append((name, places))
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": len(template)})
    return _Layout(dtype, template, tuple(present))


class _Made(dict[bytes, bytes]):
    """Encoded parts by the bytes of the record they are made from."""

    def __init__(self, make: Callable[[bytes], bytes]) -> None:
        super().__init__()
        self._make = make

    def __missing__(self, record: bytes) -> bytes:
        if len(self) >= CACHE_ENTRIES:
            self.clear()
        made = self[record] = self._make(record)
        return made

    def of(self, records: NDArray[Any]) -> list[bytes]:
        raw, size = records.tobytes(), records.dtype.itemsize
        return [self[raw[start : start + size]] for start in range(0, len(raw), size)]


class PointEncoder:
    """Encodes the fused points of one service.

    Parameters
    ----------
    sensor_ids : sequence of str
        By index.
    epoch_ms : int
        The service's start. [ms since the epoch]
    encoding : {"msgpack", "json"}
        As in the configuration.
    """

    def __init__(self, sensor_ids: Sequence[str], epoch_ms: int, encoding: Encoding = "msgpack") -> None:
        self._sensors = tuple(sensor_ids)
        self._epoch = epoch_ms
        self._encoding = encoding
        self._heads = {product: _Made(self._head_maker(product)) for product in Product}
        self._tails = _Made(self._tail)
        self._tail_dtype = np.dtype(
            [("status", "u1"), ("master", "<i2"), ("flags", "<u2"), ("sources", "<i4", (len(self._sensors),))]
        )

    @property
    def content_type(self) -> str:
        """What stands beside the payload: ``application/msgpack`` or ``application/json``."""
        return CONTENT_TYPES[self._encoding]

    def label(self, points: FusedPoints) -> list[str]:
        """The key chunk of each point's track: address in upper case, or ``T`` and the number."""
        pairs = zip(points.label.tolist(), points.track_number.tolist(), strict=True)
        return [track_label(label, number) for label, number in pairs]

    def encode(self, points: FusedPoints, published_s: float) -> list[bytes]:
        """One payload for each point, in order."""
        if len(points) == 0:
            return []
        if self._encoding == "json":
            return [_json(message) for message in self.messages(points, published_s)]
        heads = self._heads[points.product].of(_identities(points))
        tails = self._tails.of(self._tail_records(points))
        return [h + b + t for h, b, t in zip(heads, _bodies(points, published_s), tails, strict=True)]

    def messages(self, points: FusedPoints, published_s: float) -> list[FusedPoint]:
        """The points as messages, one by one: the plain form that ``encode`` gives the bytes of."""
        columns = [
            self.label(points), points.track_number.tolist(), [_address(a) for a in points.address.tolist()],
            [_callsign(c) for c in points.callsign.tolist()], [_mode_a(m) for m in points.mode_a.tolist()],
            points.seq.tolist(), points.time_s.tolist(), _nullable(points.lat_deg), _nullable(points.lon_deg),
            _nullable(points.altitude_m), _nullable(points.height_m), _nullable(points.ground_speed_mps),
            _nullable(points.track_angle_deg), _nullable(points.vertical_rate_mps), _vectors(points.position_cov_m2),
            _vectors(points.velocity_cov_m2ps2), points.status.tolist(), points.element.tolist(),
            _vectors(points.span_s), points.master.tolist(), points.sources.tolist(), points.rejected.tolist(),
            _nullable(points.input_received_s), points.flags.tolist(), points.renamed_to.tolist(),
        ]  # fmt: skip
        product = _name(points.product)
        return [
            FusedPoint(
                VERSION, product, track, number, address, callsign, mode_a, self._epoch, seq, time_s, published_s,
                lat, lon, altitude, height, speed, angle, rate, position_cov, velocity_cov, STATUS_NAMES[status],
                None if element < 0 else element, span, self._master(master), self._sources(sources), rejected,
                received, _flags(flags), msgspec.UNSET if renamed < 0 else f"{renamed:06X}",
            )
            for (
                track, number, address, callsign, mode_a, seq, time_s, lat, lon, altitude, height, speed, angle, rate,
                position_cov, velocity_cov, status, element, span, master, sources, rejected, received, flags, renamed,
            ) in zip(*columns, strict=True)
        ]  # fmt: skip

    # -- parts -------------------------------------------------------------------------------------------------------
    def _head_maker(self, product: Product) -> Callable[[bytes], bytes]:
        name = _name(product)

        def make(record: bytes) -> bytes:
            identity = np.frombuffer(record, dtype=_IDENTITY)[0]
            renamed = int(identity["renamed_to"])
            fields: dict[str, Any] = {
                "version": VERSION,
                "product": name,
                "track": track_label(int(identity["label"]), int(identity["track_number"])),
                "track_number": int(identity["track_number"]),
                "address": _address(int(identity["address"])),
                "callsign": _callsign(bytes(identity["callsign"])),
                "mode_a": _mode_a(int(identity["mode_a"])),
                "epoch": self._epoch,
            }
            if renamed >= 0:
                fields["renamed_to"] = f"{renamed:06X}"
            size = len(FUSED_FIELDS) - (renamed < 0)
            return _MAP16 + size.to_bytes(2, "big") + b"".join(_pack(k) + _pack(v) for k, v in fields.items())

        return make

    def _tail_records(self, points: FusedPoints) -> NDArray[Any]:
        records = np.empty(len(points), dtype=self._tail_dtype)
        for name in ("status", "master", "flags", "sources"):
            records[name] = getattr(points, name)
        return records

    def _tail(self, record: bytes) -> bytes:
        row = np.frombuffer(record, dtype=self._tail_dtype)[0]
        fields = {
            "status": STATUS_NAMES[int(row["status"])],
            "master": self._master(int(row["master"])),
            "sources": self._sources(row["sources"].tolist()),
            "flags": _flags(int(row["flags"])),
        }
        return b"".join(_pack(k) + _pack(v) for k, v in fields.items())

    def _master(self, index: int) -> str | None:
        return self._sensors[index] if index >= 0 else None

    def _sources(self, counts: list[int]) -> dict[str, int]:
        return {sensor: many for sensor, many in zip(self._sensors, counts, strict=True) if many > 0}


def encode_feed(payloads: Sequence[bytes], content_type: str, *, epoch: int, seq: int) -> bytes:
    """Encoded points as one feed message; raises ``ValueError`` for more than ``FEED_POINTS``."""
    if len(payloads) > FEED_POINTS:
        raise ValueError(f"{len(payloads)} points, a feed message takes {FEED_POINTS}")
    if content_type == JSON:
        return b'{"version":%d,"epoch":%d,"seq":%d,"points":[%b]}' % (VERSION, epoch, seq, b",".join(payloads))
    head = _pack({"version": VERSION, "epoch": epoch, "seq": seq})
    # One field more than the head says, and an array header with a 16-bit length.
    return b"".join(
        (bytes([head[0] + 1]), head[1:], _pack("points"), b"\xdc", len(payloads).to_bytes(2, "big"), *payloads)
    )


def _identities(points: FusedPoints) -> NDArray[Any]:
    records = np.empty(len(points), dtype=_IDENTITY)
    for name in _IDENTITY.names or ():
        records[name] = getattr(points, name)
    return records


def _bodies(points: FusedPoints, published_s: float) -> list[bytes]:
    """The numbers of each point, laid out by what is present."""
    absent = _absent(points)
    first = int(absent[0])
    if (absent == first).all():
        return _filled(_layout(first), points, published_s, slice(None), len(points))
    made: list[bytes] = [b""] * len(points)
    for pattern in np.unique(absent).tolist():
        rows = np.flatnonzero(absent == pattern)
        bodies = _filled(_layout(pattern), points, published_s, rows, len(rows))
        for row, body in zip(rows.tolist(), bodies, strict=True):
            made[row] = body
    return made


def _absent(points: FusedPoints) -> NDArray[np.uint16]:
    """Bits of ``_NULLABLE`` fields that are null, one number a point."""
    n = len(points)
    known = np.zeros((16, n), dtype=np.bool_)
    for row, name in enumerate(_NUMBERS):
        np.isfinite(getattr(points, name), out=known[row])
    for row, name in enumerate(_VECTORS, len(_NUMBERS)):
        np.isfinite(getattr(points, name)).all(axis=1, out=known[row])
    np.greater_equal(points.element, 0, out=known[len(_NULLABLE) - 1])
    known[len(_NULLABLE) :] = True
    bits = np.packbits(known, axis=0, bitorder="little")  # (2, n)
    return ~np.ascontiguousarray(bits.T).view("<u2")[:, 0]


def _filled(layout: _Layout, points: FusedPoints, published_s: float, rows: Any, n: int) -> list[bytes]:
    """The records of the given rows (an index array or a slice), ``n`` of them."""
    records = np.frombuffer(bytearray(layout.template * n), dtype=layout.dtype)
    for name, places in layout.present:
        if name == "published_s":
            records[places[0]] = published_s
            continue
        column = getattr(points, name)[rows]
        if len(places) == 1:
            records[places[0]] = column
        else:
            for index, place in enumerate(places):
                records[place] = column[:, index]
    raw, size = records.tobytes(), layout.dtype.itemsize
    return [raw[start : start + size] for start in range(0, n * size, size)]


def _name(product: Product) -> Literal["live", "element"]:
    return "live" if product == Product.LIVE else "element"


def _address(address: int) -> str | None:
    return f"{address:06X}" if address >= 0 else None


def _callsign(callsign: bytes) -> str | None:
    return callsign.decode("ascii", "replace") or None


def _mode_a(mode_a: int) -> str | None:
    return f"{mode_a:04o}" if mode_a >= 0 else None


@lru_cache(maxsize=1 << len(FLAG_NAMES))
def _flag_tuple(flags: int) -> tuple[str, ...]:
    return tuple(name for bit, name in enumerate(FLAG_NAMES) if flags >> bit & 1)


def _flags(flags: int) -> list[str]:
    return list(_flag_tuple(flags))


def _nullable(column: Array) -> list[float | None]:
    known: Any = np.isfinite(column).tolist()
    return [value if there else None for value, there in zip(column.tolist(), known, strict=True)]


def _vectors(rows: Array) -> list[Any]:
    known: Any = np.isfinite(rows).all(axis=1)
    return [tuple(row) if there else None for row, there in zip(rows.tolist(), known.tolist(), strict=True)]
