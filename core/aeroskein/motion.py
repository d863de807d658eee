"""Motion models: how a state moves in time and how much it may err, for many aircraft at once in plain matrices.

Two families. *Linear*, state ``[x y vx vy ax ay]``: constant velocity under white acceleration and constant
acceleration under white jerk (Bar-Shalom, Li & Kirubarajan 2001, ch. 6), and one axis alone ``[position velocity
acceleration]`` under piecewise-constant acceleration noise. *Turning*, state ``[x y speed acceleration yaw yaw_rate]``
with yaw clockwise from north in -π..π: constant turn rate and acceleration (CTRA) with its variants CTRV (acceleration
zero), CCA (yaw rate zero) and CSAV (both zero) of the published ADS-B filter.

The turning models share one closed form. With north as the real and east as the imaginary axis the step of the
position is ``exp(i yaw) (v T I0(θ) + a T² I1(θ))``, θ = yaw rate times T, where ``Im(θ) = ∫0..1 u^m exp(iθu) du``. The
moments are entire functions, so the limit of the yaw rate to zero is no case of its own.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array

__all__ = [
    "ACCELERATION",
    "SPEED",
    "YAW",
    "YAW_RATE",
    "acceleration_transition",
    "axis_noise",
    "axis_transition",
    "turn_moments",
    "turn_noise",
    "turn_noise_jacobian",
    "turn_transition",
    "turn_velocity",
    "turn_velocity_jacobian",
    "velocity_transition",
    "white_acceleration_noise",
    "white_jerk_noise",
    "wrap_yaw",
]

# Places in the turning state.
SPEED: Final = 2
ACCELERATION: Final = 3
YAW: Final = 4
YAW_RATE: Final = 5

# Up to one radian the power series is used: 20 terms reach the last bit there, while the closed forms divide a
# difference of order θ³ by θ³ and lose digits below.
_SERIES_BELOW_RAD: Final = 1.0
_SERIES_TERMS: Final = 20


def wrap_yaw(yaw_rad: Array) -> Array:
    """Bring an angle into -π <= angle < π. [rad]"""
    return np.asarray(np.mod(yaw_rad + math.pi, 2.0 * math.pi) - math.pi)


# -- linear models ----------------------------------------------------------------------------------------------------
def axis_transition(dt_s: Array) -> Array:
    """Transition of ``[position velocity acceleration]`` over ``dt_s`` ``(n,)``: ``(n, 3, 3)``."""
    F = np.zeros((*dt_s.shape, 3, 3))
    F[..., 0, 0] = F[..., 1, 1] = F[..., 2, 2] = 1.0
    F[..., 0, 1] = F[..., 1, 2] = dt_s
    F[..., 0, 2] = 0.5 * dt_s**2
    return F


def axis_noise(dt_s: Array, sigma_mps2: float) -> Array:
    """Discrete white noise in the acceleration of one axis, as the published linear filter has it.

    The acceleration changes at each step by an independent amount of standard deviation ``sigma_mps2`` and is constant
    in between.

    Parameters
    ----------
    dt_s : (n,) array
        Length of the step. [s]
    sigma_mps2 : float
        Change of the acceleration from one step to the next. [m/s²]

    Returns
    -------
    (n, 3, 3) array
        Process noise of ``[position velocity acceleration]``.
    """
    gain = np.stack([0.5 * dt_s**2, dt_s, np.ones_like(dt_s)], axis=-1)
    # Two reports of one instant are one step: without time the acceleration has not changed either.
    gain = gain * (dt_s > 0.0)[..., None]
    return np.asarray(sigma_mps2**2 * gain[..., :, None] * gain[..., None, :])


def acceleration_transition(dt_s: Array) -> Array:
    """Constant acceleration over ``dt_s`` ``(n,)`` for ``[x y vx vy ax ay]``: ``(n, 6, 6)``."""
    return _both_axes(axis_transition(dt_s))


def velocity_transition(dt_s: Array) -> Array:
    """Constant velocity over ``dt_s`` ``(n,)``; the accelerations become zero: ``(n, 6, 6)``."""
    F = axis_transition(dt_s)
    F[..., :, 2] = 0.0
    return _both_axes(F)


def white_jerk_noise(dt_s: Array, density_m2ps5: Array | float) -> Array:
    """Process noise of constant acceleration under white jerk, both axes.

    Parameters
    ----------
    dt_s : (n,) array
        Length of the step. [s]
    density_m2ps5 : float or (n,) array
        Power spectral density of the jerk, per axis. [m²/s⁵]

    Returns
    -------
    (n, 6, 6) array
        ``∫ F(s) G q G' F(s)' ds``, noise entering the acceleration.
    """
    Q = np.empty((*dt_s.shape, 3, 3))
    Q[..., 0, 0] = dt_s**5 / 20.0
    Q[..., 0, 1] = Q[..., 1, 0] = dt_s**4 / 8.0
    Q[..., 0, 2] = Q[..., 2, 0] = dt_s**3 / 6.0
    Q[..., 1, 1] = dt_s**3 / 3.0
    Q[..., 1, 2] = Q[..., 2, 1] = dt_s**2 / 2.0
    Q[..., 2, 2] = dt_s
    return _both_axes(Q * np.asarray(density_m2ps5)[..., None, None])


def white_acceleration_noise(dt_s: Array, density_m2ps3: Array | float) -> Array:
    """Process noise of constant velocity under white acceleration, both axes; none on the acceleration.

    Parameters
    ----------
    dt_s : (n,) array
        Length of the step. [s]
    density_m2ps3 : float or (n,) array
        Power spectral density of the acceleration, per axis. [m²/s³]

    Returns
    -------
    (n, 6, 6) array
        Process noise of ``[x y vx vy ax ay]``.
    """
    Q = np.zeros((*dt_s.shape, 3, 3))
    Q[..., 0, 0] = dt_s**3 / 3.0
    Q[..., 0, 1] = Q[..., 1, 0] = dt_s**2 / 2.0
    Q[..., 1, 1] = dt_s
    return _both_axes(Q * np.asarray(density_m2ps3)[..., None, None])


def _both_axes(M: Array) -> Array:
    """The same ``(n, 3, 3)`` matrix for east and north, uncoupled: ``(n, 6, 6)``."""
    full = np.zeros((*M.shape[:-2], 6, 6))
    full[..., 0::2, 0::2] = M
    full[..., 1::2, 1::2] = M
    return full


# -- turning models ---------------------------------------------------------------------------------------------------
def turn_moments(theta_rad: Array) -> NDArray[np.complex128]:
    """Moments ``∫0..1 u^m exp(iθu) du`` for m = 0, 1, 2, smooth through θ = 0.

    Parameters
    ----------
    theta_rad : (...) array
        Angle turned during the step. [rad]

    Returns
    -------
    (3, ...) complex array
        By the power series ``Σ (iθ)^k / (k! (m+k+1))`` near zero, by integration in parts elsewhere.
    """
    theta_rad = np.asarray(theta_rad, dtype=np.float64)
    near = np.where(np.abs(theta_rad) < _SERIES_BELOW_RAD, theta_rad, 0.0)
    far = np.where(np.abs(theta_rad) < _SERIES_BELOW_RAD, 1.0, theta_rad)
    series = np.zeros((3, *theta_rad.shape), dtype=np.complex128)
    for m in range(3):
        for k in reversed(range(_SERIES_TERMS)):  # Horner
            series[m] = series[m] * (1j * near) + 1.0 / (math.factorial(k) * (m + k + 1))
    turned = np.exp(1j * far)
    first = (turned - 1.0) / (1j * far)
    second = (turned - first) / (1j * far)
    closed = np.stack([first, second, (turned - 2.0 * second) / (1j * far)])
    return np.where(np.abs(theta_rad) < _SERIES_BELOW_RAD, series, closed)


def turn_transition(
    x: Array, dt_s: Array, keep_acceleration: Array | float = 1.0, keep_yaw_rate: Array | float = 1.0
) -> Array:
    """Move turning states: constant turn rate and acceleration, or one of its variants.

    Parameters
    ----------
    x : (..., 6) array
        ``[x, y, speed, acceleration, yaw, yaw rate]``. [m, m, m/s, m/s², rad, rad/s]
    dt_s : (...) array
        Length of the step. [s]
    keep_acceleration, keep_yaw_rate : float or (...) array
        1 keeps it, 0 makes it zero: (1, 1) is CTRA, (0, 1) CTRV, (1, 0) CCA, (0, 0) CSAV.

    Returns
    -------
    (..., 6) array
        States after the step, yaw in -π..π.
    """
    speed, yaw = x[..., SPEED], x[..., YAW]
    acceleration = x[..., ACCELERATION] * keep_acceleration
    yaw_rate = x[..., YAW_RATE] * keep_yaw_rate
    m0, m1, _ = turn_moments(yaw_rate * dt_s)
    step = np.exp(1j * yaw) * (speed * dt_s * m0 + acceleration * dt_s**2 * m1)
    return np.stack(
        [
            x[..., 0] + step.imag,
            x[..., 1] + step.real,
            speed + acceleration * dt_s,
            acceleration,
            wrap_yaw(yaw + yaw_rate * dt_s),
            yaw_rate,
        ],
        axis=-1,
    )


def turn_noise_jacobian(
    x: Array, dt_s: Array, keep_acceleration: Array | float = 1.0, keep_yaw_rate: Array | float = 1.0
) -> Array:
    """Derivative of ``turn_transition`` by acceleration and yaw rate: ``(..., 6, 2)``.

    For the variants it is taken at the point they move along (acceleration or yaw rate zero), where the noise enters.
    """
    speed, yaw = x[..., SPEED], x[..., YAW]
    acceleration = x[..., ACCELERATION] * keep_acceleration
    yaw_rate = x[..., YAW_RATE] * keep_yaw_rate
    _, m1, m2 = turn_moments(yaw_rate * dt_s)
    heading = np.exp(1j * yaw)
    by_acceleration = heading * dt_s**2 * m1
    by_yaw_rate = heading * 1j * (speed * dt_s**2 * m1 + acceleration * dt_s**3 * m2)
    J = np.zeros((*x.shape[:-1], 6, 2))
    J[..., 0, 0], J[..., 1, 0] = by_acceleration.imag, by_acceleration.real
    J[..., 0, 1], J[..., 1, 1] = by_yaw_rate.imag, by_yaw_rate.real
    J[..., SPEED, 0] = J[..., YAW, 1] = dt_s
    J[..., ACCELERATION, 0] = J[..., YAW_RATE, 1] = 1.0
    return J


def turn_noise(
    x: Array,
    dt_s: Array,
    sigma_mps2: Array | float,
    sigma_radps: Array | float,
    keep_acceleration: Array | float = 1.0,
    keep_yaw_rate: Array | float = 1.0,
) -> Array:
    """Process noise of the turning models, through the Jacobian as in an extended Kalman filter.

    Parameters
    ----------
    x : (n, 6) array
        States before the step.
    dt_s : (n,) array
        Length of the step. [s]
    sigma_mps2, sigma_radps : float or (n,) array
        By how much acceleration and yaw rate may change within one second; the variance grows with the length of the
        step, so that a missing report does not change the model. [m/s², rad/s]
    keep_acceleration, keep_yaw_rate : float or (n,) array
        Variant, as in ``turn_transition``.

    Returns
    -------
    (n, 6, 6) array
        ``J diag(σa², σw²) J' dt``.
    """
    J = turn_noise_jacobian(x, dt_s, keep_acceleration, keep_yaw_rate)
    sigma = np.broadcast_arrays(np.asarray(sigma_mps2, dtype=np.float64), sigma_radps, dt_s)[:2]
    scaled = J * (np.stack(sigma, axis=-1) * np.sqrt(dt_s)[..., None])[..., None, :]
    return np.asarray(scaled @ np.swapaxes(scaled, -1, -2))


def turn_velocity(x: Array) -> Array:
    """East and north velocity of turning states ``(..., 6)``: ``(..., 2)``. [m/s]"""
    return np.stack([x[..., SPEED] * np.sin(x[..., YAW]), x[..., SPEED] * np.cos(x[..., YAW])], axis=-1)


def turn_velocity_jacobian(x: Array) -> Array:
    """Derivative of ``turn_velocity`` by speed and yaw: ``(..., 2, 2)``."""
    sin, cos = np.sin(x[..., YAW]), np.cos(x[..., YAW])
    first = np.stack([sin, x[..., SPEED] * cos], axis=-1)
    return np.stack([first, np.stack([cos, -x[..., SPEED] * sin], axis=-1)], axis=-2)
