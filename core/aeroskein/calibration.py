"""Calibration: what is applied to reports before anything else, held constant over blocks of ten seconds.

Radar biases come from registration; the difference of geometric height and pressure altitude is learned here, per
aircraft and per place, from elements whose reports carry both. Both change while reports are under way. If a report
were corrected by whatever is known when it happens to arrive, the fused picture would depend on the order of arrival.
So what is known when a ten-second block begins is applied to all reports *stamped* in that block.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.plots import Array, Bools, Ints

__all__ = ["BlockTime", "HeightOffsets"]

BLOCK_S: Final = 10.0
# A place's offset follows the weather, which takes an hour to move it by ten metres; two hundred elements average the
# aircraft's own altimetry errors out. [elements]
CELL_MEMORY: Final = 200.0
# Share of an element's difference that an aircraft's own offset takes over, once some are known.
OWN_SHARE: Final = 0.2
# Before anything is learned: how far pressure altitude and height may differ on an ordinary day. [m]
UNKNOWN_SIGMA_M: Final = 100.0
# What remains: altimetry errors differ from aircraft to aircraft; an aircraft's own is known to a few metres. [m]
CELL_SIGMA_M: Final = 25.0
OWN_SIGMA_M: Final = 6.0


class BlockTime:
    """Says when a new block begins, and which reports belong to the block before it."""

    def __init__(self) -> None:
        self.start_s = -math.inf

    def begins(self, now_s: float) -> bool:
        """Whether the clock has entered a new block; if so, the block of now is this one."""
        start_s = math.floor(now_s / BLOCK_S) * BLOCK_S
        if start_s <= self.start_s:
            return False
        self.start_s = start_s
        return True

    def before(self, stamp_s: Array) -> Bools:
        """Reports ``(n,)`` stamped before the present block."""
        return np.asarray(stamp_s < self.start_s)


class HeightOffsets:
    """Geometric height minus pressure altitude, by track slot and by place: learned now, applied by block.

    Places are the cells of the grid of origins; a report's place is looked up, never a track's, because which cell a
    track began in may hang on which report came first. ``own_m (capacity,)`` is the latest estimate of each aircraft,
    NaN where it never reported both.
    """

    def __init__(self, capacity: int) -> None:
        self.own_m = np.full(capacity, np.nan)
        # Applied in the present block and in the one before, ``(2, capacity)``.
        self._own_applied = np.full((2, capacity), np.nan)
        self._cells: Ints = np.zeros(0, dtype=np.int64)
        self._mean_m = np.zeros(0)
        self._weight = np.zeros(0)
        self._applied_m = np.full((2, 0), np.nan)
        # Mean of all cells, for where nobody has taught anything yet.
        self._everywhere_m = np.full(2, np.nan)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = capacity - len(self.own_m)
        self.own_m = np.concatenate([self.own_m, np.full(more, np.nan)])
        self._own_applied = np.concatenate([self._own_applied, np.full((2, more), np.nan)], axis=1)

    def clear(self, slots: Ints) -> None:
        """Forget what was learned from the tracks that had these slots."""
        self.own_m[slots] = np.nan
        self._own_applied[:, slots] = np.nan

    def learn(self, slots: Ints, lat_deg: Array, lon_deg: Array, difference_m: Array) -> None:
        """Take the mean differences of closed elements ``(n,)``, NaN where no report carried both. [deg, deg, m]"""
        known = np.isfinite(difference_m)
        slots, difference_m = slots[known], difference_m[known]
        if not len(slots):
            return
        own = self.own_m[slots]
        self.own_m[slots] = np.where(np.isnan(own), difference_m, own + OWN_SHARE * (difference_m - own))
        cell = self._cell_of(lat_deg[known], lon_deg[known])
        count = np.bincount(cell, minlength=len(self._mean_m)).astype(np.float64)
        total = np.bincount(cell, weights=difference_m, minlength=len(self._mean_m))
        taught = count > 0.0
        weight = np.minimum(self._weight[taught], CELL_MEMORY)
        self._mean_m[taught] = (self._mean_m[taught] * weight + total[taught]) / (weight + count[taught])
        self._weight[taught] = weight + count[taught]

    def _cell_of(self, lat_deg: Array, lon_deg: Array) -> Ints:
        """Index of each position's cell ``(n,)``; a new cell begins with the mean of all that have learned."""
        keys = geodesy.origin_keys(lat_deg, lon_deg)
        cell, there = self._find(keys)
        if there.all():
            return cell
        new = np.unique(keys[~there])
        at = np.searchsorted(self._cells, new)
        start = self._everywhere_m[0]
        self._cells = np.insert(self._cells, at, new)
        self._mean_m = np.insert(self._mean_m, at, np.nan_to_num(start))
        self._weight = np.insert(self._weight, at, float(np.isfinite(start)))
        self._applied_m = np.insert(self._applied_m, at, np.nan, axis=1)
        return np.searchsorted(self._cells, keys)

    def _find(self, keys: Ints) -> tuple[Ints, Bools]:
        """Index of the cell of each key ``(n,)``, and whether there is one."""
        if not len(self._cells):
            return np.zeros(len(keys), dtype=np.int64), np.zeros(len(keys), dtype=np.bool_)
        at = np.minimum(np.searchsorted(self._cells, keys), len(self._cells) - 1)
        return at, self._cells[at] == keys

    def begin_block(self) -> None:
        """What is known now is applied from now on."""
        self._own_applied = np.stack([self.own_m, self._own_applied[0]])
        learned = np.where(self._weight > 0.0, self._mean_m, np.nan)
        self._applied_m = np.stack([learned, self._applied_m[0]])
        everywhere = self._mean_m[self._weight > 0.0].mean() if (self._weight > 0.0).any() else np.nan
        self._everywhere_m = np.array([everywhere, self._everywhere_m[0]])

    def applied(self, slots: Ints, before: Bools, place: Callable[[Ints], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Offset and its sigma ``(n,)`` for reports of tracks; -1 in ``slots`` stands for no track yet. [m]

        ``place`` gives latitude and longitude of some rows; it is asked only where the aircraft's own is not known.
        """
        offset = self._own_applied[before.astype(np.int64), slots]
        offset[slots < 0] = np.nan
        sigma = np.full(len(slots), OWN_SIGMA_M)
        rest = np.isnan(offset).nonzero()[0]
        if len(rest):
            offset[rest], sigma[rest] = self._of_place(*place(rest), before[rest].astype(np.int64))
        return offset, sigma

    def _of_place(self, lat_deg: Array, lon_deg: Array, block: Ints) -> tuple[Array, Array]:
        of_place = self._everywhere_m[block]
        if len(self._cells):
            at, there = self._find(geodesy.origin_keys(lat_deg, lon_deg))
            here = np.where(there, self._applied_m[block, at], np.nan)
            of_place = np.where(np.isnan(here), of_place, here)
        return np.nan_to_num(of_place), np.where(np.isnan(of_place), UNKNOWN_SIGMA_M, CELL_SIGMA_M)
