"""The turning models: CTRA against filterpy's unscented filter, the IMM against a plain one made of those."""

import math
from typing import Any

import numpy as np
import pytest
from tests import filter_scenes as scenes
from tests.filter_scenes import Floats, turning_flights

from aeroskein import motion
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.adsb_filter.start import start_states
from aeroskein.adsb_filter.turning import POINTS, Bank, bank_of, filter_turning, smooth_turning
from aeroskein.measurements import Measurements

SETTINGS = AdsbFilterSettings(outlier_sigmas=1000.0)
POSITIONS = AdsbFilterSettings(outlier_sigmas=1000.0, use_velocity=False)


class PlainModel:
    """One model of the bank as filterpy's unscented filter, over one flight."""

    def __init__(self, bank: Bank, index: int, x: Floats, P: Floats) -> None:
        self.keep = float(bank.keep_acceleration[index, 0]), float(bank.keep_yaw_rate[index, 0])
        self.sigmas = float(bank.acceleration_sigma_mps2[index, 0]), float(bank.yaw_rate_sigma_radps[index, 0])
        self.filter = scenes.ukf(x, P, self.move, POINTS)

    def move(self, x: Floats, dt: float) -> Floats:
        return motion.turn_transition(x[None], np.array([dt]), *self.keep)[0]

    def noise(self, x: Floats, dt: float) -> Floats:
        return motion.turn_noise(x[None], np.array([dt]), *self.sigmas, *self.keep)[0]

    def step(self, seen: Measurements, row: int, use_velocity: bool) -> float:
        """Predict and take one report; gives the logarithm of its likelihood."""
        f = self.filter
        dt = float(seen.time_s[row] - seen.time_s[row - 1])
        f.Q = self.noise(f.x, dt)
        f.predict(dt=dt)
        v, jitter = scenes.velocity_of(f.x), seen.time_variance[row]
        R0 = np.array([[seen.r_ee[row], seen.r_en[row]], [seen.r_en[row], seen.r_nn[row]]])
        f.update(np.array([seen.east_m[row], seen.north_m[row]]), R=R0 + jitter * np.outer(v, v))
        log_likelihood = float(f.log_likelihood)
        if use_velocity:
            a = scenes.acceleration_of(f.x)
            f.sigmas_f = f.points_fn.sigma_points(f.x, f.P)
            reported = np.array([seen.v_east_mps[row], seen.v_north_mps[row]])
            R = seen.velocity_variance[row] * np.eye(2) + jitter * np.outer(a, a)
            f.update(reported, R=R, hx=scenes.velocity_of)
            log_likelihood += float(f.log_likelihood)
        return log_likelihood


def start_of(seen: Measurements, settings: AdsbFilterSettings, flight: int) -> tuple[Floats, Floats]:
    x, P = start_states(seen, settings).turning()
    return x[flight], P[flight]


