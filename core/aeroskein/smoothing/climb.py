"""Altitude of whole tracks: a two-state filter with its Rauch-Tung-Striebel smoother, for all flights together.

State altitude and vertical rate under white vertical acceleration. What is measured is pressure altitude where the
flight reports any, geometric height otherwise, and reported vertical rates.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import linear_gaussian
from aeroskein.lanes import Lanes, continues, held_rows, step_s
from aeroskein.plots import Array, Bools, Ints

__all__ = ["smooth_altitude"]

# A climb begins with about 1 m/s² for a second. [m²/s³]
ACCELERATION_DENSITY: Final = 0.5
# One sigma of a reported vertical rate: steps of 64 ft/min, and the lag of the air data computer. [m/s]
RATE_SIGMA_MPS: Final = 1.0
# Before anything is reported: the steepest climbs and descents of transports. [m/s]
START_RATE_SIGMA_MPS: Final = 15.0
# Squared distance beyond which a value is an outlier; after so many in a row the next is believed.
GATE: Final = 36.0
REFUSALS_TO_BELIEVE: Final = 4

_H: Final = np.eye(2)


def smooth_altitude(
    flight: Ints, time_s: Array, altitude_m: Array, sigma_m: Array, rate_mps: Array
) -> tuple[Array, Array]:
    """Smooth altitude and rate of all rows.

    Parameters
    ----------
    flight, time_s : (n,) arrays
        Rows ordered by flight and time. [s]
    altitude_m, sigma_m, rate_mps : (n,) arrays
        Reported values, NaN where none (those rows are only estimated), and the altitude's sigma. [m, m, m/s]

    Returns
    -------
    altitude_m, rate_mps : (n,) arrays
        NaN for flights that report no altitude. [m, m/s]
    """
    n = len(flight)
    dt_s, lanes = step_s(flight, time_s), Lanes(flight)
    x, P = np.zeros((n, 2)), np.zeros((n, 2, 2))
    prior_x, prior_cov = x.copy(), P.copy()
    # A flight begins at its first known altitude, with a wide guess at its first row.
    known = np.isfinite(altitude_m)
    first_known = held_rows(flight, known)[1]
    for k in range(lanes.steps):
        rows = lanes.rows(k)
        m = len(rows)
        if k == 0:
            begin = np.where(first_known[rows] >= 0, altitude_m[first_known[rows]], 0.0)
            ahead_s = np.where(first_known[rows] >= 0, time_s[first_known[rows]] - time_s[rows], 0.0)
            state, cov = np.stack([begin, np.zeros(m)], axis=1), np.zeros((m, 2, 2))
            cov[:, 0, 0] = (10.0 * np.nan_to_num(sigma_m[rows])) ** 2 + (START_RATE_SIGMA_MPS * ahead_s) ** 2 + 1e4
            cov[:, 1, 1] = START_RATE_SIGMA_MPS**2
            refused = np.zeros(m, dtype=np.int64)
        else:
            state, cov = linear_gaussian.predict(state[:m], cov[:m], _transition(dt_s[rows]), _noise(dt_s[rows]))
        refused = refused[:m]
        seen = altitude_m[rows], sigma_m[rows], known[rows]
        widen = _judge(state, cov, *seen, refused)
        cov = cov * np.where(np.isfinite(widen), widen, 1.0)[:, None, None]
        prior_x[rows], prior_cov[rows] = state, cov
        state, cov = _take(state, cov, altitude_m[rows], sigma_m[rows], np.isfinite(widen), 0)
        state, cov = _take(state, cov, rate_mps[rows], np.full(m, RATE_SIGMA_MPS), np.isfinite(rate_mps[rows]), 1)
        x[rows], P[rows] = state, cov
    _backwards(lanes, dt_s, x, P, prior_x, prior_cov)
    first = np.flatnonzero(~continues(flight))
    has_any = np.logical_or.reduceat(known, first) if n else np.zeros(0, dtype=np.bool_)
    return np.where(has_any[flight], x[:, 0], np.nan), np.where(has_any[flight], x[:, 1], np.nan)


def _transition(dt_s: Array) -> Array:
    F = np.tile(np.eye(2), (len(dt_s), 1, 1))
    F[:, 0, 1] = dt_s
    return F


def _noise(dt_s: Array) -> Array:
    Q = np.stack([dt_s**3 / 3.0, dt_s**2 / 2.0, dt_s**2 / 2.0, dt_s], axis=1).reshape(-1, 2, 2)
    return np.asarray(ACCELERATION_DENSITY * Q)


def _judge(x: Array, P: Array, value: Array, sigma: Array, known: Bools, refused: Ints) -> Array:
    """Factor by which the covariance is widened before an altitude is taken; NaN where it is not taken."""
    innovation = np.where(known, value - x[:, 0], 0.0)
    d2 = innovation**2 / (P[:, 0, 0] + np.where(known, sigma, 1.0) ** 2)
    believed = known & (d2 > GATE) & (refused >= REFUSALS_TO_BELIEVE)
    taken = known & ((d2 <= GATE) | believed)
    refused[:] = np.where(taken, 0, refused + known)
    return np.where(taken, np.where(believed, d2, 1.0), np.nan)


def _take(x: Array, P: Array, value: Array, sigma: Array, where: Bools, state: int) -> tuple[Array, Array]:
    H = _H[state : state + 1]
    innovation = np.where(where, value - x[:, state], 0.0)[:, None]
    R = np.where(where, sigma, 1.0)[:, None, None] ** 2
    new_x, new_P = linear_gaussian.update(x, P, innovation, H, R)
    return np.where(where[:, None], new_x, x), np.where(where[:, None, None], new_P, P)


def _backwards(lanes: Lanes, dt_s: Array, x: Array, P: Array, prior_x: Array, prior_cov: Array) -> None:
    for k in range(lanes.steps - 2, -1, -1):
        later = lanes.rows(k + 1)
        rows = later - 1
        x[rows], P[rows] = linear_gaussian.smooth(
            x[rows], P[rows], _transition(dt_s[later]), prior_x[later], prior_cov[later], x[later], P[later]
        )
