"""The picture at regular instants: which tracks were there, which flights, and who is who.

At every step each living track is represented by its point nearest in time, and is compared with truth at that point's
own time, so that nothing has to be extrapolated. Tracks and flights nearer than the cut-off are assigned one to one
with the least sum of squared distances; addresses play no part here.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from aeroskein.evaluation.assignment import cheapest_assignment
from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.grouping import expand_ranges, group_starts
from aeroskein.evaluation.neighbours import near_pairs
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.evaluation.windows import Windows
from aeroskein.plots import Array, Bools, Ints

__all__ = ["Picture", "picture_of"]


@dataclass(slots=True, eq=False)
class Picture:
    """Tracks and flights at all steps.

    Attributes
    ----------
    step : (n,) int64
        Step of each presence of a track; the instant is ``step * step_s``.
    track_number : (n,) int64
    point : (n,) int64
        Row of the point that stands for the track.
    flight : (n,) int64
        Flight assigned to it, -1 where none.
    distance_m : (n,) float64
        To that flight, NaN where none. [m]
    is_near : (n,) bool
        Some flight was within the cut-off, assigned or not.
    is_beyond : (n,) bool
        No flight is near, and truth of the flight that the track was on last has ended: nobody knows.
    truth_step, truth_flight : (m,) int64
        Every flight at every step at which it is judged.
    truth_track : (m,) int64
        Track number assigned to it, -1 where it was missed.
    """

    step: Ints
    track_number: Ints
    point: Ints
    flight: Ints
    distance_m: Array
    is_near: Bools
    is_beyond: Bools
    truth_step: Ints
    truth_flight: Ints
    truth_track: Ints


def picture_of(
    points: PointColumns, held: Bools, curve: TruthCurve, windows: Windows, *, step_s: float, cutoff_m: float
) -> Picture:
    """Build the picture of one product.

    Parameters
    ----------
    points : PointColumns
        The points of one product.
    held : (n,) bool
        Which of them belong to confirmed or coasting tracks.
    curve, windows : TruthCurve, Windows
    step_s : float
        Time between two steps. [s]
    cutoff_m : float
        Beyond it a track and a flight have nothing to do with each other. [m]
    """
    rows = np.flatnonzero(held & np.isfinite(points.lat_deg) & np.isfinite(points.lon_deg))
    rows = rows[np.lexsort((points.time_s[rows], points.track_number[rows]))]
    step, point = _presences(points, rows, step_s)
    used, which = np.unique(point, return_inverse=True)
    near = near_pairs(points.time_s[used], points.lat_deg[used], points.lon_deg[used], curve, cutoff_m)
    start = np.searchsorted(near.point, np.arange(len(used) + 1))
    owner, pair = expand_ranges(start[which], np.diff(start)[which])
    chosen = _assign(step[owner], owner, near.flight[pair], near.distance_m[pair], cutoff_m)
    flight, distance = np.full(len(step), -1, dtype=np.int64), np.full(len(step), np.nan)
    flight[owner[chosen]] = near.flight[pair[chosen]]
    distance[owner[chosen]] = near.distance_m[pair[chosen]]
    truth_step, truth_flight = _judged_flights(curve, windows, step_s)
    track, is_near = points.track_number[point], np.bincount(owner, minlength=len(step)) > 0
    last = _last_flight(track, flight)
    return Picture(
        step=step,
        track_number=track,
        point=point,
        flight=flight,
        distance_m=distance,
        is_near=is_near,
        is_beyond=~is_near & (last >= 0) & ~curve.at(last, points.time_s[point]).valid,
        truth_step=truth_step,
        truth_flight=truth_flight,
        truth_track=_lookup(truth_step, truth_flight, step, flight, track),
    )


def _last_flight(track: Ints, flight: Ints) -> Ints:
    """The flight that each track was last on, -1 before its first; rows are ordered by track, then step."""
    row = np.arange(len(flight))
    last = np.maximum.accumulate(np.where(flight >= 0, row, -1)) if len(row) else row
    starts = group_starts(track)
    first = np.repeat(starts[:-1], np.diff(starts))
    return np.where(last >= first, flight[np.maximum(last, 0)], -1) if len(row) else row


def _presences(points: PointColumns, rows: Ints, step_s: float) -> tuple[Ints, Ints]:
    """Step and point of every track at every step at which it lives; ordered by track, then step.

    A point stands for half a step around its time, and for the whole span of its element.
    """
    time_s = points.time_s[rows]
    low = np.fmin(points.span_s[rows, 0], time_s - 0.5 * step_s)
    high = np.fmax(points.span_s[rows, 1], time_s + 0.5 * step_s)
    first = np.ceil(low / step_s).astype(np.int64)
    owner, step = expand_ranges(first, np.maximum(np.ceil(high / step_s).astype(np.int64) - first, 0))
    track = points.track_number[rows][owner]
    away_s = np.abs(step * step_s - time_s[owner])
    order = np.lexsort((away_s, step, track))
    track, step = track[order], step[order]
    fresh = np.append(True, (track[1:] != track[:-1]) | (step[1:] != step[:-1]))[: len(order)]
    return step[fresh], rows[owner[order[fresh]]]


def _assign(step: Ints, owner: Ints, flight: Ints, distance_m: Array, cutoff_m: float) -> Ints:
    """Which of the pairs (presence ``owner``, flight, same step) form the cheapest one-to-one assignment."""
    if len(step) == 0:
        return np.zeros(0, dtype=np.int64)
    flight_key = step * (int(flight.max()) + 1) + flight
    _, flight_index, flight_count = np.unique(flight_key, return_inverse=True, return_counts=True)
    alone = (np.bincount(owner)[owner] == 1) & (flight_count[flight_index] == 1)
    contested = np.flatnonzero(~alone)
    contested = contested[np.argsort(step[contested], kind="stable")]
    chosen = [np.flatnonzero(alone)]
    starts = group_starts(step[contested])
    for low, high in itertools.pairwise(starts):
        pairs = contested[low:high]
        chosen.append(pairs[_assign_step(owner[pairs], flight[pairs], distance_m[pairs], cutoff_m)])
    return np.sort(np.concatenate(chosen))


def _assign_step(owner: Ints, flight: Ints, distance_m: Array, cutoff_m: float) -> Ints:
    """The same for the contested pairs of one step."""
    owners, row = np.unique(owner, return_inverse=True)
    flights, column = np.unique(flight, return_inverse=True)
    gain = np.zeros((len(owners), len(flights)))
    index = np.full(gain.shape, -1, dtype=np.int64)
    gain[row, column] = distance_m**2 - cutoff_m**2
    index[row, column] = np.arange(len(owner))
    if gain.shape[0] > gain.shape[1]:
        gain, index = gain.T, index.T
    chosen = index[np.arange(len(gain)), cheapest_assignment(gain)]
    return np.asarray(chosen[chosen >= 0])


def _judged_flights(curve: TruthCurve, windows: Windows, step_s: float) -> tuple[Ints, Ints]:
    """Every step of every flight that lies in its judged span and has truth."""
    judged = np.flatnonzero(windows.end_s >= windows.start_s)
    first = np.ceil(windows.start_s[judged] / step_s).astype(np.int64)
    last = np.floor(windows.end_s[judged] / step_s).astype(np.int64)
    owner, step = expand_ranges(first, np.maximum(last - first + 1, 0))
    flight = judged[owner]
    known = curve.at(flight, np.asarray(step * step_s, dtype=np.float64)).valid
    return step[known], flight[known]


def _lookup(truth_step: Ints, truth_flight: Ints, step: Ints, flight: Ints, track: Ints) -> Ints:
    """Track assigned to each flight at each step, -1 where none."""
    assigned = np.flatnonzero(flight >= 0)
    found = np.full(len(truth_step), -1, dtype=np.int64)
    if len(assigned) == 0 or len(truth_step) == 0:
        return found
    width = int(max(truth_flight.max(), flight.max())) + 1
    key = step[assigned] * width + flight[assigned]
    order = np.argsort(key, kind="stable")
    key = key[order]
    wanted = truth_step * width + truth_flight
    place = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
    hit = key[place] == wanted
    found[hit] = track[assigned[order[place[hit]]]]
    return found
