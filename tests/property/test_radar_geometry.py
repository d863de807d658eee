"""Properties of radar conversions that hold for every site and target."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from aeroskein import ellipsoid, geodesy, radar_geometry

latitudes = st.floats(-90.0, 90.0)
longitudes = st.floats(-180.0, 180.0)
azimuths = st.floats(0.0, 360.0, exclude_max=True)
site_heights = st.floats(-100.0, 4_000.0)
heights = st.floats(-100.0, 15_000.0)


@given(latitudes, longitudes, site_heights, st.floats(1_000.0, 400_000.0), azimuths, heights)
def test_every_feasible_measurement_is_measured_again(
    lat: float, lon: float, site_height: float, slant: float, azimuth: float, height: float
) -> None:
    site = geodesy.frame_rows(lat, lon, site_height)
    fix = radar_geometry.radar_to_geodetic(site, np.array([slant]), np.array([azimuth]), np.array([height]))
    assume(fix.feasible[0])

    again = radar_geometry.geodetic_to_radar(site, fix.lat_deg, fix.lon_deg, np.array([height]))

    ground_m = max(fix.ground_range_m[0], 1.0)
    turned_deg = (again[1][0] - azimuth + 180.0) % 360.0 - 180.0
    assert abs(again[0][0] - slant) < 1e-3
    # Overhead the azimuth says nothing; what counts is the distance it makes.
    assert abs(np.radians(turned_deg)) * ground_m < 1e-3 or fix.ground_range_m[0] < 1.0


@given(latitudes, longitudes, site_heights, st.floats(1_000.0, 400_000.0), azimuths, heights)
def test_a_measurement_is_feasible_exactly_when_a_point_of_the_beam_has_that_height(
    lat: float, lon: float, site_height: float, slant: float, azimuth: float, height: float
) -> None:
    site = geodesy.frame_rows(lat, lon, site_height)

    fix = radar_geometry.radar_to_geodetic(site, np.array([slant]), np.array([azimuth]), np.array([height]))

    # The highest point at that range is overhead, the lowest below the antenna.
    tolerance = 2e-3
    reachable = abs(height - site_height) <= slant
    near_the_limit = abs(abs(height - site_height) - slant) < tolerance
    assert fix.feasible[0] == reachable or near_the_limit


@given(latitudes, longitudes, st.floats(1.0, 400_000.0), azimuths, heights)
def test_covariance_is_positive_definite_everywhere(
    lat: float, lon: float, slant: float, azimuth: float, height: float
) -> None:
    site = geodesy.frame_rows(lat, lon, 100.0)
    measured = np.array([slant]), np.array([azimuth])
    fix = radar_geometry.radar_to_geodetic(site, *measured, np.array([height]))

    ee, en, nn = radar_geometry.radar_covariance(
        site, *measured, fix, range_sigma_m=50.0, azimuth_sigma_deg=0.07, height_sigma_m=8.0
    )[0]

    assert ee > 0.0
    assert nn > 0.0
    assert ee * nn - en * en > 0.0
    assert ee + nn < slant**2 + 500.0**2


@given(latitudes, longitudes, heights)
def test_the_site_itself_is_the_origin_of_its_measurements(lat: float, lon: float, height: float) -> None:
    site = geodesy.frame_rows(lat, lon, height)

    slant, _, _ = radar_geometry.geodetic_to_radar(site, np.array([lat]), np.array([lon]), height)

    assert slant[0] < 1e-6
    assert np.abs(site[0, :3] - ellipsoid.to_ecef(np.array([lat]), np.array([lon]), height)).max() < 1e-9
