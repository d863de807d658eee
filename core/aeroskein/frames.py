"""The fusion planes in use: a table of frames, found by the snapped origin, shared by neighbouring tracks.

Each frame also learns how far geometric height lies above pressure altitude there: aircraft that report both teach it,
and radars, whose plots carry pressure altitude only, need it to turn slant range into ground range.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.plots import Array, Bools, Ints

__all__ = ["FrameTable"]

# The offset follows the weather, which takes an hour to move it by ten metres; a thousand reports average the
# aircraft's own altimetry errors out. [reports]
OFFSET_MEMORY: Final = 1000.0
# Before anything is learned: how far pressure altitude and height may differ on an ordinary day. [m]
UNKNOWN_OFFSET_SIGMA_M: Final = 100.0
# What remains when it is learned: altimetry errors differ from aircraft to aircraft. [m]
KNOWN_OFFSET_SIGMA_M: Final = 25.0


class FrameTable:
    """Frames by index: ``rows (frames, 12)``, and the height offset of each."""

    def __init__(self) -> None:
        self.rows: Array = np.zeros((0, 12))
        self.offset_m: Array = np.zeros(0)
        self._weight: Array = np.zeros(0)
        self._keys: Ints = np.zeros(0, dtype=np.int64)
        self._index: Ints = np.zeros(0, dtype=np.int64)

    def near(self, lat_deg: Array, lon_deg: Array) -> Ints:
        """Index of the frame for each position ``(n,)``, made where there is none yet."""
        lat0, lon0 = geodesy.snap_origin(lat_deg, lon_deg)
        steps = 1.0 / geodesy.ORIGIN_GRID_DEG
        keys = np.round((lat0 + 90.0) * steps).astype(np.int64) * 10_000
        keys += np.round((lon0 + 180.0) * steps).astype(np.int64)
        missing, first = np.unique(keys[~np.isin(keys, self._keys)], return_index=True)
        if len(missing):
            at = np.flatnonzero(~np.isin(keys, self._keys))[first]
            self._add(missing, lat0[at], lon0[at])
        return self._index[np.searchsorted(self._keys, keys)]

    def _add(self, keys: Ints, lat0: Array, lon0: Array) -> None:
        new = np.arange(len(self.rows), len(self.rows) + len(keys))
        self.rows = np.concatenate([self.rows, geodesy.frame_rows(lat0, lon0)])
        # A new frame begins with what its nearest neighbour has learned.
        offset = np.zeros(len(keys))
        taught = np.flatnonzero(self._weight > 0.0)
        if len(taught):
            apart = self.rows[new][:, None, :3] - self.rows[taught][None, :, :3]
            offset = self.offset_m[taught[(apart**2).sum(axis=2).argmin(axis=1)]]
        self.offset_m = np.concatenate([self.offset_m, offset])
        self._weight = np.concatenate([self._weight, np.where(len(taught) > 0, 1.0, 0.0) * np.ones(len(keys))])
        place = np.searchsorted(self._keys, keys)
        self._keys = np.insert(self._keys, place, keys)
        self._index = np.insert(self._index, place, new)

    def learn_offset(self, frame: Ints, offset_m: Array) -> None:
        """Take reported differences height minus altitude ``(n,)`` [m] into their frames."""
        if not len(frame):
            return
        count = np.bincount(frame, minlength=len(self.rows)).astype(np.float64)
        total = np.bincount(frame, weights=offset_m, minlength=len(self.rows))
        taught = count > 0.0
        weight = np.minimum(self._weight[taught], OFFSET_MEMORY)
        self.offset_m[taught] = (self.offset_m[taught] * weight + total[taught]) / (weight + count[taught])
        self._weight[taught] = weight + count[taught]

    def offset_near(self, frame: Ints, known: Bools) -> tuple[Array, Array]:
        """Offset and its sigma ``(n,)`` in each frame, nothing learned where the frame is not ``known``. [m]"""
        n = len(frame)
        if not len(self.rows):
            return np.zeros(n), np.full(n, UNKNOWN_OFFSET_SIGMA_M)
        learned = known & (self._weight[frame] > 0.0)
        offset = np.where(learned, self.offset_m[frame], 0.0)
        return offset, np.where(learned, KNOWN_OFFSET_SIGMA_M, UNKNOWN_OFFSET_SIGMA_M)
