"""Step 0 of the published ADS-B filter: initial indicators of bad positions, and their repair by interpolation.

Three signs, each a limit on differences between neighbours: a spike (three positions with an angle under 20 degrees), a
speed above 340 m/s (reported, or implied by two positions), an acceleration above 5 m/s² (from two speeds, or from
three positions). At one report a second they say more about quantisation and time jitter than about flight, so they
replace positions only where asked for; otherwise they are counted, and the filter's innovation decides.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.flights import interpolated
from aeroskein.lanes import Lanes, continues, held_rows
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints

__all__ = ["ACCELERATION", "SPEED", "SPIKE", "indicators", "repair", "spikes"]

# Bits of the indicator column.
SPIKE: Final = 1
SPEED: Final = 2
ACCELERATION: Final = 4

# After this many positions in a row that cannot be reached from the last good one, that one was the bad one.
BELIEVE_AFTER: Final = 4


def indicators(measurements: Measurements, ground_speed_mps: Array, settings: AdsbFilterSettings) -> NDArray[np.uint8]:
    """Find positions that the published limits call bad.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time; rows without a position have no indicator from it.
    ground_speed_mps : (n,) array
        Reported speed, NaN where none. [m/s]
    settings : AdsbFilterSettings
        The limits.

    Returns
    -------
    (n,) uint8
        ``SPIKE | SPEED | ACCELERATION``, 0 where nothing is wrong.
    """
    flight, time_s = measurements.slot, measurements.time_s
    position_m = np.stack([measurements.east_m, measurements.north_m], axis=1)
    found = np.zeros(len(flight), dtype=np.uint8)
    spike = spikes(flight, position_m, settings.spike_angle_deg, settings.spike_leg_m)
    too_fast = ground_speed_mps > settings.max_speed_mps
    too_fast |= _unreachable(flight, time_s, position_m, settings.max_speed_mps)
    pulled = _speed_changes(flight, time_s, ground_speed_mps) > settings.max_acceleration_mps2
    pulled |= _bends(flight, time_s, position_m) > settings.max_acceleration_mps2
    for bit, where in ((SPIKE, spike), (SPEED, too_fast), (ACCELERATION, pulled)):
        found[where] |= bit
    return found


def _between(flight: Ints) -> Bools:
    """Rows with a neighbour of the same flight on both sides."""
    before = continues(flight)
    after = np.append(before[1:], False) if len(flight) else before
    return before & after


def spikes(flight: Ints, position_m: Array, angle_deg: float, leg_m: float) -> Bools:
    """Rows where the track turns back: the angle between the ways to both neighbours is below ``angle_deg``.

    Parameters
    ----------
    flight : (n,) int64
        Flight of each row, ascending.
    position_m : (n, 2) array
        Positions; NaN makes no spike. [m]
    angle_deg, leg_m : float
        Largest angle, and the shortest leg that counts. [deg, m]
    """
    spike = np.zeros(len(flight), dtype=np.bool_)
    at = np.flatnonzero(_between(flight))
    back, on = position_m[at - 1] - position_m[at], position_m[at + 1] - position_m[at]
    along = (back * on).sum(axis=1)
    across = np.abs(back[:, 0] * on[:, 1] - back[:, 1] * on[:, 0])
    long_enough = np.minimum(np.hypot(*back.T), np.hypot(*on.T)) > leg_m
    spike[at] = long_enough & (np.degrees(np.arctan2(across, along)) < angle_deg)
    return spike


def _unreachable(flight: Ints, time_s: Array, position_m: Array, max_speed_mps: float) -> Bools:
    """Rows that lie too far from the last position that was not itself found bad."""
    bad = np.zeros(len(flight), dtype=np.bool_)
    lanes = Lanes(flight)
    if lanes.steps == 0:
        return bad
    good = lanes.rows(0).copy()
    in_a_row = np.zeros(len(good), dtype=np.int64)
    for k in range(1, lanes.steps):
        rows = lanes.rows(k)
        m = len(rows)
        distance_m = np.hypot(*(position_m[rows] - position_m[good[:m]]).T)
        far = distance_m > max_speed_mps * (time_s[rows] - time_s[good[:m]])
        in_a_row[:m] = np.where(far, in_a_row[:m] + 1, 0)
        believed = in_a_row[:m] > BELIEVE_AFTER
        bad[rows] = far & ~believed
        in_a_row[:m][believed] = 0
        known = np.isfinite(position_m[rows, 0]) | np.isnan(position_m[good[:m], 0])
        good[:m] = np.where(~bad[rows] & known, rows, good[:m])
    return bad


def _speed_changes(flight: Ints, time_s: Array, speed_mps: Array) -> Array:
    """Acceleration from this and the last reported speed, 0 where there is none. [m/s²]"""
    change = np.zeros(len(flight))
    at = np.flatnonzero(continues(flight))
    step_s = time_s[at] - time_s[at - 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        change[at] = np.nan_to_num(np.abs(speed_mps[at] - speed_mps[at - 1]) / step_s, nan=0.0)
    return change


def _bends(flight: Ints, time_s: Array, position_m: Array) -> Array:
    """Acceleration from three positions and times, at the middle one, 0 where there is none. [m/s²]"""
    bend = np.zeros(len(flight))
    at = np.flatnonzero(_between(flight))
    first_s, second_s = time_s[at] - time_s[at - 1], time_s[at + 1] - time_s[at]
    with np.errstate(divide="ignore", invalid="ignore"):
        before = (position_m[at] - position_m[at - 1]) / first_s[:, None]
        after = (position_m[at + 1] - position_m[at]) / second_s[:, None]
        bend[at] = np.nan_to_num(2.0 * np.hypot(*(after - before).T) / (first_s + second_s), nan=0.0, posinf=np.inf)
    return bend


def repair(measurements: Measurements, bad: Bools) -> Array:
    """Positions with the bad ones replaced linearly in time between their neighbours.

    At the ends of a flight there is no neighbour on one side; there the position becomes missing instead of standing
    still, and the filter predicts.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time.
    bad : (n,) bool
        Positions to replace.

    Returns
    -------
    (n, 2) array
        East and north. [m]
    """
    flight, time_s = measurements.slot, measurements.time_s
    repaired = []
    for column in (measurements.east_m, measurements.north_m):
        kept = np.where(bad, np.nan, column)
        filled = np.where(bad, interpolated(flight, time_s, kept), column)
        inside = _has_good_on_both_sides(flight, np.isfinite(kept))
        repaired.append(np.where(bad & ~inside, np.nan, filled))
    return np.stack(repaired, axis=1)


def _has_good_on_both_sides(flight: Ints, good: Bools) -> Bools:
    before, after = held_rows(flight, good)
    return np.asarray((before >= 0) & (after >= 0))
