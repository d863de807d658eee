"""What other libraries make of the same reports: filterpy's IMM, and the best that Stone Soup offers.

They get what the reference estimators get: all reports of a flight in order of time, in its plane, with their
covariances, the jitter of the time stamp turned along the predicted flight, and a gate of six sigma. filterpy: three
linear filters (the models of ``smoothing/parameters.py``) in its ``IMMEstimator``. Stone Soup: a Kalman filter of
constant acceleration, an unscented filter of constant turn rate, and its smoother over whole tracks, which is offline.
Stone Soup has no interacting models for Kalman filters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any, Final, NamedTuple

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from aeroskein import motion
from aeroskein.measurements import Measurements
from aeroskein.plots import Array
from aeroskein.smoothing import ReferenceEstimates, parameters
from aeroskein.smoothing.start import first_states, started

__all__ = ["LIBRARIES", "library_estimates"]

POSITION: Final = np.eye(2, 6)
BOTH: Final = np.eye(4, 6)
START: Final = datetime(2026, 1, 1, tzinfo=UTC)
# White jerk of Stone Soup's constant acceleration, white acceleration and turn acceleration of its constant turn: of
# several values those that gave it the smallest errors. [m²/s⁵], [m²/s³], [rad²/s³]
JERK_DENSITY: Final = 0.2**2
TURN_ACCELERATION_DENSITY: Final = 0.2**2
TURN_RATE_DENSITY: Final = 0.005**2
TURN_RATE_SIGMA_RADPS: Final = 0.02


class _Report(NamedTuple):
    """One report: time, position and velocity (if any), their covariance without the stamp, the stamp's variance."""

    time_s: float
    z: Array
    R: Array
    time_variance: float

    def covariance(self, velocity: Array, acceleration: Array) -> Array:
        """With the error of the time stamp along the predicted flight."""
        R = self.R.copy()
        R[:2, :2] += self.time_variance * np.outer(velocity, velocity)
        if len(self.z) == 4:
            R[2:, 2:] += self.time_variance * np.outer(acceleration, acceleration)
        return R


def library_estimates(measurements: Measurements, name: str) -> ReferenceEstimates:
    """Estimates of one library's estimator at the times of the reports, NaN before each flight's start."""
    n = len(measurements)
    pair, matrix = np.full((n, 2), np.nan), np.full((n, 2, 2), np.nan)
    found = ReferenceEstimates(measurements.slot, measurements.time_s, pair, pair.copy(), matrix, matrix.copy())
    rows = np.flatnonzero(started(measurements))
    seen = measurements.take(rows)
    begin = np.unique(seen.slot, return_index=True)[1]
    seen.slot = np.unique(seen.slot, return_inverse=True)[1].astype(np.int64)
    first_x, first_P = first_states(seen)
    for k, (start, end) in enumerate(zip(begin, [*begin[1:], len(seen)], strict=True)):
        reports = list(_reports(seen, int(start), int(end)))
        at = rows[start:end]
        for row, (x, P) in zip(at, LIBRARIES[name](reports, first_x[k], first_P[k]), strict=True):
            found.position_m[row], found.velocity_mps[row] = x[:2], x[2:4]
            found.position_cov_m2[row], found.velocity_cov_m2ps2[row] = P[:2, :2], P[2:4, 2:4]
    return found


def _reports(seen: Measurements, start: int, end: int) -> Iterator[_Report]:
    for i in range(start, end):
        R = np.array([[seen.r_ee[i], seen.r_en[i]], [seen.r_en[i], seen.r_nn[i]]])
        z = np.array([seen.east_m[i], seen.north_m[i]])
        if np.isfinite(seen.velocity_variance[i]):
            z = np.append(z, [seen.v_east_mps[i], seen.v_north_mps[i]])
            R = np.block([[R, np.zeros((2, 2))], [np.zeros((2, 2)), seen.velocity_variance[i] * np.eye(2)]])
        yield _Report(float(seen.time_s[i]), z, R, float(seen.time_variance[i]))


def _outside(z: Array, R: Array, x: Array, P: Array) -> bool:
    innovation = (z - BOTH[: len(z)] @ x)[:2]
    S = (P + 0.0)[:2, :2] + R[:2, :2]
    return bool(innovation @ np.linalg.solve(S, innovation) > parameters.GATE)


