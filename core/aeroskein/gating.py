"""Gates that can open again: which sources have been refused lately, and when to believe them after all.

A gate keeps outliers out, but a track that has gone astray would refuse the truth for ever. So a source that was
refused several times in a row is believed once, with the state's covariance widened to meet it, unless a source at
least as accurate has been accepted meanwhile: then the track is right and the source is wrong.
"""

from __future__ import annotations

from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, Ints

__all__ = ["GATE", "GateMemory", "astray_velocity_variance"]

# Squared statistical distance in the plane beyond which a report is an outlier: six sigma. One good report in
# 65 million lies outside; real tails are heavier, which is why it is not four.
GATE: Final = 36.0
# Refusals in a row after which a source is believed once.
MISSES_TO_OPEN: Final = 4
# Counted no further: a source may be wrong for hours.
MOST_MISSES: Final = 1000
# A state that meets a report which is believed in spite of its gate may have been wrong for about this long, but not
# by more than an aircraft's own speed: a wider velocity would let the next false report in as well. [s], [m/s]
ASTRAY_S: Final = 4.0
ASTRAY_MPS: Final = 250.0


def astray_velocity_variance(off_m2: Array) -> Array:
    """Variance of velocity to add where a state was off by the root of ``off_m2`` (any shape). [m²/s²]"""
    return np.minimum(off_m2 / ASTRAY_S**2, ASTRAY_MPS**2)


class GateMemory:
    """Per lane and sensor: refusals in a row, and the best accuracy accepted from others since they began."""

    def __init__(self, misses: NDArray[np.int16], best_m2: Array) -> None:
        self.misses = misses
        self.best_m2 = best_m2

    @classmethod
    def empty(cls, n: int, sensors: int) -> Self:
        """No refusals so far."""
        return cls(np.zeros((n, sensors), dtype=np.int16), np.full((n, sensors), np.inf))

    def take(self, lanes: Ints) -> GateMemory:
        """A copy for the given lanes."""
        return GateMemory(self.misses[lanes], self.best_m2[lanes])

    def put(self, lanes: Ints, memory: GateMemory) -> None:
        """Write a copy back."""
        self.misses[lanes] = memory.misses
        self.best_m2[lanes] = memory.best_m2

    @property
    def pending(self) -> bool:
        """Whether any source is being refused, so that what is accepted must be remembered."""
        return bool(self.misses.any())

    def opens(self, lanes: Ints, sensor: Ints, trace_m2: Array) -> Bools:
        """Where the next report of ``sensor`` ``(n,)`` with this accuracy ``(n,)`` [m²] is believed in any case."""
        return (self.misses[lanes, sensor] >= MISSES_TO_OPEN) & (trace_m2 < self.best_m2[lanes, sensor])

    def note(self, lanes: Ints, sensor: Ints, trace_m2: Array, accepted: Bools) -> None:
        """Remember what became of one report per lane; arrays ``(n,)``."""
        misses, best = self.misses[lanes], self.best_m2[lanes]
        row = np.arange(len(lanes))
        # What was accepted speaks against every source that is being refused.
        np.minimum(best, np.where(accepted, trace_m2, np.inf)[:, None], out=best)
        best[misses == 0] = np.inf
        misses[row, sensor] = np.where(accepted, 0, np.minimum(misses[row, sensor] + 1, MOST_MISSES))
        best[row[accepted], sensor[accepted]] = np.inf
        self.misses[lanes] = misses
        self.best_m2[lanes] = best
