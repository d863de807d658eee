"""Motion models against numerical integration, matrix exponentials and filterpy."""

import math

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise, Q_discrete_white_noise
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from aeroskein import motion

angles = st.floats(-3.1, 3.1)
states = st.tuples(
    st.floats(-1e5, 1e5),
    st.floats(-1e5, 1e5),
    st.floats(0.0, 300.0),
    st.floats(-3.0, 3.0),
    angles,
    st.floats(-0.2, 0.2),
).map(np.array)


def integrate(x: np.ndarray, dt_s: float) -> np.ndarray:
    """The model's differential equation, solved numerically."""

    def rate(_: float, s: np.ndarray) -> list[float]:
        return [s[2] * math.sin(s[4]), s[2] * math.cos(s[4]), s[3], 0.0, s[5], 0.0]

    return solve_ivp(rate, (0.0, dt_s), x, rtol=1e-12, atol=1e-9).y[:, -1]


@given(states, st.floats(0.1, 20.0))
def test_closed_transition_solves_the_differential_equation(x: np.ndarray, dt_s: float) -> None:
    moved = motion.turn_transition(x[None], np.array([dt_s]))[0]

    expected = integrate(x, dt_s)
    np.testing.assert_allclose(moved[:4], expected[:4], rtol=1e-9, atol=1e-5)
    assert math.remainder(moved[4] - expected[4], 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@given(states, st.floats(0.1, 10.0), st.floats(0.1, 10.0))
def test_two_steps_make_the_step_of_their_sum(x: np.ndarray, first_s: float, second_s: float) -> None:
    once = motion.turn_transition(x[None], np.array([first_s + second_s]))
    twice = motion.turn_transition(motion.turn_transition(x[None], np.array([first_s])), np.array([second_s]))

    np.testing.assert_allclose(once[0, :4], twice[0, :4], rtol=1e-12, atol=1e-7)


@pytest.mark.parametrize("yaw_rate", [0.0, 1e-300, 1e-12, 1e-7, -1e-7])
def test_yaw_rate_towards_zero_has_the_straight_line_as_limit(yaw_rate: float) -> None:
    x = np.array([[10.0, 20.0, 200.0, 1.0, 0.5, yaw_rate]])

    moved = motion.turn_transition(x, np.array([4.0]))[0]

    assert moved[0] == pytest.approx(10.0 + 808.0 * math.sin(0.5), abs=2e-3 * (yaw_rate != 0) + 1e-9)
    assert moved[1] == pytest.approx(20.0 + 808.0 * math.cos(0.5), abs=2e-3 * (yaw_rate != 0) + 1e-9)


def test_moments_are_continuous_where_series_and_closed_form_meet() -> None:
    below, above = motion.turn_moments(np.array([np.nextafter(1.0, 0.0), 1.0])).T

    np.testing.assert_allclose(below, above, rtol=0, atol=4e-15)


def test_yaw_stays_within_a_half_turn_either_way() -> None:
    x = np.array([[0.0, 0.0, 100.0, 0.0, 3.1, 0.1]])

    moved = motion.turn_transition(x, np.array([2.0]))[0]

    assert moved[4] == pytest.approx(3.3 - 2 * math.pi)


@pytest.mark.parametrize(("keep_a", "keep_w"), [(1, 1), (0, 1), (1, 0), (0, 0)])
def test_variants_drop_what_they_hold_at_zero(keep_a: int, keep_w: int) -> None:
    x = np.array([[0.0, 0.0, 100.0, 1.5, 0.3, 0.04]])

    moved = motion.turn_transition(x, np.array([3.0]), keep_a, keep_w)[0]

    held = np.array([0.0, 0.0, 100.0, 1.5 * keep_a, 0.3, 0.04 * keep_w])
    np.testing.assert_allclose(moved, integrate(held, 3.0), rtol=1e-9, atol=1e-9)


@given(states, st.floats(0.1, 10.0))
def test_noise_jacobian_is_the_derivative_by_acceleration_and_yaw_rate(x: np.ndarray, dt_s: float) -> None:
    dt = np.array([dt_s])
    step = 1e-5

    J = motion.turn_noise_jacobian(x[None], dt)[0]

    for column, place in enumerate((motion.ACCELERATION, motion.YAW_RATE)):
        plus, minus = x.copy(), x.copy()
        plus[place] += step
        minus[place] -= step
        change = motion.turn_transition(plus[None], dt)[0] - motion.turn_transition(minus[None], dt)[0]
        change[4] = math.remainder(change[4], 2 * math.pi)
        scale = 1.0 + np.abs(J[:, column])
        np.testing.assert_allclose(J[:, column] / scale, change / (2 * step) / scale, atol=1e-4)


def test_turn_noise_grows_with_the_length_of_the_step() -> None:
    x = np.array([[0.0, 0.0, 100.0, 0.0, 0.0, 0.0]])

    one = motion.turn_noise(x, np.array([1.0]), 0.5, 0.01)[0]
    four = motion.turn_noise(x, np.array([4.0]), 0.5, 0.01)[0]

    assert four[motion.ACCELERATION, motion.ACCELERATION] == pytest.approx(4 * one[3, 3])
    assert one[3, 3] == pytest.approx(0.25)
    assert one[5, 5] == pytest.approx(1e-4)


def test_noise_of_one_axis_is_filterpys_discrete_white_noise() -> None:
    Q = motion.axis_noise(np.array([0.7, 4.0]), 1.3)

    for k, dt in enumerate((0.7, 4.0)):
        np.testing.assert_allclose(Q[k], Q_discrete_white_noise(3, dt, 1.3**2), rtol=1e-12)


def test_white_jerk_noise_is_filterpys_continuous_white_noise() -> None:
    Q = motion.white_jerk_noise(np.array([0.7, 4.0]), np.array([0.04, 4.0]))

    for k, (dt, density) in enumerate(((0.7, 0.04), (4.0, 4.0))):
        expected = Q_continuous_white_noise(3, dt, density)
        np.testing.assert_allclose(Q[k][0::2, 0::2], expected, rtol=1e-12)
        np.testing.assert_allclose(Q[k][1::2, 1::2], expected, rtol=1e-12)
        assert not Q[k][0::2, 1::2].any()


def test_white_acceleration_noise_is_filterpys_continuous_white_noise() -> None:
    Q = motion.white_acceleration_noise(np.array([3.0]), 0.0025)[0]

    np.testing.assert_allclose(Q[0:4:2, 0:4:2], Q_continuous_white_noise(2, 3.0, 0.0025), rtol=1e-12)
    assert not Q[4:].any()


def test_acceleration_transition_is_a_matrix_exponential() -> None:
    A = np.diag(np.ones(4), 2)

    F = motion.acceleration_transition(np.array([2.5]))[0]

    np.testing.assert_allclose(F, expm(2.5 * A), rtol=1e-12)


def test_velocity_transition_makes_the_acceleration_zero() -> None:
    F = motion.velocity_transition(np.array([2.0]))[0]

    np.testing.assert_array_equal(F @ np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), [7.0, 10.0, 3.0, 4.0, 0.0, 0.0])


@given(states)
def test_velocity_jacobian_is_the_derivative_of_the_velocity(x: np.ndarray) -> None:
    J = motion.turn_velocity_jacobian(x)

    for column, place in enumerate((motion.SPEED, motion.YAW)):
        plus, minus = x.copy(), x.copy()
        plus[place] += 1e-6
        minus[place] -= 1e-6
        change = (motion.turn_velocity(plus) - motion.turn_velocity(minus)) / 2e-6
        np.testing.assert_allclose(J[:, column], change, atol=1e-6 * (1.0 + abs(x[2])))
