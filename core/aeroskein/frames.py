"""The fusion planes in use: a table of frames, found by the snapped origin, shared by neighbouring tracks."""

from __future__ import annotations

import numpy as np

from aeroskein import geodesy
from aeroskein.plots import Array, Ints

__all__ = ["FrameTable"]


class FrameTable:
    """Frames by index: ``rows (frames, 12)``."""

    def __init__(self) -> None:
        self.rows: Array = np.zeros((0, 12))
        self._keys: Ints = np.zeros(0, dtype=np.int64)
        self._index: Ints = np.zeros(0, dtype=np.int64)

    def near(self, lat_deg: Array, lon_deg: Array) -> Ints:
        """Index of the frame for each position ``(n,)``, made where there is none yet."""
        lat0, lon0 = geodesy.snap_origin(lat_deg, lon_deg)
        keys = geodesy.origin_keys(lat_deg, lon_deg)
        missing, first = np.unique(keys[~np.isin(keys, self._keys)], return_index=True)
        if len(missing):
            at = np.flatnonzero(~np.isin(keys, self._keys))[first]
            self._add(missing, lat0[at], lon0[at])
        return self._index[np.searchsorted(self._keys, keys)]

    def _add(self, keys: Ints, lat0: Array, lon0: Array) -> None:
        new = np.arange(len(self.rows), len(self.rows) + len(keys))
        self.rows = np.concatenate([self.rows, geodesy.frame_rows(lat0, lon0)])
        place = np.searchsorted(self._keys, keys)
        self._keys = np.insert(self._keys, place, keys)
        self._index = np.insert(self._index, place, new)
