"""Fused and truth files to the columns that are judged."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from aeroskein.evaluation import PointColumns, Truth
from aeroskein.points import Flag, Product, Status
from aeroskein_service.evaluation.lines import FileNotes, LineReader

__all__ = ["Latitude", "Longitude", "address_number", "read_points", "read_truth"]

Latitude = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, msgspec.Meta(ge=-180.0, le=360.0)]
_ADDRESS: Final = re.compile(r"[0-9A-Fa-f]{6}")
_MODE_A: Final = re.compile(r"[0-7]{4}")
_PRODUCTS: Final = {product.name.lower(): int(product) for product in Product}
_STATUSES: Final = {status.name.lower(): int(status) for status in Status}
_FLAGS: Final = {flag.name.lower(): int(flag) for flag in Flag if flag.name}
_NAN2: Final = (np.nan, np.nan)
_NAN3: Final = (np.nan, np.nan, np.nan)


class _PointLine(msgspec.Struct, gc=False):
    """A fused point, as far as it is judged."""

    time_s: float
    lat_deg: Latitude
    lon_deg: Longitude
    product: Literal["live", "element"] = "element"
    status: Literal["tentative", "confirmed", "coasting", "terminated"] = "confirmed"
    track: str | None = None
    track_number: int | None = None
    address: str | None = None
    mode_a: str | None = None
    callsign: str | None = None
    epoch: int | None = None
    seq: int | None = None
    published_s: float | None = None
    input_received_s: float | None = None
    altitude_m: float | None = None
    height_m: float | None = None
    ground_speed_mps: float | None = None
    track_angle_deg: float | None = None
    vertical_rate_mps: float | None = None
    position_cov_m2: tuple[float, float, float] | None = None
    velocity_cov_m2ps2: tuple[float, float, float] | None = None
    element: int | None = None
    span_s: tuple[float, float] | None = None
    flags: tuple[str, ...] | None = None


class _TruthLine(msgspec.Struct, gc=False):
    """A sample of truth."""

    track: Annotated[str, msgspec.Meta(min_length=1)]
    time_s: float
    lat_deg: Latitude
    lon_deg: Longitude
    height_m: float | None = None
    altitude_m: float | None = None
    ground_speed_mps: float | None = None
    track_angle_deg: float | None = None
    vertical_rate_mps: float | None = None
    phase: str | None = None
    address: str | None = None
    callsign: str | None = None


_TRUTH_FLOATS: Final = (
    *("time_s", "lat_deg", "lon_deg", "height_m", "altitude_m"),
    *("ground_speed_mps", "track_angle_deg", "vertical_rate_mps"),
)
_FLOATS: Final = (*_TRUTH_FLOATS, "published_s", "input_received_s")


def read_points(path: Path) -> tuple[PointColumns, FileNotes]:
    """Read a fused file.

    Parameters
    ----------
    path : Path
        JSON Lines, one fused point a line, plain or gzip.

    Returns
    -------
    PointColumns, FileNotes
        The points in file order; how many lines, which of them broken. Raises ``OSError``.
    """
    reader = LineReader(path, _PointLine)
    numbers = _Numbers()
    parts = [_point_columns(rows, numbers) for rows in reader.chunks()]
    return PointColumns.concatenate(parts), reader.notes


def read_truth(path: Path) -> tuple[Truth, FileNotes]:
    """Read a truth file; as ``read_points``. Samples may come in any order."""
    reader = LineReader(path, _TruthLine)
    flights: dict[str, int] = {}
    phases: dict[str, int] = {}
    identities: dict[int, tuple[str | None, str | None]] = {}
    columns: dict[str, list[Any]] = {name: [] for name in (*_TRUTH_FLOATS, "flight", "phase")}
    for rows in reader.chunks():
        flight = [flights.setdefault(row.track, len(flights)) for row in rows]
        columns["flight"].append(np.array(flight, dtype=np.int32))
        phase = [-1 if row.phase is None else phases.setdefault(row.phase, len(phases)) for row in rows]
        columns["phase"].append(np.array(phase, dtype=np.int16))
        for name in _TRUTH_FLOATS:
            columns[name].append(np.array([getattr(row, name) for row in rows], dtype=np.float64))
        for index, row in zip(flight, rows, strict=True):
            if index not in identities:
                identities[index] = (row.address, row.callsign)
    joined = {name: np.concatenate(parts) if parts else None for name, parts in columns.items()}
    known = [identities[i] for i in range(len(flights))]
    truth = Truth.of(
        tuple(flights),
        0 if joined["time_s"] is None else len(joined["time_s"]),
        phases=tuple(phases),
        addresses=[address_number(address or name) for name, (address, _) in zip(flights, known, strict=True)],
        callsigns=[(callsign or "").strip().encode("ascii", "replace") for _, callsign in known],
        **joined,
    )
    return truth, reader.notes


class _Numbers(dict[str, int]):
    """Track numbers for points that carry only a track name: negative, so that they meet no real one."""

    def __missing__(self, track: str) -> int:
        number = self[track] = -2 - len(self)
        return number


def _point_columns(rows: list[_PointLine], numbers: _Numbers) -> PointColumns:
    columns: dict[str, Any] = {name: [getattr(row, name) for row in rows] for name in _FLOATS}
    columns["product"] = [_PRODUCTS[row.product] for row in rows]
    columns["status"] = [_STATUSES[row.status] for row in rows]
    columns["track_number"] = [
        numbers[row.track or ""] if row.track_number is None else row.track_number for row in rows
    ]
    columns["address"] = [address_number(row.address) for row in rows]
    columns["mode_a"] = [_mode_a(row.mode_a) for row in rows]
    columns["callsign"] = [(row.callsign or "").strip().encode("ascii", "replace") for row in rows]
    for name in ("epoch", "seq", "element"):
        columns[name] = [-1 if value is None else value for value in (getattr(row, name) for row in rows)]
    columns["span_s"] = [row.span_s or _NAN2 for row in rows]
    columns["position_cov_m2"] = [row.position_cov_m2 or _NAN3 for row in rows]
    columns["velocity_cov_m2ps2"] = [row.velocity_cov_m2ps2 or _NAN3 for row in rows]
    columns["flags"] = [_flag_bits(row.flags) if row.flags else 0 for row in rows]
    return PointColumns.of(len(rows), **columns)


def address_number(text: str | None) -> int:
    """The ICAO address of six hex digits, -1 where the text is none."""
    return int(text, 16) if text is not None and _ADDRESS.fullmatch(text) else -1


def _mode_a(text: str | None) -> int:
    return int(text, 8) if text is not None and _MODE_A.fullmatch(text) else -1


def _flag_bits(flags: tuple[str, ...]) -> int:
    return sum({_FLAGS.get(flag, 0) for flag in flags})
