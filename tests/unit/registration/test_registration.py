"""Registration as the engine uses it: plots corrected, biases found, states published, operators obeyed."""

import json

import numpy as np
import pytest
from benchmarks.registration_scene import START_S, Radar, Scene, comparisons, engine_settings, two_radars

from aeroskein.errors import SettingsError, SnapshotError, UnknownSensorError
from aeroskein.registration import Comparisons, Registration, group


def feed(registration: Registration, rows: Comparisons, until_s: float, begin_s: float = 0.0) -> None:
    """Give comparisons second by second, as the engine does."""
    seconds = rows.time_s - START_S
    for k in np.arange(begin_s, until_s):
        registration.update(rows.take((seconds >= k) & (seconds < k + 1.0)))
        registration.advance(now_s=START_S + k + 1.0)


def truth(radars: list[Radar]) -> np.ndarray:
    return np.array([[r.range_m, r.azimuth_deg, r.time_s] for r in radars])


@pytest.fixture(scope="module")
def converged() -> tuple[Registration, Scene]:
    scene = Scene(two_radars(np.random.default_rng(1)), aircraft=20, duration_s=150.0, seed=1)
    registration = Registration(engine_settings(scene.radars))
    feed(registration, comparisons(scene), 150.0)
    return registration, scene


def test_two_radars_are_registered_within_minutes(converged: tuple[Registration, Scene]) -> None:
    registration, scene = converged

    error = np.abs(registration.estimates()[0][1:, :3] - truth(scene.radars))

    assert (error < [[12.0, 0.01, 0.12], [20.0, 0.03, 0.15]]).all()


def test_the_claimed_sigma_covers_the_true_error(converged: tuple[Registration, Scene]) -> None:
    registration, scene = converged
    mean, covariance = registration.estimates()

    for k in (1, 2):
        error = mean[k, :3] - truth(scene.radars)[k - 1]
        assert error @ np.linalg.solve(covariance[k, :3, :3], error) < 16.3  # 99.9 % of chi-square with 3


def test_states_say_converged_with_samples_and_aircraft(converged: tuple[Registration, Scene]) -> None:
    registration, _ = converged

    states = registration.states(START_S + 150.0)

    assert [s.sensor for s in states] == ["radar1", "radar2"]
    assert all(s.state == "converged" and s.aircraft >= 18 and s.samples > 200 for s in states)


def test_corrected_plots_are_free_of_the_bias(converged: tuple[Registration, Scene]) -> None:
    registration, scene = converged
    bias = truth(scene.radars)[0]
    sensor = np.ones(1, dtype=np.int64)

    range_m, azimuth_deg, time_s = registration.correct(
        sensor, np.array([50_000.0 + bias[0]]), np.array([(0.05 + bias[1]) % 360.0]), np.array([1000.0 + bias[2]])
    )

    assert range_m == pytest.approx([50_000.0], abs=15.0)
    assert (azimuth_deg + 180.0) % 360.0 == pytest.approx([180.05], abs=0.01)
    assert time_s == pytest.approx([1000.0], abs=0.15)


def test_reports_of_sensors_that_are_no_radars_pass_unchanged(converged: tuple[Registration, Scene]) -> None:
    registration, _ = converged
    nan = np.array([np.nan])

    range_m, azimuth_deg, time_s = registration.correct(np.zeros(1, dtype=np.int64), nan, nan, np.array([5.0]))

    assert np.isnan(range_m).all()
    assert np.isnan(azimuth_deg).all()
    assert time_s == pytest.approx([5.0])


def test_bias_covariance_of_a_fresh_radar_is_its_prior_at_the_range() -> None:
    registration = Registration(engine_settings(two_radars(np.random.default_rng(0))))
    one = np.ones(1)

    cov = registration.bias_covariance(
        np.ones(1, dtype=np.int64), one * 100e3, one * 100e3, one * 90.0, one * 0.0, one * 200.0
    )

    # East of the radar: east is range, north is across and the flight.
    time_sigma_s = np.sqrt(0.5)  # relative to the mean of two radars whose priors are 1 s each
    assert cov[0, 0] == pytest.approx(300.0**2, rel=1e-6)
    assert cov[0, 2] == pytest.approx((100e3 * np.radians(0.5)) ** 2 + (200.0 * time_sigma_s) ** 2, rel=1e-6)


