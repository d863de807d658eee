"""The manoeuvre detector: three interacting linear models over one state, in plain matrices.

Constant velocity under white acceleration, and constant acceleration under weak and strong white jerk; mixing, updates
and probabilities as in Blom & Bar-Shalom (1988). Its mixture is the zero-lag reference filter, and what it thinks of
the models sets the density of jerk for the reference smoother.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aeroskein import imm, linear_gaussian, motion
from aeroskein.lanes import Lanes, continues, step_s
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints
from aeroskein.smoothing import parameters
from aeroskein.smoothing.start import first_states
from aeroskein.smoothing.updates import POSITION, VELOCITY, Refusals, position_report, velocity_report

__all__ = ["Detection", "allowed_density", "detect", "rows_before"]


@dataclass(slots=True, eq=False)
class Detection:
    """What the detector thinks after each report.

    Attributes
    ----------
    x, P : (n, 6), (n, 6, 6) float64
        Mixture of the models.
    mu : (3, n) float64
        Probabilities of the models.
    accepted : (n,) bool
        Whether the position was used.
    """

    x: Array
    P: Array
    mu: Array
    accepted: Bools

    @property
    def density_m2ps5(self) -> Array:
        """Density of jerk that the probabilities ask for, shape ``(n,)``. [m²/s⁵]"""
        return np.asarray(parameters.JERK_DENSITY @ self.mu)


def detect(measurements: Measurements) -> Detection:
    """Run the detector over all flights.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time; ``slot`` is the flight, each begins with a position.
    """
    n = len(measurements)
    lanes, dt_s = Lanes(measurements.slot), step_s(measurements.slot, measurements.time_s)
    found = Detection(np.zeros((n, 6)), np.zeros((n, 6, 6)), np.zeros((3, n)), ~continues(measurements.slot))
    first_x, first_P = first_states(measurements)
    for k in range(lanes.steps):
        rows = lanes.rows(k)
        m = len(rows)
        if k == 0:
            flight = measurements.slot[rows]
            x, P = np.repeat(first_x[None, flight], 3, axis=0), np.repeat(first_P[None, flight], 3, axis=0)
            mu = np.repeat(parameters.DETECTOR_START[:, None], m, axis=1)
            refusals = Refusals(m, int(measurements.sensor.max(initial=0.0)) + 1)
        else:
            T = imm.transition_probabilities(parameters.RATES_PER_S, dt_s[rows])
            x, P, mu = imm.mix(x[:, :m], P[:, :m], mu[:, :m], T, None)
            x, P = _predict(x, P, dt_s[rows])
            x, P, mu, found.accepted[rows] = _update(x, P, mu, measurements.take(rows), refusals)
        found.x[rows], found.P[rows] = imm.mixture(x, P, mu, None)
        found.mu[:, rows] = mu
    return found


def _predict(x: Array, P: Array, dt_s: Array) -> tuple[Array, Array]:
    steady_x, steady_P = linear_gaussian.predict(
        x[0],
        P[0],
        motion.velocity_transition(dt_s),
        motion.white_acceleration_noise(dt_s, parameters.DETECTOR_STEADY_DENSITY),
    )
    F = motion.acceleration_transition(dt_s)
    moved = [(steady_x, steady_P)]
    for model, density in enumerate(parameters.DETECTOR_JERK_DENSITY, start=1):
        moved.append(linear_gaussian.predict(x[model], P[model], F, motion.white_jerk_noise(dt_s, density)))
    return np.stack([m[0] for m in moved]), np.stack([m[1] for m in moved])


def _update(x: Array, P: Array, mu: Array, seen: Measurements, refusals: Refusals) -> tuple[Array, Array, Array, Bools]:
    observed, innovation, R, d2 = position_report(seen, x, P)
    # An outlier is one for every model.
    accepted, widen = refusals.judge(d2.min(axis=0), observed, seen.sensor.astype(np.int64))
    P = P * widen[:, None, None]
    x, P, mu = _take(accepted, x, P, mu, innovation, POSITION, R)
    told, innovation, R, d2 = velocity_report(seen, x, P)
    used = told & (accepted | ~observed) & (d2.min(axis=0) <= parameters.GATE)
    return *_take(used, x, P, mu, innovation, VELOCITY, R), accepted


def _take(
    lanes: Bools, x: Array, P: Array, mu: Array, innovation: Array, H: Array, R: Array
) -> tuple[Array, Array, Array]:
    S = linear_gaussian.innovation_covariance(P, H, R)
    new_mu = imm.reweigh(mu, imm.gaussian_log_likelihood(innovation, S))
    new_x, new_P = linear_gaussian.update(x, P, innovation, H, R)
    return (
        np.where(lanes[:, None], new_x, x),
        np.where(lanes[:, None, None], new_P, P),
        np.where(lanes, new_mu, mu),
    )


def allowed_density(
    time_s: Array, flight: Ints, at_s: Array, at_flight: Ints, density: Array, horizon_s: Array | None = None
) -> Array:
    """Density of jerk to allow for at given instants: the largest one asked for around them.

    Parameters
    ----------
    time_s, flight, density : (n,) arrays
        Reports, ordered by flight and time, and what the detector asks for after each.
    at_s, at_flight : (m,) arrays
        Instants.
    horizon_s : (m,) array, optional
        Nothing later than this is known; absent: everything is.

    Returns
    -------
    (m,) array
        Maximum over reports from 1 s before to 4 s after, no later than the horizon; where there is no report in that
        window, that of the last one before it. [m²/s⁵]
    """
    until_s = at_s + parameters.AHEAD_S
    if horizon_s is not None:
        until_s = np.minimum(until_s, horizon_s)
    first = rows_before(time_s, flight, at_s - parameters.BEHIND_S, at_flight, inclusive=False)
    last = rows_before(time_s, flight, until_s, at_flight, inclusive=True)
    start_of_flight = np.searchsorted(flight, at_flight, side="left")
    # The last report before the window stands in where the window is empty.
    allowed = density[np.clip(first - 1, start_of_flight, None)].copy()
    empty = first >= last
    allowed[~empty] = 0.0
    for ahead in range(int((last - first).max(initial=0))):
        inside = first + ahead < last
        row = np.where(inside, first + ahead, 0)
        allowed = np.where(inside, np.maximum(allowed, density[row]), allowed)
    return allowed


def rows_before(time_s: Array, flight: Ints, at_s: Array, at_flight: Ints, *, inclusive: bool) -> Ints:
    """How many rows of the table lie before each instant of its flight (or at it): an insertion point."""
    low = np.searchsorted(flight, at_flight, side="left")
    high = np.searchsorted(flight, at_flight, side="right")
    while (low < high).any():
        middle = (low + high) // 2
        row = np.minimum(middle, len(time_s) - 1)
        before = (time_s[row] <= at_s) if inclusive else (time_s[row] < at_s)
        open_ = low < high
        low = np.where(open_ & before, middle + 1, low)
        high = np.where(open_ & ~before, middle, high)
    return low
