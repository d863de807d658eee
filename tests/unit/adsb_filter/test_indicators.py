"""Initial indicators and repair: the published limits, on flights whose faults are known."""

import numpy as np
import pytest
from tests.filter_scenes import measurements

from aeroskein.adsb_filter.indicators import ACCELERATION, SPEED, SPIKE, indicators, repair, spikes
from aeroskein.adsb_filter.settings import AdsbFilterSettings

PUBLISHED = AdsbFilterSettings(spike_leg_m=0.0)
UNKNOWN = np.full(10, np.nan)


def straight(n: int = 10, speed_mps: float = 200.0) -> np.ndarray:
    """Positions of a flight to the north, one a second."""
    return np.stack([np.zeros(n), speed_mps * np.arange(n)], axis=1)


def seen(position_m: np.ndarray) -> object:
    return measurements(np.zeros(len(position_m)), np.arange(float(len(position_m))), position_m)


def found(position_m: np.ndarray, speed_mps: np.ndarray = UNKNOWN) -> np.ndarray:
    return indicators(seen(position_m), speed_mps, PUBLISHED)


def test_straight_flight_has_no_indicator() -> None:
    assert not found(straight()).any()


@pytest.mark.parametrize(("angle_deg", "is_spike"), [(19.0, True), (21.0, False)])
def test_a_spike_is_an_angle_below_twenty_degrees(angle_deg: float, is_spike: bool) -> None:
    angle = np.radians(angle_deg)
    position_m = np.array([[0.0, 100.0], [0.0, 0.0], [100.0 * np.sin(angle), 100.0 * np.cos(angle)]])

    spike = spikes(np.zeros(3, dtype=np.int64), position_m, 20.0, 0.0)

    assert spike.tolist() == [False, is_spike, False]


def test_short_legs_make_no_spike() -> None:
    position_m = np.array([[0.0, 0.0], [0.0, 10.0], [0.0, 0.5], [0.0, 12.0]])

    assert not spikes(np.zeros(4, dtype=np.int64), position_m, 20.0, 50.0).any()


def test_a_spike_needs_neighbours_of_its_own_flight() -> None:
    position_m = np.array([[0.0, 0.0], [0.0, 900.0], [0.0, 0.0]])

    assert not spikes(np.array([0, 0, 1]), position_m, 20.0, 0.0).any()


def test_reported_speed_above_the_limit_is_found() -> None:
    speed = UNKNOWN.copy()
    speed[4] = 341.0

    assert np.flatnonzero(found(straight(), speed) & SPEED).tolist() == [4]


def test_a_jump_is_found_and_the_return_from_it_is_not() -> None:
    position_m = straight()
    position_m[5, 0] = 3000.0

    assert np.flatnonzero(found(position_m) & SPEED).tolist() == [5]
    assert found(position_m)[5] & SPIKE


def test_a_flight_that_stays_elsewhere_is_believed() -> None:
    position_m = straight()
    position_m[3:, 0] += 9000.0

    assert np.flatnonzero(found(position_m) & SPEED).tolist() == [3, 4, 5, 6]


def test_acceleration_is_found_from_three_positions() -> None:
    time_s = np.arange(10.0)
    position_m = np.stack([np.zeros(10), 3.0 * time_s**2], axis=1)

    assert np.flatnonzero(found(position_m) & ACCELERATION).tolist() == list(range(1, 9))
    assert not (found(0.8 * position_m) & ACCELERATION).any()


def test_acceleration_is_found_from_two_reported_speeds() -> None:
    speed = np.full(10, 200.0)
    speed[6:] = 206.0

    assert np.flatnonzero(found(straight(), speed) & ACCELERATION).tolist() == [6]


def test_repair_interpolates_in_time_and_not_in_rows() -> None:
    position_m = straight(4)
    made = measurements(np.zeros(4), [0.0, 1.0, 4.0, 5.0], position_m)

    repaired = repair(made, np.array([False, True, False, False]))

    # A quarter of the way from row 0 (at 0 s) to row 2 (at 4 s).
    np.testing.assert_allclose(repaired[1], [0.0, 100.0])
    np.testing.assert_array_equal(repaired[[0, 2, 3]], position_m[[0, 2, 3]])


def test_repair_leaves_a_hole_where_a_neighbour_is_missing() -> None:
    repaired = repair(seen(straight(4)), np.array([True, False, False, True]))

    assert np.isnan(repaired[[0, 3]]).all()
    assert np.isfinite(repaired[[1, 2]]).all()


def test_good_data_at_one_hertz_break_the_published_acceleration_limit() -> None:
    rng = np.random.default_rng(1)
    n = 400
    jitter = 0.2 * rng.standard_normal(n)
    position_m = np.stack([np.zeros(n), 230.0 * (np.arange(n) + jitter)], axis=1) + 10.0 * rng.standard_normal((n, 2))

    flagged = indicators(seen(position_m), np.full(n, np.nan), PUBLISHED) & ACCELERATION > 0

    # Why the innovation is the default: nothing is wrong with this flight.
    assert flagged.mean() > 0.7