def test_bias_covariance_shrinks_to_little_when_registered(converged: tuple[Registration, Scene]) -> None:
    registration, _ = converged
    one = np.ones(1)

    cov = registration.bias_covariance(
        np.ones(1, dtype=np.int64), one * 100e3, one * 100e3, one * 45.0, one * 0.0, one * 0.0
    )

    assert np.sqrt(cov[0, [0, 2]]).max() < 15.0
    assert not registration.uncertain(np.array([1]))[0]


def test_without_anchor_biases_and_the_difference_of_times_are_found() -> None:
    scene = Scene(two_radars(np.random.default_rng(3)), aircraft=20, duration_s=240.0, seed=3, anchored=False)
    registration = Registration(engine_settings(scene.radars))

    feed(registration, comparisons(scene), 240.0)

    error = registration.estimates()[0][1:, :3] - truth(scene.radars)
    assert (np.abs(error[:, :2]) < [25.0, 0.02]).all()
    assert abs(error[0, 2] - error[1, 2]) < 0.1
    assert all(s.state == "converged" and s.time_bias_sigma_s > 0.5 for s in registration.states(START_S + 240.0))


def test_without_anchor_heights_that_are_all_wrong_do_not_make_the_radars_sure() -> None:
    scene = Scene(two_radars(np.random.default_rng(3)), aircraft=20, duration_s=240.0, seed=3, anchored=False,
                  extent_m=50_000.0, height_offset_m=-200.0, height_claim_m=200.0)  # fmt: skip
    registration = Registration(engine_settings(scene.radars))

    feed(registration, comparisons(scene), 240.0)

    mean, covariance = registration.estimates()
    error, sigma = (mean[1:, :3] - truth(scene.radars))[:, :2], np.sqrt(covariance[1:, [0, 1], [0, 1]])
    assert (np.abs(error) < 2.5 * sigma).all()
    assert (sigma < [30.0, 0.02]).all()


def test_a_gnss_timed_radar_fixes_the_common_time() -> None:
    scene = Scene(two_radars(np.random.default_rng(3), time_bias_sigma_s=1.0), aircraft=20, duration_s=120.0, seed=3,
                  anchored=False)  # fmt: skip
    scene.radars[0] = two_radars(np.random.default_rng(3), time_bias_sigma_s=0.05)[0]
    scene.radars[0].time_s = 0.0
    registration = Registration(engine_settings(scene.radars))

    feed(registration, comparisons(scene), 120.0)

    assert registration.estimates()[0][2, 2] == pytest.approx(0.4, abs=0.15)


def test_without_comparisons_the_mean_stays_and_the_sigma_grows(converged: tuple[Registration, Scene]) -> None:
    registration = Registration(engine_settings(converged[1].radars))
    registration.restore(converged[0].snapshot())
    mean, covariance = registration.estimates()

    registration.advance(now_s=START_S + 10_000.0)

    later_mean, later = registration.estimates()
    assert later_mean == pytest.approx(mean)
    assert (np.diagonal(later[1])[:3] > np.diagonal(covariance[1])[:3]).all()
    assert registration.states(START_S + 10_000.0)[0].state == "frozen"


def test_a_jump_is_found_once_and_taken_out_within_three_minutes() -> None:
    radars = two_radars(np.random.default_rng(5))
    radars[0].jump_s, radars[0].jump = 100.0, (120.0, 0.25, 0.0)
    scene = Scene(radars, aircraft=20, duration_s=220.0, seed=5)
    registration = Registration(engine_settings(radars))

    feed(registration, comparisons(scene), 220.0)

    expected = truth(radars)[0] + radars[0].jump
    assert registration.jumps().tolist() == [0, 1, 0]
    assert np.abs(registration.estimates()[0][1, :2] - expected[:2]) == pytest.approx([0.0, 0.0], abs=15.0)
    assert abs(registration.estimates()[0][1, 1] - expected[1]) < 0.02


