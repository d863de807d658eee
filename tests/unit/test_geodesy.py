"""Fusion planes against PROJ's topocentric conversion."""

import numpy as np
import pytest
from pyproj import Geod, Transformer

from aeroskein import ellipsoid, geodesy

ORIGINS = [(0.0, 0.0), (48.25, 11.75), (-33.0, 151.0), (89.9, 40.0), (-89.9, 0.0), (90.0, 0.0), (52.0, -180.0)]
GEOD = Geod(ellps="WGS84")


def _around(lat: float, lon: float, furthest_m: float = 400_000.0) -> tuple[np.ndarray, np.ndarray]:
    """Positions in all directions from a point, up to a distance."""
    azimuth, distance = np.meshgrid(np.arange(0.0, 360.0, 30.0), np.linspace(0.0, furthest_m, 9))
    ones = np.ones(azimuth.size)
    lons, lats, _ = GEOD.fwd(lon * ones, lat * ones, azimuth.ravel(), distance.ravel())
    return lats, lons


def _topocentric(lat: float, lon: float) -> Transformer:
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat!r} +lon_0={lon!r} +h_0=0"
    )


def _apart_m(lat_a: np.ndarray, lon_a: np.ndarray, lat_b: np.ndarray, lon_b: np.ndarray) -> float:
    return float(np.abs(ellipsoid.to_ecef(lat_a, lon_a) - ellipsoid.to_ecef(lat_b, lon_b)).max())


@pytest.mark.parametrize(("lat", "lon"), ORIGINS)
def test_plane_coordinates_agree_with_proj(lat: float, lon: float) -> None:
    lats, lons = _around(lat, lon)

    e, n = geodesy.to_plane(geodesy.frame_rows(lat, lon), lats, lons)

    expected_e, expected_n, _ = _topocentric(lat, lon).transform(lons, lats, np.zeros_like(lats))
    assert np.abs(e - expected_e).max() < 1e-6
    assert np.abs(n - expected_n).max() < 1e-6


@pytest.mark.parametrize(("lat", "lon"), ORIGINS)
def test_plane_coordinates_come_back_to_the_same_place(lat: float, lon: float) -> None:
    lats, lons = _around(lat, lon)
    frames = geodesy.frame_rows(lat, lon)

    back = geodesy.from_plane(frames, *geodesy.to_plane(frames, lats, lons))

    assert _apart_m(lats, lons, *back) < 1e-6
    assert ((back[1] >= -180.0) & (back[1] < 180.0)).all()


def test_each_position_uses_its_own_frame() -> None:
    lats, lons = np.array([48.3, -33.1]), np.array([11.9, 151.2])
    frames = geodesy.frame_rows(np.array([48.25, -33.0]), np.array([11.75, 151.0]))

    together = np.stack(geodesy.to_plane(frames, lats, lons))

    alone = [geodesy.to_plane(frames[[i]], lats[[i]], lons[[i]]) for i in range(2)]
    assert np.array_equal(together, np.stack([np.concatenate(a) for a in alone], axis=-1))


def test_a_plane_beside_the_earth_gives_nan() -> None:
    lat, lon = geodesy.from_plane(geodesy.frame_rows(48.0, 11.0), np.array([6.5e6]), np.array([0.0]))

    assert np.isnan(lat).all()
    assert np.isnan(lon).all()


def test_positions_across_the_antimeridian_are_neighbours() -> None:
    frames = geodesy.frame_rows(*geodesy.snap_origin(np.array([0.0, 0.0]), np.array([179.999, -179.999])))

    e, _ = geodesy.to_plane(frames, np.array([0.0, 0.0]), np.array([179.999, -179.999]))

    assert np.array_equal(frames[0], frames[1])
    assert e[1] - e[0] == pytest.approx(222.64, abs=0.01)


# -- origins ---------------------------------------------------------------------------------------------------------


def test_origins_lie_on_a_quarter_degree_grid() -> None:
    lat, lon = geodesy.snap_origin(np.array([48.35, -33.9, 0.1]), np.array([11.78, 151.2, -0.13]))

    assert lat.tolist() == [48.25, -34.0, 0.0]
    assert lon.tolist() == [11.75, 151.25, -0.25]


def test_both_sides_of_the_antimeridian_share_an_origin_at_every_latitude() -> None:
    lats = np.concatenate([np.arange(-90.0, 90.25, 0.25), np.random.default_rng(1).uniform(-90, 90, 500)])

    west = geodesy.snap_origin(lats, np.full_like(lats, -180.0))
    east = geodesy.snap_origin(lats, np.full_like(lats, 180.0))

    assert np.array_equal(west, east)


def test_all_longitudes_share_the_origin_at_the_pole() -> None:
    lat, lon = geodesy.snap_origin(np.full(361, 90.0), np.arange(-180.0, 181.0))

    assert np.unique(lat).tolist() == [90.0]
    assert np.unique(lon).tolist() == [0.0]


def test_no_position_is_further_than_22_km_from_its_origin() -> None:
    rng = np.random.default_rng(2)
    lats = np.concatenate([rng.uniform(-90.0, 90.0, 20_000), rng.uniform(88.0, 90.0, 5_000), [90.0, -90.0]])
    lons = rng.uniform(-180.0, 180.0, len(lats))

    origin_lat, origin_lon = geodesy.snap_origin(lats, lons)

    distance_m = GEOD.inv(lons, lats, origin_lon, origin_lat)[2]
    assert distance_m.max() < 22_000.0


def test_an_origin_is_its_own_origin() -> None:
    rng = np.random.default_rng(3)
    once = geodesy.snap_origin(rng.uniform(-90, 90, 5000), rng.uniform(-180, 180, 5000))

    twice = geodesy.snap_origin(*once)

    assert np.array_equal(once, twice)