@pytest.mark.parametrize("settings", [SETTINGS, POSITIONS])
@pytest.mark.parametrize("flight", [0, 1])
def test_unscented_filter_and_smoother_are_filterpys(settings: AdsbFilterSettings, flight: int) -> None:
    seen, bank = turning_flights(1), bank_of(settings, several=False)

    history = filter_turning(seen, start_states(seen, settings), bank, settings)
    smoothed = smooth_turning(history, seen, bank)

    rows = np.flatnonzero(seen.slot == flight)
    plain = PlainModel(bank, 0, *start_of(seen, settings, flight))
    xs, Ps, Qs = [plain.filter.x.copy()], [plain.filter.P.copy()], []
    for row in rows[1:]:
        plain.step(seen, int(row), settings.use_velocity)
        Qs.append(plain.filter.Q)
        xs.append(plain.filter.x.copy())
        Ps.append(plain.filter.P.copy())
    np.testing.assert_allclose(history.x[0, rows], xs, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(history.P[0, rows], Ps, rtol=1e-9, atol=1e-9)
    smooth_x, smooth_P = rts(plain, np.stack(xs), np.stack(Ps), Qs, np.diff(seen.time_s[rows]))
    np.testing.assert_allclose(smoothed.x[0, rows], smooth_x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(smoothed.P[0, rows], smooth_P, rtol=1e-9, atol=1e-9)


def rts(plain: PlainModel, xs: Floats, Ps: Floats, Qs: list[Floats], dt: Floats) -> tuple[Floats, Floats]:
    """Filterpy's unscented smoother, a step at a time, because it takes one process noise for all (its own ``Q``)."""
    for k in range(len(dt) - 1, -1, -1):
        plain.filter.Q = Qs[k]
        pair = plain.filter.rts_smoother(xs[k : k + 2], Ps[k : k + 2], dts=[float(dt[k])] * 2)
        xs[k], Ps[k] = pair[0][0], pair[1][0]
        xs[k, 4] = scenes.wrapped(xs[k, 4])
    return xs, Ps


def plain_mixture(states: list[Any], weights: Floats) -> tuple[Floats, Floats]:
    """Moments of a mixture of filterpy's states, written out."""
    x = scenes.mean(np.stack([s.x for s in states]), weights)
    P = np.zeros((6, 6))
    for s, w in zip(states, weights, strict=True):
        d = scenes.residual(s.x, x)
        P += w * (s.P + np.outer(d, d))
    return x, P


@pytest.mark.parametrize("settings", [SETTINGS, POSITIONS])
def test_imm_is_the_textbooks(settings: AdsbFilterSettings) -> None:
    seen, bank = turning_flights(5, (50,)), bank_of(settings, several=True)

    history = filter_turning(seen, start_states(seen, settings), bank, settings)

    models = [PlainModel(bank, j, *start_of(seen, settings, 0)) for j in range(3)]
    mu = np.full(3, 1.0 / 3.0)
    rates = bank.rates_per_s - np.diag(bank.rates_per_s.sum(axis=1))
    for row in range(1, 50):
        T = transition(rates, float(seen.time_s[row] - seen.time_s[row - 1]))
        predicted = T.T @ mu
        mixed = [plain_mixture([m.filter for m in models], T[:, j] * mu / predicted[j]) for j in range(3)]
        log_likelihood = np.zeros(3)
        for j, model in enumerate(models):
            model.filter.x, model.filter.P = mixed[j][0].copy(), mixed[j][1].copy()
            log_likelihood[j] = model.step(seen, row, settings.use_velocity)
        mu = predicted * np.exp(log_likelihood - log_likelihood.max())
        mu /= mu.sum()
        for j, model in enumerate(models):
            np.testing.assert_allclose(history.x[j, row], model.filter.x, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(history.P[j, row], model.filter.P, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(history.mu[:, row], mu, rtol=1e-8, atol=1e-10)


def transition(rates: Floats, dt: float) -> Floats:
    """``exp(rates dt)`` by eigenvalues."""
    values, vectors = np.linalg.eig(rates)
    return np.real(vectors @ np.diag(np.exp(values * dt)) @ np.linalg.inv(vectors))


def test_turn_shows_in_the_probabilities() -> None:
    seen = turning_flights(6, (60,))
    settings = AdsbFilterSettings()
    bank = bank_of(settings, several=True)

    history = filter_turning(seen, start_states(seen, settings), bank, settings)

    turning = (seen.time_s > 20.0) & (seen.time_s < 34.0)
    straight = (seen.time_s > 45.0) & (seen.time_s < 58.0)
    ctrv, _, csav = history.mu
    assert ctrv[turning].mean() > 0.9
    assert csav[straight].mean() > 0.5


def test_smoothing_shrinks_the_covariance() -> None:
    seen = turning_flights(7, (60,))
    settings = AdsbFilterSettings()
    bank = bank_of(settings, several=True)

    history = filter_turning(seen, start_states(seen, settings), bank, settings)
    filtered, smoothed = history.filtered(), smooth_turning(history, seen, bank).filtered()

    before, after = (np.trace(f.position_cov_m2, axis1=1, axis2=2) for f in (filtered, smoothed))
    assert (after[5:50] < before[5:50]).all()


def test_outlier_leaves_every_model_at_its_prediction() -> None:
    seen, clean = turning_flights(8, (30,)), turning_flights(8, (30,))
    settings = AdsbFilterSettings()
    bank = bank_of(settings, several=True)
    seen.east_m[20] += 2000.0
    clean.east_m[20] = clean.north_m[20] = np.nan
    clean.v_east_mps[20] = clean.v_north_mps[20] = np.nan

    with_outlier = filter_turning(seen, start_states(seen, settings), bank, settings)
    without = filter_turning(clean, start_states(clean, settings), bank, settings)

    assert not with_outlier.accepted[20]
    np.testing.assert_array_equal(with_outlier.x, without.x)


def test_two_reports_of_one_instant_are_both_taken() -> None:
    seen = turning_flights(9, (30,))
    seen.time_s[20] = seen.time_s[19]
    settings = AdsbFilterSettings()
    bank = bank_of(settings, several=True)

    history = filter_turning(seen, start_states(seen, settings), bank, settings)

    assert history.accepted[20]
    assert np.isfinite(smooth_turning(history, seen, bank).x).all()
    assert np.trace(history.filtered().position_cov_m2[20]) < np.trace(history.filtered().position_cov_m2[19])


def test_velocity_covariance_follows_speed_and_yaw() -> None:
    seen = turning_flights(10, (30,))
    settings = AdsbFilterSettings()
    bank = bank_of(settings, several=False)

    history = filter_turning(seen, start_states(seen, settings), bank, settings)

    speed, P = history.x[0, 25, 2], history.P[0, 25]
    expected = P[2, 2] + speed**2 * P[4, 4]
    assert np.trace(history.filtered().velocity_cov_m2ps2[25]) == pytest.approx(expected, rel=1e-9)
    assert math.hypot(*history.filtered().velocity_mps[25]) == pytest.approx(speed)
