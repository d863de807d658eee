"""What every linear reference estimator does with a report: gate it, and take its position and velocity in.

The covariance of a position is the source's own, plus the jitter of its time stamp along the flight, ``σt² v v'``; that
of a velocity the same with the acceleration, ``σt² a a'``, both from the predicted state.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import linear_gaussian
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints
from aeroskein.smoothing.parameters import GATE, REFUSALS_TO_BELIEVE

__all__ = ["POSITION", "VELOCITY", "Refusals", "position_report", "velocity_report"]

# Measurement matrices for [x y vx vy ax ay].
POSITION: Final = np.eye(2, 6)
VELOCITY: Final = np.eye(2, 6, 2)


def position_report(seen: Measurements, x: Array, P: Array) -> tuple[Bools, Array, Array, Array]:
    """What a position says to states ``(..., m, 6)``: is there one, innovation, covariance, squared distance."""
    reported = np.stack([seen.east_m, seen.north_m], axis=-1)
    observed = np.isfinite(reported[:, 0])
    R = _outer(seen.time_variance, x[..., 2:4])
    R[..., 0, 0] += seen.r_ee
    R[..., 1, 1] += seen.r_nn
    R[..., 0, 1] += seen.r_en
    R[..., 1, 0] += seen.r_en
    R = np.where(observed[:, None, None], R, np.eye(2))
    innovation = np.where(observed[:, None], reported - x[..., 0:2], 0.0)
    d2 = linear_gaussian.squared_distance(innovation, linear_gaussian.innovation_covariance(P, POSITION, R))
    return observed, innovation, R, d2


def velocity_report(seen: Measurements, x: Array, P: Array) -> tuple[Bools, Array, Array, Array]:
    """The same for a velocity."""
    reported = np.stack([seen.v_east_mps, seen.v_north_mps], axis=-1)
    observed = np.isfinite(reported[:, 0])
    variance = np.where(observed, seen.velocity_variance, 1.0)
    R = _outer(seen.time_variance, x[..., 4:6]) + variance[:, None, None] * np.eye(2)
    innovation = np.where(observed[:, None], reported - x[..., 2:4], 0.0)
    d2 = linear_gaussian.squared_distance(innovation, linear_gaussian.innovation_covariance(P, VELOCITY, R))
    return observed, innovation, R, d2


def _outer(variance: Array, vector: Array) -> Array:
    return np.asarray(variance[:, None, None] * vector[..., :, None] * vector[..., None, :])


class Refusals:
    """Which sources of each flight were refused lately, and whether one of them must be believed.

    Parameters
    ----------
    lanes, sensors : int
        Flights and sources.
    """

    def __init__(self, lanes: int, sensors: int) -> None:
        self._in_a_row: Ints = np.zeros((lanes, sensors), dtype=np.int64)

    def judge(self, squared_distance: Array, observed: Bools, sensor: Ints) -> tuple[Bools, Array]:
        """Accept or refuse one position per lane.

        Parameters
        ----------
        squared_distance, observed, sensor : (m,) arrays
            Of the first ``m`` lanes.

        Returns
        -------
        accepted : (m,) bool
            Lanes to update.
        widen : (m,) array
            Factor for the predicted covariance before the update, 1 usually: where a source is believed after all, it
            makes the report lie at one sigma.
        """
        lane = np.arange(len(observed))
        inside = squared_distance <= GATE
        believed = observed & ~inside & (self._in_a_row[lane, sensor] >= REFUSALS_TO_BELIEVE)
        accepted = observed & (inside | believed)
        # An accepted report speaks for the state, and so against all that were refused before it.
        self._in_a_row[lane[accepted]] = 0
        self._in_a_row[lane[observed & ~accepted], sensor[observed & ~accepted]] += 1
        return accepted, np.where(believed, np.maximum(squared_distance, 1.0), 1.0)
