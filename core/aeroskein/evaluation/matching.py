"""Which flight a point belongs to: by its address, or by where its track is.

A point with an address that truth knows belongs to that flight, however far off it is: a wrong position must count as
an error and not as another aircraft. The others (no address, an address on two tracks, an address that truth does not
have) are followed track by track as in CLEAR-MOT (Bernardin and Stiefelhagen 2008): a track keeps its flight while
it stays inside the gate, and takes the nearest one when it has left it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.neighbours import Pairs, near_pairs
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.plots import Bools, Ints
from aeroskein.points import Flag

__all__ = ["Matches", "match"]


@dataclass(slots=True, eq=False)
class Matches:
    """Flight of every point.

    Attributes
    ----------
    flight : (n,) int64
        Index of the flight, -1 where the point belongs to none.
    by_address : (n,) bool
        Matched by address; the others by position, or not at all.
    """

    flight: Ints
    by_address: Bools


def match(points: PointColumns, curve: TruthCurve, gate_m: float) -> Matches:
    """Find the flight of every point.

    Parameters
    ----------
    points : PointColumns
    curve : TruthCurve
    gate_m : float
        How far a track without a usable address may be from its flight. [m]

    Returns
    -------
    Matches
    """
    flight = flight_of_address(points.address, curve)
    flight[(points.flags & int(Flag.DUPLICATE_ADDRESS)) != 0] = -1
    by_address = flight >= 0
    rest = np.flatnonzero(~by_address)
    if len(rest):
        rest = rest[np.lexsort((points.time_s[rest], points.product[rest], points.track_number[rest]))]
        near = near_pairs(points.time_s[rest], points.lat_deg[rest], points.lon_deg[rest], curve, gate_m)
        series = points.track_number[rest] * 2 + points.product[rest]
        flight[rest] = _follow(series, near)
    return Matches(flight, by_address)


def flight_of_address(address: NDArray[np.int32], curve: TruthCurve) -> Ints:
    """Flight with this address, -1 where there is none or more than one, shape ``(n,)``."""
    known, first, count = np.unique(curve.addresses, return_index=True, return_counts=True)
    usable = (known >= 0) & (count == 1)
    known, first = known[usable], first[usable]
    if len(known) == 0:
        return np.full(len(address), -1, dtype=np.int64)
    place = np.minimum(np.searchsorted(known, address), len(known) - 1)
    return np.where(known[place] == address, first[place], -1).astype(np.int64)


def _follow(series: Ints, near: Pairs) -> Ints:
    """Flight of each point of tracks that are followed by position; ``series`` is sorted, points in time order."""
    start = np.searchsorted(near.point, np.arange(len(series) + 1))
    flight = np.full(len(series), -1, dtype=np.int64)
    current, previous_series = -1, None
    for row, (of_series, first, end) in enumerate(zip(series.tolist(), start[:-1], start[1:], strict=True)):
        if of_series != previous_series:
            current, previous_series = -1, of_series
        if first == end:
            continue
        candidates = near.flight[first:end]
        if current not in candidates:
            current = int(candidates[np.argmin(near.distance_m[first:end])])
        flight[row] = current
    return flight
