"""Coordinated turns: states keep their acceleration relative to the flight, and noise lies across it."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
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


def jacobian(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """By central differences, in steps that suit each component."""
    steps = np.repeat([1.0, 1e-2, 1e-4], 2)
    columns = [(f(x + d) - f(x - d)) / (2.0 * d.sum()) for d in np.diag(steps)]
    return np.stack(columns, axis=1)


@given(seeds, st.sampled_from([15.0, 150.0]))
@settings(max_examples=30)
def test_a_circle_moves_mean_and_errors_as_its_derivatives_say(seed: int, speed_mps: float) -> None:
    rng, x, full = states(seed, speed_mps)
    assume((np.abs(np.hypot(x[2], x[3])[:, None] - [30.0, 60.0]) > 1.0).all())
    h, q = np.array([0.0, *rng.uniform(0.0, 8.0, N - 1)]), 0.7
    wanted_x, wanted_P = x.copy(), full.copy()  # where no time passes nothing changes
    for k in range(1, N):
        F = jacobian(lambda y, k=k: plain.circle(y, h[k]), x[:, k])
        wanted_x[:, k] = plain.circle(x[:, k], h[k])
        middle = plain.circle(x[:, k], 0.5 * h[k])[2:4]
        wanted_P[k] = F @ full[k] @ F.T + plain.noise_of_flight(middle, h[k], 0.0, q)
    P = kalman.from_matrix(full)

    coordinated_turn.circle(x, P, h, q)

    plain.close(x, wanted_x, rtol=1e-9, atol=1e-4)
    sigma = np.sqrt(np.einsum("nii->ni", wanted_P))
    off = (kalman.to_matrix(P) - wanted_P) / (sigma[:, :, None] * sigma[:, None, :])
    assert np.abs(off).max() < 1e-5
    assert np.array_equal(P[[1, 13, 21]], P[[6, 16, 22]])


def test_an_update_across_turns_the_flight_and_does_not_speed_it_up() -> None:
    x = np.array(
        [[0.0, 0.0, 104.0, 30.0, 1.0, 5.0], [0.0, 0.0, 101.0, 0.5, 0.0, 0.0], [9.0, 9.0, 40.0, 9.0, 1.0, 1.0]]
    ).T
    full = plain.random_covariance(np.random.default_rng(3), 3)
    P, before = kalman.from_matrix(full), (x.copy(), full.copy())

    coordinated_turn.keep_speed(x, P, np.array([[100.0, 100.0, 35.0], [0.0, 0.0, 0.0]]))

    turn = expm(0.3 * plain.QUARTER)
    plain.close(x[2:4, 0], turn @ [104.0, 0.0])
    plain.close(x[4:6, 0], turn @ [1.0, 5.0])
    M = np.kron(np.diag([0.0, 1.0, 1.0]), turn) + np.kron(np.diag([1.0, 0.0, 0.0]), np.eye(2))
    plain.close(kalman.to_matrix(P)[0], M @ before[1][0] @ M.T)
    # A step too small to matter, and a flight too slow to have a direction, stay as they are.
    assert np.array_equal(x[:, 1:], before[0][:, 1:])
    assert np.array_equal(kalman.to_matrix(P)[1:], kalman.to_matrix(kalman.from_matrix(full))[1:])
