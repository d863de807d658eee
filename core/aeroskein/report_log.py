"""The report log: the last half minute of accepted and refused reports of all aircraft, for those who ask for them."""

from __future__ import annotations

from collections import deque
from typing import Final

from aeroskein.plots import Array, Plots
from aeroskein.selection import Selection

__all__ = ["ReportLog"]

# At least this much is promised to consumers. [s]
KEEP_S: Final = 30.0


class ReportLog:
    """Batches of reports as they came, with the positions they were converted to."""

    def __init__(self) -> None:
        self._batches: deque[tuple[float, Plots, Array, Array]] = deque()

    def add(self, now_s: float, plots: Plots, lat_deg: Array, lon_deg: Array) -> None:
        """Keep a batch; positions ``(n,)`` are NaN where nobody could place the report."""
        self._batches.append((now_s, plots, lat_deg, lon_deg))
        while self._batches and now_s - self._batches[0][0] > KEEP_S:
            self._batches.popleft()

    def select(self, selection: Selection) -> Plots:
        """The reports that match, in order of arrival; a radar report counts by its converted position."""
        parts = []
        for _, plots, lat_deg, lon_deg in self._batches:
            match = selection.of_plots(plots, lat_deg, lon_deg)
            if match.any():
                parts.append(plots.take(match))
        return Plots.concatenate(parts)
