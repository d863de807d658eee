"""Which flights were near which points: all pairs within a distance, found without comparing everything.

Truth is sampled on a coarse clock; sample and point meet through a three-dimensional grid of cells in Earth-centred
coordinates (the classic cell list, Bentley, Stanat, Williams 1977), one clock tick apart at most. Only these few pairs
are then compared exactly, at the point's own time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.evaluation.geometry import east_north_axes, ecef, rotate_to_east_north, up_vector
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.plots import Array, Ints

__all__ = ["Pairs", "near_pairs"]

# Truth moves at most this far during half a tick; faster than any aircraft in a jet stream.
_TICK_S: Final = 4.0
_MAX_SPEED_MPS: Final = 450.0
# Cells along one axis of the grid: covers the Earth with cells of 1 km and more in 14 bits.
_CELLS: Final = 1 << 14
_HALF_GRID_M: Final = 7.5e6
# Pairs compared at a time, so that memory stays bounded.
_CHUNK: Final = 1 << 20


@dataclass(slots=True, eq=False)
class Pairs:
    """Point and flight, near each other; ordered by point.

    Attributes
    ----------
    point, flight : (m,) int64
        Row of the point; index of the flight.
    distance_m : (m,) float64
        Horizontal distance at the point's own time. [m]
    """

    point: Ints
    flight: Ints
    distance_m: Array


def near_pairs(time_s: Array, lat_deg: Array, lon_deg: Array, curve: TruthCurve, gate_m: float) -> Pairs:
    """All pairs of points and flights nearer than a gate, horizontally.

    Parameters
    ----------
    time_s, lat_deg, lon_deg : (n,) array
        The points. [s since the epoch, deg]
    curve : TruthCurve
    gate_m : float
        [m]

    Returns
    -------
    Pairs
    """
    point, flight = _coarse(time_s, lat_deg, lon_deg, curve, gate_m)
    distance = np.full(len(point), np.inf)
    for start in range(0, len(point), _CHUNK):
        part = slice(start, start + _CHUNK)
        row = point[part]
        distance[part] = horizontal_distance_m(time_s[row], lat_deg[row], lon_deg[row], flight[part], curve)
    near = np.flatnonzero(distance < gate_m)
    near = near[np.lexsort((flight[near], point[near]))]
    return Pairs(point[near], flight[near], distance[near])


def horizontal_distance_m(time_s: Array, lat_deg: Array, lon_deg: Array, flight: Ints, curve: TruthCurve) -> Array:
    """Distance of each point from its flight at its own time, infinite where truth says nothing. [m]"""
    truth = curve.at(flight, time_s)
    offset = ecef(up_vector(lat_deg, lon_deg), np.nan_to_num(truth.height_m)) - truth.position
    error = rotate_to_east_north(offset, *east_north_axes(truth.up))
    distance = np.hypot(error[:, 0], error[:, 1])
    # Seen from above, the far side of the Earth is as near as the near side.
    same_side = np.sum(offset * offset, axis=1) < (1e6) ** 2
    return np.where(truth.valid & same_side & np.isfinite(distance), distance, np.inf)


def _coarse(time_s: Array, lat_deg: Array, lon_deg: Array, curve: TruthCurve, gate_m: float) -> tuple[Ints, Ints]:
    """Pairs that may be near: same tick, same or neighbouring cell."""
    nothing = np.zeros(0, dtype=np.int64)
    usable = np.flatnonzero(np.isfinite(time_s) & np.isfinite(lat_deg) & np.isfinite(lon_deg))
    if len(usable) == 0 or len(curve) == 0:
        return nothing, nothing
    cell_m = max(gate_m + 0.5 * _TICK_S * _MAX_SPEED_MPS, 2.0 * _HALF_GRID_M / (_CELLS - 2))
    tick = np.round(time_s[usable] / _TICK_S).astype(np.int64)
    sample_tick, sample_flight, sample_position = _ticks(curve, np.unique(tick))
    sample_key = _key(sample_tick, _cells(sample_position, cell_m))
    order = np.argsort(sample_key, kind="stable")
    sample_key, sample_flight = sample_key[order], sample_flight[order]
    cell = _cells(ecef(up_vector(lat_deg[usable], lon_deg[usable]), np.zeros(len(usable))), cell_m)
    points, flights = [], []
    for shift in np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3):
        key = _key(tick, cell + shift)
        first = np.searchsorted(sample_key, key, side="left")
        count = np.searchsorted(sample_key, key, side="right") - first
        hit = np.repeat(np.arange(len(key)), count)
        within = np.arange(len(hit)) - np.repeat(np.cumsum(count) - count, count)
        points.append(usable[hit])
        flights.append(sample_flight[first[hit] + within])
    return np.concatenate(points), np.concatenate(flights)


def _ticks(curve: TruthCurve, wanted: Ints) -> tuple[Ints, Ints, Array]:
    """Truth on the ticks that are wanted: tick, flight, position on the ellipsoid."""
    start, end = curve.start_s, curve.end_s
    alive = np.flatnonzero(np.isfinite(start))
    # A point half a tick before the first sample still asks for that flight, so edges are held.
    first = np.searchsorted(wanted, np.floor(start[alive] / _TICK_S))
    last = np.searchsorted(wanted, np.ceil(end[alive] / _TICK_S), side="right")
    count = np.maximum(last - first, 0)
    flight = np.repeat(alive, count)
    within = np.arange(len(flight)) - np.repeat(np.cumsum(count) - count, count)
    tick = wanted[np.repeat(first, count) + within]
    instant = np.clip(tick * _TICK_S, start[flight], end[flight])
    states = curve.at(flight, instant)
    kept = states.valid
    level = ecef(states.up[kept], np.zeros(int(kept.sum())))
    return tick[kept], flight[kept], level


def _cells(position: Array, cell_m: float) -> Ints:
    return np.asarray(np.floor((position + _HALF_GRID_M) / cell_m), dtype=np.int64)


def _key(tick: Ints, cell: Ints) -> Ints:
    """One number per tick and cell; ticks count from the year 1970, 21 bits of them would wrap and may."""
    packed = (cell[:, 0] * _CELLS + cell[:, 1]) * _CELLS + cell[:, 2]
    return np.asarray(((tick & 0x1FFFFF) << 42) | packed)
