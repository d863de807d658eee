"""The non-linear models of the published ADS-B filter: an unscented filter over CTRA, or an IMM of its variants.

One model is the unscented Kalman filter; several interact. The variants are CTRV (acceleration zero: turns), CCA (yaw
rate zero: speeding up or slowing down) and CSAV (both zero: uniform straight flight); the publication calls the second
one "constant curvature", but it flies straight. All share the state ``[x y speed acceleration yaw yaw_rate]`` and one
closed transition; what a variant holds at zero re-enters each step as noise, so that mixing never meets a singular
covariance. Smoothing takes the models of each step together (see ``imm``); with one model that is the unscented
Rauch-Tung-Striebel smoother.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from aeroskein import imm, motion, unscented
from aeroskein.adsb_filter.gate import Gate
from aeroskein.adsb_filter.record import Filtered
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.adsb_filter.start import Start, position_covariance
from aeroskein.lanes import Lanes, step_s
from aeroskein.measurements import Measurements
from aeroskein.motion import YAW
from aeroskein.plots import Array, Bools, Ints
from aeroskein.unscented import Prediction, SigmaPoints

__all__ = ["CTRA", "IMM_RATES_PER_S", "IMM_VARIANTS", "Bank", "TurnHistory", "filter_turning", "smooth_turning"]

# Van der Merwe's points at their full spread: all weights of the mean are 0 or more, so that no covariance of an
# unobserved state turns negative; smaller spreads gain nothing on turns of a few degrees a step.
POINTS: Final = SigmaPoints(alpha=1.0, beta=2.0, kappa=0.0)


class Variant(NamedTuple):
    """What a model keeps of acceleration and yaw rate: 1 or 0."""

    keep_acceleration: float
    keep_yaw_rate: float


CTRA: Final = (Variant(1.0, 1.0),)
# CTRV, CCA, CSAV.
IMM_VARIANTS: Final = (Variant(0.0, 1.0), Variant(1.0, 0.0), Variant(0.0, 0.0))
# A turn or a change of speed begins about every three minutes of straight flight and lasts about half a minute.
IMM_RATES_PER_S: Final = np.array([[0.0, 0.005, 0.03], [0.005, 0.0, 0.03], [0.005, 0.005, 0.0]])
# What a variant holds at zero is white from step to step: gusts and the tracking of an autopilot, not a manoeuvre. Its
# noise is this share of that of a variant that keeps it; less makes the covariances of turns too small.
HELD_SHARE: Final = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """Models that run side by side.

    Attributes
    ----------
    keep_acceleration, keep_yaw_rate : (M, 1) arrays
        As in ``Variant``.
    acceleration_sigma_mps2, yaw_rate_sigma_radps : (M, 1) arrays
        Process noise of each. [m/s², rad/s]
    rates_per_s : (M, M) array
        Rates of change between them. [1/s]
    """

    keep_acceleration: Array
    keep_yaw_rate: Array
    acceleration_sigma_mps2: Array
    yaw_rate_sigma_radps: Array
    rates_per_s: Array

    def __len__(self) -> int:
        return len(self.keep_acceleration)

    def predict(self, x: Array, P: Array, dt_s: Array) -> Prediction:
        """Move states ``(..., M, m, 6)`` by ``dt_s`` ``(m,)``; without time nothing changes."""
        Q = motion.turn_noise(
            x, dt_s, self.acceleration_sigma_mps2, self.yaw_rate_sigma_radps, self.keep_acceleration, self.keep_yaw_rate
        )

        def transition(points: Array) -> Array:
            keep = self.keep_acceleration[..., None], self.keep_yaw_rate[..., None]
            return motion.turn_transition(points, dt_s[:, None], *keep)

        moved = unscented.predict(x, P, transition, Q, POINTS, YAW)
        still = dt_s <= 0.0
        return Prediction(
            np.where(still[:, None], x, moved.x),
            np.where(still[:, None, None], P, moved.P),
            np.where(still[:, None, None], P, moved.cross),
        )


def bank_of(settings: AdsbFilterSettings, *, several: bool) -> Bank:
    """The published bank: CTRA alone, or its three variants interacting."""
    variants = IMM_VARIANTS if several else CTRA
    keep = np.array(variants)[:, :, None]
    share = np.where(keep > 0.0, 1.0, HELD_SHARE) if several else np.ones_like(keep)
    return Bank(
        keep_acceleration=keep[:, 0],
        keep_yaw_rate=keep[:, 1],
        acceleration_sigma_mps2=settings.acceleration_sigma_mps2 * share[:, 0],
        yaw_rate_sigma_radps=settings.yaw_rate_sigma_radps * share[:, 1],
        rates_per_s=IMM_RATES_PER_S if several else np.zeros((1, 1)),
    )


@dataclass(slots=True, eq=False)
class TurnHistory:
    """Models of all reports: ``x (M, n, 6)``, ``P (M, n, 6, 6)``, ``mu (M, n)``.

    ``widened (n,)`` is the factor by which the prediction's covariance was multiplied after a gap or to believe a
    report, which the smoother must know.
    """

    x: Array
    P: Array
    mu: Array
    widened: Array
    accepted: Bools

    def filtered(self) -> Filtered:
        """As estimates: the mixture's moments, velocity through the Jacobian at its mean."""
        x, P = imm.mixture(self.x, self.P, self.mu, YAW)
        result = Filtered.empty(len(x))
        result.position_m[:], result.position_cov_m2[:] = x[:, :2], P[:, :2, :2]
        result.velocity_mps[:] = motion.turn_velocity(x)
        J = motion.turn_velocity_jacobian(x)
        at = [motion.SPEED, YAW]
        result.velocity_cov_m2ps2[:] = J @ P[:, at][:, :, at] @ np.swapaxes(J, -1, -2)
        result.accepted[:] = self.accepted
        return result


