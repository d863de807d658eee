"""Filtered flights as points of the message contract, so that whatever reads fused files reads them too.

Unsmoothed estimates use nothing later than their report: they are live points. Smoothed ones are elements of one report
each: the span of a report reaches from the middle between it and the one before to the middle between it and the next,
so spans are contiguous and half-open as the contract wants them.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.adsb_filter.record import Filtered
from aeroskein.flights import Flights, interpolated
from aeroskein.lanes import continues, held_rows
from aeroskein.planes import Planes
from aeroskein.plots import ON_GROUND, Array, Bools, Ints
from aeroskein.points import Flag, FusedPoints, Product, Status
from aeroskein.units import wrap_azimuth_deg

__all__ = ["COAST_LIMIT_S", "fused_points"]

# A live track without an accepted report for longer is terminated, not published. [s]
COAST_LIMIT_S: Final = 30.0
# The last element of a track ends this long after its report: spans are half-open and must hold it. [s]
LAST_SPAN_S: Final = 1e-3


def fused_points(
    flights: Flights, planes: Planes, height_m: Array, result: Filtered, guarded: Bools, *, smoothed: bool, sensors: int
) -> FusedPoints:
    """Make one point per report.

    Parameters
    ----------
    flights : Flights
        The reports.
    planes : Planes
        The flights' planes.
    height_m : (n,) array
        Height of each, for speeds over ground at the aircraft's height; NaN counts as 0. [m]
    result : Filtered
        One estimate per report.
    guarded : (n,) bool
        Estimates that are a fallback because a better one was rejected.
    smoothed : bool
        Elements instead of live points.
    sensors : int
        How many sensors are configured.
    """
    plots, flight = flights.plots, flights.flight
    # Of several reports at one instant the last has seen them all.
    last_of_instant = ~np.append(continues(flight)[1:] & (np.diff(plots.time_s) == 0.0), False)
    rows = np.flatnonzero(last_of_instant & _known(flights, result.accepted, smoothed))
    group = np.searchsorted(rows, np.arange(len(flight)))
    in_time = group < len(rows)
    sources = np.zeros((len(rows), sensors), dtype=np.int32)
    used, refused = in_time & result.accepted, in_time & ~result.accepted
    np.add.at(sources, (group[used], plots.sensor[used]), 1)
    rejected = np.bincount(group[refused], minlength=len(rows)).astype(np.int32)
    index = np.arange(len(rows)) - np.searchsorted(flight[rows], flight[rows])
    flags = np.where(sources.sum(axis=1) == 0, int(Flag.COASTED), 0) | np.where(guarded[rows], int(Flag.GUARDED), 0)
    flags |= np.where(plots.flags[rows] & ON_GROUND > 0, int(Flag.ON_GROUND), 0)
    taken = plots.take(rows)
    return FusedPoints(
        product=Product.ELEMENT if smoothed else Product.LIVE,
        slot=flight[rows],
        track_number=flight[rows] + 1,
        label=taken.address,
        address=taken.address,
        mode_a=taken.mode_a,
        callsign=taken.callsign,
        seq=index,
        time_s=taken.time_s,
        altitude_m=interpolated(flight, plots.time_s, plots.altitude_m)[rows],
        height_m=interpolated(flight, plots.time_s, plots.height_m)[rows],
        vertical_rate_mps=taken.vertical_rate_mps,
        status=np.full(len(rows), Status.CONFIRMED, dtype=np.uint8),
        element=index if smoothed else np.full(len(rows), -1, dtype=np.int64),
        span_s=_spans(flight[rows], taken.time_s) if smoothed else np.full((len(rows), 2), np.nan),
        master=np.where(sources.sum(axis=1) > 0, sources.argmax(axis=1), -1).astype(np.int16),
        sources=sources,
        rejected=rejected,
        input_received_s=np.full(len(rows), np.nan) if smoothed else taken.received_s,
        flags=flags.astype(np.uint16),
        renamed_to=np.full(len(rows), -1, dtype=np.int32),
        **_kinematics(flight[rows], planes, height_m[rows], result.take(rows)),
    )


def _known(flights: Flights, accepted: Bools, smoothed: bool) -> Bools:
    """Rows not longer than the coasting limit after an accepted report; smoothed: or before one."""
    time_s = flights.plots.time_s
    last, following = held_rows(flights.flight, accepted)
    fresh = (last >= 0) & (time_s - time_s[last] <= COAST_LIMIT_S)
    return np.asarray(fresh | ((last >= 0) & (following >= 0) & smoothed))


def _spans(flight: Ints, time_s: Array) -> Array:
    """Half-open spans from middle to middle, ``(n, 2)``. [s]"""
    joined = continues(flight)
    start = np.where(joined, 0.5 * (time_s + np.roll(time_s, 1)), time_s)
    ends_here = ~np.append(joined[1:], False) if len(joined) else joined
    end = np.where(ends_here, time_s + LAST_SPAN_S, np.roll(start, -1))
    return np.stack([start, end], axis=1)


def _kinematics(flight: Ints, planes: Planes, height_m: Array, result: Filtered) -> dict[str, Array]:
    """Position, velocity and covariances in the local plane at each point, by column name."""
    lat_deg, lon_deg = planes.from_plane(flight, result.position_m[:, 0], result.position_m[:, 1])
    back = geodesy.invert_axes(planes.axes(flight, lat_deg, lon_deg, height_m))
    v_east, v_north = geodesy.rotate_vector(back, result.velocity_mps[:, 0], result.velocity_mps[:, 1])
    packed = []
    for matrix in (result.position_cov_m2, result.velocity_cov_m2ps2):
        upper = np.stack([matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]], axis=1)
        packed.append(geodesy.rotate_covariance(back, upper))
    return {
        "lat_deg": lat_deg,
        "lon_deg": lon_deg,
        "ground_speed_mps": np.hypot(v_east, v_north),
        "track_angle_deg": wrap_azimuth_deg(np.degrees(np.arctan2(v_east, v_north))),
        "position_cov_m2": packed[0],
        "velocity_cov_m2ps2": packed[1],
    }
