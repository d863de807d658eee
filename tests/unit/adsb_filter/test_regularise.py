"""Which reports make up a flight, and the state it starts with."""

from typing import Any

import numpy as np
import pytest
from tests.filter_scenes import measurements, turning_flights

from aeroskein.adsb_filter.regularise import moving_rows, started_rows
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.adsb_filter.start import position_covariance, start_states
from aeroskein.flights import Flights
from aeroskein.motion import SPEED, YAW
from aeroskein.plots import ON_GROUND, Plots


def kept(speed_mps: list[float], altitude_m: list[float], ground: Any = 0) -> list[bool]:
    n = len(speed_mps)
    plots = Plots.of(
        n, time_s=np.arange(float(n)), ground_speed_mps=speed_mps, altitude_m=altitude_m,
        flags=np.asarray(ground) * ON_GROUND,
    )  # fmt: skip
    return moving_rows(Flights(plots, np.zeros(n, dtype=np.int64))).tolist()


def test_standing_on_the_ground_at_both_ends_is_dropped_and_taxiing_in_stays() -> None:
    speed = [0.0, 5.0, 80.0, 90.0, 20.0, 0.0, 0.0]
    altitude = [0.0, 0.0, 50.0, 60.0, 0.0, 0.0, 0.0]

    assert kept(speed, altitude) == [False, False, True, True, True, False, False]


def test_standing_between_two_flights_is_not_an_end() -> None:
    assert kept([80.0, 0.0, 0.0, 80.0], [50.0, 0.0, 0.0, 50.0]) == [True, True, True, True]


def test_a_ground_flag_counts_as_altitude_zero() -> None:
    assert kept([0.0, 70.0, 70.0], [np.nan] * 3, [1, 0, 0]) == [False, True, True]


def test_a_ground_flag_at_flying_speed_is_wrong() -> None:
    assert kept([120.0, 130.0], [np.nan] * 2, [1, 1]) == [True, True]


def test_a_vehicle_keeps_its_rows_between_standing() -> None:
    assert kept([0.0, 5.0, 6.0, 0.0], [0.0] * 4, [1] * 4) == [False, True, True, False]


def test_an_outlier_is_no_start() -> None:
    seen = turning_flights(1, (30,))
    seen.north_m[0] += 4000.0

    rows = started_rows(seen, 340.0)

    assert rows.tolist() == [False] + [True] * 29


def test_an_outlier_among_the_witnesses_does_not_cost_the_start() -> None:
    seen = turning_flights(1, (30,))
    seen.north_m[1] += 4000.0

    assert started_rows(seen, 340.0).all()


def test_two_reports_are_no_flight() -> None:
    seen = turning_flights(1, (30, 2))

    assert started_rows(seen, 340.0).tolist() == [True] * 30 + [False] * 2


def straight(yaw_rad: float, n: int = 12, **changes: Any) -> Any:
    time_s = np.arange(float(n))
    position_m = 100.0 * time_s[:, None] * np.array([np.sin(yaw_rad), np.cos(yaw_rad)])
    return measurements(np.zeros(n), time_s, position_m, **changes)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, 3.0, -2.0])
def test_start_without_velocities_looks_along_the_first_positions(yaw_rad: float) -> None:
    x, _ = start_states(straight(yaw_rad), AdsbFilterSettings()).turning()

    assert x[0, YAW] == pytest.approx(yaw_rad)
    assert x[0, SPEED] == pytest.approx(100.0)
    assert (x[0, 3], x[0, 5]) == (0.0, 0.0)


def test_start_takes_the_reported_velocity() -> None:
    seen = straight(0.0, v_east_mps=70.0, v_north_mps=70.0, velocity_variance=4.0)

    start = start_states(seen, AdsbFilterSettings())

    np.testing.assert_allclose(start.velocity_mps, [[70.0, 70.0]])
    np.testing.assert_allclose(start.velocity_cov_m2ps2, [4.0 * np.eye(2)])


def test_start_takes_positions_where_velocities_are_not_used() -> None:
    seen = straight(0.0, v_east_mps=70.0, v_north_mps=70.0, velocity_variance=4.0)

    start = start_states(seen, AdsbFilterSettings(use_velocity=False))

    np.testing.assert_allclose(start.velocity_mps, [[0.0, 100.0]], atol=1e-12)


def test_start_takes_speed_and_acceleration_of_past_take_offs() -> None:
    settings = AdsbFilterSettings(start_speed_mps=75.0, start_acceleration_mps2=2.0)

    x, _ = start_states(straight(0.5), settings).turning()

    np.testing.assert_allclose(x[0, [SPEED, 3, YAW]], [75.0, 2.0, 0.5])


def test_start_is_not_misled_by_one_outlier_after_it() -> None:
    seen = straight(0.0)
    seen.east_m[2] += 2000.0

    x, _ = start_states(seen, AdsbFilterSettings()).turning()

    np.testing.assert_allclose(x[0, [SPEED, YAW]], [100.0, 0.0], atol=1e-9)


def test_start_variance_is_that_of_the_measurements() -> None:
    seen = straight(0.0)

    _, P = start_states(seen, AdsbFilterSettings()).turning()

    # Along: 10 m and 0.2 s at 100 m/s; the velocity is the difference of two such positions over 2 s.
    assert P[0, 1, 1] == pytest.approx(100.0 + 400.0)
    assert P[0, SPEED, SPEED] == pytest.approx(2.0 * 500.0 / 4.0)
    assert P[0, YAW, YAW] == pytest.approx(2.0 * 100.0 / 4.0 / 100.0**2)


def test_a_flight_of_one_instant_starts_without_velocity() -> None:
    seen = measurements(np.zeros(3), [0.0, 0.5, 1.0], np.zeros((3, 2)))

    start = start_states(seen, AdsbFilterSettings())

    assert not start.velocity_mps.any()
    assert start.velocity_cov_m2ps2[0, 0, 0] > 100.0**2


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, 2.0, -1.2])
def test_observation_covariance_is_the_published_one(yaw_rad: float) -> None:
    speed, sigma_p, sigma_t = 120.0, 10.0, 0.2
    velocity = speed * np.array([[np.sin(yaw_rad), np.cos(yaw_rad)]])

    R = position_covariance(straight(0.0).take(np.array([3])), velocity)[0]

    # diag(σp² + (σt v)², σp²) along and across, turned by the yaw: clockwise from north.
    ahead, right = np.array([np.sin(yaw_rad), np.cos(yaw_rad)]), np.array([np.cos(yaw_rad), -np.sin(yaw_rad)])
    assert ahead @ R @ ahead == pytest.approx(sigma_p**2 + (sigma_t * speed) ** 2)
    assert right @ R @ right == pytest.approx(sigma_p**2)
    assert ahead @ R @ right == pytest.approx(0.0, abs=1e-9)
