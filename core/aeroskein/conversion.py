"""Conversion: what sensors report becomes measurements in the fusion plane, with covariances.

Step 2 of the element method, with exact geodesy in place of the published formulas (``published_geometry.py`` has
those). Own positions (ADS-B, multilateration) are taken as they are; radar measurements need a height. Sigmas come
from the report itself, from its quality indicators, or from the sensor's configuration, in that order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints, Plots, columns_of
from aeroskein.radar_geometry import radar_covariance, radar_to_geodetic
from aeroskein.settings import EngineSettings

__all__ = ["Located", "SensorTable", "locate", "measure", "position_sigma_m", "rough_place", "velocity_sigma_mps"]

# A 95 % circle of a circular normal distribution has a radius of 2.448 sigma.
RADIUS_95: Final = 2.448
# Estimated position uncertainty by NACp (DO-260B): 95 % radius, index 0 unknown. [m]
EPU_M: Final = np.array([np.nan, 18520.0, 7408.0, 3704.0, 1852.0, 926.0, 555.6, 185.2, 92.6, 30.0, 10.0, 3.0])
# Velocity uncertainty by NACv: 95 %, index 0 unknown. [m/s]
VELOCITY_95_MPS: Final = np.array([np.nan, 10.0, 3.0, 1.0, 0.3])
POSITION_SIGMA_M: Final = EPU_M / RADIUS_95
VELOCITY_SIGMA_MPS: Final = VELOCITY_95_MPS / RADIUS_95
# Reported velocities are rounded to a knot and filtered on board; nothing better than this is believable. [m/s]
VELOCITY_FLOOR_MPS: Final = 0.5
POSITION_FLOOR_M: Final = 1.0
# A plot whose height nobody knows: middle of the airspace, give or take. [m]
UNKNOWN_HEIGHT_M: Final = 5000.0
UNKNOWN_HEIGHT_SIGMA_M: Final = 3500.0


class SensorTable:
    """The configured sensors as columns by sensor index."""

    def __init__(self, settings: EngineSettings) -> None:
        sensors = settings.sensors
        self.is_radar: Bools = np.array([s.is_radar for s in sensors], dtype=np.bool_)
        self.period_s = np.array([s.period_s for s in sensors])
        self.position_sigma_m = np.array([s.position_sigma_m for s in sensors])
        self.velocity_sigma_mps = np.array([s.velocity_sigma_mps for s in sensors])
        self.time_sigma_s = np.array([s.effective_time_sigma_s for s in sensors])
        self.range_sigma_m = np.array([s.range_sigma_m for s in sensors])
        self.azimuth_sigma_deg = np.array([s.azimuth_sigma_deg for s in sensors])
        self.altitude_sigma_m = np.array([s.altitude_sigma_m for s in sensors])
        self.sites = geodesy.frame_rows(
            np.array([s.lat_deg or 0.0 for s in sensors]),
            np.array([s.lon_deg or 0.0 for s in sensors]),
            np.array([s.height_m or 0.0 for s in sensors]),
        )


def position_sigma_m(plots: Plots, table: SensorTable) -> Array:
    """One sigma per axis of reported positions ``(n,)``: own sigma, else NACp, else configured. [m]"""
    known = (plots.nac_p > 0) & (plots.nac_p < len(EPU_M))
    by_category = POSITION_SIGMA_M[np.where(known, plots.nac_p, 0)]
    sigma = np.where(np.isnan(by_category), table.position_sigma_m[plots.sensor], by_category)
    reported = plots.position_sigma_m
    return np.maximum(np.where(np.isnan(reported), sigma, reported), POSITION_FLOOR_M)


def velocity_sigma_mps(plots: Plots, table: SensorTable) -> Array:
    """One sigma per axis of reported velocities ``(n,)``: own sigma, else NACv, else configured. [m/s]"""
    known = (plots.nac_v > 0) & (plots.nac_v < len(VELOCITY_95_MPS))
    by_category = VELOCITY_SIGMA_MPS[np.where(known, plots.nac_v, 0)]
    sigma = np.where(np.isnan(by_category), table.velocity_sigma_mps[plots.sensor], by_category)
    reported = plots.velocity_sigma_mps
    return np.maximum(np.where(np.isnan(reported), sigma, reported), VELOCITY_FLOOR_MPS)


@dataclass(slots=True, eq=False)
class Located:
    """Where reports are on the globe.

    Attributes
    ----------
    lat_deg, lon_deg : (n,) float64
        WGS-84 position. [deg]
    height_m : (n,) float64
        Height used, above the ellipsoid. [m]
    covariance : (n, 3) float64
        ``[ee, en, nn]`` in the local plane at the target, without the part from the time stamp. [m²]
    feasible : (n,) bool
        False where slant range and height contradict each other.
    """

    lat_deg: Array
    lon_deg: Array
    height_m: Array
    covariance: Array
    feasible: Bools

    def take(self, rows: Ints | Bools) -> Located:
        """The given rows, in that order."""
        return Located(
            self.lat_deg[rows], self.lon_deg[rows], self.height_m[rows], self.covariance[rows], self.feasible[rows]
        )

    def put(self, rows: Ints, better: Located) -> None:
        """Say anew where the given rows ``(n,)`` are."""
        for name in ("lat_deg", "lon_deg", "height_m", "covariance"):
            getattr(self, name)[rows] = getattr(better, name)


def rough_place(plots: Plots, table: SensorTable, rows: Ints) -> tuple[Array, Array]:
    """Latitude and longitude of some reports within some kilometres, from nothing but the reports themselves. [deg]"""
    lat, lon, sensor, range_m = plots.lat_deg[rows], plots.lon_deg[rows], plots.sensor[rows], plots.range_m[rows]
    at = (table.is_radar[sensor] & np.isfinite(range_m)).nonzero()[0]
    if len(at):
        altitude_m, azimuth_deg = plots.altitude_m[rows[at]], plots.azimuth_deg[rows[at]]
        height = np.where(np.isnan(altitude_m), UNKNOWN_HEIGHT_M, altitude_m)
        fix = radar_to_geodetic(table.sites[sensor[at]], range_m[at], azimuth_deg, height)
        lat[at], lon[at] = fix.lat_deg, fix.lon_deg
    return lat, lon


def locate(plots: Plots, table: SensorTable, height_m: Array, height_sigma_m: Array, bias_sigmas: Array) -> Located:
    """Find the position of every report.

    Parameters
    ----------
    plots : Plots
        Reports, radar measurements already corrected for registration.
    table : SensorTable
        The sensors.
    height_m, height_sigma_m : (n,) arrays
        Geometric height to assume for radar plots, and its sigma; NaN where nobody knows. [m]
    bias_sigmas : (n, 4) array
        One sigma of what registration has left in range, azimuth, time and gain. [m, deg, s, 1]
    """
    n = len(plots)
    radar = table.is_radar[plots.sensor] & np.isfinite(plots.range_m)
    lat, lon = plots.lat_deg.copy(), plots.lon_deg.copy()
    variance = position_sigma_m(plots, table) ** 2
    covariance = columns_of(variance, np.zeros(n), variance)
    feasible = np.ones(n, dtype=np.bool_)
    unknown = np.isnan(height_m)
    height = np.where(unknown, UNKNOWN_HEIGHT_M, height_m)
    at = radar.nonzero()[0]
    if len(at):
        sensor = plots.sensor[at]
        sites, slant, azimuth = table.sites[sensor], plots.range_m[at], plots.azimuth_deg[at]
        fix = radar_to_geodetic(sites, slant, azimuth, height[at])
        lat[at], lon[at], feasible[at] = fix.lat_deg, fix.lon_deg, fix.feasible
        covariance[at] = radar_covariance(
            sites, slant, azimuth, fix,
            range_sigma_m=np.hypot(table.range_sigma_m[sensor], bias_sigmas[at, 0]),
            azimuth_sigma_deg=np.hypot(table.azimuth_sigma_deg[sensor], bias_sigmas[at, 1]),
            height_sigma_m=np.where(unknown, UNKNOWN_HEIGHT_SIGMA_M, height_sigma_m)[at],
        )  # fmt: skip
        # Above a radar even a wrong height says that the target is there: overhead, within the height's blur.
        feasible |= radar & unknown
    return Located(lat, lon, height, covariance, feasible)


def measure(
    raw: Plots, plots: Plots, located: Located, slot: Ints, frames: Array, table: SensorTable, time_sigma_s: Array
) -> Measurements:
    """Bring located reports into the planes of their tracks.

    Parameters
    ----------
    raw, plots, located : Plots, Plots, Located
        The reports as they came, corrected for registration, and where they are.
    slot : (n,) int64
        Their tracks.
    frames : (n, 12) array
        The frames of those tracks.
    table : SensorTable
        The sensors.
    time_sigma_s : (n,) array
        One sigma of their time stamps, with what registration has left. [s]
    """
    east, north, axes = geodesy.to_plane_with_axes(frames, located.lat_deg, located.lon_deg, located.height_m)
    covariance = geodesy.rotate_covariance(axes, located.covariance)
    angle = np.radians(plots.track_angle_deg)
    v_east, v_north = geodesy.rotate_vector(
        axes, plots.ground_speed_mps * np.sin(angle), plots.ground_speed_mps * np.cos(angle)
    )
    # A radar's own tracked velocity lags behind the flight: it may help association, never the estimate.
    own = ~table.is_radar[plots.sensor] & np.isfinite(v_east)
    sigma = velocity_sigma_mps(plots, table)
    return Measurements(
        slot=slot,
        time_s=plots.time_s,
        received_s=plots.received_s,
        sensor=plots.sensor.astype(np.float64),
        east_m=east,
        north_m=north,
        r_ee=covariance[:, 0],
        r_en=covariance[:, 1],
        r_nn=covariance[:, 2],
        v_east_mps=np.where(own, v_east, np.nan),
        v_north_mps=np.where(own, v_north, np.nan),
        velocity_variance=np.where(own, sigma**2, np.nan),
        time_variance=time_sigma_s**2,
        altitude_m=plots.altitude_m,
        vertical_rate_mps=plots.vertical_rate_mps,
        height_m=plots.height_m,
        stamp_s=raw.time_s,
        range_m=raw.range_m,
        azimuth_deg=raw.azimuth_deg,
    )
