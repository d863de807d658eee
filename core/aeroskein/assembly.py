"""Assembly: states in the plane become fused points on the globe, with everything a consumer needs to know of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aeroskein import geodesy
from aeroskein.frames import FrameTable
from aeroskein.plots import Array, Ints
from aeroskein.points import FusedPoints, Product
from aeroskein.tracks import TrackTable
from aeroskein.units import wrap_azimuth_deg

__all__ = ["PlaneState", "assemble"]


@dataclass(slots=True, eq=False)
class PlaneState:
    """States to publish, lanes in one order.

    Attributes
    ----------
    time_s : (n,) float64
        Instant. [s since the epoch]
    x : (4, n) float64
        Position and velocity in the track's plane. [m, m/s]
    position_cov, velocity_cov : (3, n) float64
        ``[ee, en, nn]`` in the plane. [m², m²/s²]
    altitude_m, height_m, vertical_rate_mps : (n,) float64
        NaN where unknown. [m, m, m/s]
    """

    time_s: Array
    x: Array
    position_cov: Array
    velocity_cov: Array
    altitude_m: Array
    height_m: Array
    vertical_rate_mps: Array


def assemble(
    product: Product,
    slots: Ints,
    state: PlaneState,
    tracks: TrackTable,
    frames: FrameTable,
    *,
    seq: Ints,
    element: Ints,
    span_s: Array,
    master: NDArray[np.int16],
    sources: NDArray[np.int32],
    rejected: NDArray[np.int32],
    input_received_s: Array,
    status: NDArray[np.uint8],
    flags: NDArray[np.uint16],
) -> FusedPoints:
    """Make fused points of n tracks; the keyword columns are those of ``FusedPoints``."""
    n = len(slots)
    rows = frames.rows[tracks.frame[slots]]
    lat, lon = geodesy.from_plane(rows, state.x[0], state.x[1])
    # Where no height is known the altitude is near enough to scale a speed by.
    height = np.where(np.isnan(state.height_m), state.altitude_m, state.height_m)
    back = geodesy.invert_axes(geodesy.local_axes(rows, lat, lon, height))
    east, north = geodesy.rotate_vector(back, state.x[2], state.x[3])
    covariances = np.array([state.position_cov, state.velocity_cov]).swapaxes(1, 2)
    position_cov, velocity_cov = geodesy.rotate_covariance(back, covariances)
    return FusedPoints(
        product=product,
        slot=slots,
        track_number=tracks.number[slots],
        label=tracks.label[slots],
        address=tracks.address[slots],
        mode_a=tracks.mode_a[slots],
        callsign=tracks.callsign[slots],
        seq=seq,
        time_s=state.time_s,
        lat_deg=lat,
        lon_deg=lon,
        altitude_m=state.altitude_m,
        height_m=state.height_m,
        ground_speed_mps=np.hypot(east, north),
        track_angle_deg=wrap_azimuth_deg(np.degrees(np.arctan2(east, north))),
        vertical_rate_mps=state.vertical_rate_mps,
        position_cov_m2=position_cov,
        velocity_cov_m2ps2=velocity_cov,
        status=status,
        element=element,
        span_s=span_s,
        master=master,
        sources=sources,
        rejected=rejected,
        input_received_s=input_received_s,
        flags=flags,
        renamed_to=np.full(n, -1, dtype=np.int32),
    )
