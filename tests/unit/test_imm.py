"""Interacting multiple models against filterpy, matrix exponentials, hidden Markov chains and enumeration."""

import itertools
import math

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from aeroskein import imm, linear_gaussian
from aeroskein.unscented import Prediction

RATES = np.array([[0.0, 0.004, 0.012], [0.01, 0.0, 0.03], [0.05, 0.15, 0.0]])
F = np.array([[1.0, 1.0], [0.0, 1.0]])
H = np.array([[1.0, 0.0]])
R = np.array([[4.0]])
# A quiet and a lively target.
QS = np.array([0.01, 4.0])[:, None, None] * np.array([[0.25, 0.5], [0.5, 1.0]])
CHAIN = np.array([[0.9, 0.1], [0.3, 0.7]])


@given(st.floats(0.0, 600.0))
def test_transition_probabilities_are_the_matrix_exponential(dt_s: float) -> None:
    A = RATES - np.diag(RATES.sum(axis=1))

    T = imm.transition_probabilities(RATES, np.array([dt_s]))[0]

    np.testing.assert_allclose(T, expm(A * dt_s), rtol=1e-10, atol=1e-12)


def test_transition_over_no_time_changes_nothing() -> None:
    np.testing.assert_array_equal(imm.transition_probabilities(RATES, np.zeros(1))[0], np.eye(3))


