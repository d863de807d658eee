"""Coordinated turns on the six-component state: what a turn does to an acceleration, and where its noise lies.

A constant acceleration in a fixed direction is no turn: in a turn it keeps its direction *relative to the flight*. With
the turn rate w = (v x a) / v² of the state itself the mean is moved as a(t) = R(w t) a, whose integrals are closed
forms, so that a flight that nobody sees for half a minute stays on its circle; the covariance is that of constant
acceleration. And pilots and autopilots change the acceleration across the
flight (bank) much faster than along it (thrust), so white jerk has two densities. Both together are the constant turn
rate and acceleration model in linear form: one predict serves turns and straight flight, and smoothing stays exact.
State and covariance rows are those of ``kalman``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import kalman
from aeroskein.plots import Array, Bools

__all__ = ["keep_across", "predict"]

# Slower, a direction of flight is noise: an aircraft may then accelerate any way. [m/s]
SLOWEST_MPS: Final = 30.0
# Turn rates are taken for at least this speed, and no higher than this, twice a standard-rate turn. [m/s], [rad/s]
TURN_SPEED_MIN_MPS: Final = 60.0
TURN_RATE_MAX_RADPS: Final = 0.12
# Below this the first terms of the series serve: what they leave out is a part in a thousand million. [rad]
SMALL_ANGLE_RAD: Final = 1e-4

# The rows of an acceleration east and north beside the same other component.
_ACCELERATION_PAIRS: Final = ((4, 5), (10, 11), (14, 15), (18, 19))


def predict(x: Array, P: Array, h: Array, along: Array, across: Array) -> None:
    """Move states by ``h`` in a turn at constant rate and acceleration with white jerk, in place.

    Parameters
    ----------
    x, P : (6, ..., n), (24, ..., n) arrays
        States and covariances in block-upper rows.
    h : (n,) array
        Time steps; zero leaves a lane as it is. [s]
    along, across : (..., n) arrays
        Power spectral density of the jerk along and across the flight; their mean either way where there is no
        direction. [m²/s⁵]
    """
    ee, en, nn = _across_squares(x)
    turned = _turned(x, h)
    kalman.predict(x, P, h, along)
    x += turned
    more = (across - along) * h
    noise = np.empty((2, 2, *more.shape))
    np.multiply(more, ee, out=noise[0, 0])
    np.multiply(more, en, out=noise[0, 1])
    noise[1, 0] = noise[0, 1]
    np.multiply(more, nn, out=noise[1, 1])
    h2 = h * h
    product = np.empty_like(noise)
    weights = (h2 * h2 / 20.0, h2 * h / 8.0, h2 / 6.0, h2 / 3.0, 0.5 * h)
    *blocks, of_acceleration = kalman.blocks(P)
    for block, weight in zip(blocks, weights, strict=True):
        block += np.multiply(weight, noise, out=product)
    of_acceleration += noise


def keep_across(x: Array, P: Array, where: Bools) -> None:
    """Take out of states ``(6, n)`` and covariances ``(24, n)`` all acceleration along the flight, in place.

    Lanes that are not in ``where`` ``(n,)`` keep theirs.
    """
    # I - f f' with f along the flight, and the unit matrix where nothing is to be done.
    e, n = _across(x)
    ee, en, nn = np.where(where, e * e, 1.0), np.where(where, e * n, 0.0), np.where(where, n * n, 1.0)
    x[4], x[5] = ee * x[4] + en * x[5], en * x[4] + nn * x[5]
    for i, j in _ACCELERATION_PAIRS:
        P[i], P[j] = ee * P[i] + en * P[j], en * P[i] + nn * P[j]
    across_e, across_n = ee * P[20] + en * P[21], ee * P[21] + en * P[23]
    beside_n = en * P[21] + nn * P[23]
    P[20], P[23] = across_e * ee + across_n * en, (en * P[20] + nn * P[21]) * en + beside_n * nn
    P[21] = P[22] = across_e * en + across_n * nn


def _turned(x: Array, h: Array) -> Array:
    """What the turning of the acceleration adds to a step of constant acceleration, ``(6, ..., n)``.

    With J a quarter turn: R - I, its integral over the step, and the integral of that.
    """
    rate = _turn_rate(x)
    angle = rate * h
    small = np.abs(angle) < SMALL_ANGLE_RAD
    w = np.where(small, 1.0, rate)
    sin, less = np.sin(angle), 2.0 * np.sin(0.5 * angle) ** 2
    half = 0.5 * h * h
    parts = (
        (np.where(small, 0.0, less / w**2 - half), np.where(small, angle * half / 3.0, (angle - sin) / w**2)),
        (np.where(small, 0.0, sin / w - h), np.where(small, angle * 0.5 * h, less / w)),
        (-less, sin),
    )
    ae, an = x[4], x[5]
    return np.stack([row for same, turned in parts for row in (same * ae - turned * an, same * an + turned * ae)])


def _across(x: Array) -> tuple[Array, Array]:
    """Unit vector to the left of the flight; zero where there is no direction."""
    speed = np.hypot(x[2], x[3])
    one = (speed >= SLOWEST_MPS) / np.maximum(speed, SLOWEST_MPS)
    return -x[3] * one, x[2] * one


def _across_squares(x: Array) -> tuple[Array, Array, Array]:
    """Products ee, en, nn of the unit vector across; half the unit matrix where there is no direction."""
    e, n = _across(x)
    ee, nn = e * e, n * n
    aimless = 0.5 * (1.0 - ee - nn)
    return ee + aimless, e * n, nn + aimless


def _turn_rate(x: Array) -> Array:
    """Turn rate, counter-clockwise. [rad/s]"""
    square = np.maximum(x[2] * x[2] + x[3] * x[3], TURN_SPEED_MIN_MPS**2)
    rate = (x[2] * x[5] - x[3] * x[4]) / square
    return np.asarray(np.clip(rate, -TURN_RATE_MAX_RADPS, TURN_RATE_MAX_RADPS))
