"""Publishing: states of tracks and closed elements become fused points, with sequence numbers, sources and flags."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aeroskein.assembly import PlaneState, assemble
from aeroskein.closed import Closed
from aeroskein.engine_state import EngineState
from aeroskein.fusion import Fused
from aeroskein.plots import Array, Ints
from aeroskein.points import Flag, FusedPoints, Product, Status
from aeroskein.vertical import fit_at
from aeroskein.windows import REPORT

__all__ = ["element_points", "live_points", "live_state"]


def live_points(state: EngineState, slots: Ints, time_s: Array) -> FusedPoints:
    """One live point per track at the given times; what counts since the last point begins anew."""
    live = state.live
    live.published_s[slots] = time_s
    points = live_state(state, slots, time_s, state.next_seq(Product.LIVE, slots))
    live.sources[slots] = 0
    live.rejected[slots] = 0
    return points


def live_state(state: EngineState, slots: Ints, time_s: Array, seq: Ints) -> FusedPoints:
    """The live states of tracks at the given times, without publishing anything."""
    live, tracks = state.live, state.tracks
    n = len(slots)
    x, P = live.state_at(slots, time_s)
    altitude, height, rate, _ = live.vertical.at(slots, time_s)
    status = tracks.status[slots]
    flags = tracks.flags[slots].copy()
    flags[status == Status.COASTING] |= np.uint16(Flag.COASTED)
    return assemble(
        Product.LIVE, slots, PlaneState(time_s, x[:4], P[[0, 1, 7]], P[[12, 13, 17]], altitude, height, rate),
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


def element_points(state: EngineState, closed: Closed, fused: Fused, master: NDArray[np.int16]) -> FusedPoints:
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
        live_x, live_P = state.live.state_at(slots, fused.time_s)
        x[2:], velocity_cov = live_x[2:4], live_P[[12, 13, 17]]
        if state.settings.fusion.mode == "patent":
            velocity_cov = np.full((3, n), np.nan)
    altitude, height, rate = _vertical(state, closed)
    flags = tracks.flags[slots].copy()
    flags[sources.sum(axis=1) == 0] |= np.uint16(Flag.COASTED)
    return assemble(
        Product.ELEMENT, slots, PlaneState(fused.time_s, x, fused.position_cov, velocity_cov, altitude, height, rate),
        tracks, state.frames,
        seq=state.next_seq(Product.ELEMENT, slots),
        element=closed.index,
        span_s=closed.span_s,
        master=master,
        sources=sources,
        rejected=(fused.reason > 0).sum(axis=0).astype(np.int32),
        input_received_s=np.full(n, np.nan),
        status=tracks.status[slots],
        flags=flags,
    )  # fmt: skip


def _vertical(state: EngineState, closed: Closed) -> tuple[Array, Array, Array]:
    """Altitude, height and vertical rate at the centres, from the reports around them."""
    window, vertical = closed.window, state.live.vertical
    is_report = window.kind == REPORT
    value = vertical.channel(closed.slots, window.altitude_m, window.height_m)
    value = np.where(is_report, value, np.nan)
    rate = np.where(is_report, window.vertical_rate_mps, np.nan)
    sigma = state.sensors.altitude_sigma_m[window.sensor_index]
    fitted, slope, _ = fit_at(closed.centre_s, window.time_s, value, rate, sigma)
    altitude, height = vertical.split(closed.slots, fitted)
    unknown = np.isnan(fitted)
    if unknown.any():
        a, h, r, _ = vertical.at(closed.slots[unknown], closed.centre_s[unknown])
        altitude[unknown], height[unknown], slope[unknown] = a, h, r
    return altitude, height, slope
