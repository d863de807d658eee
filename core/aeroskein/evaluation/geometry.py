"""Earth-centred coordinates for judging errors: the forward half of WGS-84 geodesy, kept apart from the product's own.

A judge that used the conversions of what it judges could not see their faults; so the dozen lines needed here stand
alone. Everything happens in Earth-centred, Earth-fixed (ECEF) coordinates, where neither the antimeridian nor a pole
is special; a difference is turned into east and north only at the very end, at the point where it is meant.
Formulas: NIMA TR8350.2, WGS-84, section 4 (geodetic to rectangular); n-vector: Gade 2010, J. Navigation 63(3).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array

__all__ = ["east_north", "east_north_axes", "ecef", "rotate_to_east_north", "up_vector", "velocity_ecef"]

# WGS-84 defining constants: semi-major axis and flattening.
SEMI_MAJOR_M: Final = 6_378_137.0
FLATTENING: Final = 1.0 / 298.257223563
ECCENTRICITY_SQUARED: Final = FLATTENING * (2.0 - FLATTENING)

# Nearer to the axis than this (6 cm on the ground) "east" has no meaning of its own; longitude 0 is assumed.
_POLE_SINE: Final = 1e-8


def up_vector(lat_deg: Array, lon_deg: Array) -> Array:
    """Unit normal of the ellipsoid (the n-vector) at positions of shape ``(n,)``, shape ``(n, 3)``. [1]"""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    cos_lat = np.cos(lat)
    return np.stack([cos_lat * np.cos(lon), cos_lat * np.sin(lon), np.sin(lat)], axis=-1)


def ecef(up: Array, height_m: Array) -> Array:
    """Earth-centred coordinates of points given by their n-vector.

    Parameters
    ----------
    up : (n, 3) array
        Unit normals of the ellipsoid. [1]
    height_m : (n,) array
        Height above the ellipsoid. [m]

    Returns
    -------
    (n, 3) array
        [m]
    """
    prime_vertical_m = SEMI_MAJOR_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * up[..., 2] ** 2)
    position = up * (prime_vertical_m + height_m)[..., None]
    position[..., 2] -= ECCENTRICITY_SQUARED * prime_vertical_m * up[..., 2]
    return position


def east_north_axes(up: Array) -> tuple[Array, Array]:
    """Unit vectors east and north for n-vectors of shape ``(n, 3)``; at a pole those of longitude 0."""
    flat = np.hypot(up[..., 0], up[..., 1])
    at_pole = flat < _POLE_SINE
    scale = np.where(at_pole, 1.0, flat)
    zero = np.zeros_like(flat)
    east = np.stack(
        [np.where(at_pole, 0.0, -up[..., 1] / scale), np.where(at_pole, 1.0, up[..., 0] / scale), zero], axis=-1
    )
    return east, np.cross(up, east)


def east_north_axes_at(lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
    """Unit vectors east and north at geodetic positions; defined at the poles too, by the longitude given there."""
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=-1)
    north = np.stack([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)], axis=-1)
    return east, north


def rotate_to_east_north(vector: Array, east: Array, north: Array) -> Array:
    """East and north components of Earth-centred vectors, shape ``(n, 2)``, in the vectors' unit."""
    return np.stack([np.sum(vector * east, axis=-1), np.sum(vector * north, axis=-1)], axis=-1)


def east_north(speed: Array, angle_deg: Array) -> Array:
    """East and north components of a speed in a direction clockwise from north, shape ``(n, 2)``."""
    angle = np.radians(angle_deg)
    return np.stack([speed * np.sin(angle), speed * np.cos(angle)], axis=-1)


def velocity_ecef(lat_deg: Array, lon_deg: Array, east_north_mps: Array, vertical_mps: Array) -> Array:
    """Earth-centred velocity from local components at a geodetic position.

    Parameters
    ----------
    lat_deg, lon_deg : (n,) array
        Where the components are meant. [deg]
    east_north_mps : (n, 2) array
        Horizontal velocity. [m/s]
    vertical_mps : (n,) array
        Upward velocity. [m/s]

    Returns
    -------
    (n, 3) array
        [m/s]
    """
    east, north = east_north_axes_at(lat_deg, lon_deg)
    horizontal = east * east_north_mps[..., :1] + north * east_north_mps[..., 1:]
    return horizontal + up_vector(lat_deg, lon_deg) * vertical_mps[..., None]
