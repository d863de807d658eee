"""Time in what was published: how old a point is when it goes out, times that repeat or go back, numbers left out."""

from __future__ import annotations

import numpy as np

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.figures import Delay, Timing
from aeroskein.evaluation.windows import is_update
from aeroskein.plots import Array
from aeroskein.points import Status

__all__ = ["delay_of", "timing_of"]

# Times nearer than this are the same time; float64 seconds since the epoch resolve a quarter of a microsecond.
_SAME_TIME_S = 1e-6


def delay_of(delay_s: Array) -> Delay:
    """Summary of delays; NaN are left out. [s]"""
    known = delay_s[np.isfinite(delay_s)]
    if len(known) == 0:
        return Delay()
    p50, p95, p99 = np.percentile(known, (50.0, 95.0, 99.0))
    return Delay(count=len(known), p50_s=float(p50), p95_s=float(p95), p99_s=float(p99), max_s=float(known.max()))


def timing_of(points: PointColumns) -> Timing:
    """Judge the times and numbers of one product.

    Parameters
    ----------
    points : PointColumns
        All points of one product, in the order of the file.

    Returns
    -------
    Timing
        ``seq`` figures are None where no point has a number. Each start of the service (``epoch``) counts for itself.
    """
    # The last point of a track repeats the time before it, with the status "terminated": it is no news.
    alive = np.flatnonzero(points.status != int(Status.TERMINATED))
    order = alive[np.lexsort((alive, points.track_number[alive], points.epoch[alive]))]
    same = (np.diff(points.track_number[order]) == 0) & (np.diff(points.epoch[order]) == 0)
    step_s = np.diff(points.time_s[order])[same]
    missing, repeated = _numbers(points)
    return Timing(
        age=delay_of(points.published_s - points.time_s),
        processing=delay_of((points.published_s - points.input_received_s)[is_update(points)]),
        interval=delay_of(step_s),
        times_repeated=int(np.sum(np.abs(step_s) <= _SAME_TIME_S)),
        times_backwards=int(np.sum(step_s < -_SAME_TIME_S)),
        seq_missing=missing,
        seq_repeated=repeated,
    )


def _numbers(points: PointColumns) -> tuple[int | None, int | None]:
    """Numbers left out between the first and the last of each track, and numbers given twice."""
    numbered = np.flatnonzero(points.seq >= 0)
    if len(numbered) == 0:
        return None, None
    order = numbered[np.lexsort((points.seq[numbered], points.track_number[numbered], points.epoch[numbered]))]
    same = (np.diff(points.track_number[order]) == 0) & (np.diff(points.epoch[order]) == 0)
    step = np.diff(points.seq[order])[same]
    return int(np.sum(np.maximum(step - 1, 0))), int(np.sum(step == 0))
