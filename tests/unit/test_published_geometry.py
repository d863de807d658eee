"""The conversions as published, and how far each of them is off."""

import numpy as np
import pytest
from pyproj import Geod, Transformer

from aeroskein import geodesy, published_geometry, radar_geometry

GEOD = Geod(ellps="WGS84")


def _worst_error_m(lat: float, distance_m: float) -> float:
    azimuth = np.arange(0.0, 360.0, 5.0)
    ones = np.ones_like(azimuth)
    lons, lats, _ = GEOD.fwd(10.0 * ones, lat * ones, azimuth, distance_m * ones)
    topocentric = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat!r} +lon_0=10 +h_0=0"
    )
    e, n, _ = topocentric.transform(lons, lats, np.zeros_like(lons))
    x, y = published_geometry.geographic_tile(lats, lons, lat, 10.0)
    return float(np.hypot(x - e, y - n).max())


@pytest.mark.parametrize(
    ("distance_km", "error_m"), [(10, 13.6), (50, 172.0), (100, 601.0), (200, 2216.0), (400, 8396.0)]
)
def test_published_tile_is_this_far_off_at_latitude_30(distance_km: float, error_m: float) -> None:
    assert _worst_error_m(30.0, 1e3 * distance_km) == pytest.approx(error_m, rel=0.01)


@pytest.mark.parametrize("lat", [-60.0, -30.0, 0.0, 30.0, 48.0, 60.0])
def test_published_tile_holds_to_42_m_inside_its_limit(lat: float) -> None:
    assert _worst_error_m(lat, published_geometry.TILE_LIMIT_M) < 42.0


def test_published_tile_has_its_published_constants() -> None:
    x, y = published_geometry.geographic_tile(np.array([61.0]), np.array([11.0]), 60.0, 10.0)

    assert x[0] == pytest.approx(55_660.0)
    assert y[0] == pytest.approx(110_946.0)


def test_published_tile_comes_back() -> None:
    lat, lon = np.array([48.02, 47.95]), np.array([179.98, -179.97])

    tile = published_geometry.geographic_tile(lat, lon, 48.0, 179.99)
    back = published_geometry.tile_to_geographic(*tile, 48.0, 179.99)

    assert np.abs(tile[0]).max() < 5_000.0
    assert np.stack(back) == pytest.approx(np.stack([lat, lon]), abs=1e-12)


def test_published_polar_formula_takes_a_zenith_angle() -> None:
    up = published_geometry.polar_to_rectangular(np.array([5.0]), np.array([0.0]), np.array([0.3]))
    level = published_geometry.polar_to_rectangular(np.array([5.0]), np.array([np.pi / 2]), np.array([0.0]))

    assert np.concatenate(up) == pytest.approx([0.0, 0.0, 5.0])
    assert np.concatenate(level) == pytest.approx([5.0, 0.0, 0.0])


def test_published_polar_formula_is_the_radars_when_its_angles_are_translated() -> None:
    rng = np.random.default_rng(1)
    r, azimuth, above = rng.uniform(20e3, 90e3, 50), rng.uniform(0.0, 360.0, 50), rng.uniform(0.0, 12e3, 50)

    e, n = published_geometry.radar_to_rectangular(r, azimuth, above)

    x, y, z = published_geometry.polar_to_rectangular(r, np.arccos(above / r), np.radians(90.0 - azimuth))
    assert np.stack([e, n, above]) == pytest.approx(np.stack([x, y, z]), abs=1e-8)


def test_published_polar_formula_fails_when_fed_azimuth_and_elevation() -> None:
    # A target 40 km due north, 3 km up: the formula as printed, with elevation and azimuth, puts it in the east.
    elevation, azimuth = np.array([np.arcsin(3.0 / 40.0)]), np.array([0.0])

    x, y, z = published_geometry.polar_to_rectangular(np.array([40e3]), elevation, azimuth)

    assert [x[0], y[0], z[0]] == pytest.approx([3_000.0, 0.0, 39_887.3], abs=0.1)


def test_a_height_above_the_range_gives_nan() -> None:
    e, _ = published_geometry.radar_to_rectangular(np.array([9e3]), np.array([0.0]), np.array([10e3]))

    assert np.isnan(e[0])


@pytest.mark.parametrize(("range_m", "error_m"), [(40e3, 33.3), (100e3, 88.7), (200e3, 196.6)])
def test_flat_earth_ground_range_is_this_far_off_at_11_km(range_m: float, error_m: float) -> None:
    sites = geodesy.frame_rows(48.0, 11.0)
    one = np.ones(1)

    _, n = published_geometry.radar_to_rectangular(range_m * one, 0.0 * one, 11_000.0 * one)

    fix = radar_geometry.radar_to_geodetic(sites, range_m * one, 0.0 * one, 11_000.0 * one)
    _, foot_n = geodesy.to_plane(sites, fix.lat_deg, fix.lon_deg)
    assert abs(n[0] - foot_n[0]) == pytest.approx(error_m, rel=0.005)