def filter_turning(measurements: Measurements, start: Start, bank: Bank, settings: AdsbFilterSettings) -> TurnHistory:
    """Run the unscented filter, or the IMM of several, over all flights.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time; a position that is NaN is only predicted.
    start : Start
        State of each flight at its first row.
    bank : Bank
        The models.
    settings : AdsbFilterSettings
        Gap, outliers; whether velocities are used.
    """
    n, models = len(measurements), len(bank)
    lanes, dt_s = Lanes(measurements.slot), step_s(measurements.slot, measurements.time_s)
    history = TurnHistory(
        np.zeros((models, n, 6)), np.zeros((models, n, 6, 6)), np.zeros((models, n)), np.ones(n),
        np.zeros(n, dtype=np.bool_),
    )  # fmt: skip
    x0, P0 = start.turning()
    for k in range(lanes.steps):
        rows = lanes.rows(k)
        m = len(rows)
        if k == 0:
            flight = measurements.slot[rows]
            x, P = np.repeat(x0[None, flight], models, axis=0), np.repeat(P0[None, flight], models, axis=0)
            mu = np.full((models, m), 1.0 / models)
            gate = Gate(m, settings.outlier_sigmas, settings.reopen_after)
            history.accepted[rows] = True
        else:
            T = imm.transition_probabilities(bank.rates_per_s, dt_s[rows])
            x, P, mu = imm.mix(x[:, :m], P[:, :m], mu[:, :m], T, YAW)
            moved = bank.predict(x, P, dt_s[rows])
            history.widened[rows] = np.where(dt_s[rows] > settings.gap_s, settings.gap_inflation, 1.0)
            x, P = moved.x, moved.P * history.widened[rows, None, None]
            x, P, mu = _take_position(history, rows, x, P, mu, measurements.take(rows), gate)
            if settings.use_velocity:
                x, P, mu = _take_velocity(history.accepted[rows], x, P, mu, measurements.take(rows), gate)
        history.x[:, rows], history.P[:, rows], history.mu[:, rows] = x, P, mu
    return history


def _position(points: Array) -> Array:
    return points[..., :2]


