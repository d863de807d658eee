"""Small scenes for the tests of the simulator, and an independent look at where things are (pyproj)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray

from aeroskein.plots import Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation import SensorErrors, SimulationSettings, TruthStates, simulate

ADSB = SensorSettings(id="adsb", kind="adsb")
RADAR1 = SensorSettings(id="radar1", kind="ssr", lat_deg=48.35, lon_deg=11.78, height_m=460.0, period_s=4.0)
RADAR2 = SensorSettings(
    id="radar2", kind="psr", lat_deg=47.8, lon_deg=11.0, height_m=700.0, period_s=8.0, range_sigma_m=100.0,
    azimuth_sigma_deg=0.15,
)  # fmt: skip
SENSORS = (ADSB, RADAR1, RADAR2)

_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
GEOD = pyproj.Geod(ellps="WGS84")


def ecef(lat_deg: Any, lon_deg: Any, height_m: Any) -> NDArray[np.float64]:
    """ECEF positions ``(n, 3)`` by PROJ. [m]"""
    return np.stack(_ECEF.transform(lon_deg, lat_deg, height_m), axis=-1)


def local_axes(lat_deg: Any, lon_deg: Any) -> tuple[Any, Any, Any]:
    """Unit vectors east, north, up ``(n, 3)``."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    zero = np.zeros_like(lat)
    east = np.stack([-np.sin(lon), np.cos(lon), zero], axis=-1)
    north = np.stack([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)], axis=-1)
    return east, north, np.cross(east, north)


def run(
    *sensors: SensorSettings, errors: tuple[SensorErrors, ...] = (), chunk_s: float = 10.0, **settings: Any
) -> tuple[Plots, TruthStates]:
    """All reports in order of arrival, and the truth by track."""
    made = SimulationSettings(errors=errors, **settings)
    chunks = list(simulate(made, sensors, chunk_s=chunk_s, truth=True))
    truths = [chunk.truth for chunk in chunks if chunk.truth is not None]
    return Plots.concatenate([chunk.plots for chunk in chunks]), TruthStates.concatenate(truths).by_track()


def quiet(sensor_id: str, **changes: Any) -> SensorErrors:
    """Errors of a sensor that measures exactly and misses nothing, but for the given changes."""
    none: dict[str, Any] = {
        "position_sigma_m": 0.0, "velocity_sigma_mps": 0.0, "range_sigma_m": 0.0, "azimuth_sigma_deg": 0.0,
        "time_sigma_s": 0.0, "miss_probability": 0.0, "outlier_probability": 0.0,
    }  # fmt: skip
    return SensorErrors(sensor=sensor_id, **(none | changes))


def true_at(truth: TruthStates, address: Any, time_s: Any) -> dict[str, NDArray[np.float64]]:
    """Truth of given aircraft at given times, interpolated linearly between close samples.

    ``ecef`` (n, 3), ``velocity`` (n, 3), ``height_m``, ``altitude_m``; NaN outside an aircraft's samples.
    """
    position = ecef(truth.lat_deg, truth.lon_deg, truth.height_m)
    east, north, _ = local_axes(truth.lat_deg, truth.lon_deg)
    angle = np.radians(truth.track_angle_deg)
    velocity = truth.ground_speed_mps[:, None] * (np.sin(angle)[:, None] * east + np.cos(angle)[:, None] * north)
    columns = np.column_stack([position, velocity, truth.height_m, truth.altitude_m])
    found = np.full((len(time_s), columns.shape[1]), np.nan)
    for one in np.unique(address):
        mine, theirs = truth.address == one, address == one
        for k in range(columns.shape[1]):
            found[theirs, k] = np.interp(
                time_s[theirs], truth.time_s[mine], columns[mine, k], left=np.nan, right=np.nan
            )
    return {
        "ecef": found[:, :3], "velocity": found[:, 3:6], "height_m": found[:, 6], "altitude_m": found[:, 7],
    }  # fmt: skip
