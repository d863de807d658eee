"""Coordinated turns: states keep their acceleration relative to the flight, and noise lies across it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests import plain_algebra as plain

from aeroskein import coordinated_turn, kalman

seeds = st.integers(0, 2**31)
N = 5


def states(seed: int, speed_mps: float = 150.0) -> tuple[np.random.Generator, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((6, N)) * np.repeat([1000.0, speed_mps, 2.0], 2)[:, None]
    return rng, x, plain.random_covariance(rng, N)


@given(seeds, st.sampled_from([0.0, 15.0, 150.0]))
@settings(max_examples=30)
def test_a_step_is_that_of_plain_algebra(seed: int, speed_mps: float) -> None:
    rng, x, full = states(seed, speed_mps)
    h, along, across = rng.uniform(0.0, 8.0, N), rng.uniform(0.0, 1.0, N), rng.uniform(0.0, 2.0, N)
    wanted = [plain.coordinated_turn(x[:, k], full[k], h[k], along[k], across[k]) for k in range(N)]
    P = kalman.from_matrix(full)

    coordinated_turn.predict(x, P, h, along, across)

    # Below a thousandth of a radian the first terms of a series serve.
    plain.close(x, np.stack([w[0] for w in wanted], axis=1), rtol=1e-10, atol=1e-4)
    plain.close(kalman.to_matrix(P), np.stack([w[1] for w in wanted]), rtol=1e-11)


@pytest.mark.parametrize("rate_degps", [-3.0, 1.5, 3.0])
def test_a_standard_rate_turn_is_followed_for_half_a_minute(rate_degps: float) -> None:
    """Closed form: a circle, in one step or in many. Constant acceleration alone would be kilometres off."""
    speed, rate = 130.0, np.radians(rate_degps)
    x = np.array([0.0, 0.0, speed, 0.0, 0.0, speed * rate])[:, None]
    P = np.zeros((kalman.COVARIANCE_ROWS, 1))
    angle, radius = 30.0 * rate, speed / rate

    for steps in (1, 30):
        moved = x.copy()
        for _ in range(steps):
            coordinated_turn.predict(moved, P, np.full(1, 30.0 / steps), np.zeros(1), np.zeros(1))

        assert moved[0, 0] == pytest.approx(radius * np.sin(angle), abs=1e-6)
        assert moved[1, 0] == pytest.approx(radius * (1.0 - np.cos(angle)), abs=1e-6)
        assert np.hypot(moved[2, 0], moved[3, 0]) == pytest.approx(speed, abs=1e-9)


def test_straight_flight_with_equal_densities_is_constant_acceleration() -> None:
    x = np.array([0.0, 0.0, 120.0, 90.0, 0.4, 0.3])[:, None]
    P = kalman.from_matrix(plain.random_covariance(np.random.default_rng(1), 1))
    other_x, other_P = x.copy(), P.copy()
    h, q = np.array([4.0]), np.array([0.3])

    coordinated_turn.predict(x, P, h, q, q)
    kalman.predict(other_x, other_P, h, q)

    plain.close(x, other_x, rtol=1e-12)
    plain.close(P, other_P, rtol=1e-12)


@given(seeds)
@settings(max_examples=20)
def test_what_is_kept_across_is_a_projection_of_state_and_covariance(seed: int) -> None:
    _, x, full = states(seed)
    where = np.array([True, True, False, True, False])
    P, before = kalman.from_matrix(full), (x.copy(), full.copy())

    coordinated_turn.keep_across(x, P, where)

    for k in range(N):
        M = np.eye(6)
        v = before[0][2:4, k]
        n = np.array([-v[1], v[0]]) / np.hypot(*v) if np.hypot(*v) >= 30.0 else np.zeros(2)
        M[4:, 4:] = np.outer(n, n) if where[k] else np.eye(2)
        plain.close(x[:, k], M @ before[0][:, k], rtol=1e-11)
        plain.close(kalman.to_matrix(P)[k], M @ before[1][k] @ M.T, rtol=1e-11)
