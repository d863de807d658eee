"""Step 2 of the published ADS-B filter: the state at the first point above ground.

Position from the first report; direction from the reported velocity or from the first positions; speed from the
same, or from statistics of past take-offs where they are given; acceleration from those statistics; yaw rate zero. The
covariance comes from the measurement's own (R), not from a chosen constant, wherever a measurement stands behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.lanes import continues, held_rows
from aeroskein.measurements import Measurements
from aeroskein.motion import SPEED, YAW, turn_velocity_jacobian
from aeroskein.plots import Array, Ints

__all__ = ["Start", "position_covariance", "start_states"]

# What is not measured: how hard an aircraft may be accelerating or turning when it is first seen: 0.3 g, and a
# standard-rate turn of 3 degrees a second.
ACCELERATION_SIGMA_MPS2: Final = 3.0
YAW_RATE_SIGMA_RADPS: Final = 0.0524
# Two positions closer in time than this give no velocity: their time jitter is a good part of it. [s]
LEAST_BASE_S: Final = 2.0
# Positions after that which are asked for the velocity; the middle answer counts, so one outlier does not matter.
WITNESSES: Final = 3
# No velocity at all: anything up to the speed of an airliner. [m/s]
UNKNOWN_VELOCITY_SIGMA_MPS: Final = 150.0
# Below this speed the direction is as good as unknown, and dividing by the speed would overflow. [m/s]
SLOW_MPS: Final = 5.0
# An unknown direction; wider would only fold over itself. [rad]
MAX_YAW_SIGMA_RAD: Final = 1.2


@dataclass(slots=True, eq=False)
class Start:
    """States of all flights at their first report.

    Attributes
    ----------
    position_m, position_cov_m2 : (flights, 2), (flights, 2, 2) float64
        East and north, time jitter included. [m, m²]
    velocity_mps, velocity_cov_m2ps2 : (flights, 2), (flights, 2, 2) float64
        East and north. [m/s, m²/s²]
    acceleration_mps2 : (flights, 2) float64
        Along the velocity. [m/s²]
    """

    position_m: Array
    position_cov_m2: Array
    velocity_mps: Array
    velocity_cov_m2ps2: Array
    acceleration_mps2: Array

    def axes(self) -> tuple[Array, Array]:
        """For the linear filter: ``[position velocity acceleration]`` ``(flights, 2, 3)``, covariances alike."""
        x = np.stack([self.position_m, self.velocity_mps, self.acceleration_mps2], axis=-1)
        P = np.zeros((*x.shape, 3))
        P[..., 0, 0] = np.diagonal(self.position_cov_m2, axis1=-2, axis2=-1)
        P[..., 1, 1] = np.diagonal(self.velocity_cov_m2ps2, axis1=-2, axis2=-1)
        P[..., 2, 2] = ACCELERATION_SIGMA_MPS2**2
        return x, P

    def turning(self) -> tuple[Array, Array]:
        """For the turning models: states ``(flights, 6)`` and covariances ``(flights, 6, 6)``."""
        speed = np.hypot(*self.velocity_mps.T)
        x = np.zeros((len(speed), 6))
        x[:, :2] = self.position_m
        x[:, SPEED] = speed
        x[:, 3] = np.hypot(*self.acceleration_mps2.T) * np.sign((self.acceleration_mps2 * self.velocity_mps).sum(1))
        x[:, YAW] = np.arctan2(self.velocity_mps[:, 0], self.velocity_mps[:, 1])
        P = np.zeros((len(speed), 6, 6))
        P[:, :2, :2] = self.position_cov_m2
        bounded = x.copy()
        bounded[:, SPEED] = np.maximum(speed, SLOW_MPS)
        J = np.linalg.inv(turn_velocity_jacobian(bounded))
        polar = J @ self.velocity_cov_m2ps2 @ np.swapaxes(J, -1, -2)
        P[:, SPEED, SPEED] = polar[:, 0, 0]
        P[:, YAW, YAW] = np.minimum(polar[:, 1, 1], MAX_YAW_SIGMA_RAD**2)
        P[:, 3, 3] = ACCELERATION_SIGMA_MPS2**2
        P[:, 5, 5] = YAW_RATE_SIGMA_RADPS**2
        return x, P


def position_covariance(measurements: Measurements, velocity_mps: Array) -> Array:
    """Step 3: observation covariance with the time jitter turned into position along the flight.

    ``R = R0 + σt² v v'``, which is the published diag(σp² + (σt v)², σp²) along and across, rotated by the yaw, without
    needing an angle where the aircraft stands.

    Parameters
    ----------
    measurements : Measurements
        Reports, ``(n,)``.
    velocity_mps : (..., n, 2) array
        Velocity of the flight at each, from the filter: two raw positions would give noise at low speed. [m/s]

    Returns
    -------
    (..., n, 2, 2) array
        [m²]
    """
    R = measurements.time_variance[:, None, None] * velocity_mps[..., :, None] * velocity_mps[..., None, :]
    R[..., 0, 0] += measurements.r_ee
    R[..., 1, 1] += measurements.r_nn
    R[..., 0, 1] += measurements.r_en
    R[..., 1, 0] += measurements.r_en
    return np.asarray(R)


def start_states(measurements: Measurements, settings: AdsbFilterSettings) -> Start:
    """Begin every flight at its first row, which must have a position."""
    first = np.flatnonzero(~continues(measurements.slot))
    begin = measurements.take(first)
    position_m = np.stack([begin.east_m, begin.north_m], axis=1)
    velocity, cov = _from_positions(measurements, first, settings.max_speed_mps)
    reported = np.stack([begin.v_east_mps, begin.v_north_mps], axis=1)
    told = np.isfinite(reported[:, 0]) & settings.use_velocity
    velocity = np.where(told[:, None], reported, velocity)
    told_cov = np.where(told, begin.velocity_variance, 0.0)[:, None, None] * np.eye(2)
    cov = np.where(told[:, None, None], told_cov, cov)
    speed = np.hypot(*velocity.T)
    ahead = velocity / np.where(speed > 0.0, speed, 1.0)[:, None]
    if settings.start_speed_mps is not None:
        velocity = ahead * settings.start_speed_mps
    return Start(
        position_m=position_m,
        position_cov_m2=position_covariance(begin, velocity),
        velocity_mps=velocity,
        velocity_cov_m2ps2=cov,
        acceleration_mps2=ahead * settings.start_acceleration_mps2,
    )


def _from_positions(measurements: Measurements, first: Ints, max_speed_mps: float) -> tuple[Array, Array]:
    """Velocity of each flight's start and its covariance, from the first and some later positions.

    Published are the first two positions; with the jitter of time stamps they can be a third of a second apart that is
    said to be a whole one. The middle of several over at least two seconds is not misled by that, nor by an outlier.
    """
    flight, time_s = measurements.slot, measurements.time_s
    position_m = np.stack([measurements.east_m, measurements.north_m], axis=1)
    usable = np.isfinite(position_m[:, 0]) & (time_s >= time_s[first][flight] + LEAST_BASE_S)
    following = held_rows(flight, usable)[1]
    answers, witness = [], first
    for _ in range(WITNESSES):
        # The first row is not usable itself, so this is a later one; at a flight's end the last one answers again.
        ahead = np.minimum(witness + 1, len(flight) - 1)
        more = (flight[ahead] == flight[first]) & (following[ahead] >= 0)
        witness = np.where(more, following[ahead], witness)
        base_s = time_s[witness] - time_s[first]
        has_base = base_s >= LEAST_BASE_S
        answer = (position_m[witness] - position_m[first]) / np.where(has_base, base_s, 1.0)[:, None]
        answers.append(np.where(has_base[:, None], answer, np.nan))
        if len(answers) == 1:
            shortest, shortest_s = witness, np.where(has_base, base_s, 1.0)
    velocity = np.median(np.stack(answers), axis=0)
    ends = measurements.take(first), measurements.take(shortest)
    known = np.nan_to_num(velocity)
    cov = sum(position_covariance(end, known) for end in ends) / shortest_s[:, None, None] ** 2
    unknown = np.isnan(velocity[:, 0])
    speed = np.hypot(*known.T)
    known *= np.minimum(1.0, max_speed_mps / np.maximum(speed, 1.0))[:, None]
    return known, np.where(unknown[:, None, None], UNKNOWN_VELOCITY_SIGMA_MPS**2 * np.eye(2), cov)
