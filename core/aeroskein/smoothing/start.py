"""Where the reference estimators begin: the first report of each flight that the next ones do not contradict."""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.lanes import continues, held_rows
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints
from aeroskein.smoothing.parameters import ACCELERATION_SIGMA_MPS2, UNKNOWN_VELOCITY_SIGMA_MPS

__all__ = ["first_states", "started"]

# No civil aircraft is faster over ground, jet stream included. [m/s]
FASTEST_MPS: Final = 450.0
# Of this many reports after the first, so many must be reachable from it.
WITNESSES: Final = 3
AGREEING: Final = 2
# A velocity from two positions needs this much time between them; longer ones may hold a turn. [s]
BASE_S: Final = 3.0
LONGEST_BASE_S: Final = 30.0


def started(measurements: Measurements) -> Bools:
    """Rows at or after the first believable position of their flight, shape ``(n,)``; a lone report is believed."""
    flight = measurements.slot
    at = np.flatnonzero(np.isfinite(measurements.east_m))
    asked, agreeing = np.zeros(len(at), dtype=np.int64), np.zeros(len(at), dtype=np.int64)
    variance = measurements.r_ee + measurements.r_nn + 2.0 * FASTEST_MPS**2 * measurements.time_variance
    for ahead in range(1, WITNESSES + 1):
        here, there = at[:-ahead], at[ahead:]
        same = flight[here] == flight[there]
        e = measurements.east_m[there] - measurements.east_m[here]
        n = measurements.north_m[there] - measurements.north_m[here]
        reach_m = FASTEST_MPS * (measurements.time_s[there] - measurements.time_s[here])
        near = np.hypot(e, n) <= reach_m + 3.0 * np.sqrt(variance[here] + variance[there])
        asked[: len(here)] += same
        agreeing[: len(here)] += same & near
    believable = np.zeros(len(flight), dtype=np.bool_)
    believable[at] = agreeing >= np.minimum(asked, AGREEING)
    return np.asarray(held_rows(flight, believable)[0] >= 0)


def first_states(measurements: Measurements) -> tuple[Array, Array]:
    """States ``(flights, 6)`` and covariances ``(flights, 6, 6)`` at each flight's first row.

    Position as measured; velocity as measured, or from the first position at least three seconds later, or unknown;
    acceleration unknown.
    """
    first = np.flatnonzero(~continues(measurements.slot))
    begin = measurements.take(first)
    velocity, variance = _velocity(measurements, first)
    x = np.zeros((len(first), 6))
    x[:, 0], x[:, 1] = begin.east_m, begin.north_m
    x[:, 2:4] = velocity
    P = np.zeros((len(first), 6, 6))
    P[:, :2, :2] = begin.time_variance[:, None, None] * velocity[:, :, None] * velocity[:, None, :]
    P[:, 0, 0] += begin.r_ee
    P[:, 1, 1] += begin.r_nn
    P[:, 0, 1] += begin.r_en
    P[:, 1, 0] += begin.r_en
    P[:, 2, 2] = P[:, 3, 3] = variance
    P[:, 4, 4] = P[:, 5, 5] = ACCELERATION_SIGMA_MPS2**2
    return x, P


def _velocity(measurements: Measurements, first: Ints) -> tuple[Array, Array]:
    flight, time_s = measurements.slot, measurements.time_s
    base_s = time_s - time_s[first][flight]
    usable = np.isfinite(measurements.east_m) & (base_s >= BASE_S) & (base_s <= LONGEST_BASE_S)
    second = held_rows(flight, usable)[1][first]
    has_second = second >= 0
    second = np.where(has_second, second, first)
    base = np.where(has_second, base_s[second], 1.0)
    way = np.stack([c[second] - c[first] for c in (measurements.east_m, measurements.north_m)], axis=1)
    velocity = way / base[:, None]
    credible = has_second & (np.hypot(*velocity.T) <= FASTEST_MPS)
    spread = measurements.r_ee + measurements.r_nn + FASTEST_MPS**2 * measurements.time_variance
    from_two = (spread[first] + spread[second]) / base**2 + (0.5 * ACCELERATION_SIGMA_MPS2 * base) ** 2
    variance = np.where(credible, from_two, UNKNOWN_VELOCITY_SIGMA_MPS**2)
    velocity = np.where(credible[:, None], velocity, 0.0)
    told = np.stack([measurements.v_east_mps[first], measurements.v_north_mps[first]], axis=1)
    known = np.isfinite(told[:, 0])
    return np.where(known[:, None], told, velocity), np.where(known, measurements.velocity_variance[first], variance)
