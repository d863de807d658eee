"""Calibration: what is applied to reports before anything else, held constant over blocks of ten seconds.

Radar biases come from registration; the difference of geometric height and pressure altitude is learned here, per
aircraft and per frame, from elements whose reports carry both. Both change while reports are under way. If a report
were corrected by whatever is known when it happens to arrive, the fused picture would depend on the order of arrival.
So what is known when a ten-second block begins is applied to all reports *stamped* in that block.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["BlockTime", "HeightOffsets"]

BLOCK_S: Final = 10.0
# A frame's offset follows the weather, which takes an hour to move it by ten metres; two hundred elements average the
# aircraft's own altimetry errors out. [elements]
FRAME_MEMORY: Final = 200.0
# Share of an element's difference that an aircraft's own offset takes over, once some are known.
OWN_SHARE: Final = 0.2
# Before anything is learned: how far pressure altitude and height may differ on an ordinary day. [m]
UNKNOWN_SIGMA_M: Final = 100.0
# What remains: altimetry errors differ from aircraft to aircraft; an aircraft's own is known to a few metres. [m]
FRAME_SIGMA_M: Final = 25.0
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
    """Geometric height minus pressure altitude, by track slot and by frame: learned now, applied by block.

    ``own_m (capacity,)`` is the latest estimate, NaN where an aircraft never reported both.
    """

    def __init__(self, capacity: int) -> None:
        self.own_m = np.full(capacity, np.nan)
        # Applied in the present block and in the one before, ``(2, capacity)``.
        self._own_applied = np.full((2, capacity), np.nan)
        self._frame_m = np.zeros(0)
        self._frame_weight = np.zeros(0)
        self._frame_applied = np.full((2, 0), np.nan)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = capacity - len(self.own_m)
        self.own_m = np.concatenate([self.own_m, np.full(more, np.nan)])
        self._own_applied = np.concatenate([self._own_applied, np.full((2, more), np.nan)], axis=1)

    def clear(self, slots: Ints) -> None:
        """Forget what was learned from the tracks that had these slots."""
        self.own_m[slots] = np.nan
        self._own_applied[:, slots] = np.nan

    def make_frames(self, count: int) -> None:
        """Keep step with the table of frames; a new frame begins with the mean of all that have learned."""
        more = count - len(self._frame_m)
        if more <= 0:
            return
        learned = self._frame_weight > 0.0
        start = float(self._frame_m[learned].mean()) if learned.any() else 0.0
        self._frame_m = np.concatenate([self._frame_m, np.full(more, start)])
        self._frame_weight = np.concatenate([self._frame_weight, np.full(more, 1.0 if learned.any() else 0.0)])
        known = np.full((2, more), start if learned.any() else np.nan)
        self._frame_applied = np.concatenate([self._frame_applied, known], axis=1)

    def learn(self, slots: Ints, frame: Ints, difference_m: Array) -> None:
        """Take the mean differences of closed elements ``(n,)``, NaN where no report carried both. [m]"""
        known = np.isfinite(difference_m)
        slots, frame, difference_m = slots[known], frame[known], difference_m[known]
        if not len(slots):
            return
        own = self.own_m[slots]
        self.own_m[slots] = np.where(np.isnan(own), difference_m, own + OWN_SHARE * (difference_m - own))
        count = np.bincount(frame, minlength=len(self._frame_m)).astype(np.float64)
        total = np.bincount(frame, weights=difference_m, minlength=len(self._frame_m))
        taught = count > 0.0
        weight = np.minimum(self._frame_weight[taught], FRAME_MEMORY)
        self._frame_m[taught] = (self._frame_m[taught] * weight + total[taught]) / (weight + count[taught])
        self._frame_weight[taught] = weight + count[taught]

    def begin_block(self) -> None:
        """What is known now is applied from now on."""
        self._own_applied = np.stack([self.own_m, self._own_applied[0]])
        learned = np.where(self._frame_weight > 0.0, self._frame_m, np.nan)
        self._frame_applied = np.stack([learned, self._frame_applied[0]])

    def applied(self, slots: Ints, frame: Ints, before: Bools) -> tuple[Array, Array]:
        """Offset and its sigma ``(n,)`` for reports of tracks; -1 in ``slots`` stands for no track yet. [m]"""
        block = before.astype(np.int64)
        known = slots >= 0
        at = np.where(known, slots, 0)
        own = np.where(known, self._own_applied[block, at], np.nan)
        if len(self._frame_m):
            of_frame = np.where(known, self._frame_applied[block, np.where(known, frame, 0)], np.nan)
        else:
            of_frame = np.full(len(slots), np.nan)
        offset = np.where(np.isnan(own), of_frame, own)
        sigma = np.where(np.isnan(own), np.where(np.isnan(of_frame), UNKNOWN_SIGMA_M, FRAME_SIGMA_M), OWN_SIGMA_M)
        return np.nan_to_num(offset), sigma
