"""Latency of each aircraft's ADS-B."""

import numpy as np
import pytest

from aeroskein.registration import LatencyEstimator

NOISE = np.array([[70.0**2, 0.0, 70.0**2]])
REFERENCE = np.array([[6.0**2, 0.0, 6.0**2]])


def learn(latency_s: float, seconds: float, bias: float = 0.0, speed: float = 220.0, seed: int = 0) -> tuple:
    rng, estimator = np.random.default_rng(seed), LatencyEstimator(3)
    for t in np.arange(0.0, seconds, 4.0):
        course = 0.3 + t / 200.0
        v = speed * np.array([[np.sin(course), np.cos(course)]])
        residual = v * latency_s + rng.normal(size=(1, 2)) * 70.0
        estimator.update(np.array([1]), np.array([t]), residual, v, NOISE, REFERENCE, bias * NOISE)
    return estimator.latency_s(np.arange(3))


@pytest.mark.parametrize("true_s", [-0.2, 0.0, 0.35])
def test_five_minutes_tell_the_latency_to_less_than_80_ms(true_s: float) -> None:
    errors = [learn(true_s, 300.0, seed=k)[0][1] - true_s for k in range(20)]

    assert np.sqrt(np.mean(np.square(errors))) < 0.08


def test_the_claimed_sigma_is_that_of_the_errors() -> None:
    runs = [learn(0.1, 200.0, seed=k) for k in range(60)]
    squared = [((mean[1] - 0.1) / sigma[1]) ** 2 for mean, sigma in runs]

    assert 0.5 < np.mean(squared) < 1.5


def test_other_slots_keep_the_prior() -> None:
    mean, sigma = learn(0.3, 100.0)

    assert (mean[0], sigma[0]) == (0.0, pytest.approx(0.3))


def test_what_the_radar_may_be_off_by_does_not_average_away() -> None:
    _, sigma = learn(0.3, 600.0, bias=0.25)

    assert sigma[1] > 35.0 / 220.0 * 0.95


def test_a_wild_plot_is_left_out() -> None:
    estimator = LatencyEstimator(1)

    estimator.update(
        np.array([0]), np.array([0.0]), np.array([[0.0, 5000.0]]), np.array([[0.0, 200.0]]), NOISE, REFERENCE, 0 * NOISE
    )

    assert estimator.latency_s(np.array([0]))[0] == pytest.approx([0.0])


def test_slots_grow_and_are_reset() -> None:
    estimator = LatencyEstimator(1)
    columns = (np.array([[0.0, 80.0]]), np.array([[0.0, 200.0]]), NOISE, REFERENCE, 0 * NOISE)
    estimator.update(np.array([0]), np.array([0.0]), *columns)

    estimator.grow(4)
    kept = estimator.latency_s(np.array([0]))[0][0]
    estimator.reset(np.array([0]))

    assert kept > 0.1
    assert estimator.latency_s(np.array([0, 3]))[0] == pytest.approx([0.0, 0.0])