def test_a_radar_three_degrees_off_is_registered_all_the_same() -> None:
    radars = two_radars(np.random.default_rng(6))
    radars[0].azimuth_deg = 3.0
    scene = Scene(radars, aircraft=20, duration_s=180.0, seed=6)
    registration = Registration(engine_settings(radars))

    feed(registration, comparisons(scene), 180.0)

    assert registration.estimates()[0][1, 1] == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize(
    "column", ["range_m", "lat_deg", "height_m", "v_east_mps", "position_cov_m2", "height_sigma_m"]
)
def test_a_comparison_that_lacks_a_number_is_left_out(column: str) -> None:
    scene = Scene(two_radars(np.random.default_rng(1)), aircraft=20, duration_s=30.0, seed=1)
    registration, broken = Registration(engine_settings(scene.radars)), Registration(engine_settings(scene.radars))
    rows = comparisons(scene)
    odd = np.arange(len(rows)) % 2 == 1
    feed(registration, rows.take(~odd), 30.0)

    getattr(rows, column)[odd] = np.nan
    feed(broken, rows, 30.0)

    assert np.isfinite(broken.estimates()[1]).all()
    assert broken.estimates()[0][1:, :2] == pytest.approx(registration.estimates()[0][1:, :2], abs=1.0)


def test_spoofed_aircraft_do_not_steer_registration() -> None:
    scene = Scene(two_radars(np.random.default_rng(7)), aircraft=10, duration_s=180.0, seed=7,
                  spoofed=np.array([1, 4]), spoof_m=(600.0, -400.0))  # fmt: skip
    registration = Registration(engine_settings(scene.radars))

    feed(registration, comparisons(scene), 180.0)

    error = np.abs(registration.estimates()[0][1:, :2] - truth(scene.radars)[:, :2])
    assert (error < [[20.0, 0.02], [40.0, 0.05]]).all()


def test_frozen_means_held_and_released_means_learning(converged: tuple[Registration, Scene]) -> None:
    scene = converged[1]
    registration = Registration(engine_settings(scene.radars))
    rows = comparisons(scene)
    registration.control("radar1", "freeze", now_s=START_S)
    feed(registration, rows, 20.0)
    held = registration.estimates()[0][1].copy()

    released = registration.control("radar1", "release", now_s=START_S + 20.0)
    feed(registration, rows, 60.0, begin_s=20.0)

    assert held == pytest.approx(np.zeros(4))
    assert released.state == "converging"
    assert abs(registration.estimates()[0][1, 0] - truth(scene.radars)[0, 0]) < 20.0


def test_set_values_are_in_force_at_once_and_what_is_not_named_stays() -> None:
    registration = Registration(engine_settings(two_radars(np.random.default_rng(0))))

    state = registration.control("radar2", "set", now_s=START_S, azimuth_bias_deg=0.4)

    assert (state.azimuth_bias_deg, state.range_bias_m) == (0.4, 0.0)
    _, azimuth_deg, _ = registration.correct(np.array([2]), np.array([1e4]), np.array([10.0]), np.array([0.0]))
    assert azimuth_deg == pytest.approx([9.6])


def test_reset_goes_back_to_the_configured_values(converged: tuple[Registration, Scene]) -> None:
    registration = Registration(engine_settings(converged[1].radars))
    registration.restore(converged[0].snapshot())

    state = registration.control("radar1", "reset", now_s=START_S)

    assert (state.range_bias_m, state.range_bias_sigma_m, state.samples, state.state) == (0.0, 300.0, 0, "converging")


