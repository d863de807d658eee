"""Windows: the buffered reports of closing elements, gathered from the rings and put in order of time.

Lanes are tracks, sorted so that those with the most events come first: in the k-th round of any pass the lanes that
still have an event are then a plain slice. Besides reports a window holds *marks*, instants at which the passes must
stop without a measurement: the centre of the element, and the time up to which its track will be settled.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.lanes import ranks
from aeroskein.measurements import COLUMNS
from aeroskein.plots import Array, Bools, Ints
from aeroskein.rings import Rings

__all__ = ["CENTRE", "FOUNDING", "NOTHING", "REPORT", "SETTLED", "Window", "gather"]

TIME: Final = COLUMNS.index("time_s")
SENSOR: Final = COLUMNS.index("sensor")

# Kinds of event. A founding report stands at the very start of the window: the state there is made of it, so it counts
# as a report and changes nothing.
FOUNDING: Final = -1
NOTHING: Final = 0
REPORT: Final = 1
CENTRE: Final = 2
SETTLED: Final = 3
# Time of what is no event: later than everything, and finite, so that differences stay numbers. [s]
NEVER_S: Final = 1e18


@dataclass(slots=True, eq=False)
class Window:
    """Events of n lanes in order of time.

    Attributes
    ----------
    lanes : (n,) int64
        Where each lane stood in the caller's order.
    place : (K, n) int64
        Where each report lies in its ring.
    columns : (COLUMN_COUNT, K, n) float64
        The packed reports; only the time is set for marks.
    kind : (K, n) int8
        What each event is; ``NOTHING`` fills up lanes with fewer than K.
    active : list of int
        How many lanes, from the first on, have an event in round k.
    reported : (K, n) bool
        Where there is a report, founding ones included.
    sensor_index : (K, n) int64
        Sensor of each report, 0 where there is none.
    """

    lanes: Ints
    place: Ints
    columns: Array
    kind: NDArray[np.int8]
    active: list[int]
    reported: Bools = field(init=False)
    sensor_index: Ints = field(init=False)

    def __post_init__(self) -> None:
        self.reported = np.abs(self.kind) == REPORT  # founding reports are REPORT with a minus
        self.sensor_index = np.where(self.reported, self.columns[SENSOR], 0.0).astype(np.int64)

    def __getattr__(self, name: str) -> Array:
        # Columns by name, e.g. ``window.east_m``; called only for what is no attribute.
        return self.columns[_INDEX[name]] if name in _INDEX else _missing(name)


_INDEX: Final = {name: index for index, name in enumerate(COLUMNS)}


def _missing(name: str) -> Array:
    raise AttributeError(name)


def gather(rings: Rings, slots: Ints, from_s: Array, until_s: Array, centre_s: Array, settled_s: Array) -> Window:
    """Take the reports with ``from_s <= time <= until_s``, add the marks, and sort.

    Parameters
    ----------
    rings : Rings
        The buffered reports of all tracks.
    slots : (n,) int64
        The closing tracks.
    from_s, until_s : (n,) arrays
        The window; reports at its very start are founding ones. [s since the epoch]
    centre_s, settled_s : (n,) arrays
        The marks; where they coincide there is one mark, ``CENTRE``. [s since the epoch]
    """
    n = len(slots)
    times = rings.time_s[slots]
    inside = (times >= from_s[:, None]) & (times <= until_s[:, None]) & np.isfinite(times)
    at = np.flatnonzero(inside)
    lane, place = np.divmod(at, times.shape[1])
    count = np.bincount(lane, minlength=n)
    # Each lane's reports side by side, and behind them its two marks: a report at the very instant of a mark comes
    # before it, for the sort is stable.
    width = int(count.max(initial=0)) + 2
    keys, places, kinds = np.full(n * width, NEVER_S), np.zeros(n * width, np.int64), np.zeros(n * width, np.int8)
    to = lane * width + ranks(lane)
    keys[to], places[to] = times.take(at), place
    kinds[to] = np.where(keys[to] > from_s[lane], REPORT, FOUNDING)
    one_mark = settled_s == centre_s
    keys[width - 2 :: width], keys[width - 1 :: width] = centre_s, np.where(one_mark, NEVER_S, settled_s)
    kinds[width - 2 :: width], kinds[width - 1 :: width] = CENTRE, np.where(one_mark, NOTHING, SETTLED)
    count += 2 - one_mark
    lanes = np.argsort(-count, kind="stable")
    order = np.argsort(keys.reshape(n, width), axis=1, kind="stable")[lanes, : int(count.max(initial=0))]
    # Where each event stands in these tables, (K, n).
    at = np.ascontiguousarray((lanes[:, None] * width + order).T)
    place, kind = places[at], kinds[at]
    columns = rings.columns(slots[lanes], place)
    columns[TIME] = keys[at]
    return Window(lanes, place, columns, kind, np.count_nonzero(kind, axis=1).tolist())
