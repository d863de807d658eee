"""Latency of each aircraft's ADS-B, from plots of registered radars, and how much of it is taken out of its stamps.

An aircraft whose ADS-B is ``l`` seconds late seems to be ``l`` times its speed behind where the radar sees it, along
its flight. One scalar Kalman state per track slot with a prior of 0.3 s. What the radar's own biases may contribute
does not average away over its plots; it is kept apart as a floor of the claimed uncertainty. Only differences between
aircraft are observable: what the middle one of them has is the time of the picture.

Most transponders are honest and a few are late. A correction with the plain estimate would move every honest aircraft
by its noise (0.05 s are 12 m at 240 m/s), so the estimate is weighed by two hypotheses: latency scatters as it does
among the others, or it is one of the few. What results is applied by blocks of ten seconds, as all corrections are.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["LatencyEstimator"]

# Latency before anything is known: mean 0, this scatter. [s]
PRIOR_SIGMA_S: Final = 0.3
# Its drift in one second (0.03 s in an hour): equipment, not flight.
DRIFT_S_PER_ROOT_S: Final = 0.0005
# Squared distance beyond which a plot is an outlier.
GATE: Final = 16.0
# How likely an aircraft is one of the few before anything is known of it. Small, because a correction that is not
# needed does harm: with this, evidence of four sigma is needed.
LATE_SHARE: Final = 0.003
# Nothing is applied before the latency is known to this. [s]
KNOWN_SIGMA_S: Final = 0.07
# A middle and a scatter need this many aircraft. [aircraft]
FEWEST: Final = 8
# Scatter is believed where it exceeds what noise alone would show by so many of its own sigmas, which for a median
# absolute deviation of n values are 2.3 / sqrt(n) of it.
SCATTER_SIGMAS: Final = 2.0
DEVIATION_SIGMA: Final = 2.3
# Most that a correction changes from one block to the next: 12 m at 240 m/s, which the estimator follows. [s]
STEP_S: Final = 0.05
# Standard deviation of a normal distribution over its median absolute deviation.
PER_DEVIATION: Final = 1.4826


class LatencyEstimator:
    """Per track slot: latency, its variance, and what is applied.

    Parameters
    ----------
    capacity : int
        Slots.
    """

    def __init__(self, capacity: int) -> None:
        self._mean_s = np.zeros(capacity)
        self._variance_s2 = np.full(capacity, PRIOR_SIGMA_S**2)
        self._floor_s2 = np.zeros(capacity)
        self._time_s = np.full(capacity, np.nan)
        # In the present block and in the one before.
        self._applied_s = np.zeros((capacity, 2))

    def grow(self, capacity: int) -> None:
        """Make room for more slots."""
        fresh = LatencyEstimator(capacity)
        for name, column in vars(self).items():
            getattr(fresh, name)[: len(column)] = column
        vars(self).update(vars(fresh))

    def clear(self, slots: Ints) -> None:
        """Forget these slots: they belong to new tracks."""
        self._mean_s[slots] = 0.0
        self._variance_s2[slots] = PRIOR_SIGMA_S**2
        self._floor_s2[slots] = 0.0
        self._time_s[slots] = np.nan
        self._applied_s[slots] = 0.0

    def learn(self, slot: Ints, time_s: Array, late_s: Array, noise_s2: Array, floor_s2: Array) -> None:
        """Learn from plots of converged radars beside the ADS-B of the same aircraft.

        Parameters
        ----------
        slot : (n,) int64
            Track slot; rows of one slot are averaged.
        time_s : (n,) array
            Time of the plot. [s since the epoch]
        late_s, noise_s2, floor_s2 : (n,) arrays
            What each plot says of the latency, the variance of its noise, and of what the radar's bias may contribute;
            NaN where a plot says nothing. [s, s², s²]
        """
        inside = (late_s - self._mean_s[slot]) ** 2 < GATE * (self._variance_s2[slot] + noise_s2 + floor_s2)
        if not inside.any():
            return
        time_s, late_s, noise_s2, floor_s2 = time_s[inside], late_s[inside], noise_s2[inside], floor_s2[inside]
        slots, index = np.unique(slot[inside], return_inverse=True)
        newest_s = np.full(len(slots), -np.inf)
        np.maximum.at(newest_s, index, time_s)
        step_s = np.fmax(newest_s - self._time_s[slots], 0.0)
        prior = self._variance_s2[slots] + DRIFT_S_PER_ROOT_S**2 * np.nan_to_num(step_s)
        prior = np.minimum(prior, PRIOR_SIGMA_S**2)
        information = 1.0 / prior + np.bincount(index, weights=1.0 / noise_s2)
        total = self._mean_s[slots] / prior + np.bincount(index, weights=late_s / noise_s2)
        self._mean_s[slots] = total / information
        self._variance_s2[slots] = 1.0 / information
        # The bias of today is the one that all plots so far have shared, more or less.
        self._floor_s2[slots] = np.bincount(index, weights=floor_s2) / np.bincount(index)
        self._time_s[slots] = np.fmax(newest_s, self._time_s[slots])

    def latency_s(self, slot: Ints) -> tuple[Array, Array]:
        """Latency and its sigma, ``(n,)`` each; 0 and 0.3 where nothing is known. [s]"""
        sigma = np.sqrt(self._variance_s2[slot] + self._floor_s2[slot])
        return self._mean_s[slot], np.minimum(sigma, PRIOR_SIGMA_S)

    def begin_block(self) -> None:
        """What is known now is applied from now on; what was applied still serves for the block before."""
        self._applied_s[:, 1] = self._applied_s[:, 0]
        known = np.flatnonzero(np.isfinite(self._time_s))
        if len(known):
            change = self._believed_s(known) - self._applied_s[known, 0]
            self._applied_s[known, 0] += np.clip(change, -STEP_S, STEP_S)

    def applied_s(self, slot: Ints, before: Bools) -> Array:
        """What is taken out of the stamps of each track's ADS-B ``(n,)``; a slot of -1 is no track yet. [s]"""
        return np.where(slot >= 0, self._applied_s[np.maximum(slot, 0), before.astype(np.int64)], 0.0)

    def _believed_s(self, slots: Ints) -> Array:
        """Latency against the others, weighed by whether an aircraft is one of them or one of the few, ``(n,)``. [s]"""
        prior = PRIOR_SIGMA_S**2
        information = 1.0 / self._variance_s2[slots] - 1.0 / prior
        sure = (information > 0.0) & (1.0 / np.maximum(information, 1e-9) + self._floor_s2[slots] <= KNOWN_SIGMA_S**2)
        noise = np.where(sure, 1.0 / np.where(sure, information, 1.0), 1.0) + self._floor_s2[slots]
        # Without the prior: each aircraft's own evidence.
        seen = np.where(sure, self._mean_s[slots] / (self._variance_s2[slots] * np.where(sure, information, 1.0)), 0.0)
        middle, scatter = _middle_and_scatter(seen[sure], noise[sure])
        away = seen - middle
        as_others = _normal(away, scatter + noise) * (1.0 - LATE_SHARE)
        as_late = _normal(away, prior + noise) * LATE_SHARE
        share_late = as_late / np.maximum(as_late + as_others, 1e-300)
        believed = away * (share_late * prior / (prior + noise) + (1.0 - share_late) * scatter / (scatter + noise))
        return np.where(sure, believed, 0.0)


def _middle_and_scatter(seen_s: Array, noise_s2: Array) -> tuple[float, float]:
    """Median, and the variance between honest aircraft: what the noise of the estimates does not explain. [s, s²]"""
    n = len(seen_s)
    if n < FEWEST:
        return 0.0, 0.0
    middle = float(np.median(seen_s))
    spread = (PER_DEVIATION * float(np.median(np.abs(seen_s - middle)))) ** 2
    noise = float(np.median(noise_s2))
    seen = spread > noise * (1.0 + SCATTER_SIGMAS * DEVIATION_SIGMA / np.sqrt(n))
    return middle, spread - noise if seen else 0.0


def _normal(x: Array, variance: Array) -> Array:
    """Density of a normal distribution, without the constant."""
    return np.exp(-0.5 * x * x / variance) / np.sqrt(variance)