def _take_position(
    history: TurnHistory, rows: Ints, x: Array, P: Array, mu: Array, seen: Measurements, gate: Gate
) -> tuple[Array, Array, Array]:
    position = np.stack([seen.east_m, seen.north_m], axis=1)
    observed = np.isfinite(position[:, 0])
    R = position_covariance(seen, motion.turn_velocity(x))
    expected = unscented.predict_measurement(x, P, _position, R, POINTS, YAW)
    innovation = np.where(observed[:, None], position - expected.x, 0.0)
    d2 = np.einsum("...i,...i->...", innovation, np.linalg.solve(expected.P, innovation[..., None])[..., 0])
    # An outlier is one for every model.
    accepted, widen = gate.judge(d2.min(axis=0), observed, np.stack([seen.v_east_mps, seen.v_north_mps], axis=1))
    if (widen > 1.0).any():
        P = P * widen[:, None, None]
        expected = unscented.predict_measurement(x, P, _position, R, POINTS, YAW)
        history.widened[rows] *= widen
    history.accepted[rows] = accepted
    return _apply(accepted, x, P, mu, expected, innovation)


def _take_velocity(
    accepted: Bools, x: Array, P: Array, mu: Array, seen: Measurements, gate: Gate
) -> tuple[Array, Array, Array]:
    velocity = np.stack([seen.v_east_mps, seen.v_north_mps], axis=1)
    observed = np.isfinite(seen.east_m)
    told = gate.trusts(velocity)
    turned = motion.turn_velocity(x)
    # Along: the acceleration; across, to the right: speed times yaw rate.
    ahead = np.stack([np.sin(x[..., YAW]), np.cos(x[..., YAW])], axis=-1)
    bend = np.stack([turned[..., 1], -turned[..., 0]], axis=-1) * x[..., 5, None] + ahead * x[..., 3, None]
    R = seen.time_variance[:, None, None] * bend[..., :, None] * bend[..., None, :]
    R = R + np.where(told, seen.velocity_variance, 1.0)[:, None, None] * np.eye(2)
    expected = unscented.predict_measurement(x, P, motion.turn_velocity, R, POINTS, YAW)
    innovation = np.where(told[:, None], velocity - expected.x, 0.0)
    d2 = np.einsum("...i,...i->...", innovation, np.linalg.solve(expected.P, innovation[..., None])[..., 0])
    # A report whose position is an outlier is not trusted with its velocity either.
    used = told & (accepted | ~observed) & (d2.min(axis=0) <= gate.limit)
    return _apply(used, x, P, mu, expected, innovation)


def _apply(
    lanes: Bools, x: Array, P: Array, mu: Array, expected: Prediction, innovation: Array
) -> tuple[Array, Array, Array]:
    """Update states and probabilities in the given lanes, leave the others."""
    new_x, new_P = unscented.update(x, P, expected, innovation, YAW)
    new_mu = imm.reweigh(mu, imm.gaussian_log_likelihood(innovation, expected.P))
    return (
        np.where(lanes[:, None], new_x, x),
        np.where(lanes[:, None, None], new_P, P),
        np.where(lanes, new_mu, mu),
    )


def smooth_turning(history: TurnHistory, measurements: Measurements, bank: Bank) -> TurnHistory:
    """Smooth all flights backwards; see ``imm.smooth``. The result is one Gaussian per report."""
    lanes, dt_s = Lanes(measurements.slot), step_s(measurements.slot, measurements.time_s)
    x, P = imm.mixture(history.x, history.P, history.mu, YAW)
    mu = history.mu.copy()
    for k in range(lanes.steps - 2, -1, -1):
        later = lanes.rows(k + 1)
        rows = later - 1
        T = imm.transition_probabilities(bank.rates_per_s, dt_s[later])
        mixed_x, mixed_P, _ = imm.mix(history.x[:, rows], history.P[:, rows], history.mu[:, rows], T, YAW)
        moved = bank.predict(mixed_x, mixed_P, dt_s[later])
        moved = moved._replace(P=moved.P * history.widened[later, None, None])
        x[rows], P[rows] = imm.smooth(mixed_x, mixed_P, moved, mu[:, later], x[later], P[later], YAW)
        mu[:, rows] = imm.smoothed_probabilities(history.mu[:, rows], T, mu[:, later])
    return TurnHistory(x[None], P[None], np.ones((1, len(mu[0]))), history.widened, history.accepted)
