"""Fusion: one closed element becomes one fused point, in one of three ways.

``information`` takes the estimate at the element's centre. ``weighted`` is the published method with weights per
report by accuracy: inverse variance, in position *and* time, because a place without its time cannot be published.
``patent`` is the published method with the minimum enclosing circle of what lies between the boundary lines; its time
is that of the axis where the circle's centre projects onto it. The last two publish positions only; their velocity is
the live state's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.closed import Closed
from aeroskein.enclosing_circle import smallest_circles
from aeroskein.plots import Array, Bools
from aeroskein.reasons import Reason
from aeroskein.settings import EngineSettings
from aeroskein.windows import Window

__all__ = ["Fused", "fuse"]

# A polyline axis has a piece about every second: at 3 degrees a second its chord bends off by less than a metre. [s]
PIECE_S: Final = 1.0
# A moving axis is no slower than this when a place on it is turned into a time. [m/s]
SLOWEST_AXIS_MPS: Final = 1.0


@dataclass(slots=True, eq=False)
class Fused:
    """Fused points in the plane, lanes in the order of the closed elements.

    Attributes
    ----------
    time_s : (n,) float64
        Instant. [s since the epoch]
    position_m : (2, n) float64
        East and north. [m]
    position_cov : (3, n) float64
        ``[ee, en, nn]``, NaN in mode patent. [m²]
    velocity_mps, velocity_cov : (2, n), (3, n) float64 or None
        None where the live state gives them.
    accepted : (K, n) bool
        Reports of the element that were used.
    reason : (K, n) uint8
        What became of every report in the element's span.
    half_width_m : (n,) float64
        Half distance of the element's boundary lines. [m]
    """

    time_s: Array
    position_m: Array
    position_cov: Array
    velocity_mps: Array | None
    velocity_cov: Array | None
    accepted: Bools
    reason: NDArray[np.uint8]
    half_width_m: Array


def fuse(closed: Closed, settings: EngineSettings) -> Fused:
    """Fuse every closed element by the configured mode."""
    mode = settings.fusion.mode
    if mode == "information":
        return _information(closed)
    if mode == "weighted":
        return _weighted(closed)
    return _patent(closed, settings.patent.half_width_m, settings.patent.axis == "chord")


def _widest(closed: Closed, inside: Bools) -> Array:
    """The element's boundary lines hold all its reports: the widest of their half widths. [m]"""
    width = np.where(inside, closed.estimate.half_width_m, 0.0)
    return np.asarray(np.nan_to_num(width).max(axis=0, initial=0.0))


def _information(closed: Closed) -> Fused:
    e = closed.estimate
    inside = closed.in_span()
    return Fused(
        closed.centre_s,
        e.x[:2],
        np.stack([e.P[:, 0, 0], e.P[:, 0, 1], e.P[:, 1, 1]]),
        e.x[2:4],
        np.stack([e.P[:, 2, 2], e.P[:, 2, 3], e.P[:, 3, 3]]),
        inside & (e.reason == 0),
        np.where(inside, e.reason, 0).astype(np.uint8),
        _widest(closed, inside),
    )


def _report_covariance(window: Window, x: Array) -> tuple[Array, Array, Array]:
    """Covariances of reports with the time stamp's part turned along the axis's velocity, three ``(K, n)``."""
    tv, vx, vy = window.time_variance, x[2], x[3]
    return window.r_ee + tv * vx * vx, window.r_en + tv * vx * vy, window.r_nn + tv * vy * vy


def _weighted(closed: Closed) -> Fused:
    e, w = closed.estimate, closed.window
    inside = closed.in_span()
    accepted = inside & (e.reason == 0)
    ree, ren, rnn = _report_covariance(w, e.x)
    weight = np.where(accepted, 1.0 / (ree + rnn), 0.0)
    total = weight.sum(axis=0)
    some = total > 0.0
    share = weight / np.where(some, total, 1.0)

    def mean(value: Array, otherwise: Array) -> Array:
        offset = np.where(accepted, value - otherwise, 0.0)
        return np.asarray(otherwise + (share * offset).sum(axis=0))

    covariance = np.stack([(share**2 * np.where(accepted, r, 0.0)).sum(axis=0) for r in (ree, ren, rnn)])
    predicted = np.stack([e.P[:, 0, 0], e.P[:, 0, 1], e.P[:, 1, 1]])
    return Fused(
        mean(w.time_s, closed.centre_s),
        np.stack([mean(w.east_m, e.x[0]), mean(w.north_m, e.x[1])]),
        np.where(some, covariance, predicted),
        None,
        None,
        accepted,
        np.where(inside, e.reason, 0).astype(np.uint8),
        _widest(closed, inside),
    )


