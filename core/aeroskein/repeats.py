"""Repeats and jumps: what only a report's predecessors can tell about it.

The same report twice is a duplicate. The same place again with a newer time, from a target that moves, is stale: a
receiver that repeats what it last heard. A place that no aircraft could have reached since is implausible.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, Ints

__all__ = ["SensorMemory", "is_implausible"]

# A target that stands may repeat its place truthfully; below this it may be standing. [m/s]
MOVING_MPS: Final = 15.0
# No aircraft in service is faster over ground; the rest is room for noise and for a track that has coasted. [m/s], [m]
FASTEST_MPS: Final = 700.0
LEEWAY_M: Final = 10_000.0


def is_implausible(distance_m: Array, elapsed_s: Array) -> Bools:
    """Whether a report lies further from its track than any aircraft could have flown. Arrays ``(n,)``."""
    return np.asarray(distance_m > LEEWAY_M + FASTEST_MPS * np.abs(elapsed_s))


class SensorMemory:
    """Per track and sensor: time and raw place of the newest report."""

    def __init__(self, capacity: int, sensors: int) -> None:
        self.time_s = np.full((capacity, sensors), -np.inf)
        self.place = np.full((capacity, sensors, 2), np.nan)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = SensorMemory(capacity - len(self.time_s), self.time_s.shape[1])
        self.time_s = np.concatenate([self.time_s, more.time_s])
        self.place = np.concatenate([self.place, more.place])

    def clear(self, slots: Ints) -> None:
        """Forget what was there before."""
        self.time_s[slots] = -np.inf
        self.place[slots] = np.nan

    def compare(
        self, slots: Ints, sensor: NDArray[np.int16], time_s: Array, place: Array, speed_mps: Array
    ) -> tuple[Bools, Bools, Bools]:
        """Compare reports with their predecessors, and remember them.

        Parameters
        ----------
        slots, sensor, time_s : (n,) arrays
            Reports in order of arrival.
        place : (n, 2) array
            Raw position as the sensor gave it: latitude and longitude, or range and azimuth.
        speed_mps : (n,) array
            How fast the target moves, NaN where unknown. [m/s]

        Returns
        -------
        duplicate, stale, behind : (n,) bool arrays
            The last one marks reports older than the newest of their sensor: only the buffer can tell whether they
            are duplicates.
        """
        n = len(slots)
        cell = slots * self.time_s.shape[1] + sensor
        order = np.argsort(cell, kind="stable")
        cell = cell[order]
        s, k, t, p = slots[order], sensor[order], time_s[order], place[order]
        before_t, before_p = self.time_s[s, k], self.place[s, k]
        several = bool((cell[1:] == cell[:-1]).any())
        if several:
            newest, last = _newest_before(s, k, t, before_t)
            before_t = np.where(newest < 0, before_t, t[newest])
            before_p = np.where((newest < 0)[:, None], before_p, p[newest])
        else:
            last = np.flatnonzero(t > before_t)
        same_place = (before_p[:, 0] == p[:, 0]) & (before_p[:, 1] == p[:, 1])
        duplicate = same_place & (t == before_t)
        if several:
            duplicate |= _repeated(s, k, t, p)
        moving = ~(speed_mps[order] < MOVING_MPS)
        stale = same_place & (t > before_t) & moving
        behind = (t <= before_t) & ~duplicate
        self.time_s[s[last], k[last]] = t[last]
        self.place[s[last], k[last]] = p[last]
        out = np.empty((3, n), dtype=np.bool_)
        out[:, order] = duplicate, stale, behind
        return out[0], out[1], out[2]


def _newest_before(slots: Ints, sensor: NDArray[np.int16], time_s: Array, memory_s: Array) -> tuple[Ints, Ints]:
    """The newest report that came before each, of the same track and sensor.

    Parameters
    ----------
    slots, sensor, time_s : (n,) arrays
        Reports sorted by track and sensor, within these in order of arrival.
    memory_s : (n,) array
        Time of the newest one remembered for that track and sensor.

    Returns
    -------
    newest : (n,) int64
        Row of the newest that came before, -1 where that is the one remembered.
    last : (groups,) int64
        Rows that are newer than everything else of their track and sensor, the remembered one included.
    """
    n = len(time_s)
    first = np.ones(n, dtype=np.bool_)
    first[1:] = (slots[1:] != slots[:-1]) | (sensor[1:] != sensor[:-1])
    row = np.arange(n)
    start = np.maximum.accumulate(np.where(first, row, 0))
    # Ranks in place of times, so that a running maximum can be kept for every group at once.
    rank = np.unique(np.concatenate([time_s, memory_s]), return_inverse=True)[1]
    base = np.cumsum(first) * 2 * n
    highest = np.maximum.accumulate(base + np.maximum(rank[:n], rank[n:]))
    before = np.where(first, base + rank[n:], np.roll(highest, 1))
    leads = np.maximum.accumulate(np.where(base + rank[:n] > before, row, -1))
    newest = np.where(first, -1, np.roll(leads, 1))
    ends = np.flatnonzero(np.append(first[1:], np.ones(min(n, 1), dtype=np.bool_)))
    last = leads[ends]
    return np.where(newest < start, -1, newest), last[last >= start[ends]]


def _repeated(slots: Ints, sensor: NDArray[np.int16], time_s: Array, place: Array) -> Bools:
    """Which reports, in order of arrival, equal an earlier one of the same call. Arrays ``(n,)``, place ``(n, 2)``."""
    n = len(time_s)
    columns = (place[:, 1], place[:, 0], time_s, sensor, slots)
    order = np.lexsort((np.arange(n), *columns))
    again = np.zeros(n, dtype=np.bool_)
    again[order[1:]] = np.all([c[order[1:]] == c[order[:-1]] for c in columns], axis=0)
    return again
