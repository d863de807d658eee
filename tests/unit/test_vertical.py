"""The vertical channel against filterpy and least squares; altitude and height are never mixed."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.vertical import (
    ACCELERATION_DENSITY,
    FORGET_S,
    MISSES_TO_RESTART,
    RATE_SIGMA_MPS,
    START_RATE_SIGMA_MPS,
    VerticalFilter,
    fit_at,
)

NAN = np.nan
SIGMA_M = 8.0
ONE = np.array([0])


def started(n: int = 1) -> VerticalFilter:
    vertical = VerticalFilter(n)
    vertical.start(np.arange(n))
    return vertical


def take(
    vertical: VerticalFilter, time_s: float, altitude_m: float = NAN, height_m: float = NAN, rate_mps: float = NAN
) -> None:
    vertical.update(ONE, *(np.array([v]) for v in (time_s, altitude_m, height_m, rate_mps, SIGMA_M)))


def at(vertical: VerticalFilter, time_s: float) -> tuple[float, ...]:
    """Altitude, height, rate, sigma."""
    when = np.array([time_s])
    return tuple(float(v[0]) for v in (*vertical.at(ONE, when), vertical.sigma_at(ONE, when)))


# -- the live filter --------------------------------------------------------------------------------------------------
def test_filter_is_filterpys() -> None:
    rng = np.random.default_rng(1)
    vertical, kf = started(), KalmanFilter(2, 1)
    time_s, last_s = 0.0, 0.0
    for k in range(60):
        time_s += float(rng.choice([0.3, 1.0, 4.0, 11.0]))
        altitude = 3000.0 + 5.0 * time_s + rng.normal(0, SIGMA_M)
        rate = 5.0 + rng.normal(0, 1) if k % 3 else NAN
        take(vertical, time_s, altitude, rate_mps=rate)
        if k == 0:
            kf.x, kf.P = np.array([altitude, 0.0]), np.diag([SIGMA_M**2, START_RATE_SIGMA_MPS**2])
        else:
            h = time_s - last_s
            Q = Q_continuous_white_noise(dim=2, dt=h, spectral_density=ACCELERATION_DENSITY)
            kf.predict(F=np.array([[1.0, h], [0.0, 1.0]]), Q=Q)
            kf.update(np.array([altitude]), R=np.array([[SIGMA_M**2]]), H=np.array([[1.0, 0.0]]))
            if np.isfinite(rate):
                kf.update(np.array([rate]), R=np.array([[RATE_SIGMA_MPS**2]]), H=np.array([[0.0, 1.0]]))
        last_s = time_s

        got = at(vertical, time_s)
        assert got[0] == pytest.approx(kf.x[0], rel=1e-10)
        assert got[2] == pytest.approx(kf.x[1], abs=1e-9)
        assert got[3] == pytest.approx(np.sqrt(kf.P[0, 0]), rel=1e-9)


def test_state_ahead_of_its_reports_is_predicted() -> None:
    vertical = started()
    take(vertical, 10.0, 3000.0, rate_mps=8.0)

    altitude, _, rate, sigma = at(vertical, 14.0)

    assert altitude == pytest.approx(3032.0)
    assert rate == pytest.approx(8.0)
    assert sigma == pytest.approx(np.sqrt(SIGMA_M**2 + 16.0 * RATE_SIGMA_MPS**2 + ACCELERATION_DENSITY * 64.0 / 3.0))


def test_nothing_reported_is_nothing_known() -> None:
    vertical = started()
    take(vertical, 10.0)

    assert np.isnan(at(vertical, 10.0)[:3]).all()


def test_pressure_altitude_alone_says_nothing_of_height() -> None:
    vertical = started()
    take(vertical, 1.0, 3000.0)

    altitude, height, _, _ = at(vertical, 1.0)

    assert altitude == 3000.0
    assert np.isnan(height)


def test_height_alone_says_nothing_of_pressure_altitude() -> None:
    vertical = started()
    take(vertical, 1.0, height_m=3000.0)

    altitude, height, _, _ = at(vertical, 1.0)

    assert np.isnan(altitude)
    assert height == 3000.0


def test_the_difference_is_learned_from_reports_that_carry_both() -> None:
    vertical = started()
    for second in range(5):
        take(vertical, float(second), 3000.0, 3090.0)

    altitude, height, _, _ = at(vertical, 4.0)

    assert altitude == pytest.approx(3000.0)
    assert height == pytest.approx(3090.0)


def test_heights_count_as_altitudes_once_the_difference_is_known() -> None:
    vertical = started()
    take(vertical, 0.0, 3000.0, 3090.0)
    for second in range(1, 20):
        take(vertical, float(second), height_m=3190.0)

    altitude, height, _, _ = at(vertical, 19.0)

    assert altitude == pytest.approx(3100.0, abs=1.0)
    assert height == pytest.approx(3190.0, abs=1.0)


def test_heights_are_never_mixed_with_altitudes_without_the_difference() -> None:
    vertical = started()
    for second in range(10):
        take(vertical, float(second), altitude_m=3000.0) if second % 2 else take(
            vertical, float(second), height_m=3090.0
        )

    altitude, height, _, _ = at(vertical, 9.0)

    assert altitude == pytest.approx(3000.0)
    assert np.isnan(height)


def test_a_first_altitude_begins_anew_what_was_a_height() -> None:
    vertical = started()
    take(vertical, 0.0, height_m=3090.0)

    take(vertical, 1.0, altitude_m=3000.0)

    assert at(vertical, 1.0)[0] == 3000.0


def test_a_wrong_altitude_is_left_out() -> None:
    vertical = started()
    for second in range(10):
        take(vertical, float(second), 3000.0, rate_mps=0.0)

    take(vertical, 10.0, 12_000.0, rate_mps=0.0)

    assert at(vertical, 10.0)[0] == pytest.approx(3000.0, abs=1.0)


def test_an_altitude_that_insists_is_believed() -> None:
    vertical = started()
    for second in range(10):
        take(vertical, float(second), 3000.0)

    found = []
    for second in range(10, 11 + MISSES_TO_RESTART):
        take(vertical, float(second), 5000.0)
        found.append(at(vertical, float(second))[0] > 4000.0)

    assert found == [False] * MISSES_TO_RESTART + [True]


def test_a_late_altitude_does_not_turn_time_back() -> None:
    vertical = started()
    take(vertical, 10.0, 3000.0, rate_mps=5.0)
    before = vertical.rows.copy()

    take(vertical, 8.0, 2990.0)

    assert np.array_equal(vertical.rows, before, equal_nan=True)


def test_a_state_without_reports_is_forgotten() -> None:
    vertical = started()
    take(vertical, 0.0, 3000.0, rate_mps=0.0)

    assert np.isfinite(at(vertical, FORGET_S)[0])
    assert np.isnan(at(vertical, FORGET_S + 0.1)[:3]).all()
    take(vertical, FORGET_S + 10.0, 9000.0)
    assert at(vertical, FORGET_S + 10.0)[0] == 9000.0


def test_tracks_side_by_side_are_tracks_alone() -> None:
    rng = np.random.default_rng(2)
    together, alone = started(3), [started() for _ in range(3)]
    for second in range(20):
        z = np.where(rng.random(3) < 0.7, 3000.0 + rng.normal(0, 8, 3), NAN)
        height = np.where(rng.random(3) < 0.5, z + 90.0, NAN)
        rate = np.where(rng.random(3) < 0.5, rng.normal(0, 1, 3), NAN)
        t = second + rng.random(3)
        together.update(np.arange(3), t, z, height, rate, np.full(3, SIGMA_M))
        for i, one in enumerate(alone):
            take(one, t[i], z[i], height[i], rate[i])

    for i, one in enumerate(alone):
        assert np.array_equal(together.rows[i], one.rows[0], equal_nan=True)


def test_growth_and_a_new_start_leave_nothing_behind() -> None:
    vertical = started()
    take(vertical, 0.0, 3000.0, 3090.0)

    vertical.grow(2)
    assert at(vertical, 0.0)[0] == 3000.0
    vertical.start(ONE)

    assert np.isnan(at(vertical, 0.0)[:3]).all()


# -- the fit at the centre of an element ------------------------------------------------------------------------------
def least_squares(
    centre: float, t: np.ndarray, z: np.ndarray, rate: np.ndarray, sigma: np.ndarray
) -> tuple[float, float, float]:
    """The same fit by numpy: rows divided by their sigmas, and a weak belief that nobody climbs."""
    dt = t - centre
    rows, values = [[0.0, 1.0 / START_RATE_SIGMA_MPS]], [0.0]
    for k in range(len(t)):
        if np.isfinite(z[k]):
            s = np.sqrt(sigma[k] ** 2 + ACCELERATION_DENSITY * abs(dt[k]) ** 3 / 3.0)
            rows, values = [*rows, [1.0 / s, dt[k] / s]], [*values, z[k] / s]
        if np.isfinite(rate[k]):
            s = np.sqrt(RATE_SIGMA_MPS**2 + ACCELERATION_DENSITY * abs(dt[k]))
            rows, values = [*rows, [0.0, 1.0 / s]], [*values, rate[k] / s]
    A = np.array(rows)
    value, slope = np.linalg.lstsq(A, np.array(values), rcond=None)[0]
    return float(value), float(slope), float(np.sqrt(np.linalg.inv(A.T @ A)[0, 0]))


@given(st.integers(0, 2**31), st.integers(1, 12))
def test_fit_is_weighted_least_squares(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    t = 1.79e9 + np.sort(rng.uniform(-8.0, 8.0, count))
    z = 9000.0 + 6.0 * (t - 1.79e9) + rng.normal(0, 5, count)
    z[rng.random(count) < 0.2] = NAN
    z[0] = 9000.0
    rate = np.where(rng.random(count) < 0.5, 6.0 + rng.normal(0, 1, count), NAN)
    sigma = rng.choice([6.0, 8.0, 30.0], count)
    centre = 1.79e9 + rng.uniform(-3.0, 3.0)

    got = fit_at(np.array([centre]), *(c[:, None] for c in (t, z, rate, sigma)))

    wanted = least_squares(centre, t, z, rate, sigma)
    assert float(got[0][0]) == pytest.approx(wanted[0], abs=1e-6)
    assert float(got[1][0]) == pytest.approx(wanted[1], abs=1e-6)
    assert float(got[2][0]) == pytest.approx(wanted[2], rel=1e-8)


@pytest.mark.parametrize("errors", [{3: 400.0}, {0: -30_000.0}, {2: 500.0, 3: 600.0, 9: -4000.0}])
def test_fit_leaves_outliers_out_and_nothing_else(errors: dict[int, float]) -> None:
    t = np.arange(-5.0, 6.0)
    z = 9000.0 + 6.0 * t + np.random.default_rng(4).normal(0, 4, 11)
    wrong, rest = z.copy(), ~np.isin(np.arange(11), list(errors))
    for k, error in errors.items():
        wrong[k] += error
    none, sigma = np.full(11, NAN), np.full(11, SIGMA_M)

    got = fit_at(np.zeros(1), t[:, None], wrong[:, None], none[:, None], sigma[:, None])

    wanted = least_squares(0.0, t[rest], z[rest], none[rest], sigma[rest])
    assert [float(g[0]) for g in got] == pytest.approx(wanted, abs=1e-6)


def test_fit_without_altitudes_says_nothing() -> None:
    t = np.arange(3.0)[:, None]

    value, rate, sigma = fit_at(np.ones(1), t, np.full((3, 1), NAN), np.full((3, 1), 5.0), np.full((3, 1), SIGMA_M))

    assert np.isnan([value[0], rate[0], sigma[0]]).all()


def test_tracks_are_fitted_side_by_side_as_alone() -> None:
    rng = np.random.default_rng(3)
    t, z = rng.uniform(0, 8, (6, 4)), rng.normal(5000, 8, (6, 4))
    rate, sigma = rng.normal(0, 1, (6, 4)), np.full((6, 4), SIGMA_M)
    z[:, 2] = NAN

    together = fit_at(np.full(4, 4.0), t, z, rate, sigma)

    for i in range(4):
        alone = fit_at(np.full(1, 4.0), t[:, [i]], z[:, [i]], rate[:, [i]], sigma[:, [i]])
        for got, wanted in zip(together, alone, strict=True):
            assert np.array_equal(got[[i]], wanted, equal_nan=True)
