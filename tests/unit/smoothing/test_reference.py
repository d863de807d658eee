"""The reference estimators against filterpy and against the brute-force meaning of a lag."""

import itertools
from typing import Any

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import IMMEstimator, KalmanFilter
from tests.filter_scenes import Floats, turning_flights

from aeroskein.measurements import Measurements
from aeroskein.smoothing import parameters, reference_filter, reference_smoother
from aeroskein.smoothing.detector import allowed_density, detect
from aeroskein.smoothing.start import first_states
from aeroskein.smoothing.variable_jerk import filter_forwards, smooth_backwards

H_POSITION, H_VELOCITY = np.eye(6)[:2], np.eye(6)[2:4]
RATES = np.array([[0.0, 0.004, 0.012], [0.01, 0.0, 0.03], [0.05, 0.15, 0.0]])


def jerk_model(dt: float, density: float) -> tuple[Floats, Floats]:
    """Constant acceleration under white jerk, by filterpy's integral, state [x y vx vy ax ay]."""
    F, Q = np.eye(6), np.zeros((6, 6))
    for axis in (0, 1):
        at = [axis, axis + 2, axis + 4]
        F[np.ix_(at, at)] = [[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]]
        Q[np.ix_(at, at)] = Q_continuous_white_noise(3, dt, density)
    return F, Q


def steady_model(dt: float, density: float) -> tuple[Floats, Floats]:
    """Constant velocity under white acceleration; the acceleration becomes zero."""
    F, Q = np.eye(6), np.zeros((6, 6))
    for axis in (0, 1):
        F[axis, axis + 2] = dt
        F[axis + 4, axis + 4] = 0.0
        at = [axis, axis + 2]
        Q[np.ix_(at, at)] = Q_continuous_white_noise(2, dt, density)
    return F, Q


def take(kf: Any, seen: Measurements, row: int) -> None:
    """One report by filterpy: position, then velocity, each with its time jitter along the predicted motion."""
    v, jitter = kf.x[2:4], seen.time_variance[row]
    R = np.array([[seen.r_ee[row], seen.r_en[row]], [seen.r_en[row], seen.r_nn[row]]]) + jitter * np.outer(v, v)
    kf.update(np.array([seen.east_m[row], seen.north_m[row]]), R=R, H=H_POSITION)
    if np.isfinite(seen.v_east_mps[row]):
        a = kf.x[4:6]
        R = seen.velocity_variance[row] * np.eye(2) + jitter * np.outer(a, a)
        kf.update(np.array([seen.v_east_mps[row], seen.v_north_mps[row]]), R=R, H=H_VELOCITY)


def kalman(x: Floats, P: Floats) -> KalmanFilter:
    kf = KalmanFilter(6, 2)
    kf.x, kf.P = x.copy(), P.copy()
    return kf


def without_velocity(seen: Measurements) -> Measurements:
    for name in ("v_east_mps", "v_north_mps", "velocity_variance"):
        getattr(seen, name)[:] = np.nan
    return seen


def test_parameters_are_those_that_accuracy_is_claimed_for() -> None:
    np.testing.assert_array_equal(parameters.RATES_PER_S, RATES)
    np.testing.assert_allclose(parameters.JERK_DENSITY, np.array([0.02, 0.1, 1.0]) ** 2)
    np.testing.assert_allclose(parameters.DETECTOR_JERK_DENSITY, np.array([0.2, 2.0]) ** 2)
    assert pytest.approx(0.05**2) == parameters.DETECTOR_STEADY_DENSITY
    assert (parameters.BEHIND_S, parameters.AHEAD_S) == (1.0, 4.0)


def transition(dt: float) -> Floats:
    values, vectors = np.linalg.eig(RATES - np.diag(RATES.sum(axis=1)))
    return np.real(vectors @ np.diag(np.exp(values * dt)) @ np.linalg.inv(vectors))


