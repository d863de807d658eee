"""Is there always a track? Updates per interval, long gaps, and seconds that no element covers.

Counted per flight over the time in which it is judged, cut into intervals of 5 s (3 NM separation) and 8 s (5 NM). An
interval has an update if a confirmed point lies in it that is not merely predicted: a coasted point shows
something, but it is no news.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.figures import Continuity, Gap, SpanCover, Worst
from aeroskein.evaluation.grouping import expand_ranges
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.evaluation.windows import Windows, is_update
from aeroskein.plots import Array, Ints

__all__ = [
    "INTERVALS_S",
    "LONG_GAP_RATIO",
    "MIN_INTERVALS",
    "Updates",
    "continuity_of",
    "gaps_of",
    "span_cover",
    "updates_of",
]

# Update intervals at which surveillance for 3 and for 5 NM separation is assessed. [s]
INTERVALS_S: Final = (5.0, 8.0)
# A gap is long beyond three intervals and a tenth: 16.5 s and 26.4 s.
LONG_GAP_RATIO: Final = 3.3
# A flight is named as the one with the fewest updates only if it was expected this often: of a shorter one, a single
# missed interval would say more about where the recording was cut than about the tracker.
MIN_INTERVALS: Final = 10
# Spans further apart than this leave a hole; less is rounding of times in files. [s]
_SPAN_TOLERANCE_S: Final = 1e-5


@dataclass(slots=True, eq=False)
class Updates:
    """Intervals of each flight.

    Attributes
    ----------
    expected, updated : (flights,) int64
        Whole intervals in the judged span for which there is truth; those with at least one update.
    """

    expected: Ints
    updated: Ints


def updates_of(time_s: Array, flight: Ints, windows: Windows, curve: TruthCurve, interval_s: float) -> Updates:
    """Count intervals with and without update.

    Parameters
    ----------
    time_s, flight : (n,) array
        Updates and the flights they belong to; -1 is left out. [s since the epoch]
    windows : Windows
    curve : TruthCurve
    interval_s : float
        [s]
    """
    flights = len(windows.start_s)
    length_s = np.nan_to_num(windows.end_s - windows.start_s)
    whole = np.maximum(np.floor(length_s / interval_s), 0.0).astype(np.int64)
    owner, number = expand_ranges(np.zeros(flights, dtype=np.int64), whole)
    first_cell = np.cumsum(whole) - whole
    middle_s = windows.start_s[owner] + (number + 0.5) * interval_s
    is_expected = curve.at(owner, middle_s).valid
    is_updated = np.zeros(len(owner), dtype=np.bool_)
    inside = np.flatnonzero(windows.contain(flight, time_s))
    cell = np.floor((time_s[inside] - windows.start_s[flight[inside]]) / interval_s).astype(np.int64)
    in_whole = cell < whole[flight[inside]]
    is_updated[first_cell[flight[inside[in_whole]]] + cell[in_whole]] = True
    return Updates(
        expected=np.bincount(owner[is_expected], minlength=flights),
        updated=np.bincount(owner[is_expected & is_updated], minlength=flights),
    )


def continuity_of(
    points: PointColumns, flight: Ints, windows: Windows, curve: TruthCurve, interval_s: float
) -> Continuity:
    """Judge one product at one update interval.

    Parameters
    ----------
    points : PointColumns
        The points of one product.
    flight : (n,) int array
        Flight of each, -1 where none.
    windows, curve, interval_s
        As in ``updates_of``.
    """
    news = is_update(points) & windows.contain(flight, points.time_s)
    updates = updates_of(points.time_s, np.where(news, flight, -1), windows, curve, interval_s)
    expected, updated = int(updates.expected.sum()), int(updates.updated.sum())
    gap_flight, gap_start_s, gap_s = gaps_of(points.time_s[news], flight[news], windows, curve)
    limit_s = LONG_GAP_RATIO * interval_s
    is_long = gap_s > limit_s
    missed = int(np.sum(np.ceil(gap_s[is_long] / interval_s) - 1.0))
    seen = updates.expected >= MIN_INTERVALS
    share = updates.updated[seen] / updates.expected[seen]
    names = np.array(curve.names, dtype=object)[seen] if len(curve.names) else np.zeros(0, dtype=object)
    longest = int(np.argmax(gap_s)) if len(gap_s) else -1
    return Continuity(
        interval_s=interval_s,
        expected=expected,
        updated=updated,
        update_probability=updated / expected if expected else None,
        lowest_flight=Worst(flight=str(names[np.argmin(share)]), value=float(share.min())) if len(share) else None,
        flights_below_97_percent=int(np.sum(share < 0.97)),
        long_gap_limit_s=limit_s,
        long_gaps=int(is_long.sum()),
        long_gap_ratio=missed / expected if expected else None,
        longest_gap=None
        if longest < 0
        else Gap(
            flight=curve.names[gap_flight[longest]],
            start_s=float(gap_start_s[longest]),
            length_s=float(gap_s[longest]),
        ),
    )


def gaps_of(time_s: Array, flight: Ints, windows: Windows, curve: TruthCurve) -> tuple[Ints, Array, Array]:
    """Every time between two updates of a flight, from the start to the end of its span: flight, start, length.

    Where truth itself has a hole, nothing is known, and no gap is counted.
    """
    judged = np.flatnonzero(windows.end_s > windows.start_s)
    owner = np.concatenate([flight, judged, judged])
    instant = np.concatenate([time_s, windows.start_s[judged], windows.end_s[judged]])
    order = np.lexsort((instant, owner))
    owner, instant = owner[order], instant[order]
    same = owner[1:] == owner[:-1]
    owner, start, length = owner[:-1][same], instant[:-1][same], np.diff(instant)[same]
    known = curve.at(owner, start + 0.5 * length).valid
    return owner[known], start[known], length[known]


def span_cover(points: PointColumns, flight: Ints, windows: Windows) -> SpanCover | None:
    """Seconds of tracks and of flights that no element, or more than one, covers; None where points have no spans.

    Parameters
    ----------
    points : PointColumns
        Element points.
    flight : (n,) int array
        Flight of each, -1 where none.
    windows : Windows
    """
    spanned = np.flatnonzero(np.isfinite(points.span_s).all(axis=1))
    if len(spanned) == 0:
        return None
    order = spanned[np.lexsort((points.span_s[spanned, 0], points.track_number[spanned]))]
    same = np.diff(points.track_number[order]) == 0
    step_s = (points.span_s[order[1:], 0] - points.span_s[order[:-1], 1])[same]
    outside_s, judged_s = _uncovered(points.span_s, flight, windows)
    return SpanCover(
        elements=len(spanned),
        hole_s=float(np.sum(step_s[step_s > _SPAN_TOLERANCE_S])),
        overlap_s=float(-np.sum(step_s[step_s < -_SPAN_TOLERANCE_S])),
        judged_s=judged_s,
        outside_s=outside_s,
    )


def _uncovered(span_s: Array, flight: Ints, windows: Windows) -> tuple[float, float]:
    """Seconds of the judged spans of all flights that no element of any of their tracks covers, and all of them."""
    judged_s = float(np.nansum(np.maximum(windows.end_s - windows.start_s, 0.0)))
    rows = np.flatnonzero((flight >= 0) & np.isfinite(span_s).all(axis=1))
    if len(rows) == 0:
        return judged_s, judged_s
    owner = flight[rows]
    start = np.clip(span_s[rows, 0], windows.start_s[owner], windows.end_s[owner])
    end = np.clip(span_s[rows, 1], windows.start_s[owner], windows.end_s[owner])
    use = end > start
    owner, start, end = owner[use], start[use], end[use]
    order = np.lexsort((start, owner))
    owner, start, end = owner[order], start[order], end[order]
    # Furthest end so far in the same flight: a running maximum on a key that never lets flights mix.
    stride_s = float(end.max() - start.min()) + 1.0 if len(end) else 1.0
    origin_s = float(start.min()) if len(start) else 0.0
    reach = np.maximum.accumulate(end - origin_s + owner * stride_s) if len(end) else end
    before = np.append(-np.inf, reach[:-1])
    fresh_from = np.maximum(start - origin_s + owner * stride_s, before)
    covered = np.maximum(end - origin_s + owner * stride_s - fresh_from, 0.0)
    return judged_s - float(covered.sum()), judged_s
