"""When a flight is judged: from a settling time after its first report until nothing says anything of it any more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.matching import Matches
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.plots import Array, Bools, Ints
from aeroskein.points import Flag, Status

__all__ = ["Reported", "Windows", "is_held", "is_update", "windows_of"]


@dataclass(slots=True, eq=False)
class Reported:
    """When sensors spoke of each flight.

    Attributes
    ----------
    first_s, last_s : (flights,) float64
        First and last report with the flight's address, NaN where there is none. [s since the epoch]
    has_anonymous : bool
        There were reports without address: a flight without any of its own may still have been seen.
    """

    first_s: Array
    last_s: Array
    has_anonymous: bool


@dataclass(slots=True, eq=False)
class Windows:
    """Span in which each flight is judged.

    Attributes
    ----------
    first_s : (flights,) float64
        First report, as far as is known; NaN where a flight was never heard of. [s since the epoch]
    start_s, end_s : (flights,) float64
        The span; NaN where the flight could not be observed. [s since the epoch]
    """

    first_s: Array
    start_s: Array
    end_s: Array

    def contain(self, flight: Ints, time_s: Array) -> Bools:
        """Whether each instant lies in the span of its flight; false for flight -1."""
        if len(self.start_s) == 0:
            return np.zeros(len(flight), dtype=np.bool_)
        safe = np.maximum(flight, 0)
        return np.asarray((flight >= 0) & (time_s >= self.start_s[safe]) & (time_s <= self.end_s[safe]))


def windows_of(
    points: PointColumns, matches: Matches, curve: TruthCurve, from_s: float, reported: Reported | None = None
) -> Windows:
    """Find the span of every flight.

    Parameters
    ----------
    points, matches : PointColumns, Matches
        All points and the flights they belong to. Where there are no reports, the first report is the earliest
        instant they speak of: tentative points count, and so does the start of an element's span.
    curve : TruthCurve
    from_s : float
        Settling time after the first report. [s]
    reported : Reported, optional
        Then a flight is not judged after its last report, nor at all if no report was about it. Without it a flight is
        judged until its truth ends, and one that was never heard of from ``from_s`` after its truth begins.

    Returns
    -------
    Windows
    """
    first = np.full(len(curve.names), np.inf)
    earliest = np.fmin(points.time_s, points.span_s[:, 0])
    known = (matches.flight >= 0) & np.isfinite(earliest)
    np.minimum.at(first, matches.flight[known], earliest[known])
    first = np.where(np.isfinite(first), first, np.nan)
    end = curve.end_s
    start = np.where(np.isfinite(first), first, curve.start_s)
    if reported is not None:
        named = np.isfinite(reported.first_s)
        first = np.where(named, reported.first_s, first)
        start = np.where(named, reported.first_s, start if reported.has_anonymous else np.nan)
        end = np.where(named, np.fmin(reported.last_s, end), end)
    return Windows(first, np.maximum(start + from_s, curve.start_s), end)


def is_held(points: PointColumns) -> Bools:
    """Points of tracks that are confirmed or coasting, shape ``(n,)``."""
    return np.asarray((points.status == int(Status.CONFIRMED)) | (points.status == int(Status.COASTING)))


def is_update(points: PointColumns) -> Bools:
    """Points that carry news: confirmed and not flagged as coasted, shape ``(n,)``."""
    coasted = (points.flags & int(Flag.COASTED)) != 0
    return np.asarray((points.status == int(Status.CONFIRMED)) & ~coasted)
