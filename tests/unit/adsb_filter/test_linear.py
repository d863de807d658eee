"""The linear model against filterpy, report by report."""

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter
from tests.filter_scenes import turning_flights

from aeroskein.adsb_filter.linear import LinearHistory, filter_linear, smooth_linear
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.adsb_filter.start import Start, start_states
from aeroskein.measurements import Measurements

SETTINGS = AdsbFilterSettings(linear_sigma_mps2=1.0, outlier_sigmas=1000.0)


def filterpy_axis(
    seen: Measurements, flight: int, axis: int, start: Start, history: LinearHistory, use_velocity: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """One axis of one flight by filterpy: filtered and smoothed.

    The time jitter enters with the velocity that was predicted, which is the history's.
    """
    rows = np.flatnonzero(seen.slot == flight)
    x0, P0 = start.axes()
    kf = KalmanFilter(3, 1)
    kf.x, kf.P = x0[flight, axis].copy(), P0[flight, axis].copy()
    z, v = (seen.east_m, seen.north_m)[axis], (seen.v_east_mps, seen.v_north_mps)[axis]
    r = (seen.r_ee, seen.r_nn)[axis]
    xs, Ps, Fs, Qs = [kf.x.copy()], [kf.P.copy()], [], []
    for row in rows[1:]:
        dt = seen.time_s[row] - seen.time_s[row - 1]
        F = np.array([[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
        Q = Q_discrete_white_noise(3, dt, SETTINGS.linear_sigma_mps2**2)
        kf.predict(F=F, Q=Q)
        kf.update(z[row], R=r[row] + seen.time_variance[row] * kf.x[1] ** 2, H=np.array([[1.0, 0.0, 0.0]]))
        if use_velocity:
            R = seen.velocity_variance[row] + seen.time_variance[row] * kf.x[2] ** 2
            kf.update(v[row], R=R, H=np.array([[0.0, 1.0, 0.0]]))
        xs.append(kf.x.copy())
        Ps.append(kf.P.copy())
        Fs.append(F)
        Qs.append(Q)
    smoothed = kf.rts_smoother(np.stack(xs), np.stack(Ps), Fs=[F, *Fs], Qs=[Q, *Qs])
    return np.stack(xs), np.stack(Ps), smoothed[0], smoothed[1]


@pytest.mark.parametrize("use_velocity", [True, False])
@pytest.mark.parametrize("flight", [0, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_filter_and_smoother_are_filterpys(use_velocity: bool, flight: int, axis: int) -> None:
    seen = turning_flights(1)
    settings = AdsbFilterSettings(linear_sigma_mps2=1.0, outlier_sigmas=1000.0, use_velocity=use_velocity)
    start = start_states(seen, settings)

    history = filter_linear(seen, start, settings)
    smoothed = smooth_linear(history, seen)

    x, P, smooth_x, smooth_P = filterpy_axis(seen, flight, axis, start, history, use_velocity)
    mine = seen.slot == flight
    np.testing.assert_allclose(history.x[mine, axis], x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(history.P[mine, axis], P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(smoothed.x[mine, axis], smooth_x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(smoothed.P[mine, axis], smooth_P, rtol=1e-9, atol=1e-9)


def test_flights_do_not_see_each_other() -> None:
    both = turning_flights(2)
    settings = AdsbFilterSettings()
    alone = both.take(both.slot == 1)
    alone.slot = alone.slot - 1

    together = filter_linear(both, start_states(both, settings), settings)
    single = filter_linear(alone, start_states(alone, settings), settings)

    np.testing.assert_allclose(together.x[both.slot == 1], single.x, rtol=1e-12)


def test_an_outlier_leaves_the_prediction_in_its_place() -> None:
    seen = turning_flights(3, (20,))
    settings = AdsbFilterSettings()
    seen.north_m[12] += 900.0

    history = filter_linear(seen, start_states(seen, settings), settings)

    assert history.accepted.tolist() == [k != 12 for k in range(20)]
    np.testing.assert_array_equal(history.x[12], history.prior_x[12])


def test_a_report_without_position_is_predicted() -> None:
    seen = turning_flights(3, (20,))
    settings = AdsbFilterSettings(use_velocity=False)
    seen.east_m[7] = seen.north_m[7] = np.nan

    history = filter_linear(seen, start_states(seen, settings), settings)

    assert not history.accepted[7]
    np.testing.assert_array_equal(history.x[7], history.prior_x[7])


def test_after_a_long_gap_the_covariance_is_multiplied() -> None:
    seen = turning_flights(3, (20,))
    seen.time_s[10:] += 30.0
    plain, widened = AdsbFilterSettings(gap_inflation=1.0), AdsbFilterSettings(gap_inflation=3.0)

    without = filter_linear(seen, start_states(seen, plain), plain)
    with_it = filter_linear(seen, start_states(seen, widened), widened)

    np.testing.assert_allclose(with_it.prior_cov[10], 3.0 * without.prior_cov[10], rtol=1e-12)
    np.testing.assert_allclose(with_it.prior_cov[9], without.prior_cov[9], rtol=1e-12)


def test_a_filter_that_lost_the_flight_believes_it_again() -> None:
    seen = turning_flights(3, (40,))
    settings = AdsbFilterSettings(reopen_after=4)
    seen.north_m[15:] += 5000.0

    history = filter_linear(seen, start_states(seen, settings), settings)

    assert history.accepted.tolist() == [not 15 <= k < 19 for k in range(40)]
    assert abs(history.x[25, 1, 0] - seen.north_m[25]) < 60.0


def test_smoothing_cuts_the_error_of_a_flight() -> None:
    seen = turning_flights(4, (80,))
    exact = turning_flights(4, (80,))
    exact.time_variance[:] = 1e-6
    settings = AdsbFilterSettings()

    history = filter_linear(seen, start_states(seen, settings), settings)
    smoothed = smooth_linear(history, seen)

    # Where both sides are known the variance of the position falls.
    inside = slice(10, 70)
    assert (smoothed.P[inside, :, 0, 0] < 0.8 * history.P[inside, :, 0, 0]).all()