def _filterpy_imm(reports: list[_Report], x: Array, P: Array) -> list[tuple[Array, Array]]:
    """``IMMEstimator`` of three linear filters, its transition probabilities set for each interval."""
    filters = []
    for _ in range(3):
        f = KalmanFilter(dim_x=6, dim_z=4)
        f.x, f.P = x.copy(), P.copy()
        filters.append(f)
    imm = IMMEstimator(filters, parameters.DETECTOR_START.copy(), np.eye(3))
    out, last_s = [(x, P)], reports[0].time_s
    for report in reports[1:]:
        dt = np.array([report.time_s - last_s])
        last_s = report.time_s
        rates = parameters.RATES_PER_S * dt[0]
        T = rates / (1.0 + 2.0 * rates)
        imm.M = T + np.diag(1.0 - T.sum(axis=1))
        imm._compute_mixing_probabilities()
        F, densities = motion.acceleration_transition(dt)[0], (0.0, *parameters.DETECTOR_JERK_DENSITY)
        for f, density in zip(filters, densities, strict=True):
            f.F, f.Q = F, motion.white_jerk_noise(dt, density)[0]
        # The steady model of the set: no acceleration, white noise instead.
        filters[0].F = motion.velocity_transition(dt)[0]
        filters[0].Q = motion.white_acceleration_noise(dt, parameters.DETECTOR_STEADY_DENSITY)[0]
        imm.predict()
        R = report.covariance(imm.x[2:4], imm.x[4:6])
        if not _outside(report.z, R, imm.x, imm.P):
            for f in filters:
                f.dim_z, f.R, f.H = len(report.z), R, BOTH[: len(report.z)]
            imm.update(report.z)
        out.append((imm.x.copy(), imm.P.copy()))
    return out


def _stone_soup(
    reports: list[_Report], x: Array, P: Array, *, turning: bool = False, smooth: bool = False
) -> list[tuple[Array, Array]]:
    """Stone Soup's filter over one flight; its own smoother over the result where wanted."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantAcceleration
    from stonesoup.models.transition.nonlinear import ConstantTurn
    from stonesoup.predictor.kalman import KalmanPredictor, UnscentedKalmanPredictor
    from stonesoup.smoother.kalman import KalmanSmoother
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater

    # Its order of states: east, its derivatives, north, its derivatives; of a turn: x, vx, y, vy, rate.
    order = [0, 2, 1, 3] if turning else [0, 2, 4, 1, 3, 5]
    model: Any
    if turning:
        model = ConstantTurn(np.full(2, TURN_ACCELERATION_DENSITY), TURN_RATE_DENSITY)
        begin_x = np.append(x[order], 0.0)
        begin_P = np.pad(P[np.ix_(order, order)], (0, 1))
        begin_P[4, 4] = TURN_RATE_SIGMA_RADPS**2
        predictor, where = UnscentedKalmanPredictor(model), [0, 2, 1, 3]
    else:
        model = CombinedLinearGaussianTransitionModel([ConstantAcceleration(JERK_DENSITY)] * 2)
        begin_x, begin_P = x[order], P[np.ix_(order, order)]
        predictor, where = KalmanPredictor(model), [0, 3, 1, 4]
    state = GaussianState(begin_x[:, None], begin_P, START)
    updater, track = KalmanUpdater(None), Track([state])
    for report in reports[1:]:
        at = START + timedelta(seconds=report.time_s - reports[0].time_s)
        prediction = predictor.predict(state, timestamp=at)
        mean = np.asarray(prediction.state_vector, dtype=float)[:, 0]
        plain = mean[where]
        acceleration = np.array([-plain[3], plain[2]]) * mean[4] if turning else mean[[2, 5]]
        R = report.covariance(plain[2:4], acceleration)
        if _outside(report.z, R, np.append(plain, [0.0, 0.0]), np.asarray(prediction.covar)[np.ix_(where, where)]):
            state = prediction
        else:
            seen = LinearGaussian(len(mean), where[: len(report.z)], R)
            detection = Detection(report.z[:, None], timestamp=at, measurement_model=seen)
            state = updater.update(SingleHypothesis(prediction, detection))
        track.append(state)
    states = KalmanSmoother(model).smooth(track) if smooth else track
    return [
        (np.asarray(s.state_vector, dtype=float)[where, 0], np.asarray(s.covar)[np.ix_(where, where)]) for s in states
    ]


def _stone_soup_turn(reports: list[_Report], x: Array, P: Array) -> list[tuple[Array, Array]]:
    return _stone_soup(reports, x, P, turning=True)


def _stone_soup_smoother(reports: list[_Report], x: Array, P: Array) -> list[tuple[Array, Array]]:
    return _stone_soup(reports, x, P, smooth=True)


LIBRARIES: Final[dict[str, Callable[[list[_Report], Array, Array], list[tuple[Array, Array]]]]] = {
    "filterpy IMM": _filterpy_imm,
    "Stone Soup CA": _stone_soup,
    "Stone Soup turn UKF": _stone_soup_turn,
    "Stone Soup smoother, offline": _stone_soup_smoother,
}
"""Estimators by the name that the table shows."""
