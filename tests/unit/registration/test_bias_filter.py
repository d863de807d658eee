"""The joint filter, against weighted least squares and filterpy."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from aeroskein.plots import Array, Ints
from aeroskein.registration import filter as bias_filter
from aeroskein.registration.filter import BiasFilter
from aeroskein.registration.rows import Rows, bias_jacobian

SIGMA = np.array([[300.0, 0.5, 1.0, 0.0], [300.0, 0.5, 1.0, 0.0]])
TRUTH = np.array([[80.0, -0.15, 0.3, 0.0], [-60.0, 0.18, 0.4, 0.0]])


def rows_of(n: int, rng: np.random.Generator, noise: float = 1.0, aircraft: int = 8) -> tuple[Rows, Ints, Ints]:
    """Anchored rows of two radars with the true biases; radar and place of each."""
    radar, place = rng.integers(0, 2, n), rng.integers(0, aircraft, n)
    ground = rng.uniform(20e3, 150e3, n)
    angle = rng.uniform(0, 2 * np.pi, n)
    radial, across = 220.0 * np.cos(angle), 220.0 * np.sin(angle)
    H = bias_jacobian(ground, ground, radial, across)
    R = np.zeros((n, 2, 2))
    R[:, 0, 0], R[:, 1, 1] = 50.0**2, (ground * np.radians(0.07)) ** 2
    error = np.einsum("nij,nj->ni", H, TRUTH[radar])
    error += noise * rng.normal(size=(n, 2)) * np.sqrt(np.stack([R[:, 0, 0], R[:, 1, 1]], axis=-1))
    of_aircraft = np.zeros((n, 2, 3))
    of_aircraft[:, :, 0] = np.stack([radial, across], axis=-1)
    of_aircraft[:, 0, 1] = of_aircraft[:, 1, 2] = -1.0
    none = np.full(n, -1)
    rows = Rows(
        np.zeros(n), error, R, radar + 1, none, H, np.zeros((n, 2, 4)), np.zeros((n, 2)), place + 100, of_aircraft,
        np.zeros((n, 2)),
    )  # fmt: skip
    return rows, radar, place


def least_squares(rows: Rows, radar: Ints, place: Ints, aircraft: int = 8) -> tuple[Array, Array]:
    """Mean and covariance of all states by the normal equations, priors as pseudo-measurements."""
    width = 8 + 3 * aircraft
    prior = np.concatenate([SIGMA.reshape(-1), np.tile([bias_filter.LATENCY_SIGMA_S, 5.0, 5.0], aircraft)])
    prior[[3, 7]] = 1e-9
    normal, right = np.diag(prior**-2.0), np.zeros(width)
    for k in range(len(rows)):
        H = np.zeros((2, width))
        H[:, 4 * radar[k] : 4 * radar[k] + 4] = rows.of_sensor[k]
        H[:, 8 + 3 * place[k] : 11 + 3 * place[k]] = rows.of_aircraft[k]
        W = np.linalg.inv(rows.covariance_m2[k])
        normal += H.T @ W @ H
        right += H.T @ W @ rows.error_m[k]
    P = np.linalg.inv(normal)
    return P @ right, P


def test_without_time_passing_it_is_weighted_least_squares() -> None:
    rows, radar, place = rows_of(120, np.random.default_rng(1), noise=0.3)
    kf = BiasFilter(np.zeros((2, 4)), SIGMA, 8)
    kf.predict(0.0)

    kf.update(rows, radar, np.full(120, -1), place)

    x, P = least_squares(rows, radar, place)
    assert kf.biases.reshape(-1) == pytest.approx(x[:8], rel=1e-6, abs=1e-8)
    assert kf.bias_covariance.reshape(8, 8) == pytest.approx(P[:8, :8], rel=1e-4, abs=1e-10)


def test_one_aircraft_never_counts_more_than_its_own_errors_allow() -> None:
    rng = np.random.default_rng(2)
    rows, radar, place = rows_of(4000, rng, noise=0.0, aircraft=1)
    kf = BiasFilter(np.zeros((2, 4)), SIGMA, 1)
    kf.predict(0.0)

    kf.update(rows, radar, np.full(4000, -1), place)

    time_sigma = np.sqrt(kf.bias_covariance[0, 2, 0, 2])
    assert time_sigma == pytest.approx(bias_filter.LATENCY_SIGMA_S, rel=0.05)


def test_the_random_walk_and_the_aircraft_states_follow_filterpy() -> None:
    kf = BiasFilter(np.zeros((1, 4)), SIGMA[:1], 1)
    kf.predict(0.0)
    rows, _, _ = rows_of(1, np.random.default_rng(3), noise=0.1, aircraft=1)
    zero = np.zeros(1, dtype=np.int64)
    kf.update(rows, zero, np.full(1, -1), zero)
    other = KalmanFilter(dim_x=8, dim_z=2)
    other.x = np.concatenate([kf.biases[0], kf._x[4:5], kf.aircraft_errors()[0][0]])[:, None]
    other.P = kf._P[:8, :8].copy()
    keep = np.exp(-30.0 / np.array([np.inf] * 4 + [6.0 * 3600.0, 1800.0, 60.0, 60.0]))
    other.F = np.diag(keep)
    drift = bias_filter.DRIFT_PER_ROOT_S**2 * 30.0 * np.array([1.0, 1.0, 1.0, 0.0])
    other.Q = np.diag(np.concatenate([drift, np.array([1.0, 0.1, 5.0, 5.0]) ** 2 * (1.0 - keep[4:] ** 2)]))

    kf.predict(30.0)
    other.predict()

    assert kf._P[:8, :8] == pytest.approx(other.P, rel=1e-9, abs=1e-15)
    assert kf.aircraft_errors()[0][0] == pytest.approx(other.x[5:, 0], rel=1e-12)


def test_an_error_of_all_heights_does_not_average_away() -> None:
    n = 4000
    rows, radar, place = rows_of(n, np.random.default_rng(8), noise=0.0)
    rows.of_height[:, 0] = 15.0
    kf = BiasFilter(np.zeros((2, 4)), SIGMA, 8)
    kf.predict(0.0)

    kf.update(rows, radar, np.full(n, -1), place)

    assert np.sqrt(kf.bias_covariance[:, 0, :, 0].diagonal()) == pytest.approx([15.0, 15.0], rel=0.1)


def test_a_wild_row_moves_the_first_estimate_less_than_its_noise_would() -> None:
    rows, radar, place = rows_of(40, np.random.default_rng(4), noise=0.5)
    rows.error_m[5] += [4000.0, 3000.0]
    kf = BiasFilter(np.zeros((2, 4)), SIGMA, 8)
    kf.predict(0.0)

    kf.update(rows, radar, np.full(40, -1), place)

    error = np.abs(kf.biases - TRUTH)
    assert (error[:, :2] < [40.0, 0.06]).all()


def test_a_held_radar_keeps_mean_and_variance_while_the_other_learns() -> None:
    rows, radar, place = rows_of(100, np.random.default_rng(5))
    kf = BiasFilter(np.zeros((2, 4)), SIGMA, 8)
    kf.considered[0] = True
    kf.predict(0.0)

    kf.update(rows, radar, np.full(100, -1), place)

    assert kf.biases[0] == pytest.approx(np.zeros(4))
    assert np.diagonal(kf.bias_covariance[0, :, 0, :]) == pytest.approx(SIGMA[0] ** 2)
    assert abs(kf.biases[1, 0] - TRUTH[1, 0]) < 40.0


def test_rescaled_latencies_are_those_of_a_filter_that_began_with_that_scatter(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, radar, place = rows_of(60, np.random.default_rng(6), noise=0.3)
    none = np.full(60, -1)
    kf = BiasFilter(np.zeros((2, 4)), SIGMA, 8)
    kf.predict(0.0)
    kf.update(rows, radar, none, place)
    kf.rescale_latency(np.arange(8), 0.25)
    monkeypatch.setattr(bias_filter, "LATENCY_SIGMA_S", 0.25)
    other = BiasFilter(np.zeros((2, 4)), SIGMA, 8)
    other.predict(0.0)

    other.update(rows, radar, none, place)

    assert kf.biases == pytest.approx(other.biases, rel=1e-6, abs=1e-7)
    assert kf.bias_covariance == pytest.approx(other.bias_covariance, rel=1e-4, abs=1e-9)


def test_a_restarted_radar_has_nothing_in_common_with_the_other() -> None:
    rows, radar, place = rows_of(100, np.random.default_rng(7))
    kf = BiasFilter(np.zeros((2, 4)), SIGMA, 8)
    kf.predict(0.0)
    kf.update(rows, radar, np.full(100, -1), place)

    kf.restart(0, np.zeros(4), SIGMA[0])

    assert np.abs(kf.bias_covariance[0, :, 1, :]).max() == 0.0


def test_time_never_goes_back() -> None:
    kf = BiasFilter(np.zeros((1, 4)), SIGMA[:1], 1)
    kf.predict(100.0)

    kf.predict(50.0)

    assert kf.time_s == 100.0
