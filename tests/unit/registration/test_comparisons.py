"""Geometry of comparisons, against PROJ's topocentric conversion and finite differences."""

import numpy as np
import pyproj
import pytest

from aeroskein.geodesy import frame_rows
from aeroskein.registration.comparisons import Comparisons, geometry_of

SITE = (48.35, 11.78, 460.0)
SITES = np.concatenate([np.zeros((1, 12)), frame_rows(np.array([SITE[0]]), np.array([SITE[1]]), SITE[2])])


def comparison(**changes: object) -> Comparisons:
    columns: dict[str, object] = {
        "sensor": [1, 1, 1], "aircraft": [7, 8, 9], "time_s": np.array([100.0, 100.0, 100.0]),
        "range_m": [80_000.0, 150_000.0, 30_000.0], "azimuth_deg": [30.0, 200.0, 359.9],
        "reference_time_s": 100.0, "lat_deg": [48.9, 47.2, 48.6], "lon_deg": [12.4, 11.0, 11.7],
        "height_m": [9_000.0, 11_000.0, 3_000.0],
        "v_east_mps": [150.0, -80.0, 0.0], "v_north_mps": [100.0, 210.0, 90.0],
        "vertical_rate_mps": [0.0, 5.0, np.nan], "position_cov_m2": np.tile([25.0, 0.0, 25.0], (3, 1)),
        "height_sigma_m": 10.0, "anchored": True,
    }  # fmt: skip
    columns.update(changes)
    return Comparisons.of(**columns)


def topocentric(rows: Comparisons) -> np.ndarray:
    """East, north, up from the antenna, by PROJ."""
    pipeline = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lat_0={SITE[0]} +lon_0={SITE[1]} +h_0={SITE[2]}"
    )
    return np.stack(pipeline.transform(rows.lon_deg, rows.lat_deg, rows.height_m), axis=-1)


def test_range_and_azimuth_of_the_reference_are_those_of_proj() -> None:
    rows = comparison()

    geometry = geometry_of(rows, SITES)

    expected = topocentric(rows)
    assert geometry.range_m == pytest.approx(np.linalg.norm(expected, axis=1), abs=1e-5)
    assert geometry.up_m == pytest.approx(expected[:, 2], abs=1e-5)


def test_a_plot_that_equals_its_reference_has_no_error() -> None:
    enu = topocentric(comparison())
    azimuth = np.mod(np.degrees(np.arctan2(enu[:, 0], enu[:, 1])), 360.0)
    rows = comparison(range_m=np.linalg.norm(enu, axis=1), azimuth_deg=azimuth)

    geometry = geometry_of(rows, SITES)

    assert geometry.range_error_m == pytest.approx(0.0, abs=1e-5)
    assert geometry.across_error_m == pytest.approx(0.0, abs=1e-5)


def test_a_degree_too_much_clockwise_is_a_positive_error_across_north() -> None:
    enu = topocentric(comparison())
    azimuth = np.mod(np.degrees(np.arctan2(enu[:, 0], enu[:, 1])) + 1.0, 360.0)

    geometry = geometry_of(comparison(azimuth_deg=azimuth), SITES)

    assert geometry.across_error_m == pytest.approx(np.radians(1.0) * np.hypot(enu[:, 0], enu[:, 1]), rel=1e-9)


def test_radial_and_across_velocity_are_the_change_of_the_polar_coordinates() -> None:
    now, soon = comparison(), comparison(reference_time_s=99.9)

    before, after = geometry_of(now, SITES), geometry_of(soon, SITES)

    radial = (after.range_m - before.range_m) / 0.1
    across = -(after.across_error_m / after.ground_m - before.across_error_m / before.ground_m) * before.ground_m / 0.1
    assert before.radial_mps == pytest.approx(radial, abs=0.05)
    assert before.across_mps == pytest.approx(across, abs=0.05)


def test_the_plot_in_ecef_lies_where_range_azimuth_and_height_put_it() -> None:
    enu = topocentric(comparison())
    rows = comparison(
        range_m=np.linalg.norm(enu, axis=1), azimuth_deg=np.mod(np.degrees(np.arctan2(enu[:, 0], enu[:, 1])), 360.0)
    )

    geometry = geometry_of(rows, SITES)

    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    expected = np.stack(to_ecef.transform(rows.lon_deg, rows.lat_deg, rows.height_m), axis=-1)
    assert geometry.plot_m == pytest.approx(expected, abs=1e-3)


def test_columns_of_different_length_are_refused() -> None:
    with pytest.raises(ValueError, match="range_m"):
        comparison(range_m=[1.0, 2.0])