@pytest.mark.parametrize("values", [{"bias_m": 3.0}, {"range_bias_m": float("nan")}])
def test_a_value_that_does_not_exist_or_is_no_number_is_refused(values: dict[str, float]) -> None:
    registration = Registration(engine_settings(two_radars(np.random.default_rng(0))))

    with pytest.raises(SettingsError, match=next(iter(values))):
        registration.control("radar1", "set", now_s=START_S, **values)


def test_only_radars_can_be_controlled() -> None:
    registration = Registration(engine_settings(two_radars(np.random.default_rng(0))))

    with pytest.raises(SettingsError, match="only a radar"):
        registration.control("adsb", "freeze", now_s=START_S)
    with pytest.raises(UnknownSensorError):
        registration.control("radar9", "freeze", now_s=START_S)


def test_a_snapshot_survives_json_and_goes_on_where_it_was(converged: tuple[Registration, Scene]) -> None:
    registration, scene = converged
    fresh = Registration(engine_settings(scene.radars))

    fresh.restore(json.loads(json.dumps(registration.snapshot())))

    assert fresh.estimates()[0] == pytest.approx(registration.estimates()[0])
    assert fresh.estimates()[1] == pytest.approx(registration.estimates()[1])
    assert fresh.states(START_S + 150.0) == registration.states(START_S + 150.0)


def test_a_snapshot_serves_a_configuration_with_other_radars(converged: tuple[Registration, Scene]) -> None:
    registration, scene = converged
    fresh = Registration(engine_settings([scene.radars[1]]))

    fresh.restore(registration.snapshot())

    assert fresh.estimates()[0][1] == pytest.approx(registration.estimates()[0][2])


@pytest.mark.parametrize("content", [{}, {"version": 99}, {"version": 1, "method": "kalman", "sensors": ["radar1"]}])
def test_a_snapshot_that_cannot_be_read_is_refused(content: dict[str, object]) -> None:
    registration = Registration(engine_settings(two_radars(np.random.default_rng(0))))

    with pytest.raises(SnapshotError):
        registration.restore(content)


def test_switched_off_registration_applies_the_configured_values_and_learns_nothing() -> None:
    radars = two_radars(np.random.default_rng(0), azimuth_bias_deg=0.2)
    registration = Registration(engine_settings(radars, enabled=False))

    feed(registration, comparisons(Scene(radars, aircraft=5, duration_s=20.0)), 20.0)

    assert registration.states(START_S)[0].state == "off"
    assert registration.estimates()[0][1] == pytest.approx([0.0, 0.2, 0.0, 0.0])
    assert not registration.uncertain(np.array([1]))[0]


def test_a_range_gain_is_found_once_many_aircraft_have_been_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(group, "GAIN_AFTER_S", 100.0)
    radars = two_radars(np.random.default_rng(8))[:1]
    radars[0].gain = 4e-4
    registration = Registration(engine_settings(radars))

    rows = comparisons(Scene(radars, aircraft=40, duration_s=300.0, seed=100))
    feed(registration, rows, 90.0)
    before = registration.states(START_S + 90.0)[0]
    feed(registration, rows, 300.0, begin_s=90.0)

    state = registration.states(START_S + 300.0)[0]
    assert (before.range_gain, before.range_gain_sigma) == (0.0, 0.0)
    assert abs(state.range_gain - 4e-4) < 3.0 * state.range_gain_sigma < 3e-4
    assert abs(state.range_bias_m - radars[0].range_m) < 3.0 * state.range_bias_sigma_m


def test_the_published_loop_finds_range_and_azimuth_but_no_time() -> None:
    scene = Scene(two_radars(np.random.default_rng(1)), aircraft=20, duration_s=240.0, seed=1)
    registration = Registration(engine_settings(scene.radars, method="feedback"))

    feed(registration, comparisons(scene), 240.0)

    mean = registration.estimates()[0]
    assert abs(mean[1, 0] - scene.radars[0].range_m) < 40.0
    assert abs(mean[1, 1] - scene.radars[0].azimuth_deg) < 0.05
    assert mean[1, 2] == 0.0
