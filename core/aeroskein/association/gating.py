"""Coarse gate: which tracks are near which plots, without comparing all with all.

Points are sorted into cubes of the earth-centred frame, so that it works everywhere on the globe, poles and
antimeridian included. The key of a cube keeps z last: cubes above each other are neighbours in the sorted list, and the
27 cubes around a plot are 9 ranges of it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Ints

__all__ = ["PointGrid"]

# Bits per axis of a cube's key; cubes of 10 m still reach beyond the earth.
_BITS: Final = 21
_OFFSET: Final = 1 << (_BITS - 1)
# Smallest cube: below it, keys would no longer fit. [m]
CELL_MIN_M: Final = 10.0
_COLUMNS: Final = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)], dtype=np.int64)


class PointGrid:
    """Points that can be asked for their neighbourhood.

    Parameters
    ----------
    points_m : (m, 3) array
        ECEF positions; rows with NaN are nowhere. [m]
    reach_m : float
        Largest distance that will be asked for. [m]
    """

    def __init__(self, points_m: Array, reach_m: float) -> None:
        self._reach_m = max(float(reach_m), CELL_MIN_M)
        self._points_m = points_m
        finite = np.flatnonzero(np.isfinite(points_m).all(axis=1))
        keys = _keys(self._cells(points_m[finite]))
        order = np.argsort(keys, kind="stable")
        self._rows = finite[order]
        self._keys = keys[order]

    def near(self, queries_m: Array, distance_m: Array | float) -> tuple[Ints, Ints]:
        """Find all points within a distance of each query.

        Parameters
        ----------
        queries_m : (n, 3) array
            ECEF positions; rows with NaN have no neighbours. [m]
        distance_m : (n,) array or float
            Up to ``reach_m``. [m]

        Returns
        -------
        query, point : (p,) int64 arrays
            Pairs of rows, ordered by query, then by point.
        """
        asked = np.flatnonzero(np.isfinite(queries_m).all(axis=1))
        cells = self._cells(queries_m[asked])
        # (n, 9, 3): the middle cube of each of the nine columns.
        middle = np.repeat(cells[:, None, :], len(_COLUMNS), axis=1)
        middle[:, :, :2] += _COLUMNS
        keys = _keys(middle)
        first = np.searchsorted(self._keys, keys - 1, side="left").reshape(-1)
        last = np.searchsorted(self._keys, keys + 1, side="right").reshape(-1)
        count = last - first
        query = np.repeat(np.repeat(asked, len(_COLUMNS)), count)
        start = np.repeat(first - (np.cumsum(count) - count), count)
        point = self._rows[start + np.arange(len(start))]
        limit_m = np.broadcast_to(np.minimum(distance_m, self._reach_m), (len(queries_m),))[query]
        step_m = queries_m[query] - self._points_m[point]
        inside = np.einsum("pc,pc->p", step_m, step_m) <= limit_m**2
        query, point = query[inside], point[inside]
        order = np.lexsort((point, query))
        return query[order], point[order]

    def _cells(self, points_m: Array) -> Ints:
        return np.floor(points_m / self._reach_m).astype(np.int64) + _OFFSET


def _keys(cells: Ints) -> Ints:
    keys: Ints = (cells[..., 0] << (2 * _BITS)) | (cells[..., 1] << _BITS) | cells[..., 2]
    return keys
