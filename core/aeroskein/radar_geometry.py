"""What a radar sees: slant range and azimuth with a height become a position, its covariance, and the way back.

A radar measures the length and the direction of the line to the target, not where it is over ground. With the height
above the ellipsoid, known from Mode C, the elevation follows: first on a sphere that fits the site, then by Newton
steps on the true height, so that site, target and ellipsoid agree to rounding at any range. The derivatives of
that position with respect to range, azimuth and height, taken where the target is, carry noise and biases over.

A site travels as a row like a frame: ``geodesy.frame_rows(lat_deg, lon_deg, height_m)`` with the antenna's height.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from aeroskein.ellipsoid import ECCENTRICITY_SQUARED, SEMI_MAJOR_M, Angles, from_ecef, height_above, to_ecef
from aeroskein.plots import Array, Bools, columns_of
from aeroskein.units import wrap_azimuth_deg

__all__ = [
    "RadarFix", "geodetic_to_radar", "radar_covariance", "radar_jacobian", "radar_to_geodetic", "turned_covariance",
]  # fmt: skip

# Newton steps on the height. The sphere of the first guess leaves up to 3 m at 400 km; the slope of that sphere is so
# nearly right that one step leaves 0.05 mm, and the second only rounding.
HEIGHT_STEPS: Final = 2

# A shorter range is taken as this, so that nothing is divided by zero; no radar reports a target so near. [m]
SHORTEST_RANGE_M: Final = 1e-3

# How well the height must be met for a measurement to be possible: far below any altitude's resolution, far above
# rounding. [m]
HEIGHT_TOLERANCE_M: Final = 1e-3


class RadarFix(NamedTuple):
    """Positions made from radar measurements, all columns ``(n,)``.

    Attributes
    ----------
    lat_deg, lon_deg : (n,) array
        WGS-84 position. [deg]
    elevation_deg : (n,) array
        Elevation of the target above the site's horizon. [deg]
    cos_elevation : (n,) array
        Its cosine: the share of the slant range that is horizontal at the site.
    ground_range_m : (n,) array
        Slant range times that cosine. [m]
    feasible : (n,) bool array
        Whether a target at that height can have that range. Where it cannot (a range shorter than the difference of
        heights), the position is overhead.
    """

    lat_deg: Array
    lon_deg: Array
    elevation_deg: Array
    cos_elevation: Array
    ground_range_m: Array
    feasible: Bools


def radar_to_geodetic(sites: Array, slant_range_m: Array, azimuth_deg: Array, height_m: Array) -> RadarFix:
    """Find the point with this slant range, azimuth and height above the ellipsoid.

    First guess, with R the earth's radius of curvature at the site and R_s = R + h_s:
    ``sin el = ((R + h)² - R_s² - r²) / (2 r R_s)``.

    Parameters
    ----------
    sites : (n, 12) array
        Rows of ``geodesy.frame_rows`` at the antennas; ``(1, 12)`` serves all.
    slant_range_m : (n,) array
        Distance from the antenna. [m]
    azimuth_deg : (n,) array
        Clockwise from true north in the site's horizontal plane. [deg]
    height_m : (n,) array
        Height of the target above the ellipsoid; NaN gives a NaN position, not feasible. [m]

    Returns
    -------
    RadarFix
        Positions, elevations, and which are feasible.
    """
    range_m = np.maximum(slant_range_m, SHORTEST_RANGE_M)
    site = np.ascontiguousarray(sites.T)
    ahead, _ = _horizontal(site, azimuth_deg)
    root = np.sqrt(1.0 - ECCENTRICITY_SQUARED * site[11] ** 2)
    site_height_m = (site[0:3] * site[9:12]).sum(axis=0) - SEMI_MAJOR_M * root
    radius_m = SEMI_MAJOR_M * np.sqrt(1.0 - ECCENTRICITY_SQUARED) / root**2  # Gaussian mean radius
    to_site_m = radius_m + site_height_m
    sin_el = (height_m - site_height_m) * (2.0 * radius_m + height_m + site_height_m) - range_m**2
    sin_el = _sine(sin_el / (2.0 * range_m * to_site_m))
    metres_per_sine = range_m * to_site_m / (radius_m + height_m)
    for _ in range(HEIGHT_STEPS):
        missed_m = height_m - height_above(_along_beam(site, range_m, ahead, sin_el).T)
        sin_el = _sine(sin_el + missed_m / metres_per_sine)
    lat_deg, lon_deg, reached_m = from_ecef(_along_beam(site, range_m, ahead, sin_el).T)
    feasible = np.abs(reached_m - height_m) < HEIGHT_TOLERANCE_M
    cos_el = np.sqrt(1.0 - sin_el**2)
    elevation_deg = np.degrees(np.arctan2(sin_el, cos_el))
    return RadarFix(lat_deg, lon_deg, elevation_deg, cos_el, range_m * cos_el, feasible)


def geodetic_to_radar(
    sites: Array, lat_deg: Array, lon_deg: Array, height_m: Array | float
) -> tuple[Array, Array, Array]:
    """Say what a radar without errors measures.

    Parameters
    ----------
    sites : (n, 12) array
        Rows of ``geodesy.frame_rows`` at the antennas; ``(1, 12)`` serves all.
    lat_deg, lon_deg : (n,) array
        WGS-84 position. [deg]
    height_m : (n,) array or float
        Height above the ellipsoid. [m]

    Returns
    -------
    slant_range_m, azimuth_deg, elevation_deg : (n,) arrays
        Seen from the antenna; 0 <= azimuth < 360. [m, deg, deg]
    """
    step = to_ecef(lat_deg, lon_deg, height_m) - sites[..., 0:3]
    e, n, u = (np.einsum("...c,...c->...", step, sites[..., k : k + 3]) for k in (3, 6, 9))
    ground_m = np.hypot(e, n)
    azimuth_deg = wrap_azimuth_deg(np.degrees(np.arctan2(e, n)))
    return np.hypot(ground_m, u), azimuth_deg, np.degrees(np.arctan2(u, ground_m))


def radar_jacobian(
    sites: Array,
    slant_range_m: Array,
    azimuth_deg: Array,
    fix: RadarFix,
    smallest_cos_elevation: Array | float = 0.0,
) -> Array:
    """Derivatives of the position over ground with respect to range, azimuth and height.

    The point ``O + r (cos el d + sin el U)`` keeps its height when range or azimuth change: the elevation gives way,
    along ``w = -sin el d + cos el U``. With n the normal of the ellipsoid at the target that leaves
    ``û - w (n·û)/(n·w)`` for range, ``r cos el (t - w (n·t)/(n·w))`` for azimuth and ``w / (n·w)`` for height. A higher
    target at the same slant range is nearer: its ground range falls by tan(elevation) metres a metre.

    Parameters
    ----------
    sites : (n, 12) array
        Rows of ``geodesy.frame_rows`` at the antennas; ``(1, 12)`` serves all.
    slant_range_m, azimuth_deg : (n,) array
        The measurement. [m, deg]
    fix : RadarFix
        What ``radar_to_geodetic`` made of it.
    smallest_cos_elevation : (n,) array or float
        Lower bound for the cosine of the elevation; without it the derivatives grow without limit overhead.

    Returns
    -------
    (n, 2, 3) array
        d(east, north at the target, at its height) / d(range, azimuth, height). [1, m/rad, 1]
    """
    return _jacobian(sites, slant_range_m, azimuth_deg, fix, smallest_cos_elevation).transpose(2, 0, 1)


def _jacobian(
    sites: Array, slant_range_m: Array, azimuth_deg: Array, fix: RadarFix, smallest_cos_elevation: Array | float
) -> Array:
    """``radar_jacobian`` with the rows last, ``(2, 3, n)``."""
    range_m = np.maximum(slant_range_m, SHORTEST_RANGE_M)
    cos_el = np.maximum(fix.cos_elevation, np.maximum(smallest_cos_elevation, 1e-9))
    sin_el = np.sign(fix.elevation_deg) * np.sqrt(np.maximum(0.0, 1.0 - cos_el**2))
    site = np.ascontiguousarray(sites.T)
    ahead, clockwise = _horizontal(site, azimuth_deg)
    up = site[9:12]
    beam, rising = cos_el * ahead + sin_el * up, cos_el * up - sin_el * ahead
    angles = Angles.of(fix.lat_deg, fix.lon_deg)
    normal = angles.up()
    # n·w is the cosine of the elevation measured at the target, about (1 - r/R) cos el: small overhead, never zero.
    rising = rising / (normal * rising).sum(axis=0)
    moves = np.empty((3, 1, 3, len(range_m)))
    moves[:, 0, 0] = beam - rising * (normal * beam).sum(axis=0)
    moves[:, 0, 1] = (clockwise - rising * (normal * clockwise).sum(axis=0)) * (range_m * cos_el)
    moves[:, 0, 2] = rising
    jacobian: Array = (angles.level_axes()[:, :, None] * moves).sum(axis=0)
    return jacobian


def radar_covariance(
    sites: Array,
    slant_range_m: Array,
    azimuth_deg: Array,
    fix: RadarFix,
    *,
    range_sigma_m: Array | float,
    azimuth_sigma_deg: Array | float,
    height_sigma_m: Array | float,
) -> Array:
    """Covariance of a radar position in the local east-north axes at the target.

    Derivatives lie when the target is nearly overhead: with an uncertain range or height no ground range below
    ``sqrt(2 r sigma)`` can be told from zero. So the elevation is taken no steeper than that ground range has, which
    keeps the covariance finite, of the right size, and never singular.

    Parameters
    ----------
    sites : (n, 12) array
        Rows of ``geodesy.frame_rows`` at the antennas; ``(1, 12)`` serves all.
    slant_range_m, azimuth_deg : (n,) array
        The measurement. [m, deg]
    fix : RadarFix
        What ``radar_to_geodetic`` made of it.
    range_sigma_m, azimuth_sigma_deg, height_sigma_m : (n,) array or float
        One sigma of each; the height's is that of the height above the ellipsoid. [m, deg, m]

    Returns
    -------
    (n, 3) array
        Packed ``[ee, en, nn]``; ``geodesy.local_axes`` at the target's height carries it to the plane. [m²]
    """
    range_m = np.maximum(slant_range_m, SHORTEST_RANGE_M)
    blur_m = np.hypot(range_sigma_m, height_sigma_m)
    smallest = np.minimum(np.sqrt(2.0 * blur_m / range_m), 1.0)
    east, north = _jacobian(sites, slant_range_m, azimuth_deg, fix, smallest)
    for k, sigma in enumerate((range_sigma_m, np.radians(azimuth_sigma_deg), height_sigma_m)):
        east[k] *= sigma
        north[k] *= sigma
    return columns_of((east * east).sum(axis=0), (east * north).sum(axis=0), (north * north).sum(axis=0))


def turned_covariance(radial: Array, across: Array, east: Array, north: Array) -> tuple[Array, Array, Array]:
    """Covariance ee, en, nn from variances along and across a line whose unit vector is ``east``, ``north``. [m²]"""
    return (
        radial * east * east + across * north * north,
        (radial - across) * east * north,
        radial * north * north + across * east * east,
    )


def _horizontal(site: Array, azimuth_deg: Array) -> tuple[Array, Array]:
    """Unit vectors along the azimuth and clockwise of it, horizontal at the site ``(12, n)``: ``(3, n)`` in ECEF."""
    azimuth = np.radians(azimuth_deg)
    sin_az, cos_az = np.sin(azimuth), np.cos(azimuth)
    east, north = site[3:6], site[6:9]
    return sin_az * east + cos_az * north, cos_az * east - sin_az * north


def _sine(value: Array) -> Array:
    """What is meant as a sine, kept between -1 and 1."""
    return np.minimum(np.maximum(value, -1.0), 1.0)


def _along_beam(site: Array, range_m: Array, ahead: Array, sin_el: Array) -> Array:
    """The point so far along the beam of a site ``(12, n)``: ``(3, n)`` in ECEF. [m]"""
    flat_m, rise_m = range_m * np.sqrt(1.0 - sin_el**2), range_m * sin_el
    point_m: Array = site[0:3] + flat_m * ahead + rise_m * site[9:12]
    return point_m