@pytest.mark.parametrize("flight", [0, 1])
def test_detector_is_filterpys_estimator(flight: int) -> None:
    seen = without_velocity(turning_flights(1))
    found = detect(seen)
    rows = np.flatnonzero(seen.slot == flight)
    x, P = (part[flight] for part in first_states(seen))
    filters = [kalman(x, P) for _ in range(3)]
    imm = IMMEstimator(filters, parameters.DETECTOR_START, np.eye(3))

    for row in rows[1:]:
        dt = float(seen.time_s[row] - seen.time_s[row - 1])
        filters[0].F, filters[0].Q = steady_model(dt, 0.05**2)
        for kf, density in zip(filters[1:], (0.2**2, 2.0**2), strict=True):
            kf.F, kf.Q = jerk_model(dt, density)
        # filterpy mixes with what it computed at the last update; the time to this report is known only now.
        imm.M = transition(dt)
        imm._compute_mixing_probabilities()
        imm.predict()
        for kf in filters:
            v = kf.x[2:4]
            kf.H, kf.R = H_POSITION, np.diag([100.0, 100.0]) + 0.04 * np.outer(v, v)
        imm.update(np.array([seen.east_m[row], seen.north_m[row]]))
        np.testing.assert_allclose(found.x[row], imm.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.P[row], imm.P, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.mu[:, row], imm.mu, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("flight", [0, 1])
def test_variable_jerk_filter_and_smoother_are_filterpys(flight: int) -> None:
    seen = turning_flights(2)
    density = np.random.default_rng(2).uniform(1e-4, 1.0, len(seen))
    track = filter_forwards(seen, density)
    smooth_x, smooth_P = smooth_backwards(seen, track)

    rows = np.flatnonzero(seen.slot == flight)
    kf = kalman(*(part[flight] for part in first_states(seen)))
    xs, Ps, Fs, Qs = [kf.x.copy()], [kf.P.copy()], [], []
    for row in rows[1:]:
        F, Q = jerk_model(float(seen.time_s[row] - seen.time_s[row - 1]), density[row])
        kf.predict(F=F, Q=Q)
        take(kf, seen, int(row))
        for kept, value in ((xs, kf.x), (Ps, kf.P), (Fs, F), (Qs, Q)):
            kept.append(value.copy())
    np.testing.assert_allclose(track.x[rows], xs, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(track.P[rows], Ps, rtol=1e-9, atol=1e-9)
    x, P, _, _ = kf.rts_smoother(np.stack(xs), np.stack(Ps), Fs=[F, *Fs], Qs=[Q, *Qs])
    np.testing.assert_allclose(smooth_x[rows], x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(smooth_P[rows], P, rtol=1e-9, atol=1e-9)


def brute_force(seen: Measurements, density: Floats, at_s: float, lag_s: float | None) -> tuple[Floats, Floats]:
    """One instant of one flight from the definition: everything before the horizon, forwards and back, by filterpy."""
    horizon = np.inf if lag_s is None else at_s + lag_s

    def allowed(t: float) -> float:
        last = min(t + parameters.AHEAD_S, horizon)
        inside = [d for d, s in zip(density, seen.time_s, strict=True) if t - parameters.BEHIND_S <= s <= last]
        # Where nothing is known in the window, what was known before it.
        return max(inside) if inside else density[seen.time_s < t][-1]

    instants = sorted([(float(t), k) for k, t in enumerate(seen.time_s) if t <= horizon] + [(at_s, len(seen))])
    kf = kalman(*(part[0] for part in first_states(seen)))
    xs, Ps, Fs, Qs = [kf.x.copy()], [kf.P.copy()], [], []
    ends = {at_s: min((t for t, k in instants if t >= at_s and k < len(seen)), default=at_s)}
    for (before, _), (t, row) in itertools.pairwise(instants):
        F, Q = jerk_model(t - before, allowed(ends.get(t, t)))
        kf.predict(F=F, Q=Q)
        if row < len(seen):
            take(kf, seen, row)
        for kept, value in ((xs, kf.x), (Ps, kf.P), (Fs, F), (Qs, Q)):
            kept.append(value.copy())
    x, P, _, _ = kf.rts_smoother(np.stack(xs), np.stack(Ps), Fs=[F, *Fs], Qs=[Q, *Qs])
    place = [row for _, row in instants].index(len(seen))
    return x[place], P[place]


@pytest.mark.parametrize("lag_s", [0.0, 1.5, 6.0, None])
def test_smoother_with_a_lag_means_what_it_says(lag_s: float | None) -> None:
    seen = turning_flights(3, (60,))
    density = detect(seen).density_m2ps5
    at_s = np.linspace(seen.time_s[0] + 0.3, seen.time_s[-1] - 7.0, 9)

    found = reference_smoother(seen.take(np.arange(60)), np.zeros(9), at_s, lag_s=lag_s)

    for k, t in enumerate(at_s):
        x, P = brute_force(seen, density, float(t), lag_s)
        np.testing.assert_allclose(found.position_m[k], x[:2], rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(found.velocity_mps[k], x[2:4], rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(found.position_cov_m2[k], P[:2, :2], rtol=1e-8, atol=1e-8)


def test_a_lag_sees_nothing_behind_its_horizon() -> None:
    seen, changed = turning_flights(4, (60,)), turning_flights(4, (60,))
    at_s = seen.time_s[30]
    late = changed.time_s > at_s + 6.0
    changed.east_m[late] += 37.0
    changed.v_east_mps[late] += 5.0

    one, other = (reference_smoother(s, [0], [at_s], lag_s=6.0) for s in (seen, changed))

    np.testing.assert_array_equal(one.position_m, other.position_m)
    assert (
        reference_smoother(changed, [0], [at_s]).position_m != reference_smoother(seen, [0], [at_s]).position_m
    ).any()


def test_longer_lags_know_more() -> None:
    seen = turning_flights(5, (80,))
    at_s = np.arange(20.0, 50.0, 3.0)

    spread = [
        np.trace(reference_smoother(seen, np.zeros(10), at_s, lag_s=lag).position_cov_m2, axis1=1, axis2=2).mean()
        for lag in (0.0, 6.0, 12.0, None)
    ]

    assert spread == sorted(spread, reverse=True)
    assert spread[3] < 0.6 * spread[0]


def test_density_is_the_largest_around_an_instant() -> None:
    time_s, flight = np.array([0.0, 2.0, 4.0, 6.0, 0.5]), np.array([0, 0, 0, 0, 1])
    density = np.array([1.0, 5.0, 2.0, 9.0, 100.0])
    at_s, of = np.array([0.5, 1.9, 2.5, 3.5, 30.0]), np.zeros(5, dtype=np.int64)

    everything = allowed_density(time_s, flight, at_s, of, density)
    until_four = allowed_density(time_s, flight, at_s, of, density, np.full(5, 4.0))

    np.testing.assert_array_equal(everything, [5.0, 5.0, 9.0, 9.0, 9.0])
    np.testing.assert_array_equal(until_four[:4], [5.0, 5.0, 5.0, 2.0])


def test_instants_outside_a_flight_have_no_estimate() -> None:
    seen = turning_flights(6, (30,))
    asked = [seen.time_s[0] - 1.0, seen.time_s[10], seen.time_s[-1] + 5.0]

    found = reference_smoother(seen, [0, 0, 0], asked)

    assert np.isnan(found.position_m[:, 0]).tolist() == [True, False, True]
    assert np.isnan(reference_smoother(seen, [7], [seen.time_s[10]]).position_m).all()


def test_order_of_questions_does_not_matter() -> None:
    seen = turning_flights(7)
    flight, at_s = np.array([1, 0, 1, 0]), np.array([20.0, 40.0, 10.0, 12.0])

    mixed = reference_smoother(seen.take(np.arange(len(seen))), flight, at_s, lag_s=6.0)
    alone = reference_smoother(seen.take(np.flatnonzero(seen.slot == 1)), [1, 1], [20.0, 10.0], lag_s=6.0)

    np.testing.assert_allclose(mixed.position_m[[0, 2]], alone.position_m, rtol=1e-12)


def test_an_outlier_at_the_start_is_no_start() -> None:
    seen, clean = turning_flights(8, (40,)), turning_flights(8, (40,))
    seen.north_m[0] += 8000.0

    found = reference_filter(seen)

    assert np.isnan(found.position_m[0]).all()
    assert np.hypot(*(found.position_m[39] - reference_filter(clean).position_m[39])) < 1.0


def test_outliers_are_left_out() -> None:
    seen, clean = turning_flights(9, (60,)), turning_flights(9, (60,))
    seen.east_m[[20, 33, 34]] += 1500.0
    for name in ("east_m", "north_m", "v_east_mps", "v_north_mps"):
        getattr(clean, name)[[20, 33, 34]] = np.nan
    at_s = seen.time_s[10:50]

    one, other = (reference_smoother(s, np.zeros(40), at_s) for s in (seen, clean))

    np.testing.assert_allclose(one.position_m, other.position_m, atol=1e-9)


def test_a_biased_source_is_not_believed_while_another_is_accepted() -> None:
    seen = turning_flights(10, (80,))
    second = np.arange(80) % 4 == 0
    seen.sensor[second] = 1.0
    seen.v_east_mps[second] = seen.v_north_mps[second] = np.nan
    seen.east_m[second & (np.arange(80) > 10)] += 3000.0

    track = filter_forwards(seen, np.full(80, 1.0))

    assert not track.accepted[second & (np.arange(80) > 10)].any()
    assert track.accepted[~second].all()


def test_unscented_reference_filter_follows_the_same_flight() -> None:
    seen = turning_flights(11, (80,))

    linear, unscented = reference_filter(seen, "imm"), reference_filter(seen, "imm-ukf")

    apart = np.hypot(*(linear.position_m - unscented.position_m)[20:].T)
    assert np.sqrt(np.mean(apart**2)) < 10.0
    assert np.isfinite(unscented.velocity_cov_m2ps2).all()
