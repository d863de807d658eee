"""The unscented transform against filterpy, and its treatment of angles."""

import math

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints
from hypothesis import given
from hypothesis import strategies as st
from tests import filter_scenes as scenes

from aeroskein import motion, unscented
from aeroskein.unscented import SigmaPoints

POINTS = SigmaPoints(alpha=0.3, beta=2.0, kappa=-0.5)


def random_states(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.uniform([-5e3, -5e3, 50, -1, -math.pi, -0.1], [5e3, 5e3, 250, 1, math.pi, 0.1], (n, 6))
    roots = rng.standard_normal((n, 6, 6)) * np.array([20.0, 20.0, 3.0, 0.3, 0.05, 0.01])[:, None]
    return x, roots @ np.swapaxes(roots, -1, -2)


@pytest.mark.parametrize("d", [1, 3, 6])
def test_weights_are_van_der_merwes(d: int) -> None:
    mean, covariance, _ = POINTS.weights(d)

    oracle = MerweScaledSigmaPoints(d, POINTS.alpha, POINTS.beta, POINTS.kappa)
    np.testing.assert_allclose(mean, oracle.Wm, rtol=1e-12)
    np.testing.assert_allclose(covariance, oracle.Wc, rtol=1e-12)


def test_points_are_filterpys() -> None:
    x, P = random_states(1, 3)

    points = POINTS.of(x, P)

    oracle = MerweScaledSigmaPoints(6, POINTS.alpha, POINTS.beta, POINTS.kappa)
    for k in range(3):
        np.testing.assert_allclose(points[k], oracle.sigma_points(x[k], P[k]), rtol=1e-10, atol=1e-9)


@given(st.integers(0, 10_000))
def test_points_carry_the_covariance_they_were_made_from(seed: int) -> None:
    x, P = random_states(seed, 1)
    Q = np.zeros((1, 6, 6))

    kept = unscented.predict(x, P, lambda points: points, Q, POINTS, None)

    np.testing.assert_allclose(kept.P[0], P[0], rtol=1e-9, atol=1e-9 * np.abs(P).max())
    np.testing.assert_allclose(kept.cross[0], P[0], rtol=1e-9, atol=1e-9 * np.abs(P).max())


@pytest.mark.parametrize("points", [POINTS, SigmaPoints()])
def test_predict_update_and_smooth_are_filterpys(points: SigmaPoints) -> None:
    x, P = random_states(2, 4)
    dt, R = np.array([0.5, 1.0, 2.0, 4.0]), np.diag([100.0, 400.0])
    Q = motion.turn_noise(x, dt, 0.5, 0.01)
    z = x[:, :2] + np.array([130.0, -40.0])

    moved = unscented.predict(x, P, lambda p: motion.turn_transition(p, dt[:, None]), Q, points, motion.YAW)
    expected = unscented.predict_measurement(moved.x, moved.P, lambda p: p[..., :2], R, points, motion.YAW)
    new_x, new_P = unscented.update(moved.x, moved.P, expected, z - expected.x, motion.YAW)
    old_x, old_P = unscented.smooth(x, P, new_x, new_P, moved, motion.YAW)

    for k in range(4):
        step = float(dt[k])
        oracle = scenes.ukf(
            x[k], P[k], lambda s, _, step=step: motion.turn_transition(s[None], np.array([step]))[0], points
        )
        oracle.Q, oracle.R = Q[k], R
        oracle.predict()
        np.testing.assert_allclose(moved.x[k], oracle.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(moved.P[k], oracle.P, rtol=1e-9, atol=1e-9)
        oracle.update(z[k])
        np.testing.assert_allclose(new_x[k], oracle.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(new_P[k], oracle.P, rtol=1e-9, atol=1e-9)
        both_x, both_P, _ = oracle.rts_smoother(np.stack([x[k], oracle.x]), np.stack([P[k], oracle.P]), Qs=[Q[k]] * 2)
        np.testing.assert_allclose(old_x[k], both_x[0], rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(old_P[k], both_P[0], rtol=1e-9, atol=1e-8)


@given(st.integers(0, 10_000), st.floats(-math.pi, math.pi))
def test_turning_the_compass_turns_the_result(seed: int, turn: float) -> None:
    x, P = random_states(seed, 1)
    turned = x.copy()
    turned[:, 4] = motion.wrap_yaw(turned[:, 4] + turn)
    dt = np.array([1.0])

    def yaw(states: np.ndarray) -> unscented.Prediction:
        Q = np.zeros((1, 6, 6))
        return unscented.predict(states, P, lambda p: motion.turn_transition(p, dt[:, None]), Q, POINTS, motion.YAW)

    first, second = yaw(x), yaw(turned)
    assert scenes.wrapped(second.x[0, 4] - first.x[0, 4] - turn) == pytest.approx(0.0, abs=1e-9)
    assert second.P[0, 4, 4] == pytest.approx(first.P[0, 4, 4])


def test_root_of_a_singular_covariance_still_multiplies_to_it() -> None:
    P = np.diag([4.0, 0.0, -1e-18])[None]

    root = unscented.root(P)

    np.testing.assert_allclose(root @ np.swapaxes(root, -1, -2), np.diag([4.0, 0.0, 0.0])[None], atol=1e-11)


def test_indefinite_covariances_are_made_positive_and_others_are_left_alone() -> None:
    good = np.array([[4.0, 1.0], [1.0, 9.0]])
    indefinite = np.diag([1e10, 1e-6]) + np.array([[0.0, 200.0], [200.0, 0.0]])

    made = unscented.positive(np.stack([good, indefinite]))

    np.testing.assert_allclose(made[0], good, rtol=1e-12)
    assert (np.linalg.eigvalsh(made[1]) >= 0.0).all()
    # Each component keeps the size of its own variance.
    np.testing.assert_allclose(np.diag(made[1]), [1e10, 1e-6], rtol=0.6)
