"""The coordinate conversions of the element method as they were published, for mode ``patent`` and for comparison.

CN 114186635 A converts polar data with a zenith angle, and latitude and longitude with two constants. Both are kept
here, side by side with what they can be used for; the fusion itself uses ``geodesy`` and ``radar_geometry``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array
from aeroskein.units import wrap_angle_deg

__all__ = ["TILE_LIMIT_M", "geographic_tile", "polar_to_rectangular", "radar_to_rectangular", "tile_to_geographic"]

# Length of one degree of longitude on the equator and of one degree of latitude near latitude 30, as published. [km]
KILOMETRES_PER_DEGREE_EAST: Final = 111.32
KILOMETRES_PER_DEGREE_NORTH: Final = 110.946

# Furthest distance from the tile's origin at which the published formula may be used. Its constants fit one latitude
# and it knows no convergence of the meridians: up to latitude 60 the error is within 42 m at 10 km, but grows with the
# square of the distance. [m]
TILE_LIMIT_M: Final = 10_000.0


def polar_to_rectangular(r_m: Array, theta: Array, phi: Array) -> tuple[Array, Array, Array]:
    """Convert spherical coordinates as published: ``x = r sinθ cosφ, y = r sinθ sinφ, z = r cosθ``.

    Parameters
    ----------
    r_m : (n,) array
        Distance. [m]
    theta : (n,) array
        Angle from the vertical, not an elevation. [rad]
    phi : (n,) array
        Angle from the x axis towards y, not an azimuth from north. [rad]

    Returns
    -------
    x_m, y_m, z_m : (n,) arrays
        Rectangular coordinates. [m]
    """
    return r_m * np.sin(theta) * np.cos(phi), r_m * np.sin(theta) * np.sin(phi), r_m * np.cos(theta)


def radar_to_rectangular(slant_range_m: Array, azimuth_deg: Array, above_antenna_m: Array) -> tuple[Array, Array]:
    """The same conversion in a radar's own terms: azimuth from north, height instead of a zenith angle, flat earth.

    ``sinθ = sqrt(1 - (h/r)²)`` and ``φ = 90° - azimuth`` turn the published formula into this one. It neglects that
    the earth falls away below the beam (120 m in height at 40 km), for which ``radar_geometry`` is the remedy.

    Parameters
    ----------
    slant_range_m : (n,) array
        Distance from the antenna. [m]
    azimuth_deg : (n,) array
        Clockwise from true north. [deg]
    above_antenna_m : (n,) array
        Height of the target above the antenna. [m]

    Returns
    -------
    e_m, n_m : (n,) arrays
        East and north of the radar; NaN where the height exceeds the range. [m]
    """
    squared = slant_range_m**2 - above_antenna_m**2
    ground_m = np.sqrt(np.where(squared < 0.0, np.nan, squared))
    azimuth = np.radians(azimuth_deg)
    return ground_m * np.sin(azimuth), ground_m * np.cos(azimuth)


def geographic_tile(
    lat_deg: Array, lon_deg: Array, origin_lat_deg: Array | float, origin_lon_deg: Array | float
) -> tuple[Array, Array]:
    """Convert latitude and longitude as published: ``x = 111.32 cos(lat_A) Δlon, y = 110.946 Δlat`` kilometres.

    Parameters
    ----------
    lat_deg, lon_deg : (n,) array
        Position; within ``TILE_LIMIT_M`` of the origin. [deg]
    origin_lat_deg, origin_lon_deg : (n,) array or float
        Point A, any point of the track data. [deg]

    Returns
    -------
    x_m, y_m : (n,) arrays
        East and north of the origin. [m]
    """
    dlon = wrap_angle_deg(np.asarray(lon_deg - origin_lon_deg))
    x_m = 1e3 * KILOMETRES_PER_DEGREE_EAST * np.cos(np.radians(origin_lat_deg)) * dlon
    return x_m, 1e3 * KILOMETRES_PER_DEGREE_NORTH * (lat_deg - origin_lat_deg)


def tile_to_geographic(
    x_m: Array, y_m: Array, origin_lat_deg: Array | float, origin_lon_deg: Array | float
) -> tuple[Array, Array]:
    """Inverse of ``geographic_tile``: latitude and longitude, -180 <= longitude < 180. [deg]"""
    per_degree_m = 1e3 * KILOMETRES_PER_DEGREE_EAST * np.cos(np.radians(origin_lat_deg))
    lon_deg = wrap_angle_deg(np.asarray(origin_lon_deg + x_m / per_degree_m))
    return origin_lat_deg + y_m / (1e3 * KILOMETRES_PER_DEGREE_NORTH), lon_deg
