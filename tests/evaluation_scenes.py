"""Truth with known motion and points with known errors: what the tests of the evaluation are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pyproj import Geod

from aeroskein.evaluation import PointColumns, Truth
from aeroskein.points import Product

GEOD = Geod(ellps="WGS84")
START_S = 1_790_000_000.0


def great_circle(
    lat_deg: float, lon_deg: float, angle_deg: float, speed_mps: float, time_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Latitude, longitude and track angle along a geodesic flown on the ellipsoid, by pyproj."""
    n = len(time_s)
    distance = speed_mps * (time_s - time_s[0])
    lon, lat, back = GEOD.fwd(np.full(n, lon_deg), np.full(n, lat_deg), np.full(n, angle_deg), distance)
    return np.asarray(lat), np.asarray(lon), np.mod(np.asarray(back) + 180.0, 360.0)


def truth_of(
    names: Sequence[str] = ("3C6444",),
    *,
    seconds: int = 300,
    lat_deg: float = 48.0,
    lon_deg: float = 11.0,
    angle_deg: float = 70.0,
    speed_mps: float = 200.0,
    height_m: float = 0.0,
    apart_deg: float = 1.0,
    phase: str = "straight",
    step_s: float = 1.0,
) -> Truth:
    """Flights along geodesics, all in the same direction, each ``apart_deg`` of latitude north of the one before."""
    time_s = START_S + np.arange(0.0, seconds + step_s, step_s)
    tracks = [great_circle(lat_deg + k * apart_deg, lon_deg, angle_deg, speed_mps, time_s) for k in range(len(names))]
    flights, n = len(names), len(time_s)
    return Truth.of(
        names,
        flights * n,
        phases=(phase,),
        flight=np.repeat(np.arange(flights), n),
        phase=0,
        time_s=np.tile(time_s, flights),
        lat_deg=np.concatenate([track[0] for track in tracks]) if tracks else None,
        lon_deg=np.concatenate([track[1] for track in tracks]) if tracks else None,
        track_angle_deg=np.concatenate([track[2] for track in tracks]) if tracks else None,
        ground_speed_mps=speed_mps,
        vertical_rate_mps=0.0,
        height_m=height_m,
    )


def points_on(
    truth: Truth,
    *,
    east_m: Any = 0.0,
    north_m: Any = 0.0,
    along_m: Any = None,
    across_m: Any = None,
    product: Product = Product.ELEMENT,
    **columns: Any,
) -> PointColumns:
    """A confirmed point at every sample of truth, moved by known distances along geodesics."""
    n = len(truth)
    if along_m is not None or across_m is not None:
        along = np.broadcast_to(0.0 if along_m is None else along_m, n)
        across = np.broadcast_to(0.0 if across_m is None else across_m, n)
        distance = np.hypot(along, across)
        azimuth = truth.track_angle_deg + np.degrees(np.arctan2(across, along))
    else:
        east, north = np.broadcast_to(east_m, n), np.broadcast_to(north_m, n)
        distance, azimuth = np.hypot(east, north), np.degrees(np.arctan2(east, north))
    lon, lat, _ = GEOD.fwd(truth.lon_deg, truth.lat_deg, azimuth, distance)
    given = {
        "product": int(product),
        "track_number": truth.flight + 1,
        "address": truth.addresses[truth.flight],
        "seq": np.concatenate([np.arange(c) for c in np.bincount(truth.flight)]) if n else None,
        "time_s": truth.time_s,
        "published_s": truth.time_s + 1.0,
        "lat_deg": lat,
        "lon_deg": lon,
        "height_m": truth.height_m,
        "altitude_m": truth.altitude_m,
        "ground_speed_mps": truth.ground_speed_mps,
        "track_angle_deg": truth.track_angle_deg,
        "vertical_rate_mps": truth.vertical_rate_mps,
    }
    return PointColumns.of(n, **(given | columns))


def truth_and(first: Truth, second: Truth) -> Truth:
    """Two truths as one; both name the same phases."""
    columns = ("phase", "time_s", "lat_deg", "lon_deg", "height_m", "ground_speed_mps", "track_angle_deg")
    joined = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in columns}
    joined["flight"] = np.concatenate([first.flight, second.flight + len(first.names)])
    joined["vertical_rate_mps"] = np.concatenate([first.vertical_rate_mps, second.vertical_rate_mps])
    return Truth.of(first.names + second.names, len(joined["time_s"]), phases=first.phases, **joined)