# -- axes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lat", "lon"), [o for o in ORIGINS if abs(o[0]) < 90.0])
@pytest.mark.parametrize("height_m", [0.0, 12_000.0])
def test_local_axes_are_the_derivative_of_the_plane(lat: float, lon: float, height_m: float) -> None:
    lats, lons = _around(lat, lon, 200_000.0)
    keep = np.abs(lats) < 89.99
    lats, lons = lats[keep], lons[keep]
    frames = geodesy.frame_rows(lat, lon)

    axes = geodesy.local_axes(frames, lats, lons, np.full_like(lats, height_m))

    # 10 m along the aircraft's own east and north, through ECEF and back to its foot point.
    here = ellipsoid.to_ecef(lats, lons, height_m)
    for k, direction in enumerate(ellipsoid.ecef_axes(lats, lons)[:2]):
        ahead = geodesy.to_plane(frames, *ellipsoid.from_ecef(here + 10.0 * direction)[:2])
        behind = geodesy.to_plane(frames, *ellipsoid.from_ecef(here - 10.0 * direction)[:2])
        slope = (np.stack(ahead, axis=-1) - np.stack(behind, axis=-1)) / 20.0
        assert np.abs(axes[:, :, k] - slope).max() < 1e-8


def test_local_axes_hold_the_convergence_of_the_meridians() -> None:
    lat, lon = np.array([48.0]), np.array([12.0])

    axes = geodesy.local_axes(geodesy.frame_rows(48.0, 11.0), lat, lon)

    # Meridians one degree apart converge by sin(latitude) degrees.
    assert np.degrees(np.arctan2(axes[0, 1, 0], axes[0, 0, 0])) == pytest.approx(np.sin(np.radians(48.0)), rel=1e-3)


def test_an_unknown_height_leaves_the_axes_on_the_ellipsoid() -> None:
    frames, lat, lon = geodesy.frame_rows(48.0, 11.0), np.array([48.3]), np.array([12.0])

    axes = geodesy.local_axes(frames, lat, lon, np.array([np.nan]))

    assert np.array_equal(axes, geodesy.local_axes(frames, lat, lon))


def test_covariance_turns_like_a_matrix() -> None:
    rng = np.random.default_rng(4)
    axes, root = rng.normal(size=(50, 2, 2)), rng.normal(size=(50, 2, 2))
    full = root @ np.swapaxes(root, 1, 2)
    packed = np.stack([full[:, 0, 0], full[:, 0, 1], full[:, 1, 1]], axis=-1)

    turned = geodesy.rotate_covariance(axes, packed)

    expected = axes @ full @ np.swapaxes(axes, 1, 2)
    assert turned == pytest.approx(
        np.stack([expected[:, 0, 0], expected[:, 0, 1], expected[:, 1, 1]], axis=-1), rel=1e-12, abs=1e-12
    )


def test_vectors_turn_like_a_matrix_and_back() -> None:
    rng = np.random.default_rng(5)
    axes, e, n = rng.normal(size=(50, 2, 2)), rng.normal(size=50), rng.normal(size=50)

    turned = geodesy.rotate_vector(axes, e, n)
    back = geodesy.rotate_vector(geodesy.invert_axes(axes), *turned)

    assert np.stack(turned, axis=-1) == pytest.approx((axes @ np.stack([e, n], axis=-1)[:, :, None])[:, :, 0])
    assert np.stack(back) == pytest.approx(np.stack([e, n]), rel=1e-9)


# -- a change of frame -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lat", "lon"), ORIGINS)
def test_moving_the_frame_does_not_move_the_aircraft(lat: float, lon: float) -> None:
    lats, lons = _around(lat, lon, 60_000.0)
    old = geodesy.frame_rows(lat, lon)
    new = geodesy.frame_rows(*geodesy.snap_origin(lats, lons))

    e, n, _ = geodesy.move_frame(old, new, *geodesy.to_plane(old, lats, lons))

    assert np.stack([e, n]) == pytest.approx(np.stack(geodesy.to_plane(new, lats, lons)), abs=1e-6)


@pytest.mark.parametrize(("lat", "lon"), ORIGINS)
def test_moving_the_frame_turns_velocities_as_the_positions_say(lat: float, lon: float) -> None:
    lats, lons = _around(lat, lon, 60_000.0)
    old = geodesy.frame_rows(lat, lon)
    new = geodesy.frame_rows(*geodesy.snap_origin(lats, lons))
    e, n = geodesy.to_plane(old, lats, lons)

    jacobian = geodesy.move_frame(old, new, e, n)[2]

    for k, (de, dn) in enumerate([(10.0, 0.0), (0.0, 10.0)]):
        ahead = np.stack(geodesy.move_frame(old, new, e + de, n + dn)[:2], axis=-1)
        behind = np.stack(geodesy.move_frame(old, new, e - de, n - dn)[:2], axis=-1)
        assert np.abs(jacobian[:, :, k] - (ahead - behind) / 20.0).max() < 1e-8


def test_neglected_change_of_the_jacobian_is_below_a_milligal_per_jet() -> None:
    # 250 m/s in a straight line in the old plane, 50 km out, is nearly straight in the new one.
    old, new = geodesy.frame_rows(60.0, 0.0), geodesy.frame_rows(60.0, 1.8)
    e = 50_000.0 + 250.0 * np.array([-10.0, 0.0, 10.0])

    moved = np.stack(geodesy.move_frame(old, new, e, np.zeros(3))[:2])

    bend_mps2 = np.linalg.norm(moved[:, 0] - 2.0 * moved[:, 1] + moved[:, 2]) / 100.0
    assert bend_mps2 < 1e-3
