"""Intake: from raw reports to measurements of known tracks, with a reason for every report that does not get through.

The order is: values and times, sensors that are switched off, identity, place, plausibility, repeats, lateness. Each
stage sees only what the one before let through.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aeroskein.cleaning import check_times, check_values
from aeroskein.plots import Array, Bools, Ints, Plots
from aeroskein.reasons import Reason
from aeroskein.settings import EngineSettings

__all__ = ["Intake", "Verdicts"]


@dataclass(slots=True, eq=False)
class Verdicts:
    """What has become of each report of a batch so far, ``(n,)`` columns in the order of the batch.

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
    def of(cls, n: int) -> Verdicts:
        """All accepted, no tracks yet."""
        return cls(np.zeros(n, dtype=np.uint8), np.full(n, -1, dtype=np.int64))

    def refuse(self, rows: Ints, where: Bools, reason: Reason) -> Ints:
        """Refuse some of the given rows; returns the others."""
        self.reason[rows[where]] = reason
        return rows[~where]

    def counts(self, sensor: NDArray[np.int16], sensors: int) -> Ints:
        """Reports by sensor and reason, ``(sensors, reasons)``."""
        kinds = len(Reason)
        flat = np.bincount(sensor.astype(np.int64) * kinds + self.reason, minlength=sensors * kinds)
        return flat.reshape(sensors, kinds)


class Intake:
    """The checks that need no track: values, times, switched-off sensors."""

    def __init__(self, settings: EngineSettings) -> None:
        self._max_age_s = settings.fusion.max_age_s
        self._max_future_s = settings.fusion.max_future_s
        self.sensor_on: Bools = np.ones(len(settings.sensors), dtype=np.bool_)

    def check(self, plots: Plots, now_s: float | Array) -> Verdicts:
        """Look at each report by itself."""
        verdicts = Verdicts.of(len(plots))
        rows = np.arange(len(plots))
        bad = check_values(plots)
        verdicts.reason[:] = bad
        rows = rows[bad == 0]
        rows = verdicts.refuse(rows, ~self.sensor_on[plots.sensor[rows]], Reason.SENSOR_OFF)
        if len(rows):
            part = plots if len(rows) == len(plots) else plots.take(rows)
            verdicts.reason[rows] = check_times(part, now_s, self._max_age_s, self._max_future_s)
        return verdicts
