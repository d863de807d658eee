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

from aeroskein.axis import axis_stations, interpolate_on_axis, project_on_axis
from aeroskein.closed import Closed
from aeroskein.elements import inside_boundary
from aeroskein.enclosing_circle import smallest_circles
from aeroskein.plots import Array, Bools
from aeroskein.reasons import Reason
from aeroskein.settings import EngineSettings
from aeroskein.spikes import turns_back
from aeroskein.windows import REPORT, Window

__all__ = ["Fused", "diverged", "fuse"]

# A polyline axis has a piece about every second: at 3 degrees a second its chord bends off by less than a metre. [s]
PIECE_S: Final = 1.0
# The output guard: mean distance of the newest accepted reports from their predictions, and how many of them lie how
# far beside the smoothed flight within four seconds of the centre. [sigma], [reports], [sigma], [reports], [s], [m/s]
MEAN_DISTANCE: Final = 3.0
NEWEST: Final = 20
BESIDE_SIGMAS: Final = 4.0
FEWEST: Final = 5
NEAR_S: Final = 4.0
SLOWEST_MPS: Final = 15.0


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
    guarded : (n,) bool
        Where the smoothed state was held back and the filtered one stands.
    """

    time_s: Array
    position_m: Array
    position_cov: Array
    velocity_mps: Array | None
    velocity_cov: Array | None
    accepted: Bools
    reason: NDArray[np.uint8]
    half_width_m: Array
    guarded: Bools


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
    width: Array = np.fmax.reduce(closed.estimate.half_width_m, axis=0, initial=0.0, where=inside)
    return width


def _information(closed: Closed) -> Fused:
    e = closed.estimate
    inside = closed.inside
    guarded = turns_back(closed.before, e.x[:2])
    if guarded.any():
        guarded &= ~turns_back(closed.before, e.filtered_x[:2])
    guarded |= diverged(closed)
    x, covariance = e.x[:4], e.P[:, [0, 0, 1, 2, 2, 3], [0, 1, 1, 2, 3, 3]].T
    if guarded.any():
        x = np.where(guarded, e.filtered_x[:4], x)
        covariance = np.where(guarded, e.filtered_covariance[[0, 1, 7, 12, 13, 17]], covariance)
    return Fused(
        closed.centre_s,
        x[:2],
        covariance[:3],
        x[2:],
        covariance[3:],
        inside & (e.reason == 0),
        e.reason * inside,
        _widest(closed, inside),
        guarded,
    )


def diverged(closed: Closed) -> Bools:
    """Where the smoothed state contradicts the reports that it was made of, ``(n,)``: the published filter's checks.

    Either its accepted reports were surprises on average, or too many of those around the centre lie on one side
    of the smoothed flight. That it makes a spike is the third check, see ``spikes.turns_back``.
    """
    e, w = closed.estimate, closed.window
    accepted = (w.kind == REPORT) & (e.reason == 0)
    newest = accepted
    if len(accepted) > NEWEST:
        newest = accepted & (np.cumsum(accepted[::-1], axis=0)[::-1] <= NEWEST)
    surprise = np.sqrt(np.maximum(np.where(newest, e.distance2, 0.0), 0.0)).sum(axis=0)
    count = newest.sum(axis=0)
    h = w.time_s - closed.centre_s
    vx, vy = e.x[2] + h * e.x[4], e.x[3] + h * e.x[5]
    near = accepted & (np.abs(h) <= NEAR_S) & (vx * vx + vy * vy >= SLOWEST_MPS**2)
    east = w.east_m - e.x[0] - h * (e.x[2] + 0.5 * h * e.x[4])
    north = w.north_m - e.x[1] - h * (e.x[3] + 0.5 * h * e.x[5])
    # Distance across the flight and its variance, times the speed and its square, which saves dividing by them.
    beside = vx * north - vy * east
    variance = vy * vy * w.r_ee - 2.0 * vx * vy * w.r_en + vx * vx * w.r_nn
    far = near & (beside * beside > BESIDE_SIGMAS**2 * variance)
    left = beside > 0.0
    one_side = np.maximum((far & left).sum(axis=0), (far & ~left).sum(axis=0))
    return np.asarray((one_side >= FEWEST) | ((count >= FEWEST) & (surprise > MEAN_DISTANCE * count)))


def _report_covariance(window: Window, x: Array) -> tuple[Array, Array, Array]:
    """Covariances of reports with the time stamp's part turned along the axis's velocity, three ``(K, n)``."""
    tv, vx, vy = window.time_variance, x[2], x[3]
    return window.r_ee + tv * vx * vx, window.r_en + tv * vx * vy, window.r_nn + tv * vy * vy


def _weighted(closed: Closed) -> Fused:
    e, w = closed.estimate, closed.window
    inside = closed.inside
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
        np.zeros(len(some), dtype=np.bool_),
    )


def _patent(closed: Closed, half_width_m: float, chord: bool) -> Fused:
    e, w = closed.estimate, closed.window
    inside = closed.inside
    axis, times = _axis(closed, chord)
    stations = axis_stations(axis)
    points = np.stack([w.east_m.T, w.north_m.T], axis=2)
    along, across, _ = project_on_axis(points, axis)
    # Members are chosen by time; along the axis a report may lie off by as much as across it, not more.
    between = inside_boundary(across, half_width_m)
    between &= (along >= -half_width_m) & (along <= stations[:, -1:] + half_width_m)
    between = between.T
    accepted = inside & between
    centres, _ = smallest_circles(points, accepted.T)
    some: Bools = np.any(accepted, axis=0)
    position = np.where(some, centres.T, e.x[:2])
    along, _, _ = project_on_axis(position.T[:, None, :], axis)
    time = interpolate_on_axis(stations, times, along)[:, 0]
    start, end = closed.span_s[:, 0], closed.span_s[:, 1]
    return Fused(
        np.where(some, np.clip(time, start, end), closed.centre_s),
        position,
        np.full((3, len(some)), np.nan),
        None,
        None,
        accepted,
        np.where(inside & ~between, np.uint8(Reason.OUTSIDE_BOUNDARY), np.uint8(0)),
        np.full(len(some), half_width_m),
        np.zeros(len(some), dtype=np.bool_),
    )


def _axis(closed: Closed, chord: bool) -> tuple[Array, Array]:
    """Points of the axis inside each element ``(n, P, 2)`` and their times ``(n, P)``. [m, s since the epoch]"""
    start, end = closed.span_s[:, :1], closed.span_s[:, 1:]
    pieces = 1 if chord else max(1, int(np.ceil((end - start).max(initial=1.0) / PIECE_S)))
    times = start + (end - start) * np.linspace(0.0, 1.0, pieces + 1)
    h = (times - closed.centre_s[:, None])[:, :, None]
    x = closed.estimate.x.T[:, None, :]
    return x[:, :, 0:2] + h * x[:, :, 2:4] + 0.5 * h * h * x[:, :, 4:6], times
