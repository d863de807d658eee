"""Publishing: states of tracks and closed elements become fused points, with sequence numbers, sources and flags."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aeroskein import geodesy
from aeroskein.assembly import PlaneState, assemble
from aeroskein.closed import Closed
from aeroskein.engine_state import EngineState
from aeroskein.fusion import Fused
from aeroskein.plots import Array, Ints
from aeroskein.points import Flag, FusedPoints, Product, Status
from aeroskein.vertical import fit_at

__all__ = ["Vertical", "element_points", "element_vertical", "live_points", "live_state"]


def live_points(state: EngineState, slots: Ints, time_s: Array) -> FusedPoints:
    """One live point per track at the given times; what counts since the last point begins anew."""
    live = state.live
    x, position_cov, velocity_cov = live.bank.motion_at(slots, time_s)
    shift = live.place(slots, time_s, x[:2])
    held = (shift[0] != 0.0) | (shift[1] != 0.0)
    if held.any():
        east, north = shift
        x[:2] += shift
        # By as much as it was held back the point is known to be off.
        position_cov += (east * east, east * north, north * north)
    points = _live(state, slots, time_s, (x, position_cov, velocity_cov), state.next_seq(Product.LIVE, slots))
    points.flags[held] |= np.uint16(Flag.GUARDED)
    live.sources[slots] = 0
    live.rejected[slots] = 0
    return points


def live_state(state: EngineState, slots: Ints, time_s: Array, seq: Ints) -> FusedPoints:
    """The live states of tracks at the given times, without publishing anything."""
    return _live(state, slots, time_s, state.live.bank.motion_at(slots, time_s), seq)


def _live(state: EngineState, slots: Ints, time_s: Array, motion: tuple[Array, Array, Array], seq: Ints) -> FusedPoints:
    live, tracks = state.live, state.tracks
    n = len(slots)
    altitude, height, rate = live.vertical.at(slots, time_s)
    status = tracks.status[slots]
    flags = tracks.flags[slots]
    # The last point of a track that ended is a prediction too.
    flags[status >= Status.COASTING] |= np.uint16(Flag.COASTED)
    return assemble(
        Product.LIVE, slots, PlaneState(time_s, *motion, altitude, height, rate),
        tracks, state.frames,
        seq=seq,
        element=np.full(n, -1, dtype=np.int64),
        span_s=np.full((n, 2), np.nan),
        master=state.masters.master[slots],
        sources=live.sources[slots],
        rejected=live.rejected[slots],
        input_received_s=tracks.received_s[slots],
        status=status,
        flags=flags,
    )  # fmt: skip


class Vertical(NamedTuple):
    """Altitude, height and vertical rate at the centres of elements, NaN where unknown, ``(n,)``. [m, m, m/s]"""

    altitude_m: Array
    height_m: Array
    rate_mps: Array


def element_points(
    state: EngineState, closed: Closed, fused: Fused, vertical: Vertical, master: NDArray[np.int16]
) -> FusedPoints:
    """The fused points of closed elements."""
    slots, tracks = closed.slots, state.tracks
    n = len(slots)
    sensor = closed.window.sensor_index
    sensors = len(state.settings.sensors)
    event, lane = np.nonzero(fused.accepted)
    counted = np.bincount(lane * sensors + sensor[event, lane], minlength=n * sensors)
    sources = counted.reshape(n, sensors).astype(np.int32)
    x = np.empty((4, n))
    x[:2] = fused.position_m
    if fused.velocity_mps is not None and fused.velocity_cov is not None:
        x[2:], velocity_cov = fused.velocity_mps, fused.velocity_cov
    else:
        # The live state of that instant: what the forward filter knew at the element's centre without looking ahead.
        x[2:], velocity_cov = closed.estimate.filtered_x[2:4], closed.estimate.filtered_covariance[[12, 13, 17]]
        if state.settings.fusion.mode == "patent":
            velocity_cov = np.full((3, n), np.nan)
    flags = tracks.flags[slots].copy()
    flags[~fused.accepted.any(axis=0)] |= np.uint16(Flag.COASTED)
    flags[fused.guarded] |= np.uint16(Flag.GUARDED)
    return assemble(
        Product.ELEMENT, slots, PlaneState(fused.time_s, x, fused.position_cov, velocity_cov, *vertical),
        tracks, state.frames,
        seq=state.next_seq(Product.ELEMENT, slots),
        element=closed.index,
        span_s=closed.span_s,
        master=master,
        sources=sources,
        rejected=(fused.reason > 0).sum(axis=0, dtype=np.int32),
        input_received_s=np.full(n, np.nan),
        status=tracks.status[slots],
        flags=flags,
    )  # fmt: skip


def element_vertical(state: EngineState, closed: Closed) -> Vertical:
    """Fit the vertical at the centres to the reports around them; learn the difference of height and altitude."""
    window, slots = closed.window, closed.slots
    is_report = window.reported
    altitude_m = np.where(is_report, window.altitude_m, np.nan)
    height_m = np.where(is_report, window.height_m, np.nan)
    apart_m = height_m - altitude_m
    both = closed.inside & np.isfinite(apart_m)
    count = both.sum(axis=0)
    total = np.where(both, apart_m, 0.0).sum(axis=0)
    difference = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    frames = state.frames.rows[state.tracks.frame[slots]]
    state.offsets.learn(slots, *geodesy.from_plane(frames, closed.estimate.x[0], closed.estimate.x[1]), difference)
    offset = state.offsets.own_m[slots]
    has_altitude = np.isfinite(altitude_m)
    barometric = has_altitude.any(axis=0) | np.isfinite(offset)
    value = np.where(has_altitude, altitude_m, height_m - np.where(barometric, offset, 0.0))
    rate = np.where(is_report, window.vertical_rate_mps, np.nan)
    sigma = state.sensors.altitude_sigma_m.take(window.sensor_index)
    fitted, slope, _ = fit_at(closed.centre_s, window.time_s, value, rate, sigma)
    altitude, height = np.where(barometric, fitted, np.nan), np.where(barometric, fitted + offset, fitted)
    unknown = np.isnan(fitted)
    if unknown.any():
        a, h, r = state.live.vertical.at(slots[unknown], closed.centre_s[unknown])
        altitude[unknown], height[unknown], slope[unknown] = a, h, r
    return Vertical(altitude, height, slope)
