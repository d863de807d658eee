"""Planes of flights against PROJ, and the Jacobians against finite steps."""

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.planes import LambertPlanes, Planes, planes_of

GEOD = pyproj.Geod(ellps="WGS84")


def around(lat_deg: float, lon_deg: float, seed: int = 0, n: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One flight of positions within a few degrees."""
    rng = np.random.default_rng(seed)
    lat = np.clip(lat_deg + rng.uniform(-3.0, 3.0, n), -89.0, 89.0)
    lon = (lon_deg + rng.uniform(-4.0, 4.0, n) + 180.0) % 360.0 - 180.0
    return np.zeros(n, dtype=np.int64), lat, lon


@pytest.mark.parametrize("place", [(48.0, 11.0), (-33.0, 151.0), (65.0, 179.0), (12.0, -100.0)])
def test_lambert_projection_is_projs(place: tuple[float, float]) -> None:
    flight, lat, lon = around(*place)
    unrolled = place[1] + (lon - place[1] + 180.0) % 360.0 - 180.0
    low, middle, high = np.quantile(lat, [0.25, 0.5, 0.75])
    oracle = pyproj.Proj(
        proj="lcc", lat_1=low, lat_2=high, lat_0=middle, lon_0=np.median(unrolled), ellps="WGS84", over=True
    )

    planes = planes_of("lambert", flight, lat, lon)
    e, n = planes.to_plane(flight, lat, lon)
    back = planes.from_plane(flight, e, n)

    expected = oracle(unrolled, lat)
    np.testing.assert_allclose(e, expected[0], atol=1e-5)
    np.testing.assert_allclose(n, expected[1], atol=1e-5)
    np.testing.assert_allclose(back[0], lat, atol=1e-11)
    np.testing.assert_allclose((back[1] - lon + 180.0) % 360.0, 180.0, atol=1e-11)


@pytest.mark.parametrize("kind", ["local", "lambert"])
@given(st.floats(-80.0, 80.0), st.floats(-180.0, 180.0), st.integers(0, 1000))
def test_planes_go_there_and_back(kind: str, lat_deg: float, lon_deg: float, seed: int) -> None:
    flight, lat, lon = around(lat_deg, lon_deg, seed, 5)

    planes = planes_of(kind, flight, lat, lon)
    back_lat, back_lon = planes.from_plane(flight, *planes.to_plane(flight, lat, lon))

    np.testing.assert_allclose(back_lat, lat, atol=1e-10)
    np.testing.assert_allclose((back_lon - lon + 180.0) % 360.0, 180.0, atol=1e-9)


def moved(planes: Planes, flight: np.ndarray, lat: np.ndarray, lon: np.ndarray, azimuth: float) -> np.ndarray:
    """Plane vectors of one metre over ground in a direction, by PROJ's geodesics."""
    step_m = 10.0
    ahead = GEOD.fwd(lon, lat, np.full(len(lat), azimuth), np.full(len(lat), step_m))
    behind = GEOD.fwd(lon, lat, np.full(len(lat), azimuth + 180.0), np.full(len(lat), step_m))
    to = np.stack(planes.to_plane(flight, np.asarray(ahead[1]), np.asarray(ahead[0])), axis=1)
    start = np.stack(planes.to_plane(flight, np.asarray(behind[1]), np.asarray(behind[0])), axis=1)
    return (to - start) / (2 * step_m)


@pytest.mark.parametrize("kind", ["local", "lambert"])
@pytest.mark.parametrize("place", [(48.0, 11.0), (0.0, -179.9), (-70.0, 30.0)])
def test_axes_are_the_derivative_of_the_projection(kind: str, place: tuple[float, float]) -> None:
    flight, lat, lon = around(*place, n=10)
    planes = planes_of(kind, flight, lat, lon)

    axes = planes.axes(flight, lat, lon, np.zeros(10))

    np.testing.assert_allclose(axes[:, :, 0], moved(planes, flight, lat, lon, 90.0), atol=2e-6)
    np.testing.assert_allclose(axes[:, :, 1], moved(planes, flight, lat, lon, 0.0), atol=2e-6)


def test_height_slows_the_foot_point() -> None:
    flight, lat, lon = around(48.0, 11.0, n=3)
    planes = planes_of("lambert", flight, lat, lon)

    low, high = (planes.axes(flight, lat, lon, np.full(3, height_m)) for height_m in (0.0, 11_000.0))

    lengths = np.linalg.norm(low, axis=1) / np.linalg.norm(high, axis=1)
    np.testing.assert_allclose(lengths, 1.0 + 11_000.0 / 6.38e6, rtol=2e-5)


def test_standard_parallels_on_both_sides_of_the_equator_still_make_a_plane() -> None:
    flight, lat, lon = np.zeros(4, dtype=np.int64), np.array([-1.0, -0.5, 0.5, 1.0]), np.array([5.0, 5.1, 5.2, 5.3])

    planes = planes_of("lambert", flight, lat, lon)
    back = planes.from_plane(flight, *planes.to_plane(flight, lat, lon))

    assert isinstance(planes, LambertPlanes)
    np.testing.assert_allclose(back, [lat, lon], atol=1e-9)


def test_each_flight_has_its_own_plane() -> None:
    flight = np.array([0, 0, 1, 1])
    lat, lon = np.array([48.0, 48.1, -20.0, -20.1]), np.array([11.0, 11.1, 140.0, 140.1])

    both = planes_of("lambert", flight, lat, lon).to_plane(flight, lat, lon)

    alone = planes_of("lambert", flight[2:] - 1, lat[2:], lon[2:]).to_plane(flight[2:] - 1, lat[2:], lon[2:])
    np.testing.assert_array_equal(both[0][2:], alone[0])
    np.testing.assert_array_equal(both[1][2:], alone[1])
