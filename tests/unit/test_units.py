"""Factors and angle ranges."""

import numpy as np
import pytest

from aeroskein import units


@pytest.mark.parametrize(
    ("angle", "azimuth", "longitude"),
    [
        (0.0, 0.0, 0.0),
        (360.0, 0.0, 0.0),
        (-90.0, 270.0, -90.0),
        (180.0, 180.0, -180.0),
        (-180.0, 180.0, -180.0),
        (540.5, 180.5, -179.5),
        (-1e-20, 0.0, -1e-20),
        (np.nextafter(-180.0, -181.0), np.nextafter(180.0, 179.0), -180.0),
    ],
)
def test_angles_come_into_range(angle: float, azimuth: float, longitude: float) -> None:
    assert units.wrap_azimuth_deg(np.array([angle]))[0] == azimuth
    assert units.wrap_angle_deg(np.array([angle]))[0] == longitude


def test_a_knot_is_a_nautical_mile_an_hour() -> None:
    assert pytest.approx(0.514444444444, rel=1e-11) == units.KNOT_MPS


def test_six_thousand_feet_a_minute_are_thirty_and_a_half_metres_a_second() -> None:
    assert pytest.approx(30.48) == 6000 * units.FOOT_PER_MINUTE_MPS
