"""Textbook Kalman and IMM algebra with full matrices, one aircraft at a time: what the block kernels must agree with.

Written from Bar-Shalom, Li & Kirubarajan (2001), without a line of the product; process noise comes from filterpy.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from filterpy.common import Q_continuous_white_noise
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]
I2, I6 = np.eye(2), np.eye(6)
POSITION, VELOCITY = np.eye(2, 6), np.eye(2, 6, 2)


def transition(h: float) -> Array:
    """Constant acceleration in east and north, state ``[px py vx vy ax ay]``."""
    return np.kron(np.array([[1.0, h, h * h / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]]), I2)


def jerk_noise(h: float, q: float) -> Array:
    """White jerk of density q on both axes."""
    axis = Q_continuous_white_noise(dim=3, dt=h, spectral_density=q)
    return np.asarray(np.kron(axis, I2))


# Shares of the density of jerk along and across the flight.
ALONG, ACROSS = 0.25, 2.5


QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


def turn_rate(x: Array) -> float:
    """Turn rate of a state, counter-clockwise. [rad/s]"""
    return float(np.clip((x[2] * x[5] - x[3] * x[4]) / max(np.hypot(x[2], x[3]), 60.0) ** 2, -0.12, 0.12))


def turning(x: Array, h: float) -> Array:
    """How errors move in a step: as under constant acceleration, and that of the acceleration turns with the flight."""
    return np.asarray(turn_of_acceleration(x, h) @ transition(h))


def turn_of_acceleration(x: Array, h: float) -> Array:
    """By the angle of a step, where that is more than 0.005."""
    angle, turn = turn_rate(x) * h, np.eye(6)
    if abs(angle) > 0.005:
        turn[4:, 4:] = expm(angle * QUARTER)
    return turn


def circle(x: Array, h: float) -> Array:
    """A step at constant speed and turn rate."""
    rate = turn_rate(x)
    generator = np.block([[np.zeros((2, 2)), I2], [np.zeros((2, 2)), rate * QUARTER]])
    moved = expm(h * generator) @ x[:4]
    return np.concatenate([moved, rate * QUARTER @ moved[2:]])


def coordinated_turn(x: Array, P: Array, h: float, along: float, across: float) -> tuple[Array, Array]:
    """One step in a turn: the acceleration turns with the flight, and there is more jerk across than along."""
    v = x[2:4]
    rate = turn_rate(x)
    generator = np.kron(np.eye(3, k=1), I2)
    generator[4:, 4:] = rate * QUARTER
    F = turning(x, h)
    return expm(h * generator) @ x, F @ P @ F.T + noise_of_flight(v, h, along, across)


def noise_of_flight(v: Array, h: float, along: float, across: float) -> Array:
    """White jerk with two densities, along and across a velocity."""
    speed = float(np.hypot(*v))
    forward_en = v / speed if speed >= 30.0 else np.zeros(2)
    flight = np.outer(forward_en, forward_en) if speed >= 30.0 else 0.5 * I2
    density = along * flight + across * (I2 - flight)
    return np.asarray(np.kron(Q_continuous_white_noise(dim=3, dt=h, spectral_density=1.0), density))


def random_covariance(rng: np.random.Generator, n: int) -> Array:
    """``(n, 6, 6)`` covariances with the sizes that occur: tens of metres, metres a second, tenths of m/s²."""
    scale = np.repeat([40.0, 5.0, 0.5], 2)
    root = rng.standard_normal((n, 6, 6)) * scale[:, None]
    P = root @ root.transpose(0, 2, 1) + np.diag(0.1 * scale**2)
    return np.asarray(0.5 * (P + P.transpose(0, 2, 1)))


def random_r(rng: np.random.Generator, n: int) -> Array:
    """``(n, 2, 2)`` measurement covariances of 5 to 100 m, turned any way."""
    root = rng.standard_normal((n, 2, 2)) * rng.uniform(5.0, 100.0, (n, 1, 1))
    return np.asarray(root @ root.transpose(0, 2, 1) + 4.0 * I2)


class Updated(NamedTuple):
    """A state after an update, with the squared statistical distance and the determinant of the innovation."""

    x: Array
    P: Array
    d2: float
    det: float


def update(x: Array, P: Array, z: Array, R: Array, H: Array) -> Updated:
    """Joseph's form."""
    S = H @ P @ H.T + R
    n = z - H @ x
    K = np.linalg.solve(S, H @ P).T
    A = I6 - K @ H
    return Updated(x + K @ n, A @ P @ A.T + K @ R @ K.T, float(n @ np.linalg.solve(S, n)), float(np.linalg.det(S)))


