"""Percentiles and bootstrap intervals over flights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import bootstrap

from aeroskein.evaluation.spread import percentile_interval, rms_interval, signed_spread, spread

DRAWS = {"resamples": 2000, "seed": 1}


def test_sizes_that_are_not_known_are_left_out():
    found = spread(np.array([3.0, np.nan, 4.0]))

    assert (found.count, found.max) == (2, 4.0)
    assert found.rms == pytest.approx(np.sqrt(12.5))


def test_nothing_known_is_nothing_said():
    assert spread(np.array([np.nan])).rms is None
    assert signed_spread(np.zeros(0)).mean is None


def test_signed_errors_keep_their_mean_and_lose_their_sign_in_the_rest():
    found = signed_spread(np.array([-3.0, 1.0]))

    assert (found.mean, found.max) == (-1.0, 3.0)


def test_rms_interval_is_that_of_scipys_bootstrap_of_flights():
    rng = np.random.default_rng(2)
    squares = rng.gamma(3.0, 10.0, 40)
    flight = np.repeat(np.arange(40), 25)
    expected = bootstrap(
        (squares,), lambda x, axis: np.sqrt(np.mean(x, axis=axis)), method="percentile", n_resamples=5000, rng=3
    ).confidence_interval

    found = rms_interval(np.sqrt(squares)[flight], flight, **DRAWS)

    assert found.low == pytest.approx(expected.low, rel=0.02)
    assert found.high == pytest.approx(expected.high, rel=0.02)


def test_percentile_interval_is_that_of_resampling_whole_flights_by_hand():
    rng = np.random.default_rng(5)
    flight = np.repeat(np.arange(30), 40)
    size = rng.gamma(2.0, 5.0, len(flight)) * rng.gamma(5.0, 0.2, 30)[flight]
    by_flight = size.reshape(30, 40)
    drawn = [np.percentile(by_flight[rng.integers(0, 30, 30)], 95.0) for _ in range(2000)]

    found = percentile_interval(size, flight, 95.0, **DRAWS)

    assert found.low == pytest.approx(np.percentile(drawn, 2.5), rel=0.03)
    assert found.high == pytest.approx(np.percentile(drawn, 97.5), rel=0.03)


def test_equal_flights_leave_no_doubt():
    size, flight = np.tile([3.0, 4.0], 10), np.repeat(np.arange(10), 2)

    found = rms_interval(size, flight, **DRAWS)

    assert (found.low, found.high) == pytest.approx((np.sqrt(12.5), np.sqrt(12.5)))


def test_one_flight_has_no_interval():
    assert rms_interval(np.ones(5), np.zeros(5, dtype=int), **DRAWS) is None
    assert percentile_interval(np.ones(5), np.zeros(5, dtype=int), 95.0, **DRAWS) is None


@given(st.lists(st.floats(0.0, 1e6), min_size=4, max_size=60), st.integers(0, 99))
def test_an_interval_lies_among_the_flights(sizes, seed):
    size = np.array(sizes)
    flight = np.arange(len(size)) % 4
    of_flights = [np.sqrt(np.mean(size[flight == k] ** 2)) for k in range(4)]

    found = rms_interval(size, flight, resamples=50, seed=seed)

    assert min(of_flights) * (1 - 1e-9) <= found.low <= found.high <= max(of_flights) * (1 + 1e-9)


def test_the_same_seed_gives_the_same_interval():
    size, flight = np.arange(1.0, 41.0), np.repeat(np.arange(8), 5)

    assert rms_interval(size, flight, resamples=100, seed=4) == rms_interval(size, flight, resamples=100, seed=4)
