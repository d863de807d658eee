"""A plane for each flight, for the offline methods: by map projection or by an exact tangent plane.

The published ADS-B filter projects with Lambert's conformal conic: central meridian at the median longitude, standard
parallels at the 25 % and 75 % quantiles of the latitudes. Formulas: Snyder (1987), "Map Projections: A Working Manual",
USGS Professional Paper 1395, eqs. 15-1 to 15-11 with 14-15 and 15-9 for the ellipsoid. The alternative is the tangent
plane of ``geodesy`` at the median position. Both come with their Jacobian, so velocities and covariances go in and out
exactly whatever the scale of the plane is at a point; a projection alone would leave its scale error in the speeds.
"""

from __future__ import annotations

from typing import Final, Literal, Protocol

import numpy as np

from aeroskein import geodesy
from aeroskein.ellipsoid import ECCENTRICITY_SQUARED, SEMI_MAJOR_M
from aeroskein.lanes import continues, flight_quantile
from aeroskein.plots import Array, Ints
from aeroskein.units import wrap_angle_deg

__all__ = ["LambertPlanes", "LocalPlanes", "Planes", "planes_of"]

# The cone opens into a cylinder where the standard parallels cancel, at the equator. Parallels at one degree instead
# keep its apex at a finite distance; the scale there is off by 1.5e-4, which the Jacobian takes out of the speeds.
LEAST_CONE_CONSTANT: Final = float(np.sin(np.radians(1.0)))

# Fixed-point steps from the isometric latitude back (Snyder 7-9); each gains e² = 2.2 digits, so seven reach rounding.
_INVERSE_STEPS: Final = 8


