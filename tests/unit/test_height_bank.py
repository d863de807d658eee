"""Filters of a flight at several heights and of two kinds."""

import numpy as np
import pytest

from aeroskein import height_bank as bank
from aeroskein.plots import Array

HEIGHTS = 3
STEP_S = 4.0
SIGMA_M = 50.0


def started(speed_mps: float) -> tuple[Array, Array, Array]:
    """One flight northwards from the origin, its velocity known to 10 m/s."""
    x = np.zeros((1, 4, bank.KINDS, HEIGHTS))
    x[:, 3] = speed_mps
    P = np.zeros((1, bank.COVARIANCE_ROWS, bank.KINDS, HEIGHTS))
    P[:, [0, 2]], P[:, [7, 9]] = SIGMA_M**2, 10.0**2
    kind = np.tile(np.array([0.9, 0.1])[:, None], (1, 1, HEIGHTS))
    return x, P, kind


def flown(places: Array) -> Array:
    """How likely the flight is to be turning at last, at the first height."""
    x, P, kind = started(200.0)
    R = np.tile(np.array([SIGMA_M**2, 0.0, SIGMA_M**2])[:, None], (1, 1, HEIGHTS))
    for place in places:
        x, P, kind = bank.mix(x, P, kind, np.array([STEP_S]))
        x, P = bank.predict(x, P, np.array([STEP_S]))
        x, P, kind, _ = bank.update(x, P, kind, np.tile(place[:, None], (1, 1, HEIGHTS)), R)
    return kind[0, 1, 0]


def test_a_straight_flight_is_taken_for_one_and_a_turn_for_a_turn() -> None:
    t = STEP_S * np.arange(1.0, 11.0)
    rate = np.radians(3.0)

    straight = flown(np.stack([np.zeros_like(t), 200.0 * t], axis=1))
    turning = flown(200.0 / rate * np.stack([1.0 - np.cos(rate * t), np.sin(rate * t)], axis=1))

    assert straight < 0.1
    assert turning > 0.9


def test_a_step_is_that_of_a_kalman_filter_in_matrices() -> None:
    x, P, kind = started(200.0)
    z, R = np.array([[[30.0] * HEIGHTS, [850.0] * HEIGHTS]]), np.array([[[900.0], [200.0], [1600.0]]])
    t, q = STEP_S, bank.STRAIGHT_DENSITY
    F, H = np.eye(4), np.eye(2, 4)
    F[0, 2] = F[1, 3] = t
    Q = q * np.kron(np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]]), np.eye(2))
    expected = F @ np.diag([SIGMA_M**2, SIGMA_M**2, 100.0, 100.0]) @ F.T + Q
    S = H @ expected @ H.T + np.array([[900.0, 200.0], [200.0, 1600.0]])
    K = expected @ H.T @ np.linalg.inv(S)
    mean = F @ np.array([0.0, 0.0, 0.0, 200.0])

    px, pP = bank.predict(x, P, np.array([t]))
    ux, uP, _, _ = bank.update(px, pP, kind, z, np.tile(R, (1, 1, HEIGHTS)))

    straight = np.zeros((1, bank.KINDS, HEIGHTS))
    straight[0, 0, 1] = 1.0
    got_x, got_P = bank.moments(ux, uP, straight)
    assert got_x[0] == pytest.approx(mean + K @ (np.array([30.0, 850.0]) - H @ mean))
    assert got_P[0] == pytest.approx(expected - K @ S @ K.T)


def test_mixing_keeps_the_mean_and_the_covariance_of_a_flight() -> None:
    x, P, kind = started(200.0)
    x[:, 0, 1] += 300.0
    P[:, 0, 1] *= 4.0
    before = bank.moments(x, P, kind / HEIGHTS)

    mx, mP, mixed = bank.mix(x, P, kind, np.array([20.0]))

    after = bank.moments(mx, mP, mixed / HEIGHTS)
    assert mixed.sum(axis=1) == pytest.approx(1.0)
    assert mixed[0, 0, 0] != pytest.approx(0.9, abs=1e-3)
    assert after[0] == pytest.approx(before[0])
    assert after[1] == pytest.approx(before[1])


def test_moments_count_what_heights_differ_by() -> None:
    x, P, kind = started(200.0)
    x[0, 0] = np.array([-1000.0, 0.0, 1000.0])

    _, covariance = bank.moments(x, P, kind / HEIGHTS)

    assert covariance[0, 0, 0] == pytest.approx(SIGMA_M**2 + 1000.0**2 * 2.0 / 3.0)
