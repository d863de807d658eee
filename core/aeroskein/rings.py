"""Rings: how buffered reports lie in memory, for every track the same number of places.

Two thirds of what a track costs is its ring, so a report is kept in 80 bytes: its time in full, everything else in
single precision. Metres in a plane of 50 km then end at 2 mm, azimuths at 15 millionths of a degree, and the stamp and
the arrival are kept as differences from the time. Whoever reads gets rows in double precision.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.measurements import COLUMN_COUNT, COLUMNS, Measurements
from aeroskein.plots import Array, Bools, Ints

__all__ = ["Rings"]

# Times beside the first column's; kept as differences from it.
_TIMES: Final = [COLUMNS.index(name) for name in ("received_s", "stamp_s")]


class Rings:
    """Rows ``(capacity, depth, COLUMN_COUNT)`` by slot and place; ``time_s (capacity, depth)`` is -inf where empty.

    Parameters
    ----------
    capacity, depth : int
        Tracks, and reports of each.
    precision : dtype
        Of everything but the time.
    """

    def __init__(self, capacity: int, depth: int, precision: type[np.floating[Any]] = np.float32) -> None:
        self.time_s: Array = np.full((capacity, depth), -np.inf)
        # Pages that nobody has written to cost nothing, and what stands behind an empty place's time is never read.
        self._rest: NDArray[Any] = np.zeros((capacity, depth, COLUMN_COUNT - 1), dtype=precision)

    def __len__(self) -> int:
        return len(self.time_s)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        old, depth = self.time_s.shape
        larger = Rings(capacity, depth, self._rest.dtype.type)
        larger.time_s[:old], larger._rest[:old] = self.time_s, self._rest
        self.time_s, self._rest = larger.time_s, larger._rest

    def __getitem__(self, index: tuple[Ints, Ints] | Ints | Bools) -> Array:
        """Rows by slots, or by slots and places: ``(..., COLUMN_COUNT)``, a copy; NaN behind the time where empty."""
        time_s = self.time_s[index]
        rows = np.empty((*time_s.shape, COLUMN_COUNT))
        rows[..., 0] = time_s
        rows[..., 1:] = self._rest[index]
        for column in _TIMES:
            rows[..., column] += time_s
        empty = np.isneginf(time_s)
        if empty.any():
            rows[empty, 1:] = np.nan
        return rows

    def columns(self, slots: Ints, places: Ints) -> Array:
        """The reports at ``places (K, n)`` of the tracks ``slots (n,)``, column by column: ``(COLUMN_COUNT, K, n)``."""
        at = slots * self.time_s.shape[1] + places
        time_s = self.time_s.take(at)
        columns = np.empty((COLUMN_COUNT, *at.shape))
        columns[0] = time_s
        columns[1:] = np.moveaxis(self._rest.reshape(-1, COLUMN_COUNT - 1).take(at, axis=0), -1, 0)
        for column in _TIMES:
            columns[column] += time_s
        empty = np.isneginf(time_s)
        if empty.any():
            columns[1:, empty] = np.nan
        return columns

    def __setitem__(self, index: tuple[Ints, Ints] | Ints, rows: Array) -> None:
        time_s = rows[..., 0]
        self.time_s[index] = time_s
        rest = rows[..., 1:].copy()
        for column in _TIMES:
            rest[..., column - 1] -= np.where(np.isneginf(time_s), 0.0, time_s)
        self._rest[index] = rest

    def put(self, slots: Ints, places: Ints, reports: Measurements) -> None:
        """Write one report at each slot and place; the manoeuvre detector has not seen them yet."""
        time_s = reports.time_s
        rest = np.zeros((len(reports), COLUMN_COUNT - 1), dtype=self._rest.dtype)
        for column, name in enumerate(COLUMNS[1:-1]):
            values = getattr(reports, name)
            rest[:, column] = values - time_s if column + 1 in _TIMES else values
        self.time_s[slots, places] = time_s
        self._rest[slots, places] = rest

    def set_column(self, name: str, slots: Ints, places: Ints, values: Array) -> None:
        """Write one column, not a time, of some reports."""
        self._rest[slots, places, COLUMNS.index(name) - 1] = values