class Event(NamedTuple):
    """A time step and what is measured at its end, if anything is."""

    h: float
    q: float
    position: tuple[Array, Array] | None = None
    velocity: tuple[Array, Array] | None = None


class Passed(NamedTuple):
    """What the forward pass keeps for one event."""

    prior_x: Array
    prior_P: Array  # noqa: N815
    x: Array
    P: Array


def forward(x: Array, P: Array, events: list[Event]) -> list[Passed]:
    """Kalman filter over the events."""
    passed = []
    for event in events:
        x, P = coordinated_turn(x, P, event.h, ALONG * event.q, ACROSS * event.q)
        prior = x, P
        if event.position is not None:
            x, P, _, _ = update(x, P, *event.position, POSITION)
        if event.velocity is not None:
            x, P, _, _ = update(x, P, *event.velocity, VELOCITY)
        passed.append(Passed(*prior, x, P))
    return passed


def rauch_tung_striebel(passed: list[Passed], events: list[Event]) -> list[tuple[Array, Array]]:
    """Smoothed states after each event."""
    x, P = passed[-1].x, passed[-1].P
    smoothed = [(x, P)]
    for now, following, event in zip(passed[-2::-1], passed[:0:-1], events[:0:-1], strict=True):
        G = np.linalg.solve(following.prior_P, turning(now.x, event.h) @ now.P).T
        x = now.x + G @ (x - following.prior_x)
        P = now.P + G @ (P - following.prior_P) @ G.T
        smoothed.append((x, P))
    return smoothed[::-1]


class Models(NamedTuple):
    """Three models of one aircraft: states ``(3, 6)``, covariances ``(3, 6, 6)``, probabilities ``(3,)``."""

    x: Array
    P: Array
    mu: Array


def interact(m: Models, T: Array) -> Models:
    """Mixing of an IMM with transition probabilities ``T (3, 3)``, from row to column."""
    c = T.T @ m.mu
    weight = T * m.mu[:, None] / c
    x = np.stack([sum(weight[i, j] * m.x[i] for i in range(3)) for j in range(3)])
    P = np.zeros((3, 6, 6))
    for j in range(3):
        for i in range(3):
            d = m.x[i] - x[j]
            P[j] += weight[i, j] * (m.P[i] + np.outer(d, d))
    return Models(x, P, c)


def combined(m: Models) -> tuple[Array, Array]:
    """Mean and covariance of the mixture."""
    mean = m.mu @ m.x
    spread = [m.mu[i] * (m.P[i] + np.outer(m.x[i] - mean, m.x[i] - mean)) for i in range(3)]
    return mean, np.sum(spread, axis=0)


def lagging(lag: float, first: int) -> Array:
    """H of a position (``first = 0``) or velocity (``first = 2``) measured ``lag`` before the state."""
    return np.asarray((POSITION if first == 0 else VELOCITY) @ transition(-lag))


def close(actual: Any, wanted: Any, rtol: float = 1e-9, atol: float = 1e-9) -> None:
    """As ``assert_allclose``, for values of size one to ten thousand."""
    np.testing.assert_allclose(actual, wanted, rtol=rtol, atol=atol)
