"""One aircraft as the page sees it: a record of fixed layout, filled by the live picture and by replays alike.

The layout is also in ``static/js/frame.js``; ``docs/web.md`` has the table. Little endian, 52 bytes, made so that a
frame is a copy of memory: 20,000 aircraft are 1 MB.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "NAMED_BY_ADDRESS",
    "RECORD",
    "UNKNOWN_ADDRESS",
    "UNKNOWN_ANGLE",
    "UNKNOWN_MODE_A",
    "UNKNOWN_RATE",
    "Records",
    "blank",
    "in_box",
    "largest_sigma",
    "pack_motion",
    "pack_position",
    "record_label",
]

RECORD: Final = np.dtype(
    [
        ("number", "<u4"),  # track number, its low 32 bits
        ("lat", "<i4"),  # 1e-7 degrees: a centimetre
        ("lon", "<i4"),
        ("altitude_m", "<f4"),  # NaN where unknown
        ("sigma_m", "<f4"),  # one sigma of position, the larger axis; NaN where unknown
        ("speed", "<u2"),  # 0.1 m/s
        ("angle", "<u2"),  # 360/65536 degrees
        ("rate", "<i2"),  # 0.01 m/s
        ("age", "<i2"),  # how long before the picture's time the state holds, 0.01 s
        ("sensors", "<u4"),  # bit per sensor that has contributed lately
        ("flags", "<u2"),  # bits in the order of ``messages.FLAG_NAMES``
        ("mode_a", "<u2"),
        ("status", "u1"),  # index in ``messages.STATUS_NAMES``
        ("master", "i1"),  # index of the sensor, -1 where none
        ("named", "u1"),  # NAMED_BY_ADDRESS
        ("heard", "u1"),  # seconds since the newest report, 255 and more: 255
        ("address", "<u4"),
        ("callsign", "S8"),
    ]
)

NAMED_BY_ADDRESS: Final = 1
UNKNOWN_ADDRESS: Final = 0xFFFFFFFF
UNKNOWN_MODE_A: Final = 0xFFFF
UNKNOWN_ANGLE: Final = 0xFFFF  # in ``speed``: then angle means nothing either
UNKNOWN_RATE: Final = -0x8000

Records = NDArray[Any]
Array = NDArray[np.float64]


def blank(n: int) -> Records:
    """``n`` records of which nothing is known."""
    made = np.zeros(n, dtype=RECORD)
    made["altitude_m"] = made["sigma_m"] = np.nan
    made["speed"], made["rate"] = UNKNOWN_ANGLE, UNKNOWN_RATE
    made["mode_a"], made["address"], made["master"] = UNKNOWN_MODE_A, UNKNOWN_ADDRESS, -1
    return made


def pack_position(records: Records, rows: Any, lat_deg: Array, lon_deg: Array, altitude_m: Array) -> None:
    """Write positions of some records; one that is unknown, or none on Earth, stays what it was. [deg, deg, m]"""
    known = (np.abs(lat_deg) <= 90.0) & (np.abs(lon_deg) <= 180.0)
    rows = rows[known]
    records["lat"][rows] = np.rint(lat_deg[known] * 1e7).astype(np.int64)
    records["lon"][rows] = np.rint(lon_deg[known] * 1e7).astype(np.int64)
    records["altitude_m"][rows] = altitude_m[known]


def pack_motion(records: Records, rows: Any, speed_mps: Array, angle_deg: Array, rate_mps: Array) -> None:
    """Write velocities of some records. [m/s, deg, m/s]"""
    known = np.isfinite(speed_mps) & np.isfinite(angle_deg)
    speed = np.clip(np.rint(np.where(known, speed_mps, 0.0) * 10.0), 0, UNKNOWN_ANGLE - 1)
    records["speed"][rows] = np.where(known, speed, UNKNOWN_ANGLE).astype(np.uint16)
    angle = np.rint(np.where(known, angle_deg, 0.0) * (65536.0 / 360.0)).astype(np.int64) & 0xFFFF
    records["angle"][rows] = angle
    climbs = np.isfinite(rate_mps)
    rate = np.clip(np.rint(np.where(climbs, rate_mps, 0.0) * 100.0), -0x7FFF, 0x7FFF)
    records["rate"][rows] = np.where(climbs, rate, UNKNOWN_RATE).astype(np.int16)


def largest_sigma(ee: Array, en: Array, nn: Array) -> Array:
    """One sigma along the longer axis of the ellipses ``[ee, en, nn]``; NaN stays NaN. [m², m]"""
    largest = 0.5 * (ee + nn) + np.hypot(0.5 * (ee - nn), en)
    return np.asarray(np.sqrt(np.maximum(largest, 0.0)))


def in_box(records: Records, box: tuple[float, float, float, float]) -> NDArray[np.bool_]:
    """Which records lie in ``lat_min, lon_min, lat_max, lon_max``, which may cross the antimeridian. [deg]"""
    lat_min, lon_min, lat_max, lon_max = (int(edge * 1e7) for edge in box)
    lat, lon = records["lat"], records["lon"]
    between = (lon >= lon_min) & (lon <= lon_max) if lon_min <= lon_max else (lon >= lon_min) | (lon <= lon_max)
    inside: NDArray[np.bool_] = (lat >= lat_min) & (lat <= lat_max) & between
    return inside


def record_label(record: Any) -> str:
    """The key chunk of the track: its address, or ``T`` and its number."""
    if int(record["named"]) & NAMED_BY_ADDRESS:
        return f"{int(record['address']):06X}"
    return f"T{int(record['number']):06d}"
