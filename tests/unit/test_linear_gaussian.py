"""Plain Kalman algebra against filterpy."""

import numpy as np
from filterpy.kalman import KalmanFilter

from aeroskein import linear_gaussian, motion


def setting(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((5, 6)) * 100.0
    roots = rng.standard_normal((5, 6, 6)) * 10.0
    return x, roots @ np.swapaxes(roots, -1, -2), rng.uniform(0.2, 4.0, 5), rng.standard_normal((5, 4)) * 100.0


def oracle(x: np.ndarray, P: np.ndarray) -> KalmanFilter:
    made = KalmanFilter(6, 4)
    made.x, made.P = x.copy(), P.copy()
    return made


def test_predict_and_update_are_filterpys() -> None:
    x, P, dt, z = setting(3)
    F, Q = motion.acceleration_transition(dt), motion.white_jerk_noise(dt, 0.04)
    H, R = np.eye(4, 6), np.diag([100.0, 90.0, 1.0, 2.0])

    prior_x, prior_P = linear_gaussian.predict(x, P, F, Q)
    innovation = z - prior_x[:, :4]
    new_x, new_P = linear_gaussian.update(prior_x, prior_P, innovation, H, R)
    d2 = linear_gaussian.squared_distance(innovation, linear_gaussian.innovation_covariance(prior_P, H, R))

    for k in range(5):
        kf = oracle(x[k], P[k])
        kf.predict(F=F[k], Q=Q[k])
        kf.update(z[k], R=R, H=H)
        np.testing.assert_allclose(new_x[k], kf.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(new_P[k], kf.P, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(d2[k], kf.mahalanobis**2, rtol=1e-9)


def test_smoothing_is_filterpys() -> None:
    x, P, dt, z = setting(4)
    F, Q = motion.acceleration_transition(dt), motion.white_jerk_noise(dt, 0.04)
    prior_x, prior_P = linear_gaussian.predict(x, P, F, Q)
    H, R = np.eye(4, 6), np.diag([100.0, 90.0, 1.0, 2.0])
    next_x, next_P = linear_gaussian.update(prior_x, prior_P, z - prior_x[:, :4], H, R)

    old_x, old_P = linear_gaussian.smooth(x, P, F, prior_x, prior_P, next_x, next_P)

    for k in range(5):
        both = np.stack([x[k], next_x[k]]), np.stack([P[k], next_P[k]])
        xs, Ps, _, _ = oracle(x[k], P[k]).rts_smoother(*both, Fs=[F[k]] * 2, Qs=[Q[k]] * 2)
        np.testing.assert_allclose(old_x[k], xs[0], rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(old_P[k], Ps[0], rtol=1e-9, atol=1e-8)