class Planes(Protocol):
    """A plane for each flight."""

    def to_plane(self, flight: Ints, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
        """East and north coordinates ``(n,)`` of positions of the given flights. [m]"""

    def from_plane(self, flight: Ints, e_m: Array, n_m: Array) -> tuple[Array, Array]:
        """Latitude and longitude ``(n,)`` of plane coordinates. [deg]"""

    def axes(self, flight: Ints, lat_deg: Array, lon_deg: Array, height_m: Array) -> Array:
        """Jacobian ``(n, 2, 2)``: d(plane east, north) / d(local east, north at that height; NaN counts as 0)."""


def planes_of(kind: Literal["local", "lambert"], flight: Ints, lat_deg: Array, lon_deg: Array) -> Planes:
    """Lay a plane for each flight through its positions.

    Parameters
    ----------
    kind : str
        ``lambert`` as published, ``local`` for the tangent plane at the median position.
    flight : (n,) int64
        Flight of each row, ascending from 0 without holes.
    lat_deg, lon_deg : (n,) array
        Positions, none missing. [deg]
    """
    # Longitudes are unrolled about each flight's first one, so that the antimeridian has no median of its own.
    first = lon_deg[np.flatnonzero(~continues(flight))]
    unrolled = first[flight] + wrap_angle_deg(lon_deg - first[flight])
    middle = wrap_angle_deg(flight_quantile(flight, unrolled, 0.5))
    if kind == "local":
        return LocalPlanes(geodesy.frame_rows(flight_quantile(flight, lat_deg, 0.5), middle))
    return LambertPlanes(
        middle,
        flight_quantile(flight, lat_deg, 0.25),
        flight_quantile(flight, lat_deg, 0.75),
        flight_quantile(flight, lat_deg, 0.5),
    )


class LocalPlanes:
    """Tangent planes: ``frames`` are ``(flights, 12)`` rows of ``geodesy.frame_rows``."""

    def __init__(self, frames: Array) -> None:
        self.frames = frames

    def to_plane(self, flight: Ints, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
        """As ``Planes.to_plane``."""
        return geodesy.to_plane(self.frames[flight], lat_deg, lon_deg)

    def from_plane(self, flight: Ints, e_m: Array, n_m: Array) -> tuple[Array, Array]:
        """As ``Planes.from_plane``."""
        return geodesy.from_plane(self.frames[flight], e_m, n_m)

    def axes(self, flight: Ints, lat_deg: Array, lon_deg: Array, height_m: Array) -> Array:
        """As ``Planes.axes``."""
        return geodesy.local_axes(self.frames[flight], lat_deg, lon_deg, height_m)


class LambertPlanes:
    """Lambert's conformal conic with two standard parallels, one projection per flight.

    Parameters
    ----------
    central_lon_deg, low_lat_deg, high_lat_deg, origin_lat_deg : (flights,) arrays
        Central meridian, standard parallels and the latitude where north is zero. [deg]
    """

    def __init__(self, central_lon_deg: Array, low_lat_deg: Array, high_lat_deg: Array, origin_lat_deg: Array) -> None:
        low, high = np.radians(low_lat_deg), np.radians(high_lat_deg)
        cone = self._cone_constant(low, high)
        flat = np.abs(cone) < LEAST_CONE_CONSTANT
        sign = np.where(cone < 0.0, -1.0, 1.0)
        low = np.where(flat, sign * np.arcsin(LEAST_CONE_CONSTANT), low)
        high = np.where(flat, low, high)
        self.central_lon_deg = central_lon_deg
        self.cone = self._cone_constant(low, high)
        self._factor = _parallel(low) / (self.cone * _isometric(low) ** self.cone)
        self._origin_m = self._radius(np.radians(origin_lat_deg), slice(None))

    @staticmethod
    def _cone_constant(low: Array, high: Array) -> Array:
        apart = np.abs(high - low) > 1e-7
        other = np.where(apart, high, low + 0.1)  # keeps the quotient defined where it is not used
        two = (np.log(_parallel(low)) - np.log(_parallel(other))) / (
            np.log(_isometric(low)) - np.log(_isometric(other))
        )
        return np.where(apart, two, np.sin(0.5 * (low + high)))

    def _radius(self, lat: Array, flight: Ints | slice) -> Array:
        """Distance from the cone's apex. [m]"""
        return np.asarray(SEMI_MAJOR_M * self._factor[flight] * _isometric(lat) ** self.cone[flight])

    def _angle(self, flight: Ints, lon_deg: Array) -> Array:
        return np.asarray(self.cone[flight] * np.radians(wrap_angle_deg(lon_deg - self.central_lon_deg[flight])))

    def to_plane(self, flight: Ints, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
        """As ``Planes.to_plane``."""
        radius_m, angle = self._radius(np.radians(lat_deg), flight), self._angle(flight, lon_deg)
        # 1 - cos in half angles: the radius is thousands of kilometres, the result metres.
        n_m = self._origin_m[flight] - radius_m + 2.0 * radius_m * np.sin(0.5 * angle) ** 2
        return radius_m * np.sin(angle), n_m

    def from_plane(self, flight: Ints, e_m: Array, n_m: Array) -> tuple[Array, Array]:
        """As ``Planes.from_plane``."""
        cone = self.cone[flight]
        sign = np.sign(cone)
        to_apex_m = self._origin_m[flight] - n_m
        radius_m = sign * np.hypot(e_m, to_apex_m)
        angle = np.arctan2(sign * e_m, sign * to_apex_m)
        isometric = (radius_m / (SEMI_MAJOR_M * self._factor[flight])) ** (1.0 / cone)
        lat = 0.5 * np.pi - 2.0 * np.arctan(isometric)
        eccentricity = np.sqrt(ECCENTRICITY_SQUARED)
        for _ in range(_INVERSE_STEPS):
            sine = eccentricity * np.sin(lat)
            lat = 0.5 * np.pi - 2.0 * np.arctan(isometric * ((1.0 - sine) / (1.0 + sine)) ** (0.5 * eccentricity))
        lon_deg = wrap_angle_deg(self.central_lon_deg[flight] + np.degrees(angle / cone))
        return np.degrees(lat), lon_deg

    def axes(self, flight: Ints, lat_deg: Array, lon_deg: Array, height_m: Array) -> Array:
        """As ``Planes.axes``: the scale of the projection times a rotation by the convergence of the meridians."""
        lat, angle = np.radians(lat_deg), self._angle(flight, lon_deg)
        scale = self.cone[flight] * self._radius(lat, flight) / (SEMI_MAJOR_M * _parallel(lat))
        cos, sin = scale * np.cos(angle), scale * np.sin(angle)
        axes = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
        return np.asarray(axes / geodesy.height_scale(lat_deg, height_m)[:, None, :])


def _parallel(lat: Array) -> Array:
    """Radius of the parallel over the equatorial radius (Snyder 14-15)."""
    return np.asarray(np.cos(lat) / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(lat) ** 2))


def _isometric(lat: Array) -> Array:
    """``exp(-isometric latitude)`` (Snyder 15-9)."""
    eccentricity = np.sqrt(ECCENTRICITY_SQUARED)
    sine = eccentricity * np.sin(lat)
    return np.asarray(np.tan(0.25 * np.pi - 0.5 * lat) / ((1.0 - sine) / (1.0 + sine)) ** (0.5 * eccentricity))
