"""The master track: which sensor leads an aircraft's track, element by element.

The element method takes the track of highest accuracy as the master and divides it. Accuracy here is the covariance
that the sensor has at this aircraft now, not a rank fixed once; a master that falls silent hands over to the next best
and returns after it has delivered again for a while, so that a single straggler does not make it change to and fro.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, Ints

__all__ = ["MasterChoice"]

# A sensor is silent after this many of its periods, but not before three seconds. [periods], [s]
SILENT_PERIODS: Final = 2.5
SILENT_MIN_S: Final = 3.0
# Accepted reports after which a sensor that was silent may lead again.
REPORTS_TO_RETURN: Final = 3


class MasterChoice:
    """Per track and sensor: last accepted report, accepted reports since it was silent, accuracy."""

    def __init__(self, capacity: int, period_s: Array) -> None:
        sensors = len(period_s)
        self._silent_after_s = np.maximum(SILENT_MIN_S, SILENT_PERIODS * period_s)
        self.last_s = np.full((capacity, sensors), -np.inf)
        self.run = np.zeros((capacity, sensors), dtype=np.int32)
        self.trace_m2 = np.full((capacity, sensors), np.inf)
        self.master = np.full(capacity, -1, dtype=np.int16)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = MasterChoice(capacity - len(self.master), self._silent_after_s / SILENT_PERIODS)
        for name in ("last_s", "run", "trace_m2", "master"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(more, name)]))

    def clear(self, slots: Ints) -> None:
        """Begin tracks without a master."""
        self.last_s[slots], self.run[slots] = -np.inf, 0
        self.trace_m2[slots], self.master[slots] = np.inf, -1

    def choose(
        self, slots: Ints, end_s: Array, time_s: Array, sensor: Ints, trace_m2: Array, accepted: Bools
    ) -> NDArray[np.int16]:
        """Take the reports of closing elements and say which sensor leads each.

        Parameters
        ----------
        slots : (n,) int64
            Tracks.
        end_s : (n,) array
            Ends of the elements. [s since the epoch]
        time_s, sensor, trace_m2, accepted : (K, n) arrays
            Reports up to those ends, in order of time.

        Returns
        -------
        (n,) int16
            Sensor index, -1 where every sensor is silent.
        """
        last, trace = self.last_s[slots], self.trace_m2[slots]
        n, sensors = last.shape
        event, lane = np.nonzero(accepted)
        at = event * n + lane
        # Every report's place in tables of lanes and sensors.
        time_s, place = time_s.take(at), lane * sensors + sensor.take(at)
        count = np.bincount(place, minlength=last.size).reshape(n, sensors)
        total = np.bincount(place, weights=trace_m2.take(at), minlength=last.size).reshape(n, sensors)
        np.divide(total, count, out=trace, where=count > 0)
        # Windows overlap: what an earlier element has counted is not counted again.
        fresh = time_s > last.take(place)
        place, time_s = place[fresh], time_s[fresh]
        more = np.bincount(place, minlength=last.size).reshape(n, sensors)
        first, newest = np.full(last.size, np.inf), last.ravel()
        np.minimum.at(first, place, time_s)
        silent = first.reshape(n, sensors) - last > self._silent_after_s
        np.maximum.at(newest, place, time_s)
        last = newest.reshape(n, sensors)
        run = np.where(silent & (more > 0), 0, self.run[slots]) + more
        self.last_s[slots], self.run[slots], self.trace_m2[slots] = last, np.minimum(run, 1000), trace
        alive = end_s[:, None] - last <= self._silent_after_s
        # A newcomer waits, unless nobody else is there.
        settled = alive & ((run >= REPORTS_TO_RETURN) | (np.arange(last.shape[1]) == self.master[slots][:, None]))
        candidates = np.where(settled.any(axis=1)[:, None], settled, alive)
        best = np.where(candidates, trace, np.inf).argmin(axis=1)
        master = np.where(candidates.any(axis=1), best, -1).astype(np.int16)
        self.master[slots] = master
        return master
