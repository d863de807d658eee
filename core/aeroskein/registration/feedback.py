"""The published registration loop: the system track is fed back and each radar's deviation from it is taken over.

After CN 101231340 A, with what its text leaves out restored: the deviation is formed at the plot's stamp (system track
moved on with its velocity), identity *and* distance must agree, and the loop has a gain, because with gain 1 every
plot's noise would be passed on to the next. The deviation is kept in the radar's own coordinates, range and azimuth:
kept as a Cartesian vector, as the text reads, one vector cannot stand for an azimuth error that grows with range. It
knows no time error; that limit is measured in docs/registration.md.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.comparisons import RAD_PER_DEG, Comparisons, geometry_of
from aeroskein.registration.estimator import AZIMUTH_SIGMA_DEG, RANGE_SIGMA_M, preset_of, prior_sigma_of
from aeroskein.registration.rows import BIASES, usable
from aeroskein.settings import EngineSettings

__all__ = ["FeedbackEstimator"]

# Correlation by distance: a corrected plot further than this from the system track is not this aircraft. [m]
DISTANCE_MAX_M: Final = 3_000.0
# Memory of the spread of deviations, in plots.
SPREAD_MEMORY: Final = 100.0


class FeedbackEstimator:
    """Range and azimuth error of every radar by feedback; same use as ``KalmanEstimator``."""

    def __init__(self, settings: EngineSettings, sites: Array) -> None:
        self._gain = settings.registration.feedback_gain
        self._sites = sites
        self._preset, self._prior = preset_of(settings), prior_sigma_of(settings)
        n = len(settings.sensors)
        self._mean = self._preset.copy()
        self._start_sigma = self._prior.copy()
        # Share of the start value still in the estimate.
        self._left = np.ones(n)
        self._spread = np.tile([RANGE_SIGMA_M**2, AZIMUTH_SIGMA_DEG**2], (n, 1))
        self._samples = np.zeros(n, dtype=np.int64)
        self._aircraft = np.zeros(n, dtype=np.int64)
        self._seen: list[Ints] = [np.empty(0, dtype=np.int64) for _ in range(n)]
        self._last_s = np.full(n, -np.inf)
        self._held = np.zeros(n, dtype=np.bool_)

    def add(self, rows: Comparisons) -> bool:
        """Feed system tracks back (the references are the system track, anchored or not); says that they have been."""
        if len(rows) == 0:
            return False
        geometry = geometry_of(rows, self._sites)
        deviation = np.stack(
            [geometry.range_error_m, geometry.across_error_m / (geometry.ground_m * RAD_PER_DEG)], axis=-1
        )
        left_over = deviation - self._mean[rows.sensor, :2]
        distance_m = np.hypot(left_over[:, 0], left_over[:, 1] * geometry.ground_m * RAD_PER_DEG)
        near: Bools = usable(rows, geometry) & (distance_m < DISTANCE_MAX_M) & ~self._held[rows.sensor]
        order = np.flatnonzero(near)[np.argsort(rows.time_s[near], kind="stable")]
        for sensor in np.unique(rows.sensor[order]):
            mine = order[rows.sensor[order] == sensor]
            self._feed_back(int(sensor), deviation[mine])
            new = np.setdiff1d(rows.aircraft[mine], self._seen[sensor])
            self._seen[sensor] = np.union1d(self._seen[sensor], new)[-4096:]
            self._aircraft[sensor] += len(new)
            self._last_s[sensor] = rows.time_s[mine[-1]]
        return True

    def _feed_back(self, sensor: int, deviation: Array) -> None:
        """``e <- e + gain (deviation - e)`` for one plot after the other, in closed form."""
        n = len(deviation)
        share = self._gain * (1.0 - self._gain) ** np.arange(n - 1, -1, -1)
        left = (1.0 - self._gain) ** n
        residual = deviation - self._mean[sensor, :2]
        self._mean[sensor, :2] = left * self._mean[sensor, :2] + share @ deviation
        fresh = n / (n + SPREAD_MEMORY)
        self._spread[sensor] += fresh * ((residual**2).mean(axis=0) - self._spread[sensor])
        self._left[sensor] *= left
        self._samples[sensor] += n

    def advance(self, now_s: float) -> None:
        """Nothing changes with time alone."""

    def means(self) -> Array:
        """``(sensors, 4)``; time and gain stay as preset."""
        return self._mean.copy()

    def covariances(self) -> Array:
        """``(sensors, 4, 4)``: what is left of the start, plus the noise that the loop passes on."""
        out = np.zeros((len(self._mean), BIASES, BIASES))
        passed = self._gain / (2.0 - self._gain)
        for k in range(2):
            out[:, k, k] = (self._left * self._start_sigma[:, k]) ** 2 + passed * self._spread[:, k] * (
                self._samples > 0
            )
        out[:, 2, 2] = self._start_sigma[:, 2] ** 2
        return out

    def relative_covariances(self) -> Array:
        """The same: the loop knows nothing of times."""
        return self.covariances()

    def counts(self) -> tuple[Ints, Ints]:
        """Plots used and aircraft they came from, ``(sensors,)`` each."""
        return self._samples.copy(), self._aircraft.copy()

    def last_s(self) -> Array:
        """When each radar was last compared, ``(sensors,)``. [s since the epoch]"""
        return self._last_s.copy()

    def jumps(self) -> Ints:
        """The loop does not look for jumps: zeros."""
        return np.zeros(len(self._mean), dtype=np.int64)

    def restart(self, sensor: int, mean: Array, sigma: Array) -> None:
        """Begin anew with one radar."""
        self._mean[sensor], self._start_sigma[sensor], self._left[sensor] = mean, sigma, 1.0
        self._samples[sensor] = self._aircraft[sensor] = 0
        self._seen[sensor] = np.empty(0, dtype=np.int64)
        self._last_s[sensor] = -np.inf

    def adjust(self, sensor: int, change: Array, slack: Array) -> None:
        """Move one radar's errors by a known change with sigmas ``slack``, ``(4,)`` each."""
        self._start_sigma[sensor] = np.hypot(self._left[sensor] * self._start_sigma[sensor], slack)
        self._start_sigma[sensor, 2:] = self._prior[sensor, 2:]
        self._left[sensor] = 1.0
        self._mean[sensor] += change

    def hold(self, sensor: int, held: bool) -> None:
        """Freeze one radar or let it go."""
        self._held[sensor] = held

    def held(self) -> Bools:
        """Which radars are frozen, ``(sensors,)``."""
        return self._held.copy()

    def export(self) -> list[dict[str, Any]]:
        """Plain content for a snapshot."""
        names = ("_mean", "_start_sigma", "_left", "_spread", "_samples", "_aircraft", "_held")
        return [{name.strip("_"): getattr(self, name).tolist() for name in names}]

    def load(self, content: list[dict[str, Any]], indices: dict[int, int]) -> None:
        """Take an ``export`` over; ``indices`` maps its sensor indices to today's."""
        old = np.array(list(indices), dtype=np.int64)
        new = np.array(list(indices.values()), dtype=np.int64)
        for name, values in content[0].items():
            mine: Array = getattr(self, f"_{name}")
            mine[new] = np.array(values, dtype=mine.dtype)[old]
