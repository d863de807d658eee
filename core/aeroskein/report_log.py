"""The report log: the last half minute of accepted and refused reports of all aircraft, for those who ask for them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.plots import Array, Plots
from aeroskein.selection import Selection

__all__ = ["ReportLog"]

# At least this much is promised to consumers. [s]
KEEP_S: Final = 30.0
# Batches that came within this are joined: who asks waits for as many as there are, and the worker with him. [s]
JOIN_S: Final = 1.0


@dataclass(slots=True, eq=False)
class _Batch:
    """Reports as they came, with the positions they were converted to, and when the first and the last came."""

    from_s: float
    until_s: float
    plots: Plots
    lat_deg: Array
    lon_deg: Array


class ReportLog:
    """Reports in order of arrival, by the second."""

    def __init__(self) -> None:
        self._seconds: deque[_Batch] = deque()
        self._open: list[_Batch] = []

    def add(self, now_s: float, plots: Plots, lat_deg: Array, lon_deg: Array) -> None:
        """Keep a batch; positions ``(n,)`` are NaN where nobody could place the report."""
        if self._open and not 0.0 <= now_s - self._open[0].from_s < JOIN_S:
            self._seconds.append(_joined(self._open))
            self._open = []
        self._open.append(_Batch(now_s, now_s, plots, lat_deg, lon_deg))
        while self._seconds and now_s - self._seconds[0].until_s > KEEP_S:
            self._seconds.popleft()

    def select(self, selection: Selection) -> Plots:
        """The reports that match, in order of arrival; a radar report counts by its converted position."""
        parts = []
        if self._open:
            self._open = [_joined(self._open)]
        for batch in (*self._seconds, *self._open):
            match = selection.of_plots(batch.plots, batch.lat_deg, batch.lon_deg)
            if match.any():
                parts.append(batch.plots.take(match))
        return Plots.concatenate(parts)


def _joined(batches: list[_Batch]) -> _Batch:
    if len(batches) == 1:
        return batches[0]
    return _Batch(
        batches[0].from_s,
        batches[-1].until_s,
        Plots.concatenate([b.plots for b in batches]),
        np.concatenate([b.lat_deg for b in batches]),
        np.concatenate([b.lon_deg for b in batches]),
    )