def run(z: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The IMM over one target, step by step: models after each report."""
    x, P, mu = np.zeros((2, 1, 2)), np.tile(np.eye(2) * 9.0, (2, 1, 1, 1)), np.array([[0.8], [0.2]])
    history = [(x, P, mu)]
    for value in z:
        x, P, mu = imm.mix(x, P, mu, CHAIN[None], None)
        x, P = linear_gaussian.predict(x, P, F, QS[:, None])
        innovation = value - x[..., :1]
        log_likelihood = imm.gaussian_log_likelihood(innovation, linear_gaussian.innovation_covariance(P, H, R))
        x, P = linear_gaussian.update(x, P, innovation, H, R)
        mu = imm.reweigh(mu, log_likelihood)
        history.append((x, P, mu))
    return history


def test_filter_is_filterpys_estimator() -> None:
    z = np.cumsum(np.random.default_rng(5).standard_normal(30)) * 3.0
    filters = []
    for Q in QS:
        kf = KalmanFilter(2, 1)
        kf.x, kf.P, kf.F, kf.H, kf.R, kf.Q = np.zeros(2), np.eye(2) * 9.0, F, H, R, Q
        filters.append(kf)
    oracle = IMMEstimator(filters, np.array([0.8, 0.2]), CHAIN)

    history = run(z)

    for value, (x, P, mu) in zip(z, history[1:], strict=True):
        oracle.predict()
        oracle.update(np.array([value]))
        mean, covariance = imm.mixture(x, P, mu, None)
        np.testing.assert_allclose(mean[0], oracle.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(covariance[0], oracle.P, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(mu[:, 0], oracle.mu, rtol=1e-9)


def test_likelihood_is_the_normal_density() -> None:
    innovation, S = np.array([[3.0, -1.0]]), np.array([[[4.0, 1.0], [1.0, 2.0]]])

    value = imm.gaussian_log_likelihood(innovation, S)[0]

    assert value == pytest.approx(multivariate_normal(cov=S[0]).logpdf(innovation[0]))


def test_a_report_beyond_underflow_still_orders_the_models() -> None:
    mu = imm.reweigh(np.array([[0.5], [0.5]]), np.array([[-1e5], [-1e5 - 2.0]]))

    assert mu[0, 0] == pytest.approx(1.0 / (1.0 + math.exp(-2.0)))


def test_mixture_of_angles_does_not_care_where_the_circle_is_cut() -> None:
    x = np.array([[[3.1]], [[-3.1]]])
    P = np.full((2, 1, 1, 1), 0.01)

    mean, covariance = imm.mixture(x, P, np.array([[0.5], [0.5]]), 0)

    assert abs(mean[0, 0]) == pytest.approx(math.pi)
    assert covariance[0, 0, 0] == pytest.approx(0.01 + (math.pi - 3.1) ** 2)


def forward_backward(likelihood: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Smoothed probabilities of a hidden Markov chain, by enumeration of all paths."""
    n = len(likelihood)
    smoothed = np.zeros((n, 2))
    for path in itertools.product(range(2), repeat=n):
        weight = start[path[0]] * likelihood[0, path[0]]
        for k in range(1, n):
            weight *= CHAIN[path[k - 1], path[k]] * likelihood[k, path[k]]
        for k in range(n):
            smoothed[k, path[k]] += weight
    return smoothed / smoothed.sum(axis=1, keepdims=True)


def test_smoothed_probabilities_are_exact_for_a_hidden_chain() -> None:
    likelihood = np.random.default_rng(6).uniform(0.05, 1.0, (7, 2))
    start = np.array([0.6, 0.4])
    mu = [start * likelihood[0] / (start * likelihood[0]).sum()]
    for row in likelihood[1:]:
        predicted = CHAIN.T @ mu[-1]
        mu.append(predicted * row / (predicted * row).sum())

    smoothed = [mu[-1][:, None]]
    for k in range(5, -1, -1):
        smoothed.insert(0, imm.smoothed_probabilities(mu[k][:, None], CHAIN[None], smoothed[0]))

    np.testing.assert_allclose(np.hstack(smoothed).T, forward_backward(likelihood, start), rtol=1e-10)


def smooth(history: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> list[tuple[np.ndarray, np.ndarray]]:
    x, P, mu = history[-1]
    smoothed = [imm.mixture(x, P, mu, None)]
    for x, P, now_mu in history[-2::-1]:
        mixed_x, mixed_P, _ = imm.mix(x, P, now_mu, CHAIN[None], None)
        moved = Prediction(*linear_gaussian.predict(mixed_x, mixed_P, F, QS[:, None]), mixed_P @ F.T)
        smoothed.insert(0, imm.smooth(mixed_x, mixed_P, moved, mu, *smoothed[0], None))
        mu = imm.smoothed_probabilities(now_mu, CHAIN[None], mu)
    return smoothed


def exact(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed means and variances of the position by enumeration of all paths of the models: no approximation."""
    n = len(z)
    moments, weights = [], []
    for path in itertools.product(range(2), repeat=n):
        weight = (0.8, 0.2) @ CHAIN[:, path[0]]
        for a, b in itertools.pairwise(path):
            weight *= CHAIN[a, b]
        kf = KalmanFilter(2, 1)
        kf.x, kf.P, kf.F, kf.H, kf.R = np.zeros(2), np.eye(2) * 9.0, F, H, R
        xs, Ps = [kf.x.copy()], [kf.P.copy()]
        for value, model in zip(z, path, strict=True):
            kf.predict(Q=QS[model])
            kf.update(np.array([value]))
            weight *= math.exp(kf.log_likelihood)
            xs.append(kf.x.copy())
            Ps.append(kf.P.copy())
        means, covariances, _, _ = kf.rts_smoother(
            np.stack(xs), np.stack(Ps), Fs=[F] * (n + 1), Qs=[*(QS[m] for m in path), QS[0]]
        )
        moments.append((means[:, 0], covariances[:, 0, 0]))
        weights.append(weight)
    w = np.array(weights) / sum(weights)
    means, variances = (np.stack([m[i] for m in moments]) for i in (0, 1))
    mean = w @ means
    return mean, w @ (variances + (means - mean) ** 2)


@pytest.mark.parametrize("seed", range(4))
def test_smoothed_state_stays_close_to_the_exact_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lively = np.array([0, 0, 0, 1, 1, 1, 0, 0])
    speed = np.cumsum(np.where(lively, 2.0, 0.1) * rng.standard_normal(8))
    z = np.cumsum(speed) + 2.0 * rng.standard_normal(8)

    history = run(z)
    smoothed = smooth(history)

    mean, variance = exact(z)
    distance = np.array([(x[0, 0] - m) / math.sqrt(v) for (x, _), m, v in zip(smoothed, mean, variance, strict=True)])
    filtered = [imm.mixture(*models, None)[0][0, 0] for models in history]
    before = (np.array(filtered) - mean) / np.sqrt(variance)
    # Far inside one sigma, and nearer than the filter is.
    assert np.sqrt(np.mean(distance**2)) < 0.25
    assert np.sqrt(np.mean(distance**2)) < 0.5 * np.sqrt(np.mean(before**2))


def test_one_model_smooths_as_rauch_tung_and_striebel() -> None:
    rng = np.random.default_rng(8)
    x, P = rng.standard_normal((1, 1, 2)), np.eye(2)[None, None] * 3.0
    moved = Prediction(*linear_gaussian.predict(x, P, F, QS[0]), P @ F.T)
    next_x, next_P = moved.x[0] + 1.0, moved.P[0] * 0.5

    one = imm.smooth(x, P, moved, np.ones((1, 1)), next_x, next_P, None)

    expected = linear_gaussian.smooth(x[0], P[0], F, moved.x[0], moved.P[0], next_x, next_P)
    np.testing.assert_allclose(one[0], expected[0], rtol=1e-12)
    np.testing.assert_allclose(one[1], expected[1], rtol=1e-12)
