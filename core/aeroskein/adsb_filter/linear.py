"""The linear model of the published ADS-B filter: x and y apart, each with position, velocity and acceleration.

Predict, widen after a gap, judge, update, and smooth backwards (Rauch-Tung-Striebel), for all flights together: step k
takes the k-th report of every flight. Because the axes are apart, the observation covariance enters with its diagonal;
what the jitter of the time stamp correlates between east and north is the turning models' to use.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein import linear_gaussian
from aeroskein.adsb_filter.gate import Gate
from aeroskein.adsb_filter.record import Filtered
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.adsb_filter.start import Start, position_covariance
from aeroskein.lanes import Lanes, step_s
from aeroskein.measurements import Measurements
from aeroskein.motion import axis_noise, axis_transition
from aeroskein.plots import Array, Bools, Ints

__all__ = ["LinearHistory", "filter_linear", "smooth_linear"]

_POSITION: Final = np.array([[1.0, 0.0, 0.0]])
_VELOCITY: Final = np.array([[0.0, 1.0, 0.0]])


@dataclass(slots=True, eq=False)
class LinearHistory:
    """States of all reports: ``x (n, 2, 3)``, ``P (n, 2, 3, 3)``, and what was predicted for them."""

    x: Array
    P: Array
    prior_x: Array
    prior_cov: Array
    accepted: Bools

    def filtered(self) -> Filtered:
        """As estimates."""
        result = Filtered.empty(len(self.x))
        result.position_m[:], result.velocity_mps[:] = self.x[:, :, 0], self.x[:, :, 1]
        result.position_cov_m2[:] = self.P[:, :, 0, 0, None] * np.eye(2)
        result.velocity_cov_m2ps2[:] = self.P[:, :, 1, 1, None] * np.eye(2)
        result.accepted[:] = self.accepted
        return result


def filter_linear(measurements: Measurements, start: Start, settings: AdsbFilterSettings) -> LinearHistory:
    """Run the linear filter over all flights.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time; a position that is NaN is only predicted.
    start : Start
        State of each flight at its first row.
    settings : AdsbFilterSettings
        Process noise, gap, outliers; whether velocities are used.
    """
    n = len(measurements)
    lanes, dt_s = Lanes(measurements.slot), step_s(measurements.slot, measurements.time_s)
    history = LinearHistory(
        np.zeros((n, 2, 3)), np.zeros((n, 2, 3, 3)), np.zeros((n, 2, 3)), np.zeros((n, 2, 3, 3)),
        np.zeros(n, dtype=np.bool_),
    )  # fmt: skip
    x, P = start.axes()
    for k in range(lanes.steps):
        rows = lanes.rows(k)
        if k == 0:
            x, P = x[measurements.slot[rows]], P[measurements.slot[rows]]
            gate = Gate(len(rows), settings.outlier_sigmas, settings.reopen_after)
            history.prior_x[rows], history.prior_cov[rows], history.accepted[rows] = x, P, True
        else:
            m = len(rows)
            x, P = _predict(x[:m], P[:m], dt_s[rows], settings)
            x, P = _update(history, rows, x, P, measurements.take(rows), gate, settings)
        history.x[rows], history.P[rows] = x, P
    return history


def _predict(x: Array, P: Array, dt_s: Array, settings: AdsbFilterSettings) -> tuple[Array, Array]:
    F, Q = axis_transition(dt_s)[:, None], axis_noise(dt_s, settings.linear_sigma_mps2)[:, None]
    x, P = linear_gaussian.predict(x, P, F, Q)
    return x, P * np.where(dt_s > settings.gap_s, settings.gap_inflation, 1.0)[:, None, None, None]


def _update(
    history: LinearHistory,
    rows: Ints,
    x: Array,
    P: Array,
    seen: Measurements,
    gate: Gate,
    settings: AdsbFilterSettings,
) -> tuple[Array, Array]:
    position = np.stack([seen.east_m, seen.north_m], axis=1)
    observed = np.isfinite(position[:, 0])
    R = np.diagonal(position_covariance(seen, x[:, :, 1]), axis1=-2, axis2=-1)[..., None, None]
    innovation = np.where(observed[:, None], position - x[:, :, 0], 0.0)[..., None]
    # The axes are apart, so their squared distances add.
    d2 = linear_gaussian.squared_distance(innovation, P[..., :1, :1] + R).sum(axis=1)
    velocity = np.stack([seen.v_east_mps, seen.v_north_mps], axis=1)
    accepted, widen = gate.judge(d2, observed, velocity)
    P = P * widen[:, None, None, None]
    history.prior_x[rows], history.prior_cov[rows], history.accepted[rows] = x, P, accepted
    x, P = _where(accepted, linear_gaussian.update(x, P, innovation, _POSITION, R), (x, P))
    if settings.use_velocity:
        told = gate.trusts(velocity)
        variance = np.where(told, seen.velocity_variance, 1.0)[:, None] + seen.time_variance[:, None] * x[:, :, 2] ** 2
        R = np.broadcast_to(variance, velocity.shape)[..., None, None]
        innovation = np.where(told[:, None], velocity - x[:, :, 1], 0.0)[..., None]
        d2 = linear_gaussian.squared_distance(innovation, P[..., 1:2, 1:2] + R).sum(axis=1)
        # A report whose position is an outlier is not trusted with its velocity either.
        used = told & (accepted | ~observed) & (d2 <= gate.limit)
        x, P = _where(used, linear_gaussian.update(x, P, innovation, _VELOCITY, R), (x, P))
    return x, P


def _where(lanes: Bools, updated: tuple[Array, Array], kept: tuple[Array, Array]) -> tuple[Array, Array]:
    return (
        np.where(lanes[:, None, None], updated[0], kept[0]),
        np.where(lanes[:, None, None, None], updated[1], kept[1]),
    )


def smooth_linear(history: LinearHistory, measurements: Measurements) -> LinearHistory:
    """Smooth all flights backwards (Rauch-Tung-Striebel); what was predicted stays as it was."""
    lanes, dt_s = Lanes(measurements.slot), step_s(measurements.slot, measurements.time_s)
    smoothed = LinearHistory(history.x.copy(), history.P.copy(), history.prior_x, history.prior_cov, history.accepted)
    for k in range(lanes.steps - 2, -1, -1):
        later = lanes.rows(k + 1)
        rows = later - 1
        smoothed.x[rows], smoothed.P[rows] = linear_gaussian.smooth(
            history.x[rows],
            history.P[rows],
            axis_transition(dt_s[later])[:, None],
            history.prior_x[later],
            history.prior_cov[later],
            smoothed.x[later],
            smoothed.P[later],
        )
    return smoothed
