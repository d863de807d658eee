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
        order = np.lexsort((np.arange(n), sensor, slots))
        s, k, t, p = slots[order], sensor[order], time_s[order], place[order]
        first = np.ones(n, dtype=np.bool_)
        first[1:] = (s[1:] != s[:-1]) | (k[1:] != k[:-1])
        before_t = np.where(first, self.time_s[s, k], np.roll(t, 1))
        before_p = np.where(first[:, None], self.place[s, k], np.roll(p, 1, axis=0))
        same_place = (before_p == p).all(axis=1)
        duplicate = same_place & (t == before_t)
        moving = ~(speed_mps[order] < MOVING_MPS)
        stale = same_place & (t > before_t) & moving
        behind = (t <= before_t) & ~duplicate
        last = np.ones(n, dtype=np.bool_)
        last[:-1] = first[1:]
        # The newest report of the group stays in memory, which need not be the one that came last.
        newest = last & (t >= self.time_s[s, k])
        self.time_s[s[newest], k[newest]] = t[newest]
        self.place[s[newest], k[newest]] = p[newest]
        out = np.empty((3, n), dtype=np.bool_)
        out[:, order] = duplicate, stale, behind
        return out[0], out[1], out[2]
