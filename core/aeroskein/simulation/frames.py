"""Moving frames: the small tangent plane that each simulated aircraft carries along.

An aircraft is integrated in the plane that touches the ellipsoid's normal at its own position and height, two seconds
at a time; then the plane moves to where it is. The axes are carried along without turning (parallel transport, the
wander frame of inertial navigation), so a flight without turns is a geodesic and neither the poles nor the
antimeridian are special: latitude and longitude are made only for what is reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np

from aeroskein.ellipsoid import ECCENTRICITY_SQUARED, SEMI_MAJOR_M, ecef_axes, normal_and_height, to_ecef
from aeroskein.plots import Array
from aeroskein.units import wrap_angle_deg, wrap_azimuth_deg

__all__ = ["Frames", "above", "east_north", "latitude_longitude_deg", "track_angle_deg"]

# Steps of a placement: 10 km each for 320 km, where the tangent plane and the arc differ by 8 mm.
SLIDE_STEPS: Final = 32


def above(up: Array, height_m: Array) -> Array:
    """ECEF of the points at a height over the foot points with the normals ``up`` (m, 3): ``(m, 3)``. [m]"""
    prime_vertical_m = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * up[:, 2] ** 2)
    ecef_m = (prime_vertical_m + height_m)[:, None] * up
    ecef_m[:, 2] -= ECCENTRICITY_SQUARED * prime_vertical_m * up[:, 2]
    return ecef_m


def latitude_longitude_deg(up: Array) -> tuple[Array, Array]:
    """Latitude and longitude of foot points, from their normals ``(m, 3)``. [deg]"""
    lat_deg = np.degrees(np.arctan2(up[:, 2], np.hypot(up[:, 0], up[:, 1])))
    return lat_deg, wrap_angle_deg(np.degrees(np.arctan2(up[:, 1], up[:, 0])))


def east_north(up: Array, vectors: Array) -> tuple[Array, Array]:
    """East and north components of ECEF vectors ``(m, 3)`` at the points with the normals ``up``."""
    # At the very pole every direction is south; the meridian of Greenwich is taken then.
    across = np.maximum(np.hypot(up[:, 0], up[:, 1]), 1e-12)
    east = (up[:, 0] * vectors[:, 1] - up[:, 1] * vectors[:, 0]) / across
    outward = (up[:, 0] * vectors[:, 0] + up[:, 1] * vectors[:, 1]) / across
    return east, vectors[:, 2] * across - outward * up[:, 2]


def track_angle_deg(east: Array, north: Array) -> Array:
    """Direction of a velocity, clockwise from true north, in [0, 360). [deg]"""
    return wrap_azimuth_deg(np.degrees(np.arctan2(east, north)))


def _cross(one: Array, other: Array) -> Array:
    """``np.cross`` of rows ``(n, 3)``, without what it takes for every other shape."""
    (a, b, c), (d, e, f) = one.T, other.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)


@dataclass(slots=True, eq=False)
class Frames:
    """One tangent plane per aircraft, in ECEF axes, each column ``(n, 3)``.

    Attributes
    ----------
    origin_m : (n, 3) float64
        The aircraft. [m]
    right, ahead, up : (n, 3) float64
        Unit vectors: two in the plane (east and north where the frame was made), and the normal.
    """

    origin_m: Array
    right: Array
    ahead: Array
    up: Array

    @classmethod
    def at(cls, lat_deg: Array, lon_deg: Array, height_m: Array) -> Self:
        """Frames at the given points, with axes to the east and north there."""
        right, ahead, up = ecef_axes(lat_deg, lon_deg)
        return cls(to_ecef(lat_deg, lon_deg, height_m), right, ahead, up)

    def take(self, rows: Any) -> Self:
        """Copies of the given rows."""
        return type(self)(self.origin_m[rows], self.right[rows], self.ahead[rows], self.up[rows])

    def put(self, rows: Any, new: Self) -> None:
        """Replace the given rows."""
        self.origin_m[rows], self.right[rows] = new.origin_m, new.right
        self.ahead[rows], self.up[rows] = new.ahead, new.up

    def point(self, right_m: Array, ahead_m: Array) -> Array:
        """ECEF of plane coordinates, ``(n, 3)``. [m]"""
        return self.origin_m + right_m[:, None] * self.right + ahead_m[:, None] * self.ahead

    def moved(self, right_m: Array, ahead_m: Array, height_m: Array) -> Self:
        """The frames after a short step in their planes, at new heights; the axes are carried along."""
        up, _ = normal_and_height(self.point(right_m, ahead_m))
        right = self.right - np.einsum("ij,ij->i", self.right, up)[:, None] * up
        right /= np.sqrt(np.einsum("ij,ij->i", right, right))[:, None]
        return type(self)(above(up, height_m), right, _cross(up, right), up)

    def slid(self, right_m: Array, ahead_m: Array, height_m: Array) -> Self:
        """The frames after a long way straight on in the given direction, at the same heights."""
        frames = self
        for _ in range(SLIDE_STEPS):
            frames = frames.moved(right_m / SLIDE_STEPS, ahead_m / SLIDE_STEPS, height_m)
        return frames
