"""WGS-84 conversions against PROJ."""

import numpy as np
import pytest
from pyproj import Geod, Transformer

from aeroskein import ellipsoid

TO_ECEF = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
LATITUDES = (0.0, 48.0, -33.0, 89.9, -89.9, 90.0, -90.0)
HEIGHTS = (-1000.0, -100.0, 0.0, 1500.0, 15_000.0, 100_000.0)


def _grid() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    lat, lon, height = np.meshgrid(LATITUDES, (-180.0, -179.999, -60.0, 0.0, 11.8, 179.999), HEIGHTS)
    return lat.ravel(), lon.ravel(), height.ravel()


def test_earth_centred_coordinates_agree_with_proj() -> None:
    lat, lon, height = _grid()

    made = ellipsoid.to_ecef(lat, lon, height)

    expected = np.stack(TO_ECEF.transform(lon, lat, height), axis=-1)
    assert np.abs(made - expected).max() < 1e-6


def test_earth_centred_coordinates_come_back_within_two_micrometres() -> None:
    lat, lon, height = _grid()

    back = ellipsoid.from_ecef(ellipsoid.to_ecef(lat, lon, height))

    moved_m = ellipsoid.to_ecef(*back) - ellipsoid.to_ecef(lat, lon, height)
    assert np.abs(moved_m).max() < 2e-6
    assert np.abs(back[2] - height).max() < 1e-6
    assert np.abs(back[0] - lat).max() < 2e-11


def test_longitude_from_earth_centred_coordinates_stays_below_180() -> None:
    exactly_on_the_antimeridian = np.array([[-6_378_137.0, 0.0, 0.0]])

    _, lon, _ = ellipsoid.from_ecef(exactly_on_the_antimeridian)

    assert lon[0] == -180.0


def test_the_pole_has_its_latitude_and_height() -> None:
    lat, _, height = ellipsoid.from_ecef(np.array([[0.0, 0.0, -(ellipsoid.SEMI_MINOR_M + 10_000.0)]]))

    assert lat[0] == -90.0
    assert height[0] == pytest.approx(10_000.0, abs=1e-8)


def test_local_axes_are_orthonormal_and_right_handed() -> None:
    lat, lon, _ = _grid()

    east, north, up = ellipsoid.ecef_axes(lat, lon)

    axes = np.stack([east, north, up], axis=-2)
    assert np.abs(axes @ np.swapaxes(axes, -1, -2) - np.eye(3)).max() < 1e-15
    assert np.abs(np.cross(east, north) - up).max() < 1e-15


@pytest.mark.parametrize("lat", [0.0, 48.0, -33.0, 80.0])
@pytest.mark.parametrize(("azimuth", "axis"), [(90.0, 0), (0.0, 1)])
def test_height_scale_is_the_ratio_of_distances_flown(lat: float, azimuth: float, axis: int) -> None:
    # One ten-thousandth of a degree of travel at 12 km, against the geodesic below it.
    height = np.array([12_000.0])
    step = np.array([[0.0, 1e-4], [1e-4, 0.0]])[axis]
    ends = ellipsoid.to_ecef(np.array([lat, lat + step[0]]), np.array([10.0, 10.0 + step[1]]), 12_000.0)
    below_m = Geod(ellps="WGS84").inv(10.0, lat, 10.0 + step[1], lat + step[0])[2]

    scale = ellipsoid.height_scale(np.array([lat]), height)

    assert scale[0, axis] == pytest.approx(np.linalg.norm(ends[1] - ends[0]) / below_m, rel=1e-8)


def test_an_unknown_height_counts_as_zero() -> None:
    assert ellipsoid.height_scale(np.array([48.0]), np.array([np.nan])).tolist() == [[1.0, 1.0]]
