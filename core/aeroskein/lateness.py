"""Lateness: how long the element product should wait for reports that are under way.

The watermark is right where reports come within it. A feed that usually comes later would have its elements closed
before the look-ahead has arrived, and every element would hang on which reports happened to be early. So the wait
follows the delay that 95 % of a fast sensor's reports keep to, never below the watermark and never above its limit.

What is older than the first arrival comes out of a sensor's cache: it waited for us, and says nothing of the feed.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, apply_at
from aeroskein.settings import EngineSettings

__all__ = ["Lateness"]

# Only sensors that report at least this often say much about the last seconds of a look-ahead. [s]
FAST_PERIOD_S: Final = 4.0
SHARE: Final = 0.95
# Delays are counted in steps of this, and forgotten within about half a minute. [s], [1/s]
STEP_S: Final = 0.125
FORGET_PER_S: Final = 0.97
# Fewer reports than this say nothing yet.
FEWEST: Final = 50.0


class Lateness:
    """Delays of every sensor's reports, as counts by step; ``wait_s`` is what follows from them. [s]"""

    def __init__(self, settings: EngineSettings) -> None:
        fusion = settings.fusion
        self._least_s = fusion.watermark_s
        self._most_s = max(fusion.watermark_max_s, fusion.watermark_s)
        self._fast: Bools = np.array([s.period_s < FAST_PERIOD_S for s in settings.sensors], dtype=np.bool_)
        self._counts = np.zeros((len(settings.sensors), int(np.ceil(self._most_s / STEP_S)) + 1))
        self._began_s = np.inf
        self.wait_s = self._least_s

    def note(self, sensor: NDArray[np.int16], time_s: Array, received_s: Array) -> None:
        """Take stamp and arrival ``(n,)`` of accepted reports. [s since the epoch]"""
        if np.isinf(self._began_s):
            self._began_s = float(received_s.min(initial=np.inf))
        live = (time_s >= self._began_s).nonzero()[0]
        delay = np.maximum(received_s[live] - time_s[live], 0.0) / STEP_S
        step = np.minimum(delay, self._counts.shape[1] - 1.0).astype(np.int64)
        apply_at(np.add, self._counts, sensor[live], step, 1.0)

    def follow(self) -> float:
        """Called once a second: what to wait from now on. [s]"""
        self._counts *= FORGET_PER_S
        total = self._counts.sum(axis=1)
        enough = self._fast & (total >= FEWEST)
        wait_s = self._least_s
        if enough.any():
            share = np.cumsum(self._counts[enough], axis=1) / total[enough, None]
            # The end of the first step by which that share of the reports had come.
            wait_s = float(((share < SHARE).sum(axis=1).max() + 1) * STEP_S)
        self.wait_s = min(max(wait_s, self._least_s), self._most_s)
        return self.wait_s
