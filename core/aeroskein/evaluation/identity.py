"""Who is who: one track per aircraft, no swaps, no tracks without an aircraft, the right name on each.

Built on the assignment at regular instants (``instants``), where addresses play no part, so that a track with the right
address on the wrong aircraft shows. Terms: a *swap* is a track that goes over to an aircraft from another one; a
*change* is an aircraft that gets another track number; both as in CLEAR-MOT (Bernardin and Stiefelhagen 2008).
"""

from __future__ import annotations

import numpy as np

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.figures import Identity
from aeroskein.evaluation.grouping import group_starts
from aeroskein.evaluation.instants import Picture
from aeroskein.evaluation.timing import delay_of
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.evaluation.windows import Windows
from aeroskein.plots import Array, Bools, Ints
from aeroskein.points import Flag

__all__ = ["false_tracks", "identity_of"]


def identity_of(
    points: PointColumns,
    held: Bools,
    flight: Ints,
    picture: Picture,
    curve: TruthCurve,
    windows: Windows,
    step_s: float,
) -> Identity:
    """Judge the tracks of one product.

    Parameters
    ----------
    points : PointColumns
        The points of one product.
    held : (n,) bool
        Which of them belong to confirmed or coasting tracks.
    flight : (n,) int array
        Flight each point was matched with, -1 where none.
    picture, curve, windows
        The assignment, truth, and when each flight is judged.
    step_s : float
        Time between two steps of the picture. [s]
    """
    changes, swaps = _changes(picture)
    on = picture.truth_track >= 0
    numbers = np.unique(np.stack([picture.truth_flight[on], picture.truth_track[on]], axis=1), axis=0)
    per_flight = np.bincount(numbers[:, 0], minlength=len(curve.names))
    tracked = per_flight > 0
    kind, presences, flagged = false_tracks(points, picture)
    judged_flights = np.unique(picture.truth_flight)
    extra = (picture.flight < 0) & picture.is_near
    return Identity(
        tracks=len(np.unique(points.track_number[held])),
        flights_judged=len(judged_flights),
        flights_tracked=int(tracked.sum()),
        tracks_per_flight=float(per_flight[tracked].mean()) if tracked.any() else None,
        flights_with_one_track=float(np.mean(per_flight[tracked] == 1)) if tracked.any() else None,
        track_changes=changes,
        swaps=swaps,
        extra_track_ratio=float(extra.sum() / len(picture.truth_step)) if len(picture.truth_step) else None,
        false_tracks=int(kind.sum()),
        false_tracks_flagged=int((kind & flagged).sum()),
        false_track_s=float(presences[kind].sum() * step_s),
        beyond_truth_s=float(picture.is_beyond.sum() * step_s),
        initiation=delay_of(_initiation_s(points, held, flight, windows)),
        address_correct=_share(_addresses_right(points, picture, curve)),
        callsign_correct=_share(_callsigns_right(points, picture, curve)),
    )


def false_tracks(points: PointColumns, picture: Picture) -> tuple[Bools, Ints, Bools]:
    """For every track number in the picture, ascending: whether it is false, its presences, whether it was flagged.

    A track is false when most of the time no aircraft was within the cut-off; what it does after the truth of its
    flight has ended does not count. It is flagged when most of its points said ``adsb_unverified`` or ``adsb_suspect``.
    """
    tracks, index = np.unique(picture.track_number, return_inverse=True)
    presences = np.bincount(index[~picture.is_beyond], minlength=len(tracks))
    near = np.bincount(index, weights=picture.is_near, minlength=len(tracks))
    doubtful = (points.flags[picture.point] & int(Flag.ADSB_UNVERIFIED | Flag.ADSB_SUSPECT)) != 0
    warned = np.bincount(index, weights=doubtful, minlength=len(tracks))
    return near < 0.5 * presences, presences, warned > 0.5 * presences


def _changes(picture: Picture) -> tuple[int, int]:
    """Changes of track number on an aircraft; and those among them where the new track came from another aircraft."""
    hit = np.flatnonzero(picture.truth_track >= 0)
    order = hit[np.lexsort((picture.truth_step[hit], picture.truth_flight[hit]))]
    flight, track, step = picture.truth_flight[order], picture.truth_track[order], picture.truth_step[order]
    changed = np.flatnonzero((np.diff(flight) == 0) & (np.diff(track) != 0)) + 1
    previous = _previous_flight(flight, track, step)
    return len(changed), int(np.sum((previous[changed] >= 0) & (previous[changed] != flight[changed])))


def _previous_flight(flight: Ints, track: Ints, step: Ints) -> Ints:
    """The flight that each track was on the time before, -1 at its first."""
    order = np.lexsort((step, track))
    previous = np.full(len(order), -1, dtype=np.int64)
    starts = group_starts(track[order])[:-1]
    previous[order[1:]] = flight[order[:-1]]
    previous[order[starts]] = -1
    return previous


def _initiation_s(points: PointColumns, held: Bools, flight: Ints, windows: Windows) -> Array:
    """Time from the first report of each flight to its first confirmed point. [s]"""
    confirmed = np.full(len(windows.first_s), np.inf)
    rows = np.flatnonzero(held & (flight >= 0))
    np.minimum.at(confirmed, flight[rows], points.time_s[rows])
    return np.where(np.isfinite(confirmed), confirmed, np.nan) - windows.first_s


def _addresses_right(points: PointColumns, picture: Picture, curve: TruthCurve) -> Bools:
    """Tracks with an address, where they are on an aircraft that has one: whether it is the same."""
    on = np.flatnonzero(picture.flight >= 0)
    stated, true = points.address[picture.point[on]], curve.addresses[picture.flight[on]]
    return np.asarray((stated == true)[(stated >= 0) & (true >= 0)])


def _callsigns_right(points: PointColumns, picture: Picture, curve: TruthCurve) -> Bools:
    """The same for callsigns."""
    on = np.flatnonzero(picture.flight >= 0)
    stated, true = points.callsign[picture.point[on]], curve.callsigns[picture.flight[on]]
    return np.asarray((stated == true)[(stated != b"") & (true != b"")])


def _share(right: Bools) -> float | None:
    return float(right.mean()) if len(right) else None