def _patent(closed: Closed, half_width_m: float, chord: bool) -> Fused:
    e, w = closed.estimate, closed.window
    inside = closed.in_span()
    axis = _axis(closed, chord)
    along, across, _ = _on_axis(axis, w.east_m, w.north_m)
    length = np.hypot(*np.diff(axis.points, axis=0).transpose(1, 0, 2)).sum(axis=0)
    between = (np.abs(across) <= half_width_m) & (along >= -half_width_m) & (along <= length + half_width_m)
    accepted = inside & between
    points = np.stack([w.east_m.T, w.north_m.T], axis=2)
    centres, _ = smallest_circles(points, accepted.T)
    some = accepted.any(axis=0)
    position = np.where(some, centres.T, e.x[:2])
    _, _, time = _on_axis(axis, position[None, 0], position[None, 1])
    start, end = closed.span_s[:, 0], closed.span_s[:, 1]
    return Fused(
        np.where(some, np.clip(time[0], start, end), closed.centre_s),
        position,
        np.full((3, len(some)), np.nan),
        None,
        None,
        accepted,
        np.where(inside & ~between, np.uint8(Reason.OUTSIDE_BOUNDARY), np.uint8(0)),
        np.full(len(some), half_width_m),
    )


@dataclass(slots=True, eq=False)
class _Axis:
    """Points of the axis inside an element ``(pieces + 1, 2, n)`` and their times ``(pieces + 1, n)``."""

    points: Array
    times: Array


def _axis(closed: Closed, chord: bool) -> _Axis:
    start, end = closed.span_s[:, 0], closed.span_s[:, 1]
    pieces = 1 if chord else max(1, int(np.ceil((end - start).max(initial=1.0) / PIECE_S)))
    times = start + (end - start) * np.linspace(0.0, 1.0, pieces + 1)[:, None]
    h = (times - closed.centre_s)[:, None, :]
    x = closed.estimate.x
    return _Axis(x[0:2] + h * x[2:4] + 0.5 * h * h * x[4:6], times)


def _on_axis(axis: _Axis, east_m: Array, north_m: Array) -> tuple[Array, Array, Array]:
    """Arc length, signed offset and time of the nearest place on the axis, for points ``(K, n)``; ends run on."""
    start, step = axis.points[:-1], np.diff(axis.points, axis=0)
    seconds = np.diff(axis.times, axis=0)
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), SLOWEST_AXIS_MPS * np.maximum(seconds, 1e-9))
    unit = step / length[:, None]
    de = east_m[:, None] - start[None, :, 0]
    dn = north_m[:, None] - start[None, :, 1]
    s = de * unit[:, 0] + dn * unit[:, 1]
    c = dn * unit[:, 0] - de * unit[:, 1]
    # Only the first piece runs on backwards and only the last forwards.
    pieces = len(length)
    low = np.where(np.arange(pieces) == 0, -np.inf, 0.0)[:, None]
    high = np.where((np.arange(pieces) == pieces - 1)[:, None], np.inf, length)
    foot = np.clip(s, low, high)
    nearest = np.hypot(s - foot, c).argmin(axis=1)[:, None]

    def pick(value: Array) -> Array:
        return np.asarray(np.take_along_axis(value, nearest, axis=1)[:, 0])

    before = np.concatenate([np.zeros_like(length[:1]), np.cumsum(length, axis=0)[:-1]])
    along = pick(before[None] + foot)
    time = pick(axis.times[None, :-1] + foot / length * seconds)
    return along, pick(c), time
