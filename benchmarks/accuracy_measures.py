"""Errors of a scene's products and of what they are compared with, family by family, with one judge for all.

Everything that has a position and a time, the engine's points as well as references and raw reports, goes through
``aeroskein.evaluation``; the same span of each flight is judged for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from benchmarks.accuracy_scenes import Scene, Sky

from aeroskein.evaluation import PointColumns, SensorReports
from aeroskein.evaluation.matching import match
from aeroskein.evaluation.residuals import Residuals, residuals_of
from aeroskein.evaluation.roughness import roughness_of
from aeroskein.evaluation.sensors import reported_of
from aeroskein.evaluation.windows import is_held
from aeroskein.geodesy import frame_rows
from aeroskein.plots import Array, Bools, Ints, Plots
from aeroskein.points import Flag
from aeroskein.radar_geometry import radar_to_geodetic
from aeroskein.settings import SensorSettings

__all__ = ["Errors", "Judge", "coverage", "mean_nees", "ratio", "ratio_interval", "rms"]

# Draws of flights for an interval of a ratio.
RESAMPLES: Final = 300
# Squared distance inside which 95 % of a normal distribution in the plane lies.
INSIDE_95: Final = 5.991


@dataclass(slots=True, eq=False)
class Errors:
    """Errors of points, one row each, with the flight, its family and the time since the scene began."""

    residuals: Residuals
    family: Ints
    spikes: Array

    def of(self, family: int | None = None, keep: Bools | None = None) -> Residuals:
        """The residuals of one family, or of all; of rows that are to be kept only."""
        mask = np.ones(len(self.family), dtype=np.bool_) if family is None else self.family == family
        if keep is not None:
            mask = mask & keep
        return self.residuals.take(mask)


class Judge:
    """Judges what a scene's engine and references say, each flight in the same span.

    Parameters
    ----------
    scene, sky : Scene, Sky
        What was flown and reported.
    """

    def __init__(self, scene: Scene, sky: Sky) -> None:
        self._sky, self._scene = sky, scene
        reported = reported_of(SensorReports(sky.plots, tuple(s.id for s in scene.sensors)), sky.curve)
        self._start_s, self._end_s = reported.first_s + scene.from_s, reported.last_s
        self.start_s = float(np.nanmin(reported.first_s))

    def errors(self, points: PointColumns) -> Errors:
        """Errors of confirmed and coasting points in the judged span."""
        flight = match(points, self._sky.curve, 2000.0).flight
        held = is_held(points) & (flight >= 0)
        inside = held & (points.time_s >= self._start_s[flight]) & (points.time_s <= self._end_s[flight])
        residuals = residuals_of(points, np.where(inside, flight, -1), self._sky.curve)
        spikes = np.zeros(len(self._scene.families))
        family = self._sky.family[flight]
        for k in range(len(spikes)):
            part = inside & (family == k)
            of_family = points.take(part)
            spikes[k] = roughness_of(of_family, np.ones(len(of_family), dtype=np.bool_), residuals.take([])).spikes
        return Errors(residuals, self._sky.family[residuals.flight], spikes)

    def raw(self, plots: Plots, sensor_id: str) -> Errors:
        """Errors of raw reports of one sensor, radar plots set at the true height."""
        index = [s.id for s in self._scene.sensors].index(sensor_id)
        mine = plots.take(plots.sensor == index)
        flight = np.searchsorted(self._sky.curve.addresses, mine.address)
        position = _raw_positions(mine, flight, self._sky, self._scene.sensors[index])
        return self.errors(
            PointColumns.of(
                len(mine), address=mine.address, track_number=flight, time_s=mine.time_s,
                lat_deg=position[0], lon_deg=position[1],
            )
        )  # fmt: skip


def _raw_positions(plots: Plots, flight: Ints, sky: Sky, sensor: SensorSettings) -> tuple[Array, Array]:
    """Latitude and longitude that a report states; a radar plot's at the true height of its flight. [deg]"""
    if not sensor.is_radar:
        return plots.lat_deg, plots.lon_deg
    height = sky.curve.at(flight, plots.time_s).height_m
    site = frame_rows(np.array([sensor.lat_deg]), np.array([sensor.lon_deg]), np.array([sensor.height_m]))
    fix = radar_to_geodetic(np.repeat(site, len(plots), axis=0), plots.range_m, plots.azimuth_deg, height)
    return fix.lat_deg, fix.lon_deg


def rms(values: Array) -> float:
    """Root of the mean square of what is known; NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known * known))) if len(known) else float("nan")


def mean_nees(residuals: Residuals) -> float:
    """Mean squared error in units of the stated covariance; 2 is honest."""
    known = residuals.position_nees[np.isfinite(residuals.position_nees)]
    return float(known.mean()) if len(known) else float("nan")


def coverage(residuals: Residuals) -> float:
    """Share of points inside their 95 % ellipse."""
    known = residuals.position_nees[np.isfinite(residuals.position_nees)]
    return float((known <= INSIDE_95).mean()) if len(known) else float("nan")


def ratio(ours: Residuals, theirs: Residuals) -> float:
    """RMS of one over RMS of the other."""
    return rms(ours.horizontal_m) / rms(theirs.horizontal_m)


def ratio_interval(ours: Residuals, theirs: Residuals, seed: int = 1) -> tuple[float, float]:
    """95 % interval of the ratio, by drawing flights anew: the errors of one flight hang together."""
    flights = np.intersect1d(ours.flight, theirs.flight)
    if len(flights) < 3:
        return float("nan"), float("nan")
    a, b = (_sums(r, flights) for r in (ours, theirs))
    drawn = np.random.default_rng(seed).integers(0, len(flights), (RESAMPLES, len(flights)))
    means = [s[drawn].sum(axis=1) / n[drawn].sum(axis=1) for s, n in (a, b)]
    low, high = np.percentile(np.sqrt(means[0] / means[1]), [2.5, 97.5])
    return float(low), float(high)


def _sums(residuals: Residuals, flights: Ints) -> tuple[Array, Array]:
    at = np.searchsorted(flights, residuals.flight)
    at = np.minimum(at, len(flights) - 1)
    mine = flights[at] == residuals.flight
    squares = np.bincount(at[mine], weights=residuals.horizontal_m[mine] ** 2, minlength=len(flights))
    return squares, np.bincount(at[mine], minlength=len(flights)).astype(np.float64)


def in_spans(residuals: Residuals, start_s: float, spans: Sequence[tuple[float, float]]) -> Bools:
    """Which points lie in one of the spans, given in seconds since the scene began."""
    since = residuals.time_s - start_s
    inside = np.zeros(len(since), dtype=np.bool_)
    for first, end in spans:
        inside |= (since >= first) & (since < end)
    return inside


def coasted(residuals: Residuals) -> Bools:
    """Which points say that no report stands behind them."""
    return np.asarray((residuals.flags & int(Flag.COASTED)) != 0)
