"""Where the worker's time goes: microseconds per report or point of every stage, at two clock readings a stage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter_ns

__all__ = ["StageClock"]


class StageClock:
    """Adds up time and work by stage; whoever asks gets the mean since the last time they asked."""

    def __init__(self) -> None:
        self._spent_ns: dict[str, int] = {}
        self._units: dict[str, int] = {}
        self._last_us: dict[str, float] = {}

    @contextmanager
    def measure(self, stage: str, units: int) -> Iterator[None]:
        """Time a block that works on ``units`` reports or points; once per batch, never per report."""
        start = perf_counter_ns()
        try:
            yield
        finally:
            self.add(stage, perf_counter_ns() - start, units)

    def add(self, stage: str, spent_ns: int, units: int) -> None:
        """Book time and work."""
        self._spent_ns[stage] = self._spent_ns.get(stage, 0) + spent_ns
        self._units[stage] = self._units.get(stage, 0) + units

    def take_us(self) -> dict[str, float]:
        """Microseconds per unit of each stage since the last call; a stage without work keeps its last value."""
        for stage, units in self._units.items():
            if units:
                self._last_us[stage] = self._spent_ns[stage] / units / 1000.0
                self._spent_ns[stage] = self._units[stage] = 0
        return dict(self._last_us)
