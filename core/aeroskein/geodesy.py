"""The fusion plane in which tracks are kept, and the exact ways from WGS-84 into it and back.

Each track is filtered in the east-north plane that touches the ellipsoid at an origin near it (its *frame*). A target's
plane coordinates are those of its foot point: the point of the ellipsoid straight below it. They do not depend on its
height, so a missing or wrong altitude never moves it. Both directions are closed form, which a general map projection
is not, and they hold at the poles and across the antimeridian, where tables of latitude and longitude break.

Frames travel as rows of 12 numbers, ``[origin ECEF 3, east 3, north 3, up 3]``, gathered so that each target can have
its own.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from aeroskein.ellipsoid import (
    ECCENTRICITY_SQUARED,
    SECOND_ECCENTRICITY_SQUARED,
    SEMI_MAJOR_M,
    Angles,
    ecef_axes,
    from_ecef,
    height_scale,
    height_scale_at,
    to_ecef,
)
from aeroskein.plots import Array, Ints, columns_of
from aeroskein.units import wrap_angle_deg

__all__ = [
    "ORIGIN_GRID_DEG",
    "frame_rows",
    "from_ecef",
    "from_plane",
    "height_scale",
    "invert_axes",
    "local_axes",
    "move_frame",
    "origin_keys",
    "rotate_covariance",
    "rotate_vector",
    "snap_origin",
    "to_ecef",
    "to_plane",
    "to_plane_with_axes",
]

# Origins lie on a grid, so that neighbouring aircraft share one and can be compared without conversion;
# a quarter degree keeps every aircraft within 20 km of its origin when the frame is made. [deg]
ORIGIN_GRID_DEG: Final = 0.25

# Towards the poles the longitude step grows, so that a cell stays about as wide as it is high. Every step divides
# 360, else two cells would overlap somewhere. A step is used from the latitude at which it is no wider than the
# grid. [deg]
_LON_STEPS_DEG: Final = np.array([0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 24.0, 72.0, 360.0])
_LON_STEP_FROM_LAT_DEG: Final = np.array(
    [math.degrees(math.acos(ORIGIN_GRID_DEG / step)) for step in _LON_STEPS_DEG[:-1]] + [90.0]
)


def frame_rows(lat_deg: Array, lon_deg: Array, height_m: Array | float = 0.0) -> Array:
    """Make frames at the given points.

    Parameters
    ----------
    lat_deg, lon_deg : (n,) array
        Origin. [deg]
    height_m : (n,) array or float
        Height of the origin above the ellipsoid: 0 for a track's frame, the antenna's for a radar. [m]

    Returns
    -------
    (n, 12) array
        Origin ECEF [m], then the unit vectors east, north and up.
    """
    lat_deg, lon_deg = np.broadcast_arrays(np.atleast_1d(lat_deg), np.atleast_1d(lon_deg))
    return np.concatenate([to_ecef(lat_deg, lon_deg, height_m), *ecef_axes(lat_deg, lon_deg)], axis=-1)


def snap_origin(lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
    """Give each position the nearest origin of the grid, so that neighbours share one.

    The latitude step is 0.25 degrees, the longitude step 0.25 up to 60 degrees of latitude, then 0.5, 1, 2, 4, 8, 24
    and 72; the pole itself is one origin. Longitudes -180 and 180 give the same origin.

    Parameters
    ----------
    lat_deg, lon_deg : (n,) array
        Position. [deg]

    Returns
    -------
    lat_deg, lon_deg : (n,) arrays
        Origin, -180 <= longitude < 180. [deg]
    """
    origin_lat = np.minimum(np.maximum(np.rint(lat_deg / ORIGIN_GRID_DEG) * ORIGIN_GRID_DEG, -90.0), 90.0)
    # The tolerance takes up the rounding of acos, so that 60 degrees belongs to the wider step everywhere.
    step = np.searchsorted(_LON_STEP_FROM_LAT_DEG, np.abs(origin_lat) + 1e-9, side="right") - 1
    step_deg = _LON_STEPS_DEG[np.minimum(step, len(_LON_STEPS_DEG) - 1)]
    return origin_lat, wrap_angle_deg(np.rint(wrap_angle_deg(lon_deg) / step_deg) * step_deg)


def origin_keys(lat_deg: Array, lon_deg: Array) -> Ints:
    """One number per origin of the grid, for each position ``(n,)``; -1 where a position is not known. [deg]"""
    known = np.isfinite(lat_deg + lon_deg)
    if not known.all():
        keys = np.full(known.shape, -1, dtype=np.int64)
        keys[known] = origin_keys(lat_deg[known], lon_deg[known])
        return keys
    lat, lon = snap_origin(lat_deg, lon_deg)
    # The grid's whole numbers are exact in floating point.
    rows, columns = np.rint((lat + 90.0) / ORIGIN_GRID_DEG), np.rint((lon + 180.0) / ORIGIN_GRID_DEG)
    return (rows * 10_000.0 + columns).astype(np.int64)


def to_plane(frames: Array, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
    """Project positions onto their fusion planes.

    Parameters
    ----------
    frames : (n, 12) array
        One frame per position; ``(1, 12)`` serves all.
    lat_deg, lon_deg : (n,) array
        Position; its height does not matter. [deg]

    Returns
    -------
    e_m, n_m : (n,) arrays
        East and north of the origin. Points more than a quarter of the globe away fold back. [m]
    """
    return _plane_of(frames, *Angles.of(lat_deg, lon_deg).ecef())


def from_plane(frames: Array, e_m: Array, n_m: Array) -> tuple[Array, Array]:
    """Turn plane coordinates back into latitude and longitude, exactly.

    Parameters
    ----------
    frames : (n, 12) array
        One frame per position; ``(1, 12)`` serves all.
    e_m, n_m : (n,) array
        East and north of the origin. [m]

    Returns
    -------
    lat_deg, lon_deg : (n,) arrays
        WGS-84 position, -180 <= longitude < 180; NaN where the plane lies beside the earth (6,300 km off). [deg]
    """
    x, y, z = _foot_point(frames, e_m, n_m)
    lat = np.arctan2(z, (1.0 - ECCENTRICITY_SQUARED) * np.hypot(x, y))
    return np.degrees(lat), wrap_angle_deg(np.degrees(np.arctan2(y, x)))


def local_axes(frames: Array, lat_deg: Array, lon_deg: Array, height_m: Array | None = None) -> Array:
    """Jacobian from the local east-north axes at each point to its fusion plane.

    It holds the meridian convergence (0.8 degrees at 80 km from the origin at latitude 48), the contraction of the
    plane (1.2e-4 at 100 km), and, where the height is given, that the aircraft moves (R + h) / R faster than its foot
    point. ``rotate_vector`` and ``rotate_covariance`` apply it; ``invert_axes`` gives the way back.

    Parameters
    ----------
    frames : (n, 12) array
        One frame per position.
    lat_deg, lon_deg : (n,) array
        Position. [deg]
    height_m : (n,) array, optional
        Height at which the local metres are measured; NaN counts as 0. Absent: on the ellipsoid. [m]

    Returns
    -------
    (n, 2, 2) array
        d(plane east, north) / d(local east, north).
    """
    return _axes_at(frames, Angles.of(lat_deg, lon_deg), height_m)


def to_plane_with_axes(frames: Array, lat_deg: Array, lon_deg: Array, height_m: Array) -> tuple[Array, Array, Array]:
    """What ``to_plane`` and ``local_axes`` give, with the sines and cosines taken once."""
    angles = Angles.of(lat_deg, lon_deg)
    return *_plane_of(frames, *angles.ecef()), _axes_at(frames, angles, height_m)


def _axes_at(frames: Array, angles: Angles, height_m: Array | None) -> Array:
    axes = _products(frames, angles.level_axes())
    if height_m is not None:
        eastwards, northwards = height_scale_at(angles.sin_lat, height_m)
        axes[..., 0] /= eastwards[:, None]
        axes[..., 1] /= northwards[:, None]
    return axes


def move_frame(old: Array, new: Array, e_m: Array, n_m: Array) -> tuple[Array, Array, Array]:
    """Carry plane coordinates from one frame to another, with the Jacobian for velocities and covariances.

    Accelerations go through the same Jacobian: what it neglects, the change of the Jacobian along the flight, is below
    1e-3 m/s² for a jet and frames up to 100 km apart.

    Parameters
    ----------
    old, new : (n, 12) array
        Frames before and after.
    e_m, n_m : (n,) array
        Coordinates in the old frame. [m]

    Returns
    -------
    e_m, n_m : (n,) arrays
        Coordinates of the same points in the new frame. [m]
    jacobian : (n, 2, 2) array
        d(new east, north) / d(old east, north).
    """
    foot_m = _foot_point(old, e_m, n_m)
    # The foot point stays on the ellipsoid: its step must be at right angles to the gradient there, so a step along
    # the old plane is completed by a step along the old normal.
    gradient = foot_m.T * np.array([1.0, 1.0, 1.0 + SECOND_ECCENTRICITY_SQUARED])
    slope = np.einsum("...kc,...c->...k", old[..., 3:].reshape(*old.shape[:-1], 3, 3), gradient)
    steps = np.stack(
        [(old[:, 3 + k : 6 + k] - old[:, 9:12] * (slope[:, k // 3] / slope[:, 2])[:, None]).T for k in (0, 3)], axis=1
    )
    new_e_m, new_n_m = _plane_of(new, *foot_m)
    return new_e_m, new_n_m, _products(new, steps)


def rotate_vector(axes: Array, e: Array, n: Array) -> tuple[Array, Array]:
    """Apply Jacobians ``(n, 2, 2)`` to vectors given by components ``(n,)``."""
    return axes[..., 0, 0] * e + axes[..., 0, 1] * n, axes[..., 1, 0] * e + axes[..., 1, 1] * n


def rotate_covariance(axes: Array, covariance: Array) -> Array:
    """Apply Jacobians to covariances: ``J C Jᵀ``.

    Parameters
    ----------
    axes : (n, 2, 2) array
        Jacobians, for example from ``local_axes``.
    covariance : (..., n, 3) array
        Packed ``[ee, en, nn]``; several of each point share its Jacobian.

    Returns
    -------
    (..., n, 3) array
        Packed ``[ee, en, nn]`` in the new axes.
    """
    ee, en, nn = covariance[..., 0], covariance[..., 1], covariance[..., 2]
    a, b, c, d = axes[..., 0, 0], axes[..., 0, 1], axes[..., 1, 0], axes[..., 1, 1]
    return columns_of(
        a * a * ee + 2.0 * a * b * en + b * b * nn,
        a * c * ee + (a * d + b * c) * en + b * d * nn,
        c * c * ee + 2.0 * c * d * en + d * d * nn,
    )


def invert_axes(axes: Array) -> Array:
    """Inverse of Jacobians ``(n, 2, 2)``: from the plane to the local axes."""
    a, b, c, d = axes[:, 0, 0], axes[:, 0, 1], axes[:, 1, 0], axes[:, 1, 1]
    inverse: Array = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return inverse.transpose(2, 0, 1)


def _plane_of(frames: Array, x_m: Array, y_m: Array, z_m: Array) -> tuple[Array, Array]:
    of_frame = frames.T
    x, y, z = x_m - of_frame[0], y_m - of_frame[1], z_m - of_frame[2]
    # East has no component along the earth's axis.
    return x * of_frame[3] + y * of_frame[4], x * of_frame[6] + y * of_frame[7] + z * of_frame[8]


def _products(frames: Array, vectors: Array) -> Array:
    """East and north components in the frame of pairs of ECEF vectors ``(3, 2, n)``: ``(n, 2, 2)``."""
    axes = np.ascontiguousarray(frames[:, 3:9].T).reshape(2, 3, 1, -1)
    products: Array = (axes * vectors).sum(axis=1)
    return products.transpose(2, 0, 1)


def _foot_point(frames: Array, e_m: Array, n_m: Array) -> Array:
    """ECEF ``(3, n)`` of the point of the ellipsoid that has these plane coordinates.

    ``O + e E + n N + u U`` lies on ``x² + y² + k z² = a²`` with k = 1/(1 - e²). Because ``diag(1, 1, k) O`` is N U (N:
    radius in the prime vertical) and E has no z, the quadratic ``A u² + 2 B u + C = 0`` has the short coefficients
    below and loses no digits.
    """
    of_frame = frames.T
    up_z, north_z = of_frame[11], of_frame[8]
    prime_vertical_m = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * up_z**2)
    A = 1.0 + SECOND_ECCENTRICITY_SQUARED * up_z**2
    B = prime_vertical_m + SECOND_ECCENTRICITY_SQUARED * n_m * north_z * up_z
    C = e_m**2 + n_m**2 * (1.0 + SECOND_ECCENTRICITY_SQUARED * north_z**2)
    under_root = B * B - A * C
    u_m = -C / (B + np.sqrt(np.where(under_root < 0.0, np.nan, under_root)))
    foot_m: Array = of_frame[0:3] + e_m * of_frame[3:6] + n_m * of_frame[6:9] + u_m * of_frame[9:12]
    return foot_m
