"""The state of the engine: every part that keeps columns by track slot, made, grown and blanked together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import Final

import numpy as np

from aeroskein.buffers import ReportBuffers, ring_depth
from aeroskein.calibration import BlockTime, HeightOffsets
from aeroskein.closing import ElementTable
from aeroskein.conversion import SensorTable
from aeroskein.element_log import ElementLog
from aeroskein.frames import FrameTable
from aeroskein.height_finding import HeightFinder
from aeroskein.lateness import Lateness
from aeroskein.live import LiveProduct
from aeroskein.master_track import MasterChoice
from aeroskein.plots import Ints
from aeroskein.points import Product
from aeroskein.registration import LatencyEstimator
from aeroskein.repeats import SensorMemory
from aeroskein.report_log import ReportLog
from aeroskein.settings import EngineSettings
from aeroskein.tracks import TrackTable

__all__ = ["EngineState", "StageClock"]

# Elements are this much longer where no source is fast.
SLOW_ELEMENTS: Final = 2.0


class EngineState:
    """Parts by slot, and the logs; the attributes are public to the engine and its helpers only."""

    def __init__(self, settings: EngineSettings, first_number: int) -> None:
        self.settings = settings
        self.sensors = SensorTable(settings)
        self.frames = FrameTable()
        self.tracks = TrackTable(settings, first_number)
        capacity, sensors = self.tracks.capacity, len(settings.sensors)
        self.memory = SensorMemory(capacity, sensors)
        self.buffers = ReportBuffers(capacity, ring_depth(settings))
        self.live = LiveProduct(capacity, self.sensors.altitude_sigma_m)
        self.elements = ElementTable(settings, capacity)
        self.masters = MasterChoice(capacity, self.sensors.period_s)
        self.block = BlockTime()
        self.lateness = Lateness(settings)
        self.offsets = HeightOffsets(capacity)
        self.heights = HeightFinder(capacity)
        self.latencies = LatencyEstimator(capacity)
        self.seq = np.zeros((len(Product), capacity), dtype=np.int64)
        self.coasted_s = np.full(capacity, -np.inf)
        self.reports = ReportLog()
        self.element_log = ElementLog(settings.fusion.element_s, SLOW_ELEMENTS * settings.fusion.element_s)

    def make_room(self, n: int) -> bool:
        """See to it that ``n`` more tracks have slots; returns whether there are more slots now."""
        capacity = self.tracks.room_for(n)
        more = capacity - self.tracks.capacity
        if more == 0:
            return False
        for part in (
            self.tracks, self.memory, self.buffers, self.live, self.elements, self.masters, self.offsets,
            self.heights, self.latencies,
        ):  # fmt: skip
            part.grow(capacity)
        self.seq = np.concatenate([self.seq, np.zeros((len(Product), more), dtype=np.int64)], axis=1)
        self.coasted_s = np.concatenate([self.coasted_s, np.full(more, -np.inf)])
        return True

    def clear(self, slots: Ints) -> None:
        """Make the slots of new tracks blank."""
        for part in (
            self.memory, self.buffers, self.live, self.masters, self.offsets, self.heights, self.latencies,
        ):  # fmt: skip
            part.clear(slots)
        self.seq[:, slots] = 0
        self.coasted_s[slots] = -np.inf

    def next_seq(self, product: Product, slots: Ints) -> Ints:
        """Take the next sequence number of each track and product, ``(n,)``."""
        of_product = self.seq[product]
        seq: Ints = of_product[slots]
        of_product[slots] = seq + 1
        return seq


class StageClock:
    """Time per unit of each stage; the clock comes from outside, for the core has none."""

    def __init__(self, clock_s: Callable[[], float] | None) -> None:
        self._clock_s = clock_s if clock_s is not None else float
        self._spent_s: dict[str, float] = defaultdict(float)
        self._units: dict[str, int] = defaultdict(int)
        self._last_s = 0.0

    def start(self, already_s: float = 0.0) -> None:
        """The next ``lap`` counts from here, and what has been spent on it before."""
        self._last_s = self._clock_s() - already_s

    def since_s(self) -> float:
        """What has passed since the last lap. [s]"""
        return self._clock_s() - self._last_s

    def lap(self, stage: str, units: int) -> None:
        """What has passed since the last lap was spent on this stage."""
        now_s = self._clock_s()
        self._spent_s[stage] += now_s - self._last_s
        self._units[stage] += units
        self._last_s = now_s

    def take_us(self) -> dict[str, float]:
        """Microseconds per unit of every stage since this was last asked."""
        spent = {s: 1e6 * t / max(self._units[s], 1) for s, t in self._spent_s.items()}
        self._spent_s.clear()
        self._units.clear()
        return spent
