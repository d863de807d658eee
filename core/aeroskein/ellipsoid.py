"""The WGS-84 ellipsoid: geodetic and earth-centred coordinates, local axes, and what a height does to a speed.

Formulas: Bowring (1985), "The accuracy of geodetic latitude and height equations", Survey Review 28, for ECEF to
geodetic; the others follow from the normal of the ellipsoid (TR8350.2, chapter 4).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, columns_of
from aeroskein.units import wrap_angle_deg

__all__ = [
    "EARTH_M",
    "ECCENTRICITY_SQUARED",
    "SECOND_ECCENTRICITY_SQUARED",
    "SEMI_MAJOR_M",
    "SEMI_MINOR_M",
    "ecef_axes",
    "from_ecef",
    "height_scale",
    "normal_and_height",
    "to_ecef",
]

# WGS-84 defining constants, NIMA TR8350.2: equatorial radius [m] and flattening.
SEMI_MAJOR_M: Final = 6378137.0
FLATTENING: Final = 1.0 / 298.257223563
SEMI_MINOR_M: Final = SEMI_MAJOR_M * (1.0 - FLATTENING)
ECCENTRICITY_SQUARED: Final = FLATTENING * (2.0 - FLATTENING)
SECOND_ECCENTRICITY_SQUARED: Final = ECCENTRICITY_SQUARED / (1.0 - ECCENTRICITY_SQUARED)
# Mean radius, where a sphere is near enough: elevations, and what a slant range means at one height and another. [m]
EARTH_M: Final = 6_371_000.0


def to_ecef(lat_deg: Array, lon_deg: Array, height_m: Array | float = 0.0) -> Array:
    """Convert latitude, longitude and height above the ellipsoid to earth-centred coordinates.

    Parameters
    ----------
    lat_deg, lon_deg : (n,) array
        WGS-84 position. [deg]
    height_m : (n,) array or float
        Height above the ellipsoid. [m]

    Returns
    -------
    (n, 3) array
        ECEF x, y, z. [m]
    """
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    sin_lat, cos_lat = np.sin(lat), np.cos(lat)
    normal_m = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * sin_lat**2)
    from_axis_m = (normal_m + height_m) * cos_lat
    return columns_of(
        from_axis_m * np.cos(lon),
        from_axis_m * np.sin(lon),
        (normal_m * (1.0 - ECCENTRICITY_SQUARED) + height_m) * sin_lat,
    )


def from_ecef(ecef_m: Array) -> tuple[Array, Array, Array]:
    """Convert earth-centred coordinates to latitude, longitude and height above the ellipsoid.

    Parameters
    ----------
    ecef_m : (n, 3) array
        ECEF position. [m]

    Returns
    -------
    lat_deg, lon_deg, height_m : (n,) arrays
        WGS-84 position, -180 <= longitude < 180. [deg, deg, m]
    """
    normal, height_m = normal_and_height(ecef_m)
    lat = np.arctan2(normal[..., 2], np.hypot(normal[..., 0], normal[..., 1]))
    lon_deg = np.degrees(np.arctan2(ecef_m[..., 1], ecef_m[..., 0]))
    return np.degrees(lat), wrap_angle_deg(lon_deg), height_m


def normal_and_height(ecef_m: Array) -> tuple[Array, Array]:
    """Give the upward normal of the ellipsoid below each point, and the point's height, without any angle.

    Bowring (1985): the reduced latitude of the first guess is so good that one step is exact to two micrometres
    from 1 km below the ellipsoid to 100 km above it, at every latitude.

    Parameters
    ----------
    ecef_m : (n, 3) array
        ECEF position, not the earth's centre. [m]

    Returns
    -------
    normal : (n, 3) array
        Unit vector straight up.
    height_m : (n,) array
        Height above the ellipsoid. [m]
    """
    x, y, z = ecef_m[..., 0], ecef_m[..., 1], ecef_m[..., 2]
    p = np.hypot(x, y)
    first_z = SEMI_MINOR_M * z * (1.0 + SECOND_ECCENTRICITY_SQUARED * SEMI_MINOR_M / np.hypot(p, z))
    first_p = SEMI_MAJOR_M * p
    length = np.hypot(first_z, first_p)
    up_z = z + SECOND_ECCENTRICITY_SQUARED * SEMI_MINOR_M * (first_z / length) ** 3
    up_p = p - ECCENTRICITY_SQUARED * SEMI_MAJOR_M * (first_p / length) ** 3
    length = np.hypot(up_z, up_p)
    sin_lat, cos_lat = up_z / length, up_p / length
    height_m = p * cos_lat + z * sin_lat - SEMI_MAJOR_M * np.sqrt(1.0 - ECCENTRICITY_SQUARED * sin_lat**2)
    # On the axis east and west are the same; any meridian will do, and x / p would be 0 / 0.
    per_p = cos_lat / np.maximum(p, 1e-9)
    return columns_of(x * per_p, y * per_p, sin_lat), height_m


def ecef_axes(lat_deg: Array, lon_deg: Array) -> tuple[Array, Array, Array]:
    """Unit vectors east, north and up at a point, each ``(n, 3)`` in ECEF axes."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    east = columns_of(-sin_lon, cos_lon, np.zeros_like(lat))
    north = columns_of(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
    up = columns_of(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    return east, north, up


def height_scale(lat_deg: Array, height_m: Array) -> Array:
    """How much faster a point at a height moves over ground than its foot point, eastwards and northwards.

    One metre on the ellipsoid turns the normal by 1/N eastwards and 1/M northwards (N and M: radii of curvature in the
    prime vertical and the meridian), so the point at height h moves (N + h)/N and (M + h)/M metres: exact in level
    flight on every course, without a mean radius. It is 0.16 % at 10 km.

    Parameters
    ----------
    lat_deg : (n,) array
        Latitude. [deg]
    height_m : (n,) array
        Height above the ellipsoid; NaN counts as 0. [m]

    Returns
    -------
    (n, 2) array
        Factor eastwards and northwards.
    """
    squared = 1.0 - ECCENTRICITY_SQUARED * np.sin(np.radians(lat_deg)) ** 2
    prime_vertical_m = SEMI_MAJOR_M / np.sqrt(squared)
    meridian_m = prime_vertical_m * (1.0 - ECCENTRICITY_SQUARED) / squared
    height_m = np.where(np.isnan(height_m), 0.0, height_m)
    return 1.0 + columns_of(height_m / prime_vertical_m, height_m / meridian_m)
