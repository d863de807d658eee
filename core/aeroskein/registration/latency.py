"""Latency of each aircraft's ADS-B, from plots of registered radars.

An aircraft whose ADS-B is ``l`` seconds late seems to be ``l`` times its speed behind where the radar sees it, along
its flight. One Kalman state per track slot: latency, nearly constant, with a prior of 0.3 s. What the radar's own
biases may contribute does not average away over its plots; it is kept apart as a floor of the claimed uncertainty.
Only differences between aircraft are observable: the mean latency of all is what the radars' time biases are measured
against.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Ints

__all__ = ["LatencyEstimator"]

# Latency before anything is known: mean 0, this scatter. [s]
PRIOR_SIGMA_S: Final = 0.3
# Its drift in one second (0.03 s in an hour): equipment, not flight.
DRIFT_S_PER_ROOT_S: Final = 0.0005
# Slower flight says nothing. [m/s]
SPEED_MIN_MPS: Final = 40.0
# Squared distance beyond which a plot is an outlier.
GATE: Final = 16.0
# The ADS-B reference is filtered: its error is shared by neighbouring plots, so a plot counts less.
REFERENCE_CORRELATION: Final = 3.0


class LatencyEstimator:
    """Per track slot: latency and its variance.

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

    def grow(self, capacity: int) -> None:
        """Make room for more slots."""
        fresh = LatencyEstimator(capacity)
        for name, column in vars(self).items():
            getattr(fresh, name)[: len(column)] = column
        vars(self).update(vars(fresh))

    def reset(self, slots: Ints) -> None:
        """Forget these slots: they belong to new tracks."""
        self._mean_s[slots] = 0.0
        self._variance_s2[slots] = PRIOR_SIGMA_S**2
        self._floor_s2[slots] = 0.0
        self._time_s[slots] = np.nan

    def update(
        self,
        slot: Ints,
        time_s: Array,
        residual_m: Array,
        velocity_mps: Array,
        plot_cov_m2: Array,
        reference_cov_m2: Array,
        bias_cov_m2: Array,
    ) -> None:
        """Learn from radar plots of converged radars beside the ADS-B of the same aircraft.

        Parameters
        ----------
        slot : (n,) int64
            Track slot; a slot may occur several times, rows of one slot are averaged.
        time_s : (n,) array
            Corrected time of the plot. [s since the epoch]
        residual_m : (n, 2) array
            Corrected plot minus ADS-B state at that time, east and north. [m]
        velocity_mps : (n, 2) array
            Velocity, east and north. [m/s]
        plot_cov_m2, reference_cov_m2, bias_cov_m2 : (n, 3) array
            ``[ee, en, nn]``: noise of the plot, of the reference, and ``Registration.bias_covariance``. [m²]
        """
        speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
        keep = np.isfinite(residual_m).all(axis=1) & (speed > SPEED_MIN_MPS)
        if not keep.any():
            return
        slot, time_s, speed = slot[keep], time_s[keep], speed[keep]
        along = velocity_mps[keep] / speed[:, None]
        # p_adsb = p(t - l): the plot lies v l ahead of the reference.
        late_s = np.einsum("ni,ni->n", along, residual_m[keep]) / speed
        noise_m2 = _along(along, plot_cov_m2[keep]) + REFERENCE_CORRELATION * _along(along, reference_cov_m2[keep])
        noise_s2 = noise_m2 / speed**2
        floor_s2 = _along(along, bias_cov_m2[keep]) / speed**2
        inside = (late_s - self._mean_s[slot]) ** 2 < GATE * (self._variance_s2[slot] + noise_s2 + floor_s2)
        if inside.any():
            self._fuse(slot[inside], time_s[inside], late_s[inside], noise_s2[inside], floor_s2[inside])

    def _fuse(self, slot: Ints, time_s: Array, late_s: Array, noise_s2: Array, floor_s2: Array) -> None:
        slots, index = np.unique(slot, return_inverse=True)
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


def _along(direction: Array, packed: Array) -> Array:
    e, n = direction[:, 0], direction[:, 1]
    return packed[:, 0] * e**2 + 2.0 * packed[:, 1] * e * n + packed[:, 2] * n**2
