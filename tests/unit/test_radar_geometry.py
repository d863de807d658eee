"""Radar measurements to positions and back, against PROJ, differences and random draws."""

import numpy as np
import pytest
from pyproj import Transformer

from aeroskein import ellipsoid, geodesy, radar_geometry
from aeroskein.radar_geometry import RadarFix

SITES = [
    (0.0, 0.0, 0.0),
    (48.35, 11.78, 460.0),
    (-33.9, 151.2, 60.0),
    (52.0, 179.9, 2500.0),
    (89.9, 0.0, 10.0),
    (-89.9, 45.0, 2800.0),
    (90.0, 0.0, 0.0),
]
RANGES_M = (2_000.0, 10_000.0, 60_000.0, 150_000.0, 400_000.0)
HEIGHTS_M = (-100.0, 0.0, 500.0, 3_000.0, 11_000.0, 15_000.0)


def _targets(site: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets all around a site at many ground distances and heights: lat, lon, height."""
    azimuth, distance, height = np.meshgrid(np.arange(5.0, 360.0, 45.0), RANGES_M, HEIGHTS_M)
    frames = geodesy.frame_rows(site[0], site[1])
    angle = np.radians(azimuth.ravel())
    lat, lon = geodesy.from_plane(frames, distance.ravel() * np.sin(angle), distance.ravel() * np.cos(angle))
    return lat, lon, height.ravel()


def _measured_by_proj(
    site: tuple[float, float, float], lat: np.ndarray, lon: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    topocentric = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={site[0]!r} +lon_0={site[1]!r} +h_0={site[2]!r}"
    )
    e, n, u = topocentric.transform(lon, lat, height)
    return (
        np.sqrt(e**2 + n**2 + u**2),
        np.degrees(np.arctan2(e, n)) % 360.0,
        np.degrees(np.arctan2(u, np.hypot(e, n))),
    )


def _fix_at(site: np.ndarray, range_m: float, azimuth_deg: float, height_m: float) -> RadarFix:
    return radar_geometry.radar_to_geodetic(site, np.array([range_m]), np.array([azimuth_deg]), np.array([height_m]))


@pytest.mark.parametrize("site", SITES)
def test_a_target_is_seen_where_proj_sees_it(site: tuple[float, float, float]) -> None:
    lat, lon, height = _targets(site)

    slant, azimuth, elevation = radar_geometry.geodetic_to_radar(geodesy.frame_rows(*site), lat, lon, height)

    expected = _measured_by_proj(site, lat, lon, height)
    assert np.abs(slant - expected[0]).max() < 1e-6
    assert np.abs((azimuth - expected[1] + 180.0) % 360.0 - 180.0).max() < 1e-9
    assert np.abs(elevation - expected[2]).max() < 1e-9


@pytest.mark.parametrize("site", SITES)
def test_a_measurement_made_by_proj_comes_back_to_its_target(site: tuple[float, float, float]) -> None:
    lat, lon, height = _targets(site)
    slant, azimuth, elevation = _measured_by_proj(site, lat, lon, height)

    fix = radar_geometry.radar_to_geodetic(geodesy.frame_rows(*site), slant, azimuth, height)

    moved_m = ellipsoid.to_ecef(fix.lat_deg, fix.lon_deg, height) - ellipsoid.to_ecef(lat, lon, height)
    assert np.abs(moved_m).max() < 1e-3
    assert fix.feasible.all()
    assert np.abs(fix.elevation_deg - elevation).max() < 1e-6
    assert fix.ground_range_m == pytest.approx(slant * np.cos(np.radians(elevation)), abs=1e-3)


def test_each_measurement_uses_its_own_site() -> None:
    sites = np.concatenate([geodesy.frame_rows(*site) for site in SITES[1:3]])
    slant, azimuth, height = np.array([60e3, 90e3]), np.array([10.0, 200.0]), np.array([9e3, 5e3])

    together = radar_geometry.radar_to_geodetic(sites, slant, azimuth, height)

    for i in range(2):
        alone = radar_geometry.radar_to_geodetic(sites[[i]], slant[[i]], azimuth[[i]], height[[i]])
        assert [column[i] for column in together] == [column[0] for column in alone]


def test_straight_overhead_is_feasible_and_over_the_site() -> None:
    fix = _fix_at(geodesy.frame_rows(48.35, 11.78, 460.0), 10_000.0, 77.0, 10_460.0)

    assert fix.feasible[0]
    assert fix.lat_deg[0] == pytest.approx(48.35, abs=1e-5)
    assert fix.elevation_deg[0] == pytest.approx(90.0, abs=1e-3)


@pytest.mark.parametrize("height_m", [11_000.0, -10_000.0])
def test_a_height_out_of_reach_is_not_feasible_and_stays_over_the_site(height_m: float) -> None:
    fix = _fix_at(geodesy.frame_rows(48.35, 11.78, 460.0), 9_000.0, 77.0, height_m)

    assert not fix.feasible[0]
    assert fix.lat_deg[0] == pytest.approx(48.35, abs=1e-10)
    assert fix.lon_deg[0] == pytest.approx(11.78, abs=1e-10)
    assert fix.cos_elevation[0] == 0.0


@pytest.mark.parametrize("range_m", [0.0, -20.0])
def test_a_range_of_nothing_is_finite(range_m: float) -> None:
    fix = _fix_at(geodesy.frame_rows(48.35, 11.78, 460.0), range_m, 77.0, 3000.0)

    assert not fix.feasible[0]
    assert np.isfinite(fix.lat_deg[0])


def test_a_missing_height_gives_no_position() -> None:
    fix = _fix_at(geodesy.frame_rows(48.35, 11.78, 460.0), 50_000.0, 77.0, np.nan)

    assert np.isnan(fix.lat_deg[0])
    assert not fix.feasible[0]


# -- derivatives and covariance --------------------------------------------------------------------------------------


@pytest.mark.parametrize("site", SITES)
@pytest.mark.parametrize("range_m", RANGES_M[2:])
@pytest.mark.parametrize("height_m", [500.0, 12_000.0])
def test_jacobian_is_the_derivative_of_the_position(
    site: tuple[float, float, float], range_m: float, height_m: float
) -> None:
    azimuth = np.arange(5.0, 360.0, 45.0)
    measured = np.stack([np.full_like(azimuth, range_m), azimuth, np.full_like(azimuth, height_m)])
    sites = geodesy.frame_rows(*site)
    fix = radar_geometry.radar_to_geodetic(sites, *measured)

    jacobian = radar_geometry.radar_jacobian(sites, measured[0], azimuth, fix)

    east, north, _ = ellipsoid.ecef_axes(fix.lat_deg, fix.lon_deg)
    for k, (step, unit) in enumerate([(10.0, 1.0), (1e-3, np.radians(1.0)), (10.0, 1.0)]):
        change = np.zeros((3, 1))
        change[k] = step
        ahead, behind = (radar_geometry.radar_to_geodetic(sites, *(measured + sign * change)) for sign in (1.0, -1.0))
        moved_m = ellipsoid.to_ecef(ahead.lat_deg, ahead.lon_deg, measured[2] + change[2])
        moved_m -= ellipsoid.to_ecef(behind.lat_deg, behind.lon_deg, measured[2] - change[2])
        slope = np.stack([(moved_m * east).sum(-1), (moved_m * north).sum(-1)], axis=-1) / (2.0 * step * unit)
        scale = range_m if k == 1 else 1.0
        assert np.abs(jacobian[:, :, k] - slope).max() < 1e-5 * scale


def test_a_higher_target_at_the_same_range_is_nearer_by_the_tangent_of_the_elevation() -> None:
    sites = geodesy.frame_rows(48.35, 11.78, 460.0)
    fix = _fix_at(sites, 20_000.0, 90.0, 10_460.0)

    jacobian = radar_geometry.radar_jacobian(sites, np.array([20_000.0]), np.array([90.0]), fix)

    assert jacobian[0, 0, 2] == pytest.approx(-np.tan(np.radians(fix.elevation_deg[0])), rel=0.01)


def test_cross_range_sigma_is_ground_range_times_azimuth_sigma() -> None:
    sites = geodesy.frame_rows(48.35, 11.78, 460.0)
    measured = np.array([150_000.0]), np.array([90.0])
    fix = _fix_at(sites, 150_000.0, 90.0, 10_000.0)

    covariance = radar_geometry.radar_covariance(
        sites, *measured, fix, range_sigma_m=50.0, azimuth_sigma_deg=0.07, height_sigma_m=8.0
    )

    # Two degrees of longitude east of the site the beam has turned by the convergence of the meridians.
    axes = geodesy.local_axes(sites, fix.lat_deg, fix.lon_deg)
    in_site_axes = geodesy.rotate_covariance(axes, covariance)[0]
    assert np.sqrt(in_site_axes[2]) == pytest.approx(fix.ground_range_m[0] * np.radians(0.07), rel=2e-3)
    assert np.sqrt(in_site_axes[0]) == pytest.approx(50.0 / np.cos(np.radians(4.0)), rel=2e-3)
    assert abs(in_site_axes[1]) < 1.0
    assert abs(covariance[0, 1]) > 500.0


@pytest.mark.parametrize(
    ("range_m", "height_m"), [(300_000.0, 11_000.0), (60_000.0, 11_000.0), (15_000.0, 11_000.0), (11_600.0, 11_000.0)]
)
def test_covariance_is_that_of_random_draws(range_m: float, height_m: float) -> None:
    rng = np.random.default_rng(7)
    sites = geodesy.frame_rows(48.35, 11.78, 460.0)
    noise = rng.normal(size=(3, 40_000)) * np.array([[50.0], [0.07], [30.0]])
    truth = _fix_at(sites, range_m, 123.0, height_m)

    covariance = radar_geometry.radar_covariance(
        sites,
        np.array([range_m]),
        np.array([123.0]),
        truth,
        range_sigma_m=50.0,
        azimuth_sigma_deg=0.07,
        height_sigma_m=30.0,
    )

    drawn = radar_geometry.radar_to_geodetic(sites, range_m + noise[0], 123.0 + noise[1], height_m + noise[2])
    local = geodesy.to_plane(geodesy.frame_rows(truth.lat_deg, truth.lon_deg), drawn.lat_deg, drawn.lon_deg)
    sample = np.cov(np.stack(local))
    # The draws scatter by 1/sqrt(20,000); one geometry is so steep that the second derivative shows.
    largest = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    expected = np.array([[covariance[0, 0], covariance[0, 1]], [covariance[0, 1], covariance[0, 2]]])
    assert (np.abs(expected - sample) / largest).max() < 0.05


def test_overhead_the_covariance_is_as_large_as_the_ground_range_is_uncertain() -> None:
    # 9,600 m above the antenna, and a range that says the same: the ground range is anything up to about a kilometre.
    rng = np.random.default_rng(8)
    sites = geodesy.frame_rows(48.35, 11.78, 460.0)
    fix = _fix_at(sites, 9_600.0, 0.0, 10_060.0)

    covariance = radar_geometry.radar_covariance(
        sites,
        np.array([9_600.0]),
        np.array([0.0]),
        fix,
        range_sigma_m=50.0,
        azimuth_sigma_deg=0.1,
        height_sigma_m=30.0,
    )

    drawn = radar_geometry.radar_to_geodetic(
        sites, 9_600.0 + 50.0 * rng.normal(size=20_000), np.zeros(20_000), 10_060.0 + 30.0 * rng.normal(size=20_000)
    )
    spread_m = np.sqrt(np.mean(drawn.ground_range_m**2))
    assert 0.5 * spread_m < np.sqrt(covariance[0, 2]) < 2.0 * spread_m
    assert covariance[0, 0] > 0.0
