"""The truth obeys its own kinematics: positions, speeds and angles agree, and every ramp is as steep as it may be."""

from __future__ import annotations

import numpy as np
import pytest
from tests.simulation_scenes import GEOD, ecef, run

from aeroskein.simulation import SCENARIOS, Phase, SimulationSettings, TruthStates, simulate

PLACES = {"munich": (48.1, 11.6), "north pole": (90.0, 0.0), "antimeridian": (0.0, 180.0), "south": (-89.9, -77.0)}


def neighbours(truth: TruthStates) -> np.ndarray:
    """Rows whose next row is the next sample of the same aircraft."""
    return np.flatnonzero((np.diff(truth.address) == 0) & (np.diff(truth.time_s) < 1.0))


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_positions_move_as_the_velocity_says(scenario: str) -> None:
    _, truth = run(scenario=scenario, aircraft=6, duration_s=200.0, seed=3)

    here = neighbours(truth)
    position = ecef(truth.lat_deg, truth.lon_deg, truth.height_m)
    moved = np.linalg.norm(position[here + 1] - position[here], axis=1) / np.diff(truth.time_s)[here]
    speed = np.hypot(truth.ground_speed_mps, truth.vertical_rate_mps)

    assert len(here) > 5000
    assert np.abs(moved - (speed[here] + speed[here + 1]) / 2.0).max() < 0.02


@pytest.mark.parametrize("place", PLACES)
def test_aircraft_move_where_their_track_angle_points(place: str) -> None:
    lat_deg, lon_deg = PLACES[place]
    _, truth = run(scenario="terminal", aircraft=6, duration_s=120.0, lat_deg=lat_deg, lon_deg=lon_deg)

    here = neighbours(truth)
    here = here[np.abs(truth.lat_deg[here]) < 89.99]
    there = here + 1
    out, back, _ = GEOD.inv(truth.lon_deg[here], truth.lat_deg[here], truth.lon_deg[there], truth.lat_deg[there])
    # The chord of a turn lies half a turn ahead of the first angle and half a turn behind the second.
    ahead = np.mod(out - truth.track_angle_deg[here] + 180.0, 360.0) - 180.0
    behind = np.mod(back - truth.track_angle_deg[there], 360.0) - 180.0
    off = (ahead + behind) / 2.0

    assert len(here) > 2000
    assert np.abs(off).max() < 0.01


@pytest.mark.parametrize("place", PLACES)
def test_straight_flight_without_gusts_is_a_geodesic(place: str) -> None:
    lat_deg, lon_deg = PLACES[place]
    _, truth = run(scenario="cruise", aircraft=4, duration_s=600.0, gust_mps2=0.0, lat_deg=lat_deg, lon_deg=lon_deg)

    for address in np.unique(truth.address):
        one = truth.take(truth.address == address)
        azimuth, _, distance_m = GEOD.inv(one.lon_deg[0], one.lat_deg[0], one.lon_deg[-1], one.lat_deg[-1])
        first_deg = one.track_angle_deg[0]
        flown_m = one.ground_speed_mps[0] * (one.time_s[-1] - one.time_s[0])

        assert np.ptp(one.ground_speed_mps) < 1e-6
        # At height h the aircraft flies (R + h) / R metres per metre of ground.
        assert distance_m * (1.0 + one.height_m[0] / 6.371e6) == pytest.approx(flown_m, rel=2e-5)
        assert np.mod(azimuth - first_deg + 180.0, 360.0) - 180.0 == pytest.approx(0.0, abs=2e-3)


def test_turn_rate_and_acceleration_are_ramped() -> None:
    _, truth = run(scenario="terminal", aircraft=8, duration_s=400.0, gust_mps2=0.0, seed=5)

    here = neighbours(truth)
    both = here[np.isin(here + 1, here)]
    step = 0.2
    # Convergence of the meridians turns a geodesic by v tan(lat) / R, a few thousandths of a degree per second.
    turn = np.mod(truth.track_angle_deg[1:] - truth.track_angle_deg[:-1] + 180.0, 360.0) - 180.0
    turn_rate = turn / step
    pull = np.diff(truth.ground_speed_mps) / step

    assert np.abs(turn_rate[here]).max() == pytest.approx(3.0, abs=0.02)
    assert np.abs(turn_rate[both + 1] - turn_rate[both]).max() / step == pytest.approx(0.6, abs=0.02)
    assert np.abs(pull[here]).max() == pytest.approx(0.6, abs=0.01)
    assert np.abs(pull[both + 1] - pull[both]).max() / step == pytest.approx(0.3, abs=0.01)


def test_phase_says_what_the_aircraft_does() -> None:
    _, truth = run(scenario="terminal", aircraft=8, duration_s=300.0, gust_mps2=0.0, seed=2)

    here = neighbours(truth)
    turn = np.abs(np.mod(np.diff(truth.track_angle_deg)[here] + 180.0, 360.0) - 180.0) / 0.2
    climb = np.diff(truth.height_m)[here] / 0.2
    phase = truth.phase[here]

    assert turn[phase != Phase.TURN].max() < 0.15
    assert np.median(turn[phase == Phase.TURN]) > 1.0
    assert climb[phase == Phase.CLIMB].min() > -1e-6
    assert climb[phase == Phase.DESCENT].max() < 1e-6
    assert np.abs(climb[phase == Phase.STRAIGHT]).max() < 0.2


