"""Intake: the reports of one call on their way to their tracks, with a reason for every one that does not get there.

``Verdicts`` keeps what became of each report in the order they came; ``Batch`` carries those that are still on the way
through the stages. The first stage is here too: what needs no track (values, times, switched-off sensors).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aeroskein.applied_biases import CORRECTED
from aeroskein.cleaning import check_times, check_values
from aeroskein.conversion import Located
from aeroskein.plots import Array, Bools, Ints, Plots
from aeroskein.reasons import Reason
from aeroskein.settings import EngineSettings

__all__ = ["Batch", "Intake", "Verdicts"]


@dataclass(slots=True, eq=False)
class Verdicts:
    """What has become of each report of a call so far, ``(n,)`` columns in the order in which they came.

    Attributes
    ----------
    reason : uint8
        ``Reason``, 0 while accepted.
    slot : int64
        Track, -1 where none.
    """

    reason: NDArray[np.uint8]
    slot: Ints

    @classmethod
    def of(cls, reason: NDArray[np.uint8]) -> Verdicts:
        """What the first checks found; no tracks yet."""
        return cls(reason, np.full(len(reason), -1, dtype=np.int64))

    def counts(self, sensor: NDArray[np.int16], sensors: int) -> Ints:
        """Reports by sensor and reason, ``(sensors, reasons)``."""
        kinds = len(Reason)
        flat = np.bincount(sensor.astype(np.int64) * kinds + self.reason, minlength=sensors * kinds)
        return flat.reshape(sensors, kinds)


@dataclass(slots=True, eq=False)
class Batch:
    """Reports that are still on their way, side by side.

    Attributes
    ----------
    rows : (n,) int64
        Their places in the call.
    raw, plots : Plots
        As reported, and corrected for registration.
    located : Located
        Where they are on the globe.
    slot : (n,) int64
        Their tracks, -1 where none yet.
    """

    rows: Ints
    raw: Plots
    plots: Plots
    located: Located
    slot: Ints

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, which: NDArray[Any]) -> Batch:
        """The given reports (an index array or a boolean mask), in that order."""
        raw = self.raw.take(which)
        # What registration corrects are three columns; the others are shared.
        plots = raw if self.plots is self.raw else replace(raw, **{c: getattr(self.plots, c)[which] for c in CORRECTED})
        return Batch(self.rows[which], raw, plots, self.located.take(which), self.slot[which])

    def without(self, refused: Bools, reason: Reason, verdicts: Verdicts) -> Batch:
        """Refuse some; the others go on."""
        if not refused.any():
            return self
        verdicts.reason[self.rows[refused]] = reason
        return self.take(~refused)


class Intake:
    """The checks that need no track: values, times, switched-off sensors."""

    def __init__(self, settings: EngineSettings) -> None:
        self._max_age_s = settings.fusion.max_age_s
        self._max_future_s = settings.fusion.max_future_s
        self.sensor_on: Bools = np.ones(len(settings.sensors), dtype=np.bool_)

    def check(self, plots: Plots, now_s: float | Array) -> Verdicts:
        """Look at each report by itself."""
        reason = check_values(plots)
        if not self.sensor_on.all():
            reason[(reason == 0) & ~self.sensor_on[plots.sensor]] = Reason.SENSOR_OFF
        times = check_times(plots, now_s, self._max_age_s, self._max_future_s)
        return Verdicts.of(np.where(reason == 0, times, reason))
