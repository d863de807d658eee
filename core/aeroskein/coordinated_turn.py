"""Coordinated turns on the six-component state: what a turn does to an acceleration, and where its noise lies.

A constant acceleration in a fixed direction is no turn: in a turn it keeps its direction *relative to the flight*. With
the turn rate w = (v x a) / v² of the state itself the mean is moved as a(t) = R(w t) a, whose integrals are closed
forms, so that a flight that nobody sees for half a minute stays on its circle; what is not known of the acceleration
turns with it. And pilots and autopilots change the acceleration across the flight (bank) much faster than along it
(thrust), so white jerk has two densities. ``predict`` is that, the constant turn rate and acceleration model in linear
form: it serves turns and straight flight, and smoothing stays exact. ``circle`` is the turn at constant speed alone,
where the acceleration is w times the velocity turned left, and so are their errors. State and covariance rows are those
of ``kalman``.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aeroskein import kalman
from aeroskein.plots import Array, Ints

__all__ = ["Turned", "add_jerk", "circle", "keep_speed", "predict"]

# Slower, a direction of flight is noise: an aircraft may then accelerate any way. [m/s]
SLOWEST_MPS: Final = 30.0
# Turn rates are taken for at least this speed, and no higher than this, twice a standard-rate turn. [m/s], [rad/s]
TURN_SPEED_MIN_MPS: Final = 60.0
TURN_RATE_MAX_RADPS: Final = 0.12
# What is even in the angle is taken no nearer to zero than here: that leaves out less than a part in 10¹¹. [rad]
SMALL_ANGLE_RAD: Final = 1e-5
# Angles below leave covariances as they are: half a percent of an error is moved beside itself. [rad]
LEAST_TURN_RAD: Final = 0.005
# An update that turns the velocity by more than the first, but not beyond belief, turns what is tied to it. [rad]
LEAST_UPDATE_RAD: Final = 0.02
MOST_UPDATE_RAD: Final = 1.0

Complex = NDArray[np.complex128]

# Rows of the acceleration beside position and velocity, where it turns alone; of velocity and acceleration beside the
# position, where both turn; and the blocks of those.
_TURNING_ALONE: Final = (np.array([[4], [10], [14], [18]]), np.array([[5], [11], [15], [19]]))
_TURNING_WITH_VELOCITY: Final = (np.array([[2], [8], [4], [10]]), np.array([[3], [9], [5], [11]]))
_BOTH_TURN: Final = np.array([[20, 12, 14], [21, 13, 15], [22, 16, 18], [23, 17, 19]])


class Turned(NamedTuple):
    """Lanes whose acceleration was turned in a step ``(k,)``, with cosine and sine of their angles ``(k,)``."""

    lanes: Ints
    cos: Array
    sin: Array


def predict(x: Array, P: Array, h: Array, along: Array, across: Array) -> Turned:
    """Move states by ``h`` in a turn at constant rate and acceleration with white jerk, in place.

    Parameters
    ----------
    x, P : (6, n), (24, n) arrays
        States and covariances in block-upper rows.
    h : (n,) array
        Time steps; zero leaves a lane as it is. [s]
    along, across : (n,) arrays
        Power spectral density of the jerk along and across the flight; their mean either way where there is no
        direction. [m²/s⁵]

    Returns
    -------
    Turned
        What the way back through the step must know: it was one of constant acceleration, then a turn of that.
    """
    density = _jerk_density(x[2:4], along * h, across * h)
    angle = _turn_rate(x) * h
    _move(x, h, angle)
    kalman.move_covariance(P, h)
    lanes = np.flatnonzero(np.abs(angle) > LEAST_TURN_RAD)
    back = Turned(lanes, np.cos(angle[lanes]), np.sin(angle[lanes]))
    if len(lanes):
        _turn_errors(P, back, velocity=False)
    kalman.add_jerk_noise(P, h, density)
    return back


def _jerk_density(velocity: Array, along: Array, across: Array | float) -> Array:
    """Densities along and across the flight turned into the plane, ``(2, 2, n)``; their mean where it has no direction.

    ``velocity`` is ``(2, n)``. [m/s]
    """
    squares = velocity * velocity
    square = squares[0] + squares[1]
    more = across - along
    share = np.where(square >= SLOWEST_MPS**2, more, 0.0)
    share /= np.maximum(square, SLOWEST_MPS**2)
    # All of ``more`` less what has a direction is shared out evenly.
    even = 0.5 * (more - share * square)
    even += along
    density = np.empty((2, 2, *even.shape))
    diagonal = density.reshape(4, *even.shape)[0:4:3]
    np.multiply(share, squares[::-1], out=diagonal)
    diagonal += even
    share *= velocity[0]
    share *= velocity[1]
    np.negative(share, out=density[0, 1])
    np.negative(share, out=density[1, 0])
    return density


def add_jerk(P: Array, velocity: Array, h: Array, *, along: Array | float = 0.0, across: Array | float = 0.0) -> None:
    """Add white jerk over ``h`` ``(n,)`` [s] along and across velocities ``(2, n)`` [m/s], in place. [m²/s⁵]"""
    kalman.add_jerk_noise(P, h, _jerk_density(velocity, along * h, across * h))


def _move(x: Array, h: Array, angle: Array) -> None:
    """Move the states ``(6, n)`` themselves, in place; ``angle`` is what they turn by. [rad]

    With J a quarter turn the acceleration becomes R a = (cos + J sin) a; velocity and position take its integral, and
    the integral of that. All three are even functions of the angle times powers of time and angle.
    """
    # Even functions change nowhere less than here: at the smallest angle they have their value at zero.
    size = np.maximum(np.abs(angle), SMALL_ANGLE_RAD)
    half = 0.5 * size
    u = np.sin(half)
    u /= half
    sinc = u * np.cos(half)
    versed = u * u
    versed *= 0.5  # (1 - cos) / angle²
    rest = (1.0 - sinc) / (size * size)  # (angle - sin) / angle³
    tilted = angle * versed
    same, turned = np.empty((3, 1, *angle.shape)), np.empty((3, 1, *angle.shape))
    h2 = h * h
    np.multiply(h2, versed, out=same[0, 0])
    np.multiply(h, sinc, out=same[1, 0])
    np.multiply(angle, tilted, out=same[2, 0])
    np.negative(same[2, 0], out=same[2, 0])
    np.multiply(angle * rest, h2, out=turned[0, 0])
    np.multiply(h, tilted, out=turned[1, 0])
    np.multiply(angle, sinc, out=turned[2, 0])
    change = same * x[4:6]
    turned = turned * x[4:6]
    change[:, 0] -= turned[:, 1]
    change[:, 1] += turned[:, 0]
    x[0:2] += h * x[2:4]
    x += change.reshape(6, *angle.shape)


def _turn_errors(P: Array, turned: Turned, *, velocity: bool) -> None:
    """Turn the errors of the acceleration, and of the ``velocity``, of some lanes by an angle."""
    lanes, cos, sin = turned
    turn = cos + 1j * sin
    # Moments of what turns with what does not: east and north beside the same other component.
    of_east, of_north = _TURNING_WITH_VELOCITY if velocity else _TURNING_ALONE
    z = P[of_east, lanes] + 1j * P[of_north, lanes]
    z *= turn
    P[of_east, lanes], P[of_north, lanes] = z.real, z.imag
    # Where both turn, E[x conj(y)] stays and E[x y] turns twice.
    blocks = _BOTH_TURN if velocity else _BOTH_TURN[:, :1]
    e_e, e_n, n_e, n_n = P[blocks[..., None], lanes]
    R = (e_e - n_n) + 1j * (n_e + e_n)
    R *= 0.5 * turn * turn
    even, odd = 0.5 * (e_e + n_n), 0.5 * (n_e - e_n)
    P[blocks[..., None], lanes] = even + R.real, R.imag - odd, R.imag + odd, even - R.real


def circle(x: Array, P: Array, h: Array, across: Array | float) -> None:
    """Move states by ``h`` along circles at constant speed, white jerk across, in place.

    The state is taken for position, velocity and turn rate: what acceleration it has along the flight is left behind.
    Mean and Jacobian are those of the coordinated turn with unknown rate (Bar-Shalom, Li & Kirubarajan 2001, 11.7).

    Parameters
    ----------
    x, P : (6, n), (24, n) arrays
        States and covariances in block-upper rows.
    h : (n,) array
        Time steps; zero leaves a lane as it is. [s]
    across : (n,) array or float
        Power spectral density of the jerk across the flight. [m²/s⁵]
    """
    lanes = np.flatnonzero(h > 0.0)
    if len(lanes) < len(h):
        moved_x, moved_P = x.take(lanes, axis=1), P.take(lanes, axis=1)
        circle(moved_x, moved_P, h[lanes], across if isinstance(across, float) else across[lanes])
        x[:, lanes], P[:, lanes] = moved_x, moved_P
        return
    w = _turn_rate(x)
    gradient = _rate_gradient(x, w)
    # A step on a circle is its chord: half the turn, and the sine of that over it.
    half_angle = 0.5 * w * h
    size = np.maximum(np.abs(half_angle), SMALL_ANGLE_RAD)
    half = np.empty(len(h), dtype=np.complex128)
    np.cos(half_angle, out=half.real)
    np.sin(half_angle, out=half.imag)
    u = np.sin(size)
    u /= size
    by_angle = half_angle * (np.cos(size) - u) / (2.0 * size * size)
    v = np.empty(len(h), dtype=np.complex128)
    v.real, v.imag = x[2], x[3]
    # Integral of the turn over the step, the turn, i w times that: what is to become of the velocity. And the same's
    # derivatives by the rate, times the velocity.
    turned, by_rate = np.empty((3, len(h)), dtype=np.complex128), np.empty((3, len(h)), dtype=np.complex128)
    np.multiply(h * u, half, out=turned[0])
    np.multiply(half, half, out=turned[1])
    left = 1j * w
    np.multiply(left, turned[1], out=turned[2])
    by_rate[0] = h * h * (by_angle + 0.5j * u) * half * v
    new_v = turned[1] * v
    quarter = 1j * new_v
    np.multiply(h, quarter, out=by_rate[1])
    by_rate[2] = left * by_rate[1] + quarter
    moved = turned[0] * v
    x[0] += moved.real
    x[1] += moved.imag
    x[2], x[3] = new_v.real, new_v.imag
    np.multiply(w, quarter.real, out=x[4])
    np.multiply(w, quarter.imag, out=x[5])
    _circle_errors(P, _parts(turned), _parts(by_rate), gradient)
    # Noise across the middle of the step.
    add_jerk(P, _parts((half * v)[None]), h, across=across)


def _parts(z: Complex) -> Array:
    """East and north of complex rows ``(k, n)``, one after the other: ``(2k, n)``."""
    parts = np.empty((len(z), 2, z.shape[1]))
    parts[:, 0], parts[:, 1] = z.real, z.imag
    return parts.reshape(2 * len(z), z.shape[1])


def _circle_errors(P: Array, turned: Array, by_rate: Array, gradient: Array) -> None:
    """Errors after a step on a circle, in place; those of position, velocity and acceleration from the last two before.

    ``turned`` and ``by_rate`` ``(6, n)`` say what an error of the velocity to the east, and of the turn rate, becomes;
    one to the north becomes the same, a quarter turn to the left. ``gradient (4, n)`` is that of the turn rate.
    """
    M = by_rate[:, None] * gradient
    M[:, 0] += turned
    M[0::2, 1] -= turned[1::2]
    M[1::2, 1] += turned[0::2]
    r1, r2, r3 = kalman.block_rows(P)
    before = np.empty((4, 4, P.shape[-1]))
    before[0:2], before[2:4, 2:4] = r2, r3
    before[2:4, 0:2] = r2[:, 2:4].swapaxes(0, 1)
    with_position = r1[:, 2:6].copy()
    half = np.einsum("ikn,kjn->ijn", M, before)
    half[0:2] += with_position
    r1[:, 0:2] += np.einsum("ikn,jkn->ijn", M[0:2], with_position)
    r1[:, 0:2] += np.einsum("ikn,jkn->ijn", half[0:2], M[0:2])
    np.einsum("ikn,jkn->ijn", half[0:2], M[2:6], out=r1[:, 2:6])
    np.einsum("ikn,jkn->ijn", half[2:4], M[2:6], out=r2)
    np.einsum("ikn,jkn->ijn", half[4:6], M[4:6], out=r3)
    # Symmetric to the last bit.
    P[6], P[16], P[22] = P[1], P[13], P[21]


def keep_speed(x: Array, P: Array, before: Array) -> None:
    """Let updates turn velocities where they moved them across, in place: a turn is no gain of speed.

    A gain moves a velocity along a straight line, and a large change across makes it longer. Speed and direction are
    what was estimated: the direction changes by the step across over the speed, and what is tied to the flight, the
    acceleration and the errors of both, turns with it. Small steps are left alone.

    Parameters
    ----------
    x, P : (6, n), (24, n) arrays
        States and covariances after the update.
    before : (2, n) array
        Velocities before it. [m/s]
    """
    speed = np.hypot(before[0], before[1])
    fast = np.maximum(speed, TURN_SPEED_MIN_MPS)
    across = before[0] * x[3] - before[1] * x[2]  # the step along drops out
    angle = np.abs(across) / fast**2
    lanes = np.flatnonzero((angle > LEAST_UPDATE_RAD) & (angle < MOST_UPDATE_RAD) & (speed >= TURN_SPEED_MIN_MPS))
    if not len(lanes):
        return
    speed, forward = speed[lanes], before[:, lanes] / speed[lanes]
    by = across[lanes] / speed**2
    turned = Turned(lanes, np.cos(by), np.sin(by))
    reached = forward[0] * x[2, lanes] + forward[1] * x[3, lanes]
    x[2:4, lanes] = reached * _turn(forward, turned.cos, turned.sin)
    x[4:6, lanes] = _turn(x[4:6, lanes], turned.cos, turned.sin)
    _turn_errors(P, turned, velocity=True)


def _turn(v: Array, same: Array | float, left: Array | float) -> Array:
    """``same`` times vectors ``(2, n)`` and ``left`` times their quarter turn."""
    return np.stack([same * v[0] - left * v[1], left * v[0] + same * v[1]])


def _rate_gradient(x: Array, rate: Array) -> Array:
    """Derivative of the turn rate by velocity and acceleration, ``(4, n)``; zero where the rate is at its limit."""
    square = x[2] * x[2] + x[3] * x[3]
    slow = square < TURN_SPEED_MIN_MPS**2
    gradient = np.empty((4, x.shape[-1]))
    gradient[0], gradient[3] = x[5], x[2]
    np.negative(x[4], out=gradient[1])
    np.negative(x[3], out=gradient[2])
    gradient[:2] -= 2.0 * rate * ~slow * x[2:4]
    gradient *= (np.abs(rate) < TURN_RATE_MAX_RADPS) / np.maximum(square, TURN_SPEED_MIN_MPS**2)
    return gradient


def _turn_rate(x: Array) -> Array:
    """Turn rate, counter-clockwise. [rad/s]"""
    square = np.maximum(x[2] * x[2] + x[3] * x[3], TURN_SPEED_MIN_MPS**2)
    rate: Array = (x[2] * x[5] - x[3] * x[4]) / square
    np.maximum(rate, -TURN_RATE_MAX_RADPS, out=rate)
    return np.minimum(rate, TURN_RATE_MAX_RADPS, out=rate)
