"""Latency of each aircraft's ADS-B: what radar plots tell of it, and what is taken out of its stamps."""

import numpy as np
import pytest

from aeroskein.geodesy import frame_rows
from aeroskein.radar_geometry import geodetic_to_radar
from aeroskein.registration import Comparisons, LatencyEstimator, Registration
from aeroskein.settings import EngineSettings, RegistrationSettings, SensorSettings

NOISE_S = 0.3
NOW = np.zeros(1, dtype=np.bool_)


def learn(
    estimator: LatencyEstimator, slot: int, late_s: float, seconds: float, seed: int, floor_s: float = 0.0
) -> None:
    rng = np.random.default_rng(seed)
    for t in np.arange(0.0, seconds, 4.0):
        seen = late_s + NOISE_S * rng.normal(size=1)
        estimator.learn(np.array([slot]), np.array([t]), seen, np.full(1, NOISE_S**2), np.full(1, floor_s**2))


def fleet(late_s: list[float], seconds: float = 480.0, blocks: int = 30, seed: int = 0) -> np.ndarray:
    """What is applied to each aircraft after some blocks."""
    estimator = LatencyEstimator(len(late_s))
    for slot, late in enumerate(late_s):
        learn(estimator, slot, late, seconds, seed=100 * seed + slot)
    for _ in range(blocks):
        estimator.begin_block()
    return estimator.applied_s(np.arange(len(late_s)), np.zeros(len(late_s), dtype=np.bool_))


@pytest.mark.parametrize("true_s", [-0.2, 0.0, 0.35])
def test_five_minutes_tell_the_latency_to_less_than_80_ms(true_s: float) -> None:
    errors = []
    for seed in range(20):
        estimator = LatencyEstimator(1)
        learn(estimator, 0, true_s, 300.0, seed)
        errors.append(estimator.latency_s(np.array([0]))[0][0] - true_s)

    assert np.sqrt(np.mean(np.square(errors))) < 0.08


def test_the_claimed_sigma_is_that_of_the_errors() -> None:
    squared = []
    for seed in range(60):
        estimator = LatencyEstimator(1)
        learn(estimator, 0, 0.1, 200.0, seed)
        mean, sigma = estimator.latency_s(np.array([0]))
        squared.append(((mean[0] - 0.1) / sigma[0]) ** 2)

    assert 0.5 < np.mean(squared) < 1.5


def test_what_the_radar_may_be_off_by_does_not_average_away() -> None:
    estimator = LatencyEstimator(1)
    learn(estimator, 0, 0.3, 600.0, seed=1, floor_s=0.15)

    assert estimator.latency_s(np.array([0]))[1][0] > 0.15


def test_a_wild_plot_and_one_that_says_nothing_are_left_out() -> None:
    estimator = LatencyEstimator(1)

    estimator.learn(
        np.array([0, 0]), np.zeros(2), np.array([25.0, np.nan]), np.array([0.09, np.nan]), np.array([0.0, np.nan])
    )

    assert estimator.latency_s(np.array([0]))[0] == pytest.approx([0.0])


def test_one_late_transponder_of_twenty_is_corrected_and_the_honest_ones_hardly_moved() -> None:
    applied = np.stack([fleet([0.3] + [0.0] * 19, seed=seed) for seed in range(10)])

    assert np.sqrt(np.mean((applied[:, 0] - 0.3) ** 2)) < 0.05
    assert np.sqrt(np.mean(applied[:, 1:] ** 2)) < 0.012


def test_where_latencies_really_scatter_each_aircraft_is_corrected() -> None:
    late = np.random.default_rng(3).normal(scale=0.1, size=60)

    left = fleet(late.tolist()) - (late - np.median(late))

    assert np.sqrt(np.mean(left**2)) < 0.5 * late.std()


def test_what_all_aircraft_have_in_common_is_the_time_of_the_picture() -> None:
    assert np.abs(fleet([0.2] * 20)).max() < 0.05


def test_a_correction_moves_by_five_hundredths_of_a_second_a_block_and_serves_the_block_before() -> None:
    estimator = LatencyEstimator(1)
    learn(estimator, 0, 0.3, 480.0, seed=2)

    estimator.begin_block()
    first = estimator.applied_s(np.array([0]), NOW)
    estimator.begin_block()

    assert first == pytest.approx([0.05])
    assert estimator.applied_s(np.array([0]), NOW) == pytest.approx([0.10])
    assert estimator.applied_s(np.array([0]), ~NOW) == pytest.approx(first)
    assert estimator.applied_s(np.array([-1]), NOW) == pytest.approx([0.0])


def test_slots_grow_and_are_cleared() -> None:
    estimator = LatencyEstimator(1)
    learn(estimator, 0, 0.3, 100.0, seed=4)

    estimator.grow(4)
    kept = estimator.latency_s(np.array([0]))[0][0]
    estimator.clear(np.array([0]))

    assert kept > 0.1
    assert estimator.latency_s(np.array([0, 3]))[0] == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("course_deg", [0.0, 70.0, 200.0])
def test_a_plot_ahead_of_the_reference_by_its_speed_times_the_latency_says_so(course_deg: float) -> None:
    """The radar sees the aircraft 0.3 s of flight ahead of where ADS-B says it is; registration is off, so it knows."""
    radar = SensorSettings(id="r", kind="ssr", lat_deg=48.0, lon_deg=11.0, height_m=500.0)
    settings = EngineSettings(
        sensors=(SensorSettings(id="a", kind="adsb"), radar), registration=RegistrationSettings(enabled=False)
    )
    v = 220.0 * np.array([np.sin(np.radians(course_deg)), np.cos(np.radians(course_deg))])
    metres_per_deg = np.array([111_320.0 * np.cos(np.radians(48.5)), 111_190.0])
    lon, lat = np.array([11.4, 48.5]) + 0.3 * v / metres_per_deg
    site = frame_rows(np.array([48.0]), np.array([11.0]), np.array([500.0]))
    range_m, azimuth_deg, _ = geodetic_to_radar(site, np.array([lat]), np.array([lon]), np.array([9000.0]))
    rows = Comparisons.of(
        sensor=[1], aircraft=[1], time_s=[0.0], range_m=range_m, azimuth_deg=azimuth_deg,
        reference_time_s=[0.0], lat_deg=[48.5], lon_deg=[11.4], height_m=[9000.0], v_east_mps=[v[0]],
        v_north_mps=[v[1]], vertical_rate_mps=[0.0], position_cov_m2=[[36.0, 0.0, 36.0]], height_sigma_m=[5.0],
        anchored=[True],
    )  # fmt: skip

    late_s, noise_s2, floor_s2 = Registration(settings).lateness(rows)

    assert late_s == pytest.approx([0.3], abs=0.01)
    assert 0.15 < np.sqrt(noise_s2[0]) < 0.6
    assert floor_s2 == pytest.approx([0.0])
