"""Smoothed altitudes against filterpy, and what is done with holes and outliers."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from aeroskein.smoothing.climb import smooth_altitude


def climb(n: int = 60, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.uniform(0.5, 4.0, n))
    true = 3000.0 + 10.0 * np.clip(time_s - 40.0, 0.0, 60.0)
    return time_s, true, true + 8.0 * rng.standard_normal(n)


def smoothed(time_s: np.ndarray, altitude_m: np.ndarray, rate: float = np.nan) -> tuple[np.ndarray, np.ndarray]:
    n = len(time_s)
    return smooth_altitude(np.zeros(n, dtype=np.int64), time_s, altitude_m, np.full(n, 8.0), np.full(n, rate))


def test_smoothing_is_filterpys() -> None:
    time_s, _, altitude_m = climb()
    kf = KalmanFilter(2, 1)
    # A flight begins at its first altitude, not quite certain of it.
    kf.x, kf.P, kf.H, kf.R = np.array([altitude_m[0], 0.0]), np.diag([80.0**2 + 1e4, 15.0**2]), np.eye(2)[:1], [[64.0]]
    kf.update(altitude_m[0])
    xs, Ps, Fs, Qs = [kf.x.copy()], [kf.P.copy()], [], []
    for k in range(1, len(time_s)):
        dt = time_s[k] - time_s[k - 1]
        F = np.array([[1.0, dt], [0.0, 1.0]])
        Q = 0.5 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        kf.predict(F=F, Q=Q)
        kf.update(altitude_m[k])
        for kept, value in ((xs, kf.x), (Ps, kf.P), (Fs, F), (Qs, Q)):
            kept.append(value.copy())
    x, _, _, _ = kf.rts_smoother(np.stack(xs), np.stack(Ps), Fs=[F, *Fs], Qs=[Q, *Qs])

    altitude, rate = smoothed(time_s, altitude_m)

    np.testing.assert_allclose(altitude, x[:, 0], rtol=1e-9)
    np.testing.assert_allclose(rate, x[:, 1], rtol=1e-9, atol=1e-9)


def test_smoothing_halves_the_error() -> None:
    time_s, true, altitude_m = climb(seed=2)

    altitude, _ = smoothed(time_s, altitude_m)

    assert np.std(altitude - true) < 0.65 * np.std(altitude_m - true)


def test_an_outlier_does_not_count() -> None:
    time_s, _, altitude_m = climb(seed=3)
    spoilt = altitude_m.copy()
    spoilt[30] += 9000.0
    without = altitude_m.copy()
    without[30] = np.nan

    np.testing.assert_allclose(smoothed(time_s, spoilt)[0], smoothed(time_s, without)[0], rtol=1e-12)


def test_rows_before_the_first_altitude_are_led_back_to() -> None:
    time_s, true, altitude_m = climb(seed=4)
    altitude_m[:5] = np.nan

    altitude, _ = smoothed(time_s, altitude_m)

    np.testing.assert_allclose(altitude[:5], true[:5], atol=40.0)


def test_a_flight_without_altitude_has_none() -> None:
    time_s, _, altitude_m = climb(10)
    flight = np.repeat([0, 1], 5)
    altitude_m[5:] = np.nan

    altitude, rate = smooth_altitude(flight, time_s, altitude_m, np.full(10, 8.0), np.full(10, 1.0))

    assert np.isfinite(altitude[:5]).all()
    assert np.isnan(altitude[5:]).all()
    assert np.isnan(rate[5:]).all()


def test_reported_rates_count() -> None:
    time_s = np.arange(20.0)

    _, rate = smoothed(time_s, np.full(20, 1000.0) + 3.0 * time_s, 3.0)

    assert rate[10] == pytest.approx(3.0, abs=0.05)
