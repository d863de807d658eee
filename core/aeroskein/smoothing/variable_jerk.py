"""The reference estimator: constant acceleration under white jerk of varying density, forwards and backwards.

A Kalman filter through all reports of a flight in order of time, then Rauch-Tung-Striebel backwards, in plain 6x6
matrices. Rows without a position or velocity are instants at which an estimate is wanted and nothing is measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aeroskein import linear_gaussian, motion
from aeroskein.lanes import Lanes, continues, step_s
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools
from aeroskein.smoothing.parameters import GATE
from aeroskein.smoothing.start import first_states
from aeroskein.smoothing.updates import POSITION, VELOCITY, Refusals, position_report, velocity_report

__all__ = ["Track", "filter_forwards", "smooth_backwards", "take_report"]


@dataclass(slots=True, eq=False)
class Track:
    """States of all rows, and what was predicted for them.

    Attributes
    ----------
    x, P : (n, 6), (n, 6, 6) float64
        After the row's report.
    prior_x, prior_cov : (n, 6), (n, 6, 6) float64
        Before it, widened where a refused source was believed.
    accepted, velocity_accepted : (n,) bool
        Whether position and velocity were used.
    """

    x: Array
    P: Array
    prior_x: Array
    prior_cov: Array
    accepted: Bools
    velocity_accepted: Bools


def filter_forwards(measurements: Measurements, density_m2ps5: Array) -> Track:
    """Filter all flights.

    Parameters
    ----------
    measurements : Measurements
        Rows in the plane, ordered by flight and time; ``slot`` is the flight, each begins with a position.
    density_m2ps5 : (n,) array
        Density of jerk over the step into each row. [m²/s⁵]
    """
    n = len(measurements)
    lanes, dt_s = Lanes(measurements.slot), step_s(measurements.slot, measurements.time_s)
    begins = ~continues(measurements.slot)
    track = Track(
        np.zeros((n, 6)), np.zeros((n, 6, 6)), np.zeros((n, 6)), np.zeros((n, 6, 6)), begins.copy(), begins.copy()
    )
    first_x, first_P = first_states(measurements)
    for k in range(lanes.steps):
        rows = lanes.rows(k)
        m = len(rows)
        if k == 0:
            flight = measurements.slot[rows]
            x, P = first_x[flight], first_P[flight]
            refusals = Refusals(m, int(measurements.sensor.max(initial=0.0)) + 1)
            track.prior_x[rows], track.prior_cov[rows] = x, P
        else:
            F, Q = motion.acceleration_transition(dt_s[rows]), motion.white_jerk_noise(dt_s[rows], density_m2ps5[rows])
            x, P = linear_gaussian.predict(x[:m], P[:m], F, Q)
            seen = measurements.take(rows)
            observed, _, _, d2 = position_report(seen, x, P)
            accepted, widen = refusals.judge(d2, observed, seen.sensor.astype(np.int64))
            P = P * widen[:, None, None]
            track.prior_x[rows], track.prior_cov[rows], track.accepted[rows] = x, P, accepted
            x, P, used = take_report(seen, x, P, accepted, accepted | ~observed)
            track.velocity_accepted[rows] = used
        track.x[rows], track.P[rows] = x, P
    return track


def take_report(
    seen: Measurements, x: Array, P: Array, accepted: Bools, velocity_allowed: Bools
) -> tuple[Array, Array, Bools]:
    """Take reports in: positions where accepted, velocities where allowed and inside their own gate.

    Parameters
    ----------
    seen : Measurements
        One report a row, ``(m,)``.
    x, P : (m, 6), (m, 6, 6) arrays
        Predicted states.
    accepted, velocity_allowed : (m,) bool
        Which positions and which velocities.

    Returns
    -------
    x, P : arrays
        Updated states.
    used : (m,) bool
        Velocities that were taken.
    """
    _, innovation, R, _ = position_report(seen, x, P)
    x, P = _where(accepted, linear_gaussian.update(x, P, innovation, POSITION, R), (x, P))
    told, innovation, R, d2 = velocity_report(seen, x, P)
    used = told & velocity_allowed & (d2 <= GATE)
    x, P = _where(used, linear_gaussian.update(x, P, innovation, VELOCITY, R), (x, P))
    return x, P, used


def _where(lanes: Bools, updated: tuple[Array, Array], kept: tuple[Array, Array]) -> tuple[Array, Array]:
    return np.where(lanes[:, None], updated[0], kept[0]), np.where(lanes[:, None, None], updated[1], kept[1])


def smooth_backwards(measurements: Measurements, track: Track) -> tuple[Array, Array]:
    """States ``(n, 6)`` and covariances ``(n, 6, 6)`` of all rows given all reports (Rauch-Tung-Striebel)."""
    lanes, dt_s = Lanes(measurements.slot), step_s(measurements.slot, measurements.time_s)
    x, P = track.x.copy(), track.P.copy()
    for k in range(lanes.steps - 2, -1, -1):
        later = lanes.rows(k + 1)
        rows = later - 1
        F = motion.acceleration_transition(dt_s[later])
        x[rows], P[rows] = linear_gaussian.smooth(
            track.x[rows], track.P[rows], F, track.prior_x[later], track.prior_cov[later], x[later], P[later]
        )
    return x, P
