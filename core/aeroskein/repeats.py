"""Repeats and jumps: what only a report's predecessors can tell about it.

The same report twice is a duplicate. The same place again with a newer time, from a target that moves, is stale: a
receiver that repeats what it last heard. A place that no aircraft could have reached since is implausible.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.lanes import continues
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
        self,
        slots: Ints,
        sensor: NDArray[np.int16],
        time_s: Array,
        place: Array,
        speed_mps: Callable[[Ints], Array],
    ) -> tuple[Bools, Bools, Bools]:
        """Compare reports with their predecessors, and remember them.

        Parameters
        ----------
        slots, sensor, time_s : (n,) arrays
            Reports in order of arrival.
        place : (n, 2) array
            Raw position as the sensor gave it: latitude and longitude, or range and azimuth.
        speed_mps : function
            How fast the targets of some rows move, NaN where unknown; asked only for places that come again. [m/s]

        Returns
        -------
        duplicate, stale, behind : (n,) bool arrays
            The last one marks reports older than the newest of their sensor: only the buffer can tell whether they
            are duplicates.
        """
        n = len(slots)
        cell = slots * self.time_s.shape[1] + sensor
        # Row numbers keep the order of arrival, and numbers that are all different are sorted five times faster.
        order = np.argsort(cell * n + np.arange(n))
        cell, t, p = cell[order], time_s[order], place[order]
        before_t, before_p, newest, duplicate = self._predecessors(cell, t, p)
        same_place = (before_p[:, 0] == p[:, 0]) & (before_p[:, 1] == p[:, 1])
        newer = t > before_t
        duplicate |= same_place & (t == before_t)
        stale = same_place & newer
        rows = stale.nonzero()[0]
        if len(rows):
            stale[rows] = ~(speed_mps(order[rows]) < MOVING_MPS)
        newest &= newer
        self.time_s.reshape(-1)[cell[newest]], self.place.reshape(-1, 2)[cell[newest]] = t[newest], p[newest]
        out = np.empty((3, n), dtype=np.bool_)
        out[:, order] = duplicate, stale, ~(newer | duplicate)
        return out[0], out[1], out[2]

    def _predecessors(self, cell: Ints, t: Array, p: Array) -> tuple[Array, Array, Bools, Bools]:
        """Time and place of the newest report before each; which may be the newest of their cells, which came twice.

        Rows ``(n,)`` are sorted by cell (track and sensor), then in order of arrival; their places are ``(n, 2)``.
        """
        held_t, held_p = self.time_s.reshape(-1), self.place.reshape(-1, 2)
        before_t, before_p = held_t[cell], held_p[cell]
        newest, twice = np.ones(len(cell), dtype=np.bool_), np.zeros(len(cell), dtype=np.bool_)
        follows = continues(cell)
        rows = follows.nonzero()[0]
        if not len(rows):
            return before_t, before_p, newest, twice
        before_t[rows], before_p[rows] = t[rows - 1], p[rows - 1]
        newest[rows - 1] = False
        disordered = t <= before_t
        if disordered.any():
            # In these cells the one before is not always the newest so far.
            rows = _together_with(disordered, follows)
            c, t, p = cell[rows], t[rows], p[rows]
            last, leader = _newest_before(c, t, held_t[c])
            before_t[rows] = np.where(last < 0, held_t[c], t[last])
            before_p[rows] = np.where((last < 0)[:, None], held_p[c], p[last])
            newest[rows] = False
            newest[rows[leader]] = True
            twice[rows] = _repeated(c, t, p)
        return before_t, before_p, newest, twice


def _together_with(some: Bools, follows: Bools) -> Ints:
    """All rows of the groups in which some rows are; rows of one group follow each other. Arrays ``(n,)``."""
    group = np.cumsum(~follows) - 1
    wanted = np.zeros(len(group), dtype=np.bool_)
    wanted[group[some]] = True
    rows: Ints = wanted[group].nonzero()[0]
    return rows


def _newest_before(cell: Ints, time_s: Array, memory_s: Array) -> tuple[Ints, Ints]:
    """The newest report that came before each, of the same track and sensor.

    Parameters
    ----------
    cell, time_s : (n,) arrays
        Reports sorted by track and sensor, which make a cell, within these in order of arrival.
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
    first[1:] = cell[1:] != cell[:-1]
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


def _repeated(cell: Ints, time_s: Array, place: Array) -> Bools:
    """Which reports, in order of arrival, equal an earlier one of the same call. Arrays ``(n,)``, place ``(n, 2)``."""
    n = len(time_s)
    columns = (place[:, 1], place[:, 0], time_s, cell)
    order = np.lexsort((np.arange(n), *columns))
    again = np.zeros(n, dtype=np.bool_)
    again[order[1:]] = np.all([c[order[1:]] == c[order[:-1]] for c in columns], axis=0)
    return again
