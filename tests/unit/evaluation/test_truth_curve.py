"""Truth between its samples, and the geometry under it, against pyproj."""

import numpy as np
import pytest
from pyproj import Transformer
from tests.evaluation_scenes import GEOD, START_S, great_circle, truth_of

from aeroskein.evaluation import Truth, TruthCurve
from aeroskein.evaluation.geometry import ecef, up_vector
from aeroskein.evaluation.hermite import hermite, parabola_tangents

LAT = np.array([0.0, 48.35, -33.9, 89.999999, -90.0])
LON = np.array([0.0, 11.78, 151.2, 45.0, 179.9])


def test_earth_centred_coordinates_are_those_of_pyproj():
    height = np.array([0.0, 12_000.0, -50.0, 9000.0, 100.0])
    expected = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform(LON, LAT, height)

    assert ecef(up_vector(LAT, LON), height) == pytest.approx(np.stack(expected, axis=1), abs=1e-6)


def test_a_cubic_in_time_comes_back_exactly():
    time_s = np.array([0.0, 1.0, 3.0, 3.5])
    value = np.stack([time_s**3 - 2.0 * time_s, 5.0 - time_s**2], axis=1)
    slope = np.stack([3.0 * time_s**2 - 2.0, -2.0 * time_s], axis=1)
    at = np.array([0.25, 2.0, 3.3])

    found, rate = hermite(
        value, slope, np.array([0, 1, 2]), (at - [0.0, 1.0, 3.0]) / [1.0, 2.0, 0.5], np.array([1.0, 2.0, 0.5])
    )

    assert found == pytest.approx(np.stack([at**3 - 2.0 * at, 5.0 - at**2], axis=1))
    assert rate == pytest.approx(np.stack([3.0 * at**2 - 2.0, -2.0 * at], axis=1))


def test_tangents_of_a_parabola_are_exact_inside_and_do_not_cross_groups():
    time_s = np.array([0.0, 1.0, 3.0, 4.0, 0.0, 2.0, 9.0])
    group = np.array([0, 0, 0, 0, 1, 1, 2])
    value = np.where(group == 0, time_s**2, 7.0 * time_s)[:, None]

    slope = parabola_tangents(time_s, value, group)[:, 0]

    assert slope.tolist() == pytest.approx([1.0, 2.0, 6.0, 7.0, 7.0, 7.0, 0.0])


def test_truth_between_samples_lies_on_the_geodesic():
    truth = truth_of(lat_deg=60.0, angle_deg=80.0, speed_mps=250.0, step_s=10.0)
    at = START_S + np.array([3.0, 77.7, 294.1])
    lat, lon, _ = great_circle(60.0, 11.0, 80.0, 250.0, np.append(START_S, at))

    states = TruthCurve(truth).at(np.zeros(3, dtype=int), at)

    expected = ecef(up_vector(lat[1:], lon[1:]), np.zeros(3))
    assert np.linalg.norm(states.position - expected, axis=1).max() < 1e-3
    assert states.valid.all()


def test_truth_without_velocity_is_followed_too():
    truth = truth_of(lat_deg=60.0, speed_mps=250.0)
    truth.ground_speed_mps[:] = np.nan
    at = START_S + np.array([0.5, 100.25])
    lat, lon, _ = great_circle(60.0, 11.0, 70.0, 250.0, np.append(START_S, at))

    states = TruthCurve(truth).at(np.zeros(2, dtype=int), at)

    assert np.linalg.norm(states.position - ecef(up_vector(lat[1:], lon[1:]), np.zeros(2)), axis=1).max() < 2e-3
    assert np.linalg.norm(states.velocity, axis=1) == pytest.approx(250.0, abs=0.01)


def test_samples_may_come_in_any_order_and_twice():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=20)
    rows = np.random.default_rng(1).permutation(np.tile(np.arange(len(truth)), 2))
    shuffled = Truth.of(
        truth.names,
        len(rows),
        phases=truth.phases,
        **{
            name: getattr(truth, name)[rows] for name in ("flight", "phase", "time_s", "lat_deg", "lon_deg", "height_m")
        },
    )

    assert len(TruthCurve(shuffled)) == len(truth)


def test_there_is_no_truth_before_the_first_and_after_the_last_sample():
    curve = TruthCurve(truth_of(["3C6444", "4CA2D6"], seconds=20))
    at = START_S + np.array([-0.01, 0.0, 20.0, 20.01, np.nan])

    assert curve.at(np.full(5, 0), at).valid.tolist() == [False, True, True, False, False]
    assert curve.at(np.full(5, 1), at).valid.tolist() == [False, True, True, False, False]
    assert not curve.at(np.full(5, -1), at).valid.any()


def test_a_flight_of_one_sample_has_no_truth():
    truth = Truth.of(["A00001"], 1, time_s=START_S, lat_deg=1.0, lon_deg=2.0)

    assert not TruthCurve(truth).at(np.zeros(1, dtype=int), np.array([START_S])).valid.any()


@pytest.mark.parametrize(("rate_degps", "phase"), [(1.0, "turn"), (0.0, "straight")])
def test_phases_are_found_from_the_motion_where_truth_does_not_name_them(rate_degps, phase):
    time_s = np.arange(0.0, 60.0)
    angle = 30.0 + rate_degps * time_s
    lat, lon = np.empty(60), np.empty(60)
    lat[0], lon[0] = 48.0, 11.0
    for k in range(59):
        lon[k + 1], lat[k + 1], _ = GEOD.fwd(lon[k], lat[k], angle[k] + rate_degps / 2.0, 150.0)
    truth = Truth.of(
        ["3C6444"], 60, time_s=time_s, lat_deg=lat, lon_deg=lon, ground_speed_mps=150.0, track_angle_deg=angle
    )

    curve = TruthCurve(truth)

    assert {curve.phases[i] for i in curve.phase} == {phase}


def test_a_turn_to_the_right_is_positive():
    angle = np.arange(0.0, 60.0, 3.0)
    lat, lon = np.cumsum(np.cos(np.radians(angle))) * 1e-3, np.cumsum(np.sin(np.radians(angle))) * 1e-3
    truth = Truth.of(
        ["3C6444"], 20, time_s=np.arange(20.0), lat_deg=lat, lon_deg=lon, ground_speed_mps=111.0, track_angle_deg=angle
    )

    rate = TruthCurve(truth).at(np.zeros(1, dtype=int), np.array([9.5])).turn_rate_degps

    assert rate[0] == pytest.approx(3.0, abs=0.05)


def test_a_climb_is_a_climb():
    truth = truth_of(seconds=60, phase="")
    truth.phase[:] = -1
    truth.vertical_rate_mps[:] = 8.0
    truth.height_m = 1000.0 + 8.0 * (truth.time_s - START_S)

    curve = TruthCurve(truth)

    assert {curve.phases[i] for i in curve.phase} == {"climb"}
    assert curve.at(np.zeros(1, dtype=int), np.array([START_S + 10.3])).height_m[0] == pytest.approx(1082.4, abs=1e-5)
