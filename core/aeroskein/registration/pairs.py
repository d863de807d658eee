"""Pairs: plots of two radars on one aircraft, brought to one instant, for registration without ADS-B.

A plot of one radar that lies in time between two plots of another is set beside the straight line between those two.
Only raw plots are used, so what is compared is independent of every filter and of the biases applied so far. The sag of
the line in a turn is taken out with the change of the reference's velocity; sharper turns are left out.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.ellipsoid import normal_and_height
from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.comparisons import RAD_PER_DEG, Comparisons, Geometry
from aeroskein.registration.rows import BIASES, NUISANCES, Noise, Rows

__all__ = ["PairBuffer"]

# Plots further apart than this are not joined by a line. [s]
GAP_MAX_S: Final = 25.0
# Change of velocity over the gap beyond which the line is no good. [m/s]
TURN_MAX_MPS: Final = 60.0
# The sag is known to about a quarter: acceleration is not constant and the velocities lag.
SAG_SHARE: Final = 0.25
# Radars with the same period share end points between neighbouring pairs; their noise counts this much more.
SHARED_END_POINTS: Final = 1.4

# Columns kept of each plot: stamp, ECEF, velocity east and north, covariance east-north (packed), sensitivity to the
# radar's biases in east-north (2 x 4), sensitivity to height east and north, slant range.
_TIME, _PLOT, _VELOCITY, _COV, _BIAS, _HEIGHT = (
    slice(0, 1),
    slice(1, 4),
    slice(4, 6),
    slice(6, 9),
    slice(9, 17),
    slice(17, 19),
)
_RANGE: Final = 19
_WIDTH: Final = 20


class PairBuffer:
    """The last two plots of every radar on every aircraft without anchor.

    Parameters
    ----------
    noise : Noise
        Random errors of the sensors.
    period_s : (sensors,) array
        Their periods: the quicker radar of a pair gives the line.
    capacity : int
        Aircraft kept; the one silent longest makes room.
    """

    def __init__(self, noise: Noise, period_s: Array, capacity: int = 512) -> None:
        self._noise = noise
        self._period_s = period_s
        sensors = len(period_s)
        self._aircraft = np.full(capacity, -1, dtype=np.int64)
        self._touched_s = np.full(capacity, -np.inf)
        # [place, sensor, 0 newest / 1 the one before, column]
        self._plots = np.zeros((capacity, sensors, 2, _WIDTH))
        self._plots[..., 0] = -np.inf

    def add(self, rows: Comparisons, geometry: Geometry) -> Rows | None:
        """Take plots in, ordered by stamp, and give the pairs they complete; None where there are none."""
        if len(rows) == 0:
            return None
        columns = self._columns(rows, geometry)
        made: list[Rows] = []
        # The k-th plot of every aircraft together: within a round no aircraft occurs twice.
        for part in _rounds(rows.aircraft):
            place = self._places(rows.aircraft[part], rows.time_s[part])
            kept = place >= 0
            part, place = part[kept], place[kept]
            sensor = rows.sensor[part]
            fresh = rows.time_s[part] > self._plots[place, sensor, 0, 0]
            part, place, sensor = part[fresh], place[fresh], sensor[fresh]
            pairs = self._complete(place, sensor, columns[part], rows.height_sigma_m[part])
            if pairs is not None:
                made.append(pairs)
            self._plots[place, sensor, 1] = self._plots[place, sensor, 0]
            self._plots[place, sensor, 0] = columns[part]
        return Rows.concatenate(made) if made else None

    def forget(self, sensor: int) -> None:
        """Drop the plots of one radar, for example after its biases jumped."""
        self._plots[:, sensor, :, 0] = -np.inf

    def _columns(self, rows: Comparisons, geometry: Geometry) -> Array:
        out = np.empty((len(rows), _WIDTH))
        out[:, 0] = rows.time_s
        out[:, _PLOT] = geometry.plot_m
        out[:, _VELOCITY] = geometry.velocity_en
        # In the horizontal plane: a metre of slant range moves the plot by r / rho, at fixed height.
        along = geometry.range_m / geometry.ground_m
        directions = np.stack([geometry.radial_en, geometry.across_en], axis=-1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        polar = self._noise.polar(rows.sensor, geometry.ground_m, np.zeros(len(rows)), np.zeros(len(rows)))
        polar[:, 0, 0] *= along**2
        plane = directions @ polar @ directions.swapaxes(1, 2)
        jitter = geometry.velocity_en * self._noise.time_sigma_s[rows.sensor, None]
        plane += jitter[:, :, None] * jitter[:, None, :]
        out[:, _COV] = plane[:, [0, 0, 1], [0, 1, 1]]
        of_bias = np.zeros((len(rows), 2, BIASES))
        of_bias[:, :, 0] = directions[:, :, 0] * along[:, None]
        of_bias[:, :, 1] = directions[:, :, 1] * (geometry.ground_m * RAD_PER_DEG)[:, None]
        of_bias[:, :, 2] = -geometry.velocity_en
        of_bias[:, :, 3] = of_bias[:, :, 0] * geometry.range_m[:, None]
        out[:, _BIAS] = of_bias.reshape(len(rows), -1)
        out[:, _RANGE] = geometry.range_m
        out[:, _HEIGHT] = -directions[:, :, 0] * (geometry.up_m / geometry.ground_m)[:, None]
        return out

    def _places(self, aircraft: Ints, time_s: Array) -> Ints:
        """Place of each aircraft (all different); new ones take the places silent longest; -1 where none is left."""
        order = np.argsort(self._aircraft, kind="stable")
        found = np.searchsorted(self._aircraft[order], aircraft)
        place = order[np.minimum(found, len(order) - 1)]
        new = np.flatnonzero(self._aircraft[place] != aircraft)
        if len(new):
            place[new] = -1
            busy = self._touched_s > time_s.max() - GAP_MAX_S
            busy[place[place >= 0]] = True
            by_age = np.argsort(np.where(busy, np.inf, self._touched_s), kind="stable")
            free = by_age[: min(len(new), int((~busy).sum()))]
            given = new[: len(free)]
            place[given] = free
            self._aircraft[free] = aircraft[given]
            self._plots[free, :, :, 0] = -np.inf
        there = place >= 0
        self._touched_s[place[there]] = time_s[there]
        return place

    def _complete(self, place: Ints, sensor: Ints, newest: Array, height_sigma_m: Array) -> Rows | None:
        """Pairs whose line ends in the newest plots, ``(n,)`` all of different aircraft."""
        before = self._plots[place, sensor, 0]
        slower = self._plots[place, :, 0]
        since_s, until_s = before[:, :1], newest[:, :1]
        inside: Bools = (slower[:, :, 0] > since_s) & (slower[:, :, 0] < until_s) & (until_s - since_s < GAP_MAX_S)
        own, others = self._period_s[sensor][:, None], self._period_s[None, :]
        number = np.arange(len(self._period_s))
        inside &= (own < others) | ((own == others) & (sensor[:, None] < number))
        turn = np.linalg.norm(newest[:, _VELOCITY] - before[:, _VELOCITY], axis=1)
        inside &= (turn < TURN_MAX_MPS)[:, None]
        row, other = np.nonzero(inside)
        if len(row) == 0:
            return None
        shared = np.where(self._period_s[sensor[row]] == self._period_s[other], SHARED_END_POINTS, 1.0)
        return _pair_rows(
            self._aircraft[place[row]],
            (other, slower[row, other]),
            (sensor[row], before[row], newest[row]),
            shared,
            height_sigma_m[row],
        )


def _pair_rows(
    aircraft: Ints,
    one: tuple[Ints, Array],
    line: tuple[Ints, Array, Array],
    shared: Array,
    height_sigma_m: Array,
) -> Rows:
    """Measured minus interpolated, in east and north at the aircraft."""
    (sensor, plot), (other, begin, end) = one, line
    n = len(sensor)
    span_s = end[:, 0] - begin[:, 0]
    share = (plot[:, 0] - begin[:, 0]) / span_s
    w = share[:, None]
    normal, _ = normal_and_height(plot[:, _PLOT])
    east = np.stack([-normal[:, 1], normal[:, 0], np.zeros(n)], axis=-1)
    east /= np.maximum(np.linalg.norm(east, axis=1, keepdims=True), 1e-12)
    north = np.cross(normal, east)
    step = plot[:, _PLOT] - ((1 - w) * begin[:, _PLOT] + w * end[:, _PLOT])
    error = np.stack([np.einsum("nc,nc->n", step, east), np.einsum("nc,nc->n", step, north)], axis=-1)
    # Between the ends a path with constant acceleration runs a (t - t0)(t - t1) / 2 beside the chord.
    sag = -0.5 * (end[:, _VELOCITY] - begin[:, _VELOCITY]) * (share * (1 - share) * span_s)[:, None]
    error -= sag
    slack = SAG_SHARE * sag
    covariance = _unpack(plot[:, _COV])
    covariance += _unpack(((1 - w) ** 2 * begin[:, _COV] + w**2 * end[:, _COV]) * shared[:, None])
    covariance += slack[:, :, None] * slack[:, None, :]
    of_line = (1 - w) * begin[:, _BIAS] + w * end[:, _BIAS]
    of_height = plot[:, _HEIGHT] - ((1 - w) * begin[:, _HEIGHT] + w * end[:, _HEIGHT])
    covariance += (of_height[:, :, None] * of_height[:, None, :]) * (height_sigma_m**2)[:, None, None]
    return Rows(
        time_s=end[:, 0],
        error_m=error,
        covariance_m2=covariance,
        sensor=sensor,
        other=other,
        of_sensor=plot[:, _BIAS].reshape(n, 2, BIASES),
        of_other=-of_line.reshape(n, 2, BIASES),
        range_m=np.stack([plot[:, _RANGE], 0.5 * (begin[:, _RANGE] + end[:, _RANGE])], axis=-1),
        aircraft=aircraft,
        of_aircraft=np.zeros((n, 2, NUISANCES)),
        # The plots were placed at heights that are too low by the common error.
        of_height=-of_height * height_sigma_m[:, None],
    )


def _unpack(packed: Array) -> Array:
    return packed[:, [0, 1, 1, 2]].reshape(-1, 2, 2)


def _rounds(key: Ints) -> list[Ints]:
    """Split rows so that no key occurs twice in a part, keeping the order of equal keys."""
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(key[order]) != 0])
    rank = np.empty(len(key), dtype=np.int64)
    rank[order] = np.arange(len(key)) - np.repeat(starts, np.diff(np.r_[starts, len(key)]))
    return [np.flatnonzero(rank == k) for k in range(int(rank.max()) + 1)]
