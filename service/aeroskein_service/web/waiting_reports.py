"""Reports that no closed element holds yet, placed on the globe for the element view.

They come as the sensors sent them. A radar's are corrected by its registration and placed by slant range, azimuth and
the aircraft's height, as the service does it when it takes them in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aeroskein.geodesy import frame_rows
from aeroskein.radar_geometry import radar_to_geodetic

__all__ = ["place_reports"]

Report = Mapping[str, Any]


def place_reports(
    by_sensor: Mapping[str, Sequence[Report]],
    sensors: Mapping[str, Mapping[str, Any]],
    registration: Mapping[str, Mapping[str, Any]],
    *,
    height_m: float | None,
    after_s: float,
) -> list[dict[str, Any]]:
    """Reports stamped after a time, in order of time.

    Parameters
    ----------
    by_sensor : mapping
        The reports of the reply to ``query/reports``.
    sensors : mapping
        What is known of each sensor, see ``SensorTable.describe``; a radar without a site cannot be placed.
    registration : mapping
        Registration states by radar, empty where none is known.
    height_m : float, optional
        Height of the aircraft, for radar plots without one. [m above the ellipsoid]
    after_s : float
        [s since the epoch]
    """
    placed = []
    for name, reports in by_sensor.items():
        for report in reports:
            state = registration.get(name, {})
            time_s = float(report["time_s"]) - (state.get("time_bias_s") or 0.0)
            if time_s <= after_s:
                continue
            place = _place(report, sensors.get(name, {}), state, height_m)
            if place is not None:
                placed.append(
                    {
                        "sensor": name,
                        "time_s": time_s,
                        "lat_deg": place[0],
                        "lon_deg": place[1],
                        "altitude_m": report.get("altitude_m"),
                    }
                )
    return sorted(placed, key=lambda report: report["time_s"])


def _place(
    report: Report, sensor: Mapping[str, Any], state: Mapping[str, Any], height_m: float | None
) -> tuple[float, float] | None:
    if report.get("lat_deg") is not None and report.get("lon_deg") is not None:
        return float(report["lat_deg"]), float(report["lon_deg"])
    site = [sensor.get(name) for name in ("lat_deg", "lon_deg", "height_m")]
    height = report.get("height_m") or height_m or report.get("altitude_m")
    if report.get("range_m") is None or report.get("azimuth_deg") is None or None in site or height is None:
        return None
    range_m = (report["range_m"] - (state.get("range_bias_m") or 0.0)) / (1.0 + (state.get("range_gain") or 0.0))
    azimuth_deg = report["azimuth_deg"] - (state.get("azimuth_bias_deg") or 0.0)
    rows = frame_rows(*(np.array([value], dtype=np.float64) for value in site))
    fix = radar_to_geodetic(rows, np.array([range_m]), np.array([azimuth_deg]), np.array([float(height)]))
    return (float(fix.lat_deg[0]), float(fix.lon_deg[0])) if fix.feasible[0] else None
