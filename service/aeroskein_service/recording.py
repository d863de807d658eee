"""The recorded traffic sample as columns in SI units, read from the data file of the package ``traffic``."""

from __future__ import annotations

import gzip
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein.errors import AeroskeinError
from aeroskein.plots import Array, Bools, Ints
from aeroskein.units import FOOT_M, FOOT_PER_MINUTE_MPS, KNOT_MPS, wrap_angle_deg, wrap_azimuth_deg
from aeroskein_service.report_columns import parse_address, parse_callsign, parse_mode_a

__all__ = ["INSTALL", "NoRecordingError", "Recording", "find_recording", "load_recording"]

INSTALL: Final = "pip install --no-deps traffic==2.13"
_SAMPLE: Final = Path("data", "samples", "collections", "quickstart.json.gz")


class NoRecordingError(AeroskeinError):
    """The sample is not installed; the message says how to get it."""

    def __init__(self) -> None:
        super().__init__(f"the recorded traffic is not installed: {INSTALL} (56 MB, without its dependencies)")


class _Row(msgspec.Struct, gc=False):
    """One state vector of the sample: feet, knots, feet per minute, milliseconds."""

    timestamp: float
    icao24: str
    latitude: float | None = None
    longitude: float | None = None
    altitude: float | None = None
    groundspeed: float | None = None
    track: float | None = None
    vertical_rate: float | None = None
    callsign: str | None = None
    squawk: str | None = None
    onground: bool = False


@dataclass(slots=True, eq=False)
class Recording:
    """Recorded ADS-B reports ordered by time; every column but ``address`` has shape ``(n,)``.

    Attributes
    ----------
    time_s : float64
        [s since the epoch, UTC]
    slot : int64
        Index of the aircraft in ``address``.
    address : (aircraft,) int32
        ICAO 24-bit addresses.
    lat_deg, lon_deg : float64
        WGS-84. [deg]
    altitude_m, ground_speed_mps, track_angle_deg, vertical_rate_mps : float64
        Pressure altitude and velocity over ground; NaN where not recorded. [m, m/s, deg, m/s]
    on_ground : bool
        As the transponder said.
    mode_a, last_mode_a : int16
        Mode 3/A code of the row; the last one known of the aircraft. -1 where unknown.
    callsign : S8
        Empty where unknown.
    unusable : int
        Rows without position or address.
    """

    time_s: Array
    slot: Ints
    address: NDArray[np.int32]
    lat_deg: Array
    lon_deg: Array
    altitude_m: Array
    ground_speed_mps: Array
    track_angle_deg: Array
    vertical_rate_mps: Array
    on_ground: Bools
    mode_a: NDArray[np.int16]
    last_mode_a: NDArray[np.int16]
    callsign: NDArray[np.bytes_]
    unusable: int


def find_recording() -> Path:
    """The sample's file; the package is not imported. Raises ``NoRecordingError``."""
    spec = importlib.util.find_spec("traffic")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        path = Path(folder) / _SAMPLE
        if path.is_file():
            return path
    raise NoRecordingError


def load_recording(path: Path | None = None) -> Recording:
    """Read the sample, or another file of the same form. Raises ``NoRecordingError`` and ``OSError``."""
    with gzip.open(path or find_recording()) as file:
        rows = msgspec.json.decode(file.read(), type=list[_Row])
    usable = [r for r in rows if r.latitude is not None and r.longitude is not None and parse_address(r.icao24) >= 0]
    usable.sort(key=lambda row: row.timestamp)
    address, slot = np.unique([parse_address(row.icao24) for row in usable], return_inverse=True)

    def numbers(name: str) -> Array:
        return np.array([getattr(row, name) for row in usable], dtype=np.float64)

    mode_a = np.array([_mode_a(row.squawk) for row in usable], dtype=np.int16)
    speed_mps, track_deg = numbers("groundspeed") * KNOT_MPS, wrap_azimuth_deg(numbers("track"))
    return Recording(
        time_s=numbers("timestamp") / 1000.0,
        slot=slot.astype(np.int64),
        address=address.astype(np.int32),
        lat_deg=numbers("latitude"),
        lon_deg=wrap_angle_deg(numbers("longitude")),
        altitude_m=numbers("altitude") * FOOT_M,
        ground_speed_mps=np.where(np.isnan(track_deg), np.nan, speed_mps),
        track_angle_deg=np.where(np.isnan(speed_mps), np.nan, track_deg),
        vertical_rate_mps=numbers("vertical_rate") * FOOT_PER_MINUTE_MPS,
        on_ground=np.array([row.onground for row in usable], dtype=np.bool_),
        mode_a=mode_a,
        last_mode_a=_carried_on(slot, mode_a),
        callsign=np.array([parse_callsign(row.callsign or "") or b"" for row in usable], dtype="S8"),
        unusable=len(rows) - len(usable),
    )


def _mode_a(squawk: str | None) -> int:
    """The code; the sample has lost leading zeros."""
    code = None if squawk is None else parse_mode_a(squawk.zfill(4))
    return -1 if code is None else code


def _carried_on(slot: NDArray[Any], value: NDArray[np.int16]) -> NDArray[np.int16]:
    """The last known value of the same slot at each row; -1 before the first."""
    order = np.argsort(slot, kind="stable")
    known = np.where(value[order] >= 0, np.arange(len(order)), -1)
    last = np.maximum.accumulate(known)
    begin = np.r_[True, np.diff(slot[order]) != 0]
    first_row = np.maximum.accumulate(np.where(begin, np.arange(len(order)), 0))
    carried = np.empty_like(value)
    carried[order] = np.where(last >= first_row, value[order][last], -1)
    return carried
