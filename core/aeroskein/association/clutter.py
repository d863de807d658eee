"""Density of false plots around a sensor, learned from the plots that never became a track."""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array

__all__ = ["ClutterMap"]

# Square cells, and how far they reach from the sensor. [m]
CELL_M: Final = 50_000.0
REACH_CELLS: Final = 10
# How long plots count. [s]
MEMORY_S: Final = 120.0
# Density assumed at first and mixed in with the weight of one cell: one false plot a scan in 40,000 km². [1/m²]
PRIOR_DENSITY: Final = 1.0 / 40_000e6


class ClutterMap:
    """Exponentially fading count of free plots per cell.

    Parameters
    ----------
    period_s : float
        Time of one scan. [s]
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        side = 2 * REACH_CELLS
        self._count = np.zeros((side, side))
        # Scans that the counts stand for.
        self._scans = 0.0
        self._time_s = np.nan

    def add(self, position_m: Array, time_s: float) -> None:
        """Count plots ``(n, 2)``."""
        step_s = 0.0 if np.isnan(self._time_s) else max(time_s - self._time_s, 0.0)
        self._time_s = np.fmax(self._time_s, time_s)
        keep = np.exp(-step_s / MEMORY_S)
        self._count *= keep
        self._scans = self._scans * keep + step_s / self._period_s
        np.add.at(self._count, self._cells(position_m), 1.0)

    def take_out(self, position_m: Array) -> None:
        """These plots ``(n, 2)`` turned out to be of an aircraft."""
        np.subtract.at(self._count, self._cells(position_m), 1.0)
        np.maximum(self._count, 0.0, out=self._count)

    def density(self, position_m: Array) -> Array:
        """False plots per area and scan around each position, ``(n,)``. [1/m²]"""
        area = CELL_M**2
        scans = max(self._scans, 1.0)
        # Shrunk towards the mean of the cells in use, because a cell sees a plot a minute.
        used = max(float((self._count > 0.05).sum()), 4.0)
        mean = self._count.sum() / scans / (used * area)
        own = self._count[self._cells(position_m)] / scans / area
        density: Array = np.maximum(0.5 * (own + mean), PRIOR_DENSITY)
        return density

    def plots_per_hour(self) -> float:
        """Free plots per hour, at least one a scan."""
        per_scan = max(float(self._count.sum()) / max(self._scans, 1.0), 1.0)
        return per_scan * 3600.0 / self._period_s

    def _cells(self, position_m: Array) -> tuple[np.ndarray, np.ndarray]:
        cell = np.clip(np.floor(position_m / CELL_M).astype(np.int64) + REACH_CELLS, 0, 2 * REACH_CELLS - 1)
        return cell[:, 0], cell[:, 1]
