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

from aeroskein import kalman
from aeroskein.plots import Array, Ints

__all__ = ["Turned", "circle", "keep_speed", "predict"]

# Slower, a direction of flight is noise: an aircraft may then accelerate any way. [m/s]
SLOWEST_MPS: Final = 30.0
# Turn rates are taken for at least this speed, and no higher than this, twice a standard-rate turn. [m/s], [rad/s]
TURN_SPEED_MIN_MPS: Final = 60.0
TURN_RATE_MAX_RADPS: Final = 0.12
# What is even in the angle is taken no nearer to zero than here: that leaves out less than a part in 10¹¹. [rad]
SMALL_ANGLE_RAD: Final = 1e-5
# Below this the first terms of the series serve: what they leave out is a part in a thousand million. [rad]
SMALL_TURN_RAD: Final = 1e-4
# Angles below leave covariances as they are: half a percent of an error is moved beside itself. [rad]
LEAST_TURN_RAD: Final = 0.005
# An update that turns the velocity by more than the first, but not beyond belief, turns what is tied to it. [rad]
LEAST_UPDATE_RAD: Final = 0.02
MOST_UPDATE_RAD: Final = 1.0


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
    part = P.take(lanes, axis=1)  # its rows are contiguous, as the blocks need
    _, p12, p13, p22, p23, p33 = kalman.blocks(part)
    p13[:] = _right(p13, cos, sin)
    p23[:] = _right(p23, cos, sin)
    p33[:] = _right(_left(p33, cos, sin), cos, sin)
    if velocity:
        p12[:] = _right(p12, cos, sin)
        p23[:] = _left(p23, cos, sin)
        p22[:] = _right(_left(p22, cos, sin), cos, sin)
        p22[1, 0] = p22[0, 1]
    p33[1, 0] = p33[0, 1]
    P[:, lanes] = part


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
    angle = w * h
    cos, sin = np.cos(angle), np.sin(angle)
    half_sin, half_cos = np.sin(0.5 * angle), np.cos(0.5 * angle)
    small = np.abs(angle) < SMALL_TURN_RAD
    rate = np.where(small, 1.0, w)
    less = 2.0 * half_sin * half_sin
    # The integral of the turn over the step, and its derivative by the rate: of the unit matrix and of a quarter turn.
    same, left = np.where(small, h, sin / rate), np.where(small, 0.5 * angle * h, less / rate)
    same_by_w = np.where(small, -angle * h * h / 3.0, (h * cos - same) / rate)
    left_by_w = np.where(small, 0.5 * h * h, (h * sin - left) / rate)
    by_w = _turn(x[2:4], same_by_w, left_by_w)
    x[0:2] += _turn(x[2:4], same, left)
    x[2:4] = _turn(x[2:4], cos, sin)
    quarter = np.stack([-x[3], x[2]])
    x[4:6] = w * quarter
    _circle_errors(P, gradient, (same, left), (cos, sin), (by_w, h * quarter), w, quarter)
    # Noise across the middle of the step.
    middle = _turn(x[2:4], half_cos, -half_sin)
    kalman.add_jerk_noise(P, h, _jerk_density(middle, np.zeros(len(h)), across * h))


def _circle_errors(
    P: Array,
    gradient: tuple[Array, Array],
    integral: tuple[Array, Array],
    turn: tuple[Array, Array],
    by_w: tuple[Array, Array],
    w: Array,
    quarter: Array,
) -> None:
    """Errors after a step on a circle, in place: from position p, velocity v and turn rate w to p + S v, R v and w J v.

    ``gradient`` is that of w by v and the acceleration, ``integral`` S, ``turn`` R, ``by_w`` the derivatives of the new
    position and velocity by w, ``quarter`` the new J v.
    """
    by_v, by_a = gradient
    dp, dv = by_w
    p11, p12, p13, p22, p23, p33 = kalman.blocks(P)
    # Covariances of the rate with position, velocity, itself.
    wp = _times(p12, by_v) + _times(p13, by_a)
    wv = _times(p22, by_v) + _times(p23, by_a)
    wa = _times(p23.swapaxes(0, 1), by_v) + _times(p33, by_a)
    ww = (by_v * wv).sum(axis=0) + (by_a * wa).sum(axis=0)
    pv = p12 + _left(p22, *integral) + dp[:, None] * wv
    pw = wp + _turn(wv, *integral) + dp * ww
    p11 += _left(p12.swapaxes(0, 1), *integral) + dp[:, None] * wp + _right(pv, *integral) + pw[:, None] * dp
    turned = _turn(wv, *turn)
    vw = turned + dv * ww
    p12[:] = _right(pv, *turn) + pw[:, None] * dv
    p22[:] = _right(_left(p22, *turn), *turn) + turned[:, None] * dv + dv[:, None] * vw
    p11[1, 0], p22[1, 0] = p11[0, 1], p22[0, 1]
    p13[:] = _right(p12, 0.0, w) + pw[:, None] * quarter
    p23[:] = _right(p22, 0.0, w) + vw[:, None] * quarter
    p33[:] = _left(p23, 0.0, w) + quarter[:, None] * (_turn(vw, 0.0, w) + ww * quarter)
    p33[1, 0] = p33[0, 1]


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


def _left(M: Array, same: Array | float, left: Array | float) -> Array:
    """The same from the left on matrices ``(2, 2, n)``."""
    return _turn(M, same, left)


def _right(M: Array, same: Array | float, left: Array | float) -> Array:
    """From the right, transposed."""
    return np.stack([same * M[:, 0] - left * M[:, 1], left * M[:, 0] + same * M[:, 1]], axis=1)


def _times(M: Array, v: Array) -> Array:
    """Matrices ``(2, 2, n)`` times vectors ``(2, n)``."""
    product: Array = M[:, 0] * v[0]
    product += M[:, 1] * v[1]
    return product


def _rate_gradient(x: Array, rate: Array) -> tuple[Array, Array]:
    """Derivative of the turn rate by velocity and acceleration ``(2, n)``, zero where it is at its limit."""
    square = x[2] * x[2] + x[3] * x[3]
    slow = square < TURN_SPEED_MIN_MPS**2
    free = (np.abs(rate) < TURN_RATE_MAX_RADPS) / np.maximum(square, TURN_SPEED_MIN_MPS**2)
    longer = 2.0 * rate * ~slow
    by_v = np.stack([x[5] - longer * x[2], -x[4] - longer * x[3]])
    return by_v * free, np.stack([-x[3], x[2]]) * free


def _turn_rate(x: Array) -> Array:
    """Turn rate, counter-clockwise. [rad/s]"""
    square = np.maximum(x[2] * x[2] + x[3] * x[3], TURN_SPEED_MIN_MPS**2)
    rate = (x[2] * x[5] - x[3] * x[4]) / square
    return np.asarray(np.clip(rate, -TURN_RATE_MAX_RADPS, TURN_RATE_MAX_RADPS))
