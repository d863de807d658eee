"""Which way is the aircraft moving: a linear IMM of three models, for the live state and for manoeuvre detection.

Interacting multiple models (Blom & Bar-Shalom 1988) over one six-component state, in two sets. The *detector* knows
steady flight (white acceleration), gentle and hard manoeuvres (white jerk); the element estimator takes from it only
the density of jerk that the flight shows, second by second. The *live* set knows steady flight, turns at constant speed
and changes of speed; its mixture is the live product. Mixing is written by pairs of models, so that no outer product
depends on the mixed mean; the tests check it against the textbook form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein import coordinated_turn, kalman
from aeroskein.plots import Array, Bools

__all__ = [
    "DETECTOR", "HOVER_MPS", "JERK_DENSITY", "LIVE", "MODELS", "START", "ModelSet", "initial", "jerk_density",
    "mixture", "step",
]  # fmt: skip

MODELS: Final = 3

# Steady: acceleration as white noise of (0.05 m/s²)² per hertz, what gusts and an autopilot leave.
STEADY_ACCELERATION_DENSITY: Final = 0.05**2


@dataclass(frozen=True, slots=True, eq=False)
class ModelSet:
    """Three models that run side by side; the first is steady flight.

    Attributes
    ----------
    rates : (3, 3) array
        Transition rates, row = from, column = to. [1/s]
    jerk : (3,) array
        Density of white jerk on both axes; with ``turns`` across the flight only, and along it only. [m²/s⁵]
    steady, held, wander : float
        Density of white acceleration of the first model, in flight and while it hovers; of the others, with ``turns``.
        [m²/s³]
    negligible : float
        Share of what a model begins its step with, below which it takes nothing from another.
    turns : bool
        Whether the others are a turn at constant speed and a change of speed, not manoeuvres of any kind.
    """

    rates: Array
    jerk: Array
    steady: float
    held: float
    wander: float
    negligible: float
    turns: bool


# Gentle and hard: white jerk; (2 m/s³)² per hertz follows the roll-in of a standard-rate turn within two seconds.
# Steady flight lasts minutes, a roll-in seconds.
DETECTOR: Final = ModelSet(
    rates=np.array([[0.0, 0.004, 0.012], [0.01, 0.0, 0.03], [0.05, 0.15, 0.0]]),
    jerk=np.array([0.0, 0.2**2, 2.0**2]),
    steady=STEADY_ACCELERATION_DENSITY,
    held=STEADY_ACCELERATION_DENSITY,
    wander=0.0,
    negligible=0.0,
    turns=False,
)
# Turn at constant speed: the bank that makes 3 degrees a second at 130 m/s comes and goes within five seconds, that is
# 1.4 m/s³, and stays in between. Change of speed: thrust takes seconds to come, 0.2 m/s³, and acts along the flight. A
# turn begins every four minutes, a change of speed every quarter of an hour; they last minutes and end by rolling out,
# which their own noise allows, rather than at once. Who hovers is held in place, to some cm/s.
#
# Nothing is taken from a turn that hardly anything speaks for: what was merged cannot be told apart again. A thousandth
# of a turn that nobody flies, given back to steady flight every few seconds, would be more noise than all gusts, where
# only radars see it; a tree of hypotheses would have dropped it.
LIVE: Final = ModelSet(
    rates=np.array([[0.0, 0.004, 0.001], [0.005, 0.0, 0.001], [0.0125, 0.025, 0.0]]),
    jerk=np.array([0.0, 1.0**2, 0.2**2]),
    steady=0.08**2,
    held=0.01**2,
    wander=0.15**2,
    negligible=0.005,
    turns=True,
)
# Slower, an aircraft hovers or stands, and has no direction worth the name. [m/s]
HOVER_MPS: Final = 15.0
# Before anything is known.
START: Final = np.array([0.80, 0.15, 0.05])
# The jerk that a smoother should allow for in each mode: less than the filter's, for it sees both sides. [m²/s⁵]
JERK_DENSITY: Final = np.array([0.02**2, 0.1**2, 1.0**2])
# What transitions alone keep the probabilities of the manoeuvres at where nothing happens; only more is evidence.
IDLE_PROBABILITY: Final = 0.02
# A model never vanishes wholly, or it could not come back.
LOWEST_PROBABILITY: Final = 1e-6


# Rows of a covariance that belong to the acceleration.
_OF_ACCELERATION: Final = (slice(4, 6), slice(10, 12), slice(14, 16), slice(18, 24))


def initial(x: Array, P: Array) -> tuple[Array, Array, Array]:
    """Three equal models from one state: ``(6, 3, n)``, ``(24, 3, n)``, probabilities ``(3, n)``."""
    n = x.shape[-1]
    xs = np.repeat(x[:, None, :], MODELS, axis=1)
    Ps = np.repeat(P[:, None, :], MODELS, axis=1)
    return xs, Ps, np.repeat(START[:, None], n, axis=1)


def transition(h: Array, models: ModelSet = DETECTOR) -> Array:
    """Transition probabilities over ``h`` ``(n,)`` [s] as ``(3, 3, n)``, from row to column."""
    T = models.rates[:, :, None] * h
    T /= 1.0 + 2.0 * T
    np.subtract(1.0, np.add.reduce(T, axis=1), out=T.reshape(MODELS * MODELS, -1)[:: MODELS + 1])
    return T


def _mix(x: Array, P: Array, mu: Array, h: Array, models: ModelSet) -> tuple[Array, Array, Array]:
    """States, covariances and predicted probabilities after the models have interacted over ``h``."""
    T = transition(h, models)
    c = np.einsum("ijn,in->jn", T, mu)
    W = T * mu[:, None]
    W /= c
    if models.negligible > 0.0:
        W *= models.negligible <= W
        W /= np.add.reduce(W, axis=0)
    mixed_x = np.einsum("cin,ijn->cjn", x, W)
    n = x.shape[-1]
    # P_i and the outer products of the three differences side by side: one weighted sum does it all.
    S = np.empty((kalman.COVARIANCE_ROWS, 6, n))
    S[:, 0:3] = P
    weights = np.empty((6, MODELS, n))
    weights[0:3] = W
    # The pairs (0, 1), (0, 2) and (1, 2).
    d = np.empty((6, 3, n))
    np.subtract(x[:, 0:1], x[:, 1:3], out=d[:, 0:2])
    np.subtract(x[:, 1], x[:, 2], out=d[:, 2])
    kalman.outer(d, S[:, 3:6])
    np.multiply(W[0:1], W[1:3], out=weights[3:5])
    np.multiply(W[1], W[2], out=weights[5])
    mixed_P = np.empty(P.shape)
    for model in range(MODELS):
        np.einsum("cin,in->cn", S, weights[:, model], out=mixed_P[:, model])
    return mixed_x, mixed_P, c


def predict(x: Array, P: Array, mu: Array, h: Array, models: ModelSet = DETECTOR) -> tuple[Array, Array, Array]:
    """Mix and move all models by ``h`` ``(n,)`` [s]; returns new ``x, P, mu``. Lanes with ``h = 0`` keep theirs."""
    x, P, mu = _mix(x, P, mu, h, models)
    # The steady model carries no acceleration.
    x[4:6, 0] = 0.0
    for rows in _OF_ACCELERATION:
        P[rows, 0] = 0.0
    if models.turns:
        kalman.move(x[:, ::2], P[:, ::2], h)
        coordinated_turn.add_jerk(P[:, 2], x[2:4, 2], h, along=float(models.jerk[2]))
        coordinated_turn.circle(x[:, 1], P[:, 1], h, float(models.jerk[1]))
    else:
        kalman.predict(x, P, h, models.jerk[:, None])
    hovers = x[2, 0] ** 2 + x[3, 0] ** 2 < HOVER_MPS**2
    steady = np.where(hovers, models.held, models.steady) * h
    if models.wander > 0.0:
        density = np.empty((MODELS, len(h)))
        density[0] = steady
        density[1:] = models.wander * h
        _add_white_acceleration(P, density, h)
    else:
        _add_white_acceleration(P[:, 0], steady, h)
    # Keeps the steady model's acceleration block regular; far below anything measurable.
    P[20:24:3, 0] += 1e-4
    return x, P, mu


def _add_white_acceleration(P: Array, q: Array, h: Array) -> None:
    # Both axes at once: their rows lie evenly apart.
    P[12:18:5] += q
    q = q * h
    P[2:10:7] += 0.5 * q
    P[0:8:7] += q * h / 3.0


def _reweigh(mu: Array, g: kalman.Gains) -> Array:
    log_likelihood = np.log(g.det)
    log_likelihood += g.d2
    log_likelihood *= -0.5
    log_likelihood -= np.maximum.reduce(log_likelihood, axis=0)
    updated = np.exp(log_likelihood, out=log_likelihood)
    updated *= mu
    np.maximum(updated, LOWEST_PROBABILITY * np.add.reduce(updated, axis=0), out=updated)
    # Probabilities that add up to a millionth more than one would move the mixture away from the origin by 5 cm.
    updated /= np.add.reduce(updated, axis=0)
    return np.where(g.ok, updated, mu)


def step(
    x: Array,
    P: Array,
    mu: Array,
    *,
    z: Sequence[Array] | Array,
    base: Sequence[Array] | Array,
    time_variance: Array,
    velocity_variance: Array,
    lag: Array | None,
    usable: Bools,
    gate: Array | float,
    turns: bool = False,
) -> tuple[Array, Bools, Array, kalman.Innovation]:
    """Update all models by one report a lane, in place; returns ``mu``, accepted, distance, innovation.

    Parameters
    ----------
    x, P, mu : (6, 3, n), (24, 3, n), (3, n) arrays
        Predicted models.
    z : four (n,) arrays
        Position and velocity measured; velocity ignored where its variance is not finite. [m, m/s]
    base : three (n,) arrays
        Position covariance ee, en, nn without the part from the time stamp. [m²]
    time_variance : (n,) array
        Variance of the time stamp, turned along the flight by each model's velocity. [s²]
    velocity_variance : (n,) array
        Per axis; inf or NaN where no velocity is reported. [m²/s²]
    lag : (n,) array or None
        How far the report lies behind the state; None where no lane is late. [s]
    usable : (n,) bool array
        Lanes to update; the others are left alone.
    gate : float
        Largest squared statistical distance of the nearest model.
    turns : bool
        Whether the second model is a turn at constant speed.
    """
    before = x[2:4, 1].copy() if turns else None
    # The time stamp's error acts along a velocity that is itself uncertain: its second moment counts.
    r00, r01, r11 = kalman.stamp_noise(base, time_variance, x[2:4], P[12:18])
    i = innovation(x, P, 0, z[0], z[1], r00, r01, r11, lag)
    nearest = np.minimum.reduce(i.d2, axis=0)
    ok = usable & (nearest <= gate)
    mu = _reweigh(mu, kalman.apply(x, P, i, ok))
    has_velocity = ok & np.isfinite(velocity_variance)
    if has_velocity.any():
        rv = np.where(has_velocity, velocity_variance, 1.0)
        r00, r01, r11 = kalman.stamp_noise((rv, 0.0, rv), time_variance, x[4:6], P[20:24])
        # A NaN times a gain of zero would still be a NaN.
        east, north = np.where(has_velocity, z[2], 0.0), np.where(has_velocity, z[3], 0.0)
        iv = innovation(x, P, 2, east, north, r00, r01, r11, lag)
        has_velocity &= np.minimum.reduce(iv.d2, axis=0) <= gate
        mu = _reweigh(mu, kalman.apply(x, P, iv, has_velocity))
    if before is not None:
        coordinated_turn.keep_speed(x[:, 1], P[:, 1], before)
    return mu, ok, nearest, i


def innovation(
    x: Array, P: Array, first: int, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array, lag: Array | None
) -> kalman.Innovation:
    """As ``kalman.innovation``, for a report that may lie ``lag`` behind the state (no rewind: H looks back)."""
    if lag is None:
        return kalman.innovation(x, P, first, z0, z1, r00, r01, r11)
    return kalman.lagged_innovation(x, P, first, z0, z1, r00, r01, r11, lag)


def mixture(x: Array, P: Array, mu: Array) -> tuple[Array, Array]:
    """One state ``(6, n)`` and covariance ``(24, n)`` from three models: moments of the mixture."""
    mean = np.einsum("cin,in->cn", x, mu)
    P_mean = np.einsum("cin,in->cn", P, mu)
    away = (x - mean[:, None]) * np.sqrt(mu)
    P_mean += kalman.outer_sum(away.swapaxes(0, 1))
    return mean, P_mean


def jerk_density(mu: Array) -> Array:
    """Density of jerk ``(n,)`` that the mode probabilities ``(3, n)`` ask a smoother to allow for. [m²/s⁵]"""
    evidence = np.maximum(mu[1:] - IDLE_PROBABILITY, 0.0) / (1.0 - IDLE_PROBABILITY)
    return np.asarray(JERK_DENSITY[0] + JERK_DENSITY[1:] @ evidence)