def test_gusts_have_the_stated_size() -> None:
    _, truth = run(scenario="cruise", aircraft=60, duration_s=200.0, truth_period_s=0.5, seed=8)

    here = neighbours(truth)
    # Along the track the acceleration is the gust's, less what is flown out of it within a minute.
    pull = np.diff(truth.ground_speed_mps)[here] / 0.5

    assert pull.std() == pytest.approx(0.03, rel=0.15)
    assert pull.mean() == pytest.approx(0.0, abs=0.003)


def test_hovering_aircraft_stand_still_and_move_vertically() -> None:
    _, truth = run(scenario="hover", aircraft=6, duration_s=400.0)

    still = truth.take(truth.ground_speed_mps < 0.01)

    assert len(still) > 1000
    assert (still.phase == Phase.HOVER).all()
    assert still.vertical_rate_mps.max() > 1.5
    assert still.vertical_rate_mps.min() < -1.5


def test_holding_aircraft_fly_six_right_turns_of_half_a_circle() -> None:
    _, truth = run(scenario="hold", aircraft=2, duration_s=900.0, gust_mps2=0.0)

    for address in np.unique(truth.address):
        one = truth.take((truth.address == address) & (truth.time_s < 1_790_000_000.0 + 720.0))
        turned = np.mod(np.diff(one.track_angle_deg) + 180.0, 360.0) - 180.0

        assert turned.min() > -0.02
        assert turned.sum() == pytest.approx(1080.0, abs=180.0)


def test_crossing_pairs_are_at_one_place_at_one_time() -> None:
    _, truth = run(scenario="crossing", aircraft=12, duration_s=600.0, truth_period_s=1.0)

    position = ecef(truth.lat_deg, truth.lon_deg, truth.height_m).reshape(12, -1, 3)
    height = truth.height_m.reshape(12, -1)
    for pair in range(6):
        apart = np.linalg.norm(position[2 * pair] - position[2 * pair + 1], axis=1)
        step_m = np.abs(height[2 * pair] - height[2 * pair + 1])[apart.argmin()]

        # They pass each other between two samples, at one level or one thousand feet apart.
        assert step_m == pytest.approx(304.8 * (pair % 2), abs=0.01)
        assert np.sqrt(max(apart.min() ** 2 - step_m**2, 0.0)) < 260.0
        assert apart[0] > 5_000.0
        assert apart[-1] > 5_000.0


@pytest.mark.parametrize("place", PLACES)
def test_aircraft_of_a_formation_stay_300_to_900_metres_apart(place: str) -> None:
    lat_deg, lon_deg = PLACES[place]
    _, truth = run(
        scenario="formation", aircraft=9, duration_s=600.0, truth_period_s=1.0, lat_deg=lat_deg, lon_deg=lon_deg
    )

    position = ecef(truth.lat_deg, truth.lon_deg, truth.height_m).reshape(3, 3, -1, 3)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        apart = np.linalg.norm(position[:, i] - position[:, j], axis=-1)
        assert apart.min() > 300.0
        assert apart.max() < 900.0


def test_traffic_comes_and_goes_under_new_addresses() -> None:
    _, truth = run(scenario="mixed", aircraft=10, duration_s=1500.0, flight_s=400.0, truth_period_s=2.0)

    for slot in range(10):
        mine = truth.take(truth.slot == slot)
        flights = np.unique(mine.address)
        assert len(flights) >= 3
        assert len(np.unique(mine.time_s)) == len(mine)
        ends = [mine.time_s[mine.address == flight].max() for flight in flights]
        begins = [mine.time_s[mine.address == flight].min() for flight in flights]
        for end_s, begin_s in zip(sorted(ends)[:-1], sorted(begins)[1:], strict=True):
            assert 20.0 <= begin_s - end_s <= 40.0


def test_flights_stay_near_the_area() -> None:
    _, truth = run(scenario="mixed", aircraft=30, duration_s=600.0, truth_period_s=5.0, lat_deg=60.0, lon_deg=20.0)

    n = len(truth)
    _, _, away_m = GEOD.inv(np.full(n, 20.0), np.full(n, 60.0), truth.lon_deg, truth.lat_deg)

    assert np.median(away_m) < 60_000.0
    assert away_m.max() < 250_000.0


def test_geometric_height_and_pressure_altitude_differ_as_set() -> None:
    _, truth = run(
        scenario="mixed", aircraft=20, duration_s=100.0, truth_period_s=5.0, geometric_minus_pressure_m=100.0,
        geometric_minus_pressure_variation_m=15.0,
    )  # fmt: skip

    above = truth.height_m - truth.altitude_m

    assert above.min() >= 85.0
    assert above.max() <= 115.0
    assert np.ptp(above) > 0.1


def test_a_flight_is_the_same_whatever_else_flies() -> None:
    few = SimulationSettings(scenario="mixed", aircraft=6, duration_s=60.0, radius_m=60_000.0)
    many = SimulationSettings(scenario="mixed", aircraft=24, duration_s=60.0, radius_m=60_000.0)

    a, b = (
        TruthStates.concatenate([c.truth for c in simulate(s, (), truth=True) if c.truth is not None])
        for s in (few, many)
    )

    same = b.take(b.slot < 6)
    assert (a.lat_deg == same.lat_deg).all()
    assert (a.height_m == same.height_m).all()
