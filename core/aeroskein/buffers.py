"""Buffers: per aircraft, the reports that the element estimator may still need, in a ring of fixed depth.

A ring keeps reports of all sensors of one aircraft in order of arrival; whoever reads them sorts by time. What lies
behind the settled time of its track is done with and may be overwritten; a report that arrives behind it is late.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from aeroskein.lanes import ranks
from aeroskein.measurements import COLUMNS, Measurements
from aeroskein.plots import Array, Bools, Ints
from aeroskein.rings import Rings
from aeroskein.settings import EngineSettings

__all__ = ["ReportBuffers", "ring_depth"]

TIME: Final = COLUMNS.index("time_s")
# Two reports of one sensor with the same time and place within this are the same report; rings round places to 4 mm,
# ranges to 3 cm and azimuths to 3e-5 degrees. [s], [m], [m], [deg]
SAME_TIME_S: Final = 1e-5
SAME_PLACE_M: Final = 0.01
SAME_RANGE_M: Final = 0.05
SAME_AZIMUTH_DEG: Final = 5e-5
# Reports that rings have room for, over what the sensors send by their periods in the longest window.
SPARE: Final = 1.5


def ring_depth(settings: EngineSettings) -> int:
    """Reports that a ring must hold: half as many again as the sensors send inside the longest open window.

    The window reaches from the settled time (up to half an element before the open element) over the look-ahead to
    the clock, with a quarter to spare.
    """
    fusion = settings.fusion
    rate = sum(1.0 / s.period_s for s in settings.sensors)
    window_s = (
        1.25 * fusion.element_s * (fusion.lookahead + 2.5) + max(fusion.watermark_s, fusion.watermark_max_s) + 1.0
    )
    slow = max((s.period_s for s in settings.sensors), default=1.0)
    return 8 * math.ceil(min(max(SPARE * rate * window_s, 4.0 * window_s / slow, 24.0), 512.0) / 8.0)


class ReportBuffers:
    """Rings of all tracks; ``rows`` holds ``(capacity, depth)`` reports."""

    def __init__(self, capacity: int, depth: int, precision: type[np.floating[Any]] = np.float32) -> None:
        self.depth = depth
        self.rows = Rings(capacity, depth, precision)
        self._written = np.zeros(capacity, dtype=np.int64)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        self._written = np.concatenate([self._written, np.zeros(capacity - len(self.rows), dtype=np.int64)])
        self.rows.grow(capacity)

    def clear(self, slots: Ints) -> None:
        """Empty the rings of tracks that ended or begin."""
        self.rows.time_s[slots] = -np.inf
        self._written[slots] = 0

    def add(self, reports: Measurements, settled_s: Array) -> Bools:
        """Store reports in order of arrival; rows of one track may follow each other.

        Parameters
        ----------
        reports : Measurements
            Sorted by slot; within a slot in any order.
        settled_s : (n,) array
            Settled time of each report's track; older entries may be overwritten, younger may not. [s]

        Returns
        -------
        (n,) bool array
            False where the ring had no room, because one aircraft sent more than its sensors' periods allow.
        """
        n = len(reports)
        if n == 0:
            return np.zeros(0, dtype=np.bool_)
        slots = reports.slot
        rank = ranks(slots)
        position = (self._written[slots] + rank) % self.depth
        free: Bools = (self.rows.time_s[slots, position] <= settled_s) & (rank < self.depth)
        if not free.all():
            # A refused report leaves no hole: positions are given again among those that are kept.
            kept = free.nonzero()[0]
            slots = slots[kept]
            position = (self._written[slots] + ranks(slots)) % self.depth
            free[kept] = self.rows.time_s[slots, position] <= settled_s[kept]
            slots, position, reports = slots[free[kept]], position[free[kept]], reports.take(free)
        self.rows.put(slots, position, reports)
        np.add.at(self._written, slots, 1)
        return free

    def holds(self, reports: Measurements) -> Bools:
        """Which reports are already there: same sensor, same stamp, same place as it was said. Shape ``(n,)``."""
        rows = self.rows[reports.slot]

        def near(**within: float) -> Bools:
            close = [np.abs(rows[:, :, COLUMNS.index(n)] - getattr(reports, n)[:, None]) < d for n, d in within.items()]
            return np.asarray(np.all(close, axis=0))

        same = np.isfinite(rows[:, :, TIME]) & near(stamp_s=SAME_TIME_S, sensor=0.5)
        # A plot's place in the plane hangs on the height assumed for it, which may have changed meanwhile.
        raw = near(range_m=SAME_RANGE_M, azimuth_deg=SAME_AZIMUTH_DEG)
        same &= raw | near(east_m=SAME_PLACE_M, north_m=SAME_PLACE_M)
        return np.asarray(same.any(axis=1))

    def earliest_s(self, slots: Ints) -> Array:
        """Time of the oldest report in each ring, inf where empty, ``(n,)``. [s since the epoch]"""
        times = self.rows.time_s[slots]
        return np.asarray(np.where(np.isneginf(times), np.inf, times).min(axis=1))

    def reports(self, slots: Ints, from_s: Array) -> Measurements:
        """What the rings of these tracks hold from the given times ``(n,)`` on, sorted by slot, then time."""
        rows = self.rows[slots]
        lane, place = np.nonzero(rows[:, :, TIME] >= from_s[:, None])
        order = np.lexsort((rows[lane, place, TIME], slots[lane]))
        packed = rows[lane, place][order]
        return Measurements(slot=slots[lane][order], **{name: packed[:, i] for i, name in enumerate(COLUMNS[:-1])})
