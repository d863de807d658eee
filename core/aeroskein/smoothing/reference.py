"""The reference estimators: what good filtering and smoothing of the same reports gives, for accuracy claims.

Written plainly, in full matrices and with fixed parameters, so that the fast engine can be measured against them: the
zero-lag filters, and the variable-jerk smoother with a lag or over whole tracks.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.adsb_filter.start import start_states
from aeroskein.adsb_filter.turning import bank_of, filter_turning
from aeroskein.lanes import held_rows
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints
from aeroskein.smoothing.detector import allowed_density, detect
from aeroskein.smoothing.fixed_lag import estimate_with_lag
from aeroskein.smoothing.start import started
from aeroskein.smoothing.variable_jerk import filter_forwards, smooth_backwards

__all__ = ["ReferenceEstimates", "reference_filter", "reference_smoother"]


@dataclass(slots=True, eq=False)
class ReferenceEstimates:
    """Estimates, one row each, in the flight's plane.

    Attributes
    ----------
    flight : (m,) int64
        Flight, as in the measurements' ``slot``.
    time_s : (m,) float64
        Instant. [s]
    position_m, velocity_mps : (m, 2) float64
        East and north; NaN where there is no estimate (before the first believable report, or after the last). [m, m/s]
    position_cov_m2, velocity_cov_m2ps2 : (m, 2, 2) float64
        [m², m²/s²]
    """

    flight: Ints
    time_s: Array
    position_m: Array
    velocity_mps: Array
    position_cov_m2: Array
    velocity_cov_m2ps2: Array


def reference_filter(measurements: Measurements, model: Literal["imm", "imm-ukf"] = "imm") -> ReferenceEstimates:
    """Estimate at the time of each report from the reports stamped until then.

    Parameters
    ----------
    measurements : Measurements
        Reports of any number of flights in their planes, ordered by flight (``slot``) and time.
    model : str
        ``imm``: three linear models (constant velocity, constant acceleration twice); ``imm-ukf``: the published
        unscented filters (CTRV, CCA, CSAV).

    Returns
    -------
    ReferenceEstimates
        One row per report, in the same order.
    """
    n = len(measurements)
    estimates = _empty(measurements.slot, measurements.time_s)
    rows = np.flatnonzero(started(measurements)) if n else np.zeros(0, dtype=np.int64)
    if len(rows) == 0:
        return estimates
    seen = _renumbered(measurements.take(rows))
    if model == "imm":
        found = detect(seen)
        _fill(estimates, rows, found.x, found.P)
    else:
        settings = AdsbFilterSettings()
        filtered = filter_turning(
            seen, start_states(seen, settings), bank_of(settings, several=True), settings
        ).filtered()
        for name in ("position_m", "velocity_mps", "position_cov_m2", "velocity_cov_m2ps2"):
            getattr(estimates, name)[rows] = getattr(filtered, name)
    return estimates


def reference_smoother(
    measurements: Measurements, at_flight: Ints, at_s: Array, *, lag_s: float | None = None
) -> ReferenceEstimates:
    """Estimate at given instants from all reports, or from those stamped no later than a lag after each.

    Parameters
    ----------
    measurements : Measurements
        Reports of any number of flights in their planes, ordered by flight (``slot``) and time.
    at_flight, at_s : (m,) arrays
        Flights (``slot``) and instants, in any order. [s]
    lag_s : float, optional
        The estimate at t uses reports up to t + lag; absent: all of them. [s]

    Returns
    -------
    ReferenceEstimates
        One row per instant, in the same order; NaN for instants before the flight's first believable report, and,
        without a lag, after its last.
    """
    return smooth_tracks(measurements, at_flight, at_s, lag_s=lag_s)[0]


def smooth_tracks(
    measurements: Measurements, at_flight: Ints, at_s: Array, *, lag_s: float | None = None
) -> tuple[ReferenceEstimates, Bools]:
    """As ``reference_smoother``; also says which reports were accepted, ``(n,)``."""
    at_flight, at_s = np.asarray(at_flight, dtype=np.int64), np.asarray(at_s, dtype=np.float64)
    estimates = _empty(at_flight, at_s)
    accepted = np.zeros(len(measurements), dtype=np.bool_)
    rows = np.flatnonzero(started(measurements)) if len(measurements) else np.zeros(0, dtype=np.int64)
    if len(rows) == 0:
        return estimates, accepted
    seen = measurements.take(rows)
    flights, first = np.unique(seen.slot, return_index=True)
    last = np.append(first[1:], len(seen)) - 1
    seen = _renumbered(seen)
    number = np.minimum(np.searchsorted(flights, at_flight), len(flights) - 1)
    askable = (flights[number] == at_flight) & (at_s >= seen.time_s[first[number]])
    if lag_s is None:
        askable &= at_s <= seen.time_s[last[number]]
    asked = np.flatnonzero(askable)
    density = detect(seen).density_m2ps5
    if lag_s is None:
        x, P, accepted[rows] = _whole(seen, density, number[asked], at_s[asked])
    else:
        track = filter_forwards(seen, allowed_density(seen.time_s, seen.slot, seen.time_s, seen.slot, density))
        accepted[rows] = track.accepted
        x, P = estimate_with_lag(seen, track, density, number[asked], at_s[asked], lag_s)
    _fill(estimates, asked, x, P)
    return estimates, accepted


def _whole(seen: Measurements, density: Array, at_flight: Ints, at_s: Array) -> tuple[Array, Array, Bools]:
    """Smooth everything, with the wanted instants as rows that report nothing."""
    n, m = len(seen), len(at_s)
    nothing = seen.take(np.zeros(m, dtype=np.int64))
    for f in fields(Measurements):
        if f.name not in ("slot", "sensor"):
            getattr(nothing, f.name)[:] = np.nan
    nothing.slot, nothing.time_s = at_flight, at_s
    nothing.time_variance[:] = 0.0
    both = Measurements(
        **{f.name: np.concatenate([getattr(seen, f.name), getattr(nothing, f.name)]) for f in fields(Measurements)}
    )
    # Of one instant the report comes first, so that a flight still begins with one.
    order = np.lexsort((np.repeat([0, 1], [n, m]), both.time_s, both.slot))
    rows = both.take(order)
    # An instant does not change the density of the step it divides: that is the next report's, if there is one.
    following = held_rows(rows.slot, np.repeat([True, False], [n, m])[order])[1]
    step_end_s = rows.time_s[np.where(following >= 0, following, np.arange(n + m))]
    track = filter_forwards(rows, allowed_density(seen.time_s, seen.slot, step_end_s, rows.slot, density))
    x, P = smooth_backwards(rows, track)
    place = np.empty(n + m, dtype=np.int64)
    place[order] = np.arange(n + m)
    return x[place[n:]], P[place[n:]], track.accepted[place[:n]]


def _renumbered(measurements: Measurements) -> Measurements:
    measurements.slot = np.unique(measurements.slot, return_inverse=True)[1].astype(np.int64)
    return measurements


def _empty(flight: Ints, time_s: Array) -> ReferenceEstimates:
    m = len(time_s)
    pair, matrix = np.full((m, 2), np.nan), np.full((m, 2, 2), np.nan)
    return ReferenceEstimates(flight, time_s, pair, pair.copy(), matrix, matrix.copy())


def _fill(estimates: ReferenceEstimates, rows: Ints, x: Array, P: Array) -> None:
    estimates.position_m[rows], estimates.velocity_mps[rows] = x[:, 0:2], x[:, 2:4]
    estimates.position_cov_m2[rows], estimates.velocity_cov_m2ps2[rows] = P[:, 0:2, 0:2], P[:, 2:4, 2:4]
