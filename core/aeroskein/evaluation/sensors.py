"""How good the raw reports were, sensor by sensor: what the fused result is to be compared with.

A radar plot is compared twice: in its own coordinates (range and azimuth against those of the truth as seen from the
site) and as a position, set at the true height, so that its missing or barometric height does not enter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aeroskein.evaluation.figures import SensorEvaluation
from aeroskein.evaluation.geometry import (
    SEMI_MAJOR_M,
    east_north_axes,
    east_north_axes_at,
    ecef,
    rotate_to_east_north,
    up_vector,
)
from aeroskein.evaluation.matching import flight_of_address
from aeroskein.evaluation.residuals import along_across
from aeroskein.evaluation.roughness import is_spike
from aeroskein.evaluation.spread import signed_spread, spread
from aeroskein.evaluation.truth_curve import TruthCurve, TruthStates
from aeroskein.evaluation.windows import Reported, Windows
from aeroskein.plots import Array, Ints, Plots

__all__ = ["SensorReports", "Site", "evaluate_sensors", "reported_of"]

# Rounds of the search for a plot's foot at the true height; each shrinks what is left by distance over the Earth's
# radius, so three leave micrometres.
_ROUNDS: Final = 3


# A sensor's clock may be this far off and still tell when a flight was seen; the prior of a radar's time error is 1 s.
_STAMP_ERROR_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Site:
    """Where a radar stands. [deg, m above the ellipsoid]"""

    lat_deg: float
    lon_deg: float
    height_m: float = 0.0


@dataclass(slots=True, eq=False)
class SensorReports:
    """Raw reports.

    Attributes
    ----------
    plots : Plots
        ``plots.sensor`` indexes ``sensors``.
    sensors : tuple of str
        Sensor ids.
    sites : dict
        Site of each radar that is known.
    """

    plots: Plots
    sensors: tuple[str, ...]
    sites: Mapping[str, Site] = field(default_factory=dict)


def reported_of(reports: SensorReports, curve: TruthCurve) -> Reported:
    """When sensors spoke of each flight."""
    plots = reports.plots
    flight = flight_of_address(plots.address, curve)
    safe = np.maximum(flight, 0)
    # A report whose time is nonsense must not stretch the time in which its flight is judged.
    if len(curve.names):
        flight = np.where(plots.time_s < curve.start_s[safe] - _STAMP_ERROR_S, -1, flight)
        flight = np.where(plots.time_s > curve.end_s[safe] + _STAMP_ERROR_S, -1, flight)
    rows = np.flatnonzero((flight >= 0) & np.isfinite(plots.time_s))
    first, last = np.full(len(curve.names), np.inf), np.full(len(curve.names), -np.inf)
    np.minimum.at(first, flight[rows], plots.time_s[rows])
    np.maximum.at(last, flight[rows], plots.time_s[rows])
    return Reported(
        first_s=np.where(np.isfinite(first), first, np.nan),
        last_s=np.where(np.isfinite(last), last, np.nan),
        has_anonymous=bool((plots.address < 0).any()),
    )


def evaluate_sensors(reports: SensorReports, curve: TruthCurve, windows: Windows) -> tuple[SensorEvaluation, ...]:
    """Judge the raw reports of every sensor in the time in which the fused points are judged."""
    flight = flight_of_address(reports.plots.address, curve)
    flight = np.where(windows.contain(flight, reports.plots.time_s), flight, -1)
    return tuple(_sensor(reports, index, name, flight, curve) for index, name in enumerate(reports.sensors))


def _sensor(reports: SensorReports, index: int, name: str, flight: Ints, curve: TruthCurve) -> SensorEvaluation:
    mine = np.flatnonzero(reports.plots.sensor == index)
    rows = mine[flight[mine] >= 0]
    plots, flight = reports.plots.take(rows), flight[rows]
    truth = curve.at(flight, plots.time_s)
    site = reports.sites.get(name)
    is_polar = np.isfinite(plots.range_m) & np.isfinite(plots.azimuth_deg)
    position = ecef(up_vector(plots.lat_deg, plots.lon_deg), np.nan_to_num(truth.height_m))
    range_m, azimuth_deg = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    if site is not None and is_polar.any():
        seen, range_m, azimuth_deg = _polar(plots, truth, site)
        position = np.where(is_polar[:, None], seen, position)
    usable = truth.valid & np.isfinite(position).all(axis=1)
    east, north = east_north_axes(truth.up)
    error = rotate_to_east_north(position - truth.position, east, north)
    along, across = along_across(error, rotate_to_east_north(truth.velocity, east, north))
    size = np.hypot(error[usable, 0], error[usable, 1])
    order = np.flatnonzero(usable)
    order = order[np.lexsort((plots.time_s[order], flight[order]))]
    return SensorEvaluation(
        sensor=name,
        reports=len(mine),
        judged=int(usable.sum()),
        not_judged_because=_why(int(usable.sum()), len(mine), len(rows), bool(is_polar.any()) and site is None),
        horizontal_m=spread(size),
        along_m=signed_spread(along[usable]),
        across_m=signed_spread(across[usable]),
        range_m=signed_spread(range_m[usable]),
        azimuth_deg=signed_spread(azimuth_deg[usable]),
        spikes=int(is_spike(flight[order], plots.time_s[order], position[order]).sum()),
        sizes_m=size,
    )


def _why(judged: int, reports: int, matched: int, site_missing: bool) -> str:
    """Why none of the reports could be judged; empty where some were."""
    if judged or not reports:
        return ""
    if not matched:
        return "no report carries the address of a flight with truth"
    return "the site of this radar is not known" if site_missing else "no truth at the time of any report"


def _polar(plots: Plots, truth: TruthStates, site: Site) -> tuple[Array, Array, Array]:
    """Radar plots as positions at the true height, and their range and azimuth errors.

    Returns
    -------
    (n, 3) array
        Earth-centred position. [m]
    (n,) array, (n,) array
        Reported minus true slant range and azimuth. [m, deg]
    """
    lat, lon = np.array([site.lat_deg]), np.array([site.lon_deg])
    up = up_vector(lat, lon)
    east, north = east_north_axes_at(lat, lon)
    origin = ecef(up, np.array([site.height_m]))
    sight = truth.position - origin
    true_en = rotate_to_east_north(sight, east, north)
    true_up = np.sum(sight * up, axis=1)
    azimuth = np.radians(plots.azimuth_deg)
    ground_true = np.hypot(true_en[:, 0], true_en[:, 1])
    ground = ground_true
    for _ in range(_ROUNDS):
        # The same height lies lower above the site's plane the further away it is.
        rise = true_up - (ground**2 - ground_true**2) / (2.0 * SEMI_MAJOR_M)
        ground = np.sqrt(np.maximum(plots.range_m**2 - rise**2, 0.0))
    level = east * (ground * np.sin(azimuth))[:, None] + north * (ground * np.cos(azimuth))[:, None]
    azimuth_error = plots.azimuth_deg - np.degrees(np.arctan2(true_en[:, 0], true_en[:, 1]))
    return (
        origin + level + up * rise[:, None],
        plots.range_m - np.linalg.norm(sight, axis=1),
        np.mod(azimuth_error + 180.0, 360.0) - 180.0,
    )
