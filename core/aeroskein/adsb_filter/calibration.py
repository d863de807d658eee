"""Position and time errors of each data source, from straight flight: what step 3 of the published filter needs.

Through a piece of straight, uniform flight a line is fitted in time; the residuals are turned along and across the
flight. Across there is only the position error: σp. Along there is the jitter of the time stamps as well, so
``σt = sqrt(var_along - var_across) / v`` (the publication lacks the root). The publication selects segments by hand;
here every window of reports is tried, and those that a parabola fits no better than the line are straight. Medians over
windows keep the outliers and the turns that slip through from mattering.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from aeroskein.lanes import continues, lengths_of_runs
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints

__all__ = ["SourceErrors", "estimate_source_errors"]

# Reports in a window: long enough for a variance, short enough to be straight in a terminal area.
WINDOW: Final = 30
# A window spans at most this; a source of ten-second reports shows no jitter beside the flight's own weaving. [s]
LONGEST_WINDOW_S: Final = 120.0
# Slower flight does not turn time into distance. [m/s]
LEAST_SPEED_MPS: Final = 50.0
# A parabola across or along must not explain more than chance: F distribution with 1 and WINDOW - 3 degrees, 10 %.
STRAIGHT_F: Final = 2.9
# Windows of a source before its values mean anything.
LEAST_WINDOWS: Final = 8


class SourceErrors(NamedTuple):
    """What was found for one source.

    Attributes
    ----------
    position_sigma_m, time_sigma_s : float
        NaN with fewer than eight straight windows. [m, s]
    windows : int
        Straight windows used.
    """

    position_sigma_m: float
    time_sigma_s: float
    windows: int


def estimate_source_errors(measurements: Measurements, sensors: int) -> list[SourceErrors]:
    """Estimate both errors of every source.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time.
    sensors : int
        How many sources there are.
    """
    return [_of_source(measurements.take(measurements.sensor == source)) for source in range(sensors)]


def _of_source(seen: Measurements) -> SourceErrors:
    seen = seen.take(np.isfinite(seen.east_m))
    rows = _windows(seen.slot)
    if len(rows) == 0:
        return SourceErrors(np.nan, np.nan, 0)
    time_s = seen.time_s[rows] - seen.time_s[rows[:, :1]]
    position_m = np.stack([seen.east_m[rows], seen.north_m[rows]], axis=-1)
    usable = (np.diff(time_s, axis=1) > 0.0).all(axis=1) & (time_s[:, -1] <= LONGEST_WINDOW_S)
    along, across, speed, straight = _residual_variances(time_s[usable], position_m[usable])
    straight &= speed >= LEAST_SPEED_MPS
    count = int(straight.sum())
    if count < LEAST_WINDOWS:
        return SourceErrors(np.nan, np.nan, count)
    # The median of a variance with k degrees of freedom lies at (1 - 2/(9k))³ of its mean (Wilson & Hilferty 1931).
    unbiased = (1.0 - 2.0 / (9.0 * (WINDOW - 2))) ** 3
    position_variance = float(np.median(across[straight])) / unbiased
    beyond = along[straight] / unbiased - position_variance
    time_variance = float(np.median(beyond / speed[straight] ** 2))
    return SourceErrors(float(np.sqrt(position_variance)), float(np.sqrt(max(time_variance, 0.0))), count)


def _windows(flight: Ints) -> Ints:
    """Rows of consecutive windows that lie within one flight each, ``(windows, WINDOW)``."""
    first = np.flatnonzero(~continues(flight))
    lengths = lengths_of_runs(first, len(flight))
    per_flight = lengths // WINDOW
    starts = np.repeat(first, per_flight)
    within = np.arange(len(starts)) - np.repeat(np.cumsum(per_flight) - per_flight, per_flight)
    return np.asarray((starts + WINDOW * within)[:, None] + np.arange(WINDOW))


def _residual_variances(time_s: Array, position_m: Array) -> tuple[Array, Array, Array, Bools]:
    """Line fits of windows ``(w, k)``, ``(w, k, 2)``: variance along and across, speed, and whether it was straight."""
    k = time_s.shape[1]
    t = time_s - time_s.mean(axis=1, keepdims=True)
    p = position_m - position_m.mean(axis=1, keepdims=True)
    velocity = np.einsum("wk,wkc->wc", t, p) / (t**2).sum(axis=1)[:, None]
    residual = p - t[..., None] * velocity[:, None, :]
    speed = np.hypot(*velocity.T)
    ahead = velocity / np.maximum(speed, 1e-9)[:, None]
    right = np.stack([ahead[:, 1], -ahead[:, 0]], axis=1)
    # The parabola, made orthogonal to the line.
    bend = t**2 - (t**2).mean(axis=1, keepdims=True)
    bend = bend - t * ((t * bend).sum(axis=1) / (t**2).sum(axis=1))[:, None]
    bend /= np.sqrt((bend**2).sum(axis=1, keepdims=True))
    variances, straight = [], np.ones(len(t), dtype=np.bool_)
    for axis in (ahead, right):
        part = np.einsum("wkc,wc->wk", residual, axis)
        squares = (part**2).sum(axis=1)
        explained = (part * bend).sum(axis=1) ** 2
        variances.append(squares / (k - 2))
        straight &= explained <= STRAIGHT_F * (squares - explained) / (k - 3)
    return variances[0], variances[1], speed, straight
