"""Step 0 of the published ADS-B filter: which reports make up each flight before anything is estimated.

Points at the beginning and end with speed and altitude zero go, and what lies before the first point above ground,
where the filter starts. Beyond the publication: a position that is repeated by a moving target is no observation (an
eighth of recorded traffic), and the start is the first position that its successors can be reached from, so that no
outlier becomes the initial state.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.flights import Flights
from aeroskein.lanes import continues, held_rows
from aeroskein.measurements import Measurements
from aeroskein.plots import ON_GROUND, Array, Bools, Ints

__all__ = ["LEAST_REPORTS", "moving_rows", "started_rows"]

# Fewer reports are no track. [reports]
LEAST_REPORTS: Final = 3
# No aircraft rolls this fast; ground flags of faster ones are wrong (thousands in recorded traffic). [m/s]
FASTEST_ROLL_MPS: Final = 60.0
# How many successors are asked whether a start can be true, and how many must agree.
WITNESSES: Final = 3
AGREEING: Final = 2


def _on_ground(flights: Flights) -> Bools:
    plots = flights.plots
    low = (plots.flags & ON_GROUND > 0) | (plots.altitude_m <= 0.0)
    return low & ~(plots.ground_speed_mps > FASTEST_ROLL_MPS)


def _from_first(flight: Ints, marked: Bools) -> Bools:
    """Rows at or after the first marked row of their flight."""
    return np.asarray(held_rows(flight, marked)[0] >= 0)


def moving_rows(flights: Flights) -> Bools:
    """Rows to keep: from the first point above ground to the last that is not standing on the ground.

    A flight that never leaves the ground (a vehicle, an aircraft taxiing) keeps its rows between the first and last
    that move.
    """
    flight = flights.flight
    ground = _on_ground(flights)
    standing = ground & (flights.plots.ground_speed_mps == 0.0)
    first = np.flatnonzero(~continues(flight))
    flies = np.logical_or.reduceat(~ground, first)[flight] if len(first) else ground
    begun = _from_first(flight, np.where(flies, ~ground, ~standing))
    not_over = held_rows(flight, ~standing)[1] >= 0
    return np.asarray(begun & not_over)


def started_rows(measurements: Measurements, max_speed_mps: float) -> Bools:
    """Rows to keep: from the first position that is believable as a start; flights of fewer than three go.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time.
    max_speed_mps : float
        Two of the next three positions must be reachable from a start at this speed. [m/s]
    """
    flight = measurements.slot
    at = np.flatnonzero(np.isfinite(measurements.east_m))
    agreeing = np.zeros(len(at), dtype=np.int64)
    asked = np.zeros(len(at), dtype=np.int64)
    for ahead in range(1, WITNESSES + 1):
        here, there = at[:-ahead], at[ahead:]
        same = flight[here] == flight[there]
        asked[: len(here)] += same
        agreeing[: len(here)] += same & _reachable(measurements, here, there, max_speed_mps)
    believable = np.zeros(len(flight), dtype=np.bool_)
    believable[at] = agreeing >= np.minimum(asked, AGREEING)
    kept = _from_first(flight, believable)
    first = np.flatnonzero(~continues(flight))
    count = np.add.reduceat(kept & np.isfinite(measurements.east_m), first, dtype=np.int64) if len(first) else first
    return np.asarray(kept & (count >= LEAST_REPORTS)[flight])


def _reachable(measurements: Measurements, here: Ints, there: Ints, max_speed_mps: float) -> Bools:
    apart_s = measurements.time_s[there] - measurements.time_s[here]
    distance_m: Array = np.hypot(
        measurements.east_m[there] - measurements.east_m[here], measurements.north_m[there] - measurements.north_m[here]
    )
    # Three sigma of the difference of both positions, time jitter included.
    variance = (measurements.r_ee + measurements.r_nn)[here] + (measurements.r_ee + measurements.r_nn)[there]
    jitter_m = max_speed_mps * np.sqrt(measurements.time_variance[here] + measurements.time_variance[there])
    return np.asarray(distance_m <= max_speed_mps * apart_s + 3.0 * np.sqrt(variance) + 3.0 * jitter_m)
