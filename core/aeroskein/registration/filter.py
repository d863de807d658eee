"""The Kalman filter over the biases of radars that share airspace, and over what the aircraft themselves get wrong.

State: four biases per radar (drifting slowly), the error that the heights of all aircraft have in common (where only
pressure altitude is known, the weather puts all of them wrong alike), and for each aircraft in use the latency of its
ADS-B and its position offset (first-order Gauss-Markov processes). Carrying the aircraft's errors as states keeps the
filter honest: plots of one aircraft share them, so a thousand plots of one aircraft never count as a thousand
witnesses, and no single aircraft can pull a radar further than its own errors are believed to reach. Because all radars
are in one state, plots of two radars without ADS-B between them tie their biases together with the right correlation.

Kalman filter with considered (Schmidt) states for radars an operator has frozen; residuals are bounded by Huber's
weight. Units: metres, degrees, seconds.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.rows import BIASES, NUISANCES, Rows

__all__ = ["GATE", "BiasFilter"]

# Squared statistical distance (two components) beyond which a comparison is an outlier: 3e-7 by chance.
GATE: Final = 30.0
# Statistical distance beyond which a comparison loses weight: heavy tails of azimuth begin there.
HUBER: Final = 3.0
# Rounds in which rows are weighted anew; each about halves the pull of a wild one.
REWEIGHTINGS: Final = 8
# Factor on the noise of a row that is left out.
REJECTED: Final = 1e8
# Rows handled at once: small enough that the first gate is not the prior's, large enough for numpy.
CHUNK: Final = 48

# Random walk of the biases in one second: 2 m, 0.002 deg, 0.01 s and 2e-6 in an hour. Thermal drift is that slow;
# faster changes are jumps and are found as such.
DRIFT_PER_ROOT_S: Final = np.array([2.0, 0.002, 0.01, 2e-6]) / 60.0

# Latency of ADS-B: scatter between aircraft [s] and how long one aircraft keeps its own [s].
LATENCY_SIGMA_S: Final = 0.1
LATENCY_MEMORY_S: Final = 1800.0
# Offset of an ADS-B position: satellite navigation, per axis [m], and how long it lasts [s].
OFFSET_SIGMA_M: Final = 5.0
OFFSET_MEMORY_S: Final = 60.0
# How long the weather keeps what it does to the heights of all aircraft. [s]
HEIGHT_MEMORY_S: Final = 6.0 * 3600.0


class BiasFilter:
    """Joint estimate for ``k`` radars with up to ``capacity`` aircraft.

    Parameters
    ----------
    mean, sigma : (k, 4) array
        Prior of range [m], azimuth [deg], time [s] and range gain; a gain sigma of 0 keeps the gain where it is.
    capacity : int
        Aircraft whose errors are states at the same time.
    """

    def __init__(self, mean: Array, sigma: Array, capacity: int) -> None:
        self.radars = len(mean)
        self.capacity = capacity
        self.time_s = -np.inf
        self.latency_sigma_s = LATENCY_SIGMA_S
        self.offset_sigma_m = OFFSET_SIGMA_M
        self.used = 0
        self.considered = np.zeros(self.radars, dtype=np.bool_)
        self.gain_free = np.zeros(self.radars, dtype=np.bool_)
        n = self._first + NUISANCES * capacity
        self._x = np.zeros(n)
        self._P = np.zeros((n, n))
        self._memory_s = np.full(n, np.inf)
        self._memory_s[self.head] = HEIGHT_MEMORY_S
        self._memory_s[self._first :] = np.tile([LATENCY_MEMORY_S, OFFSET_MEMORY_S, OFFSET_MEMORY_S], capacity)
        for radar in range(self.radars):
            self.restart(radar, mean[radar], sigma[radar])
        self._P[self.head, self.head] = 1.0
        self.clear_aircraft(np.arange(capacity))

    @property
    def head(self) -> int:
        """Number of bias states; the common height error comes after them, then the aircraft."""
        return BIASES * self.radars

    @property
    def _first(self) -> int:
        return self.head + 1

    @property
    def biases(self) -> Array:
        """Means, ``(k, 4)``."""
        return self._x[: self.head].reshape(self.radars, BIASES)

    @property
    def bias_covariance(self) -> Array:
        """Joint covariance, ``(k, 4, k, 4)``."""
        return self._P[: self.head, : self.head].reshape(self.radars, BIASES, self.radars, BIASES)

    def restart(self, radar: int, mean: Array, sigma: Array) -> None:
        """Forget what is known of one radar; it no longer has anything in common with the rest."""
        states = slice(BIASES * radar, BIASES * (radar + 1))
        self._x[states] = mean
        self._P[states] = 0.0
        self._P[:, states] = 0.0
        self._P[states, states] = np.diag(np.square(sigma))
        self.gain_free[radar] = sigma[3] > 0.0

    def shift(self, radar: int, change: Array, slack: Array) -> None:
        """Move one radar's biases by a known change that is uncertain by the sigmas ``slack``, ``(4,)`` each."""
        states = np.arange(BIASES * radar, BIASES * (radar + 1))
        self._x[states] += change
        self._P[states, states] += np.square(slack)

    def free_gain(self, radar: int, sigma: float, mean_range_m: float) -> None:
        """Begin to estimate the range gain of one radar.

        While it was fixed, the range bias stood for both: what was learned is the bias at the mean range of the
        plots, so a gain takes that much back from the bias.
        """
        bias, gain = BIASES * radar, BIASES * radar + 3
        step = np.zeros(len(self._x))
        step[bias], step[gain] = -mean_range_m * sigma, sigma
        self._P += step[:, None] * step
        self.gain_free[radar] = True

    def load(self, mean: Array, covariance: Array) -> None:
        """Take over means ``(k, 4)`` and joint covariance ``(k, 4, k, 4)``, for example after a restart."""
        self._x[: self.head] = mean.reshape(-1)
        self._P[: self.head, :] = 0.0
        self._P[:, : self.head] = 0.0
        self._P[: self.head, : self.head] = covariance.reshape(self.head, self.head)
        self.gain_free = np.diagonal(self._P)[3 : self.head : BIASES] > 0.0

    def clear_aircraft(self, slots: Ints) -> None:
        """Give these places to new aircraft: prior errors, nothing in common with anything."""
        states = (self._first + NUISANCES * slots[:, None] + np.arange(NUISANCES)).reshape(-1)
        self._x[states] = 0.0
        self._P[states, :] = 0.0
        self._P[:, states] = 0.0
        self._P[states, states] = np.tile(self._prior_variance(), len(slots))

    def aircraft_errors(self) -> tuple[Array, Array]:
        """Mean and sigma of ``[latency s, offset east m, offset north m]``, each ``(capacity, 3)``."""
        x, variance = self._x[self._first :], np.diagonal(self._P)[self._first :]
        return x.reshape(-1, NUISANCES), np.sqrt(variance).reshape(-1, NUISANCES)

    def predict(self, time_s: float) -> None:
        """Let time pass: biases drift, aircraft forget. Time never goes back."""
        step_s = time_s - self.time_s
        if not step_s > 0.0:
            return
        self.time_s = time_s
        if not np.isfinite(step_s):
            return
        n = self._active
        keep = np.exp(-step_s / self._memory_s[:n])
        gained = np.empty(n)
        drift = np.tile(DRIFT_PER_ROOT_S**2 * step_s, (self.radars, 1))
        drift[:, 3] *= self.gain_free
        gained[: self.head] = drift.reshape(-1)
        gained[self.head] = 1.0 - keep[self.head] ** 2
        gained[self._first :] = np.tile(self._prior_variance(), self.used) * (1.0 - keep[self._first :] ** 2)
        self._x[:n] *= keep
        P = self._P[:n, :n]
        P *= keep[:, None]
        P *= keep
        P[np.arange(n), np.arange(n)] += gained

    def update(self, rows: Rows, radar: Ints, other: Ints, slot: Ints) -> tuple[Array, Array]:
        """Take measurements in, at the filter's time.

        Parameters
        ----------
        rows : Rows
            At most a few hundred at a time.
        radar, other, slot : (n,) int64
            Which radar of this filter, which other one (-1: none), and which place of an aircraft (-1: none).

        Returns
        -------
        innovation_m : (n, 2) array
            Measured minus expected before each chunk was taken in. [m]
        spread_m2 : (n, 2, 2) array
            Covariance of the innovation.
        """
        if len(slot):
            self.used = max(self.used, int(slot.max()) + 1)
        if len(rows) <= CHUNK:
            return self._update_chunk(rows, radar, other, slot)
        parts = [
            self._update_chunk(rows.take(part), radar[part], other[part], slot[part])
            for part in np.split(np.arange(len(rows)), range(CHUNK, len(rows), CHUNK))
        ]
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    @property
    def _active(self) -> int:
        return self._first + NUISANCES * self.used

    def _prior_variance(self) -> Array:
        return np.array([self.latency_sigma_s, self.offset_sigma_m, self.offset_sigma_m]) ** 2

    def _sensitivity(self, rows: Rows, radar: Ints, other: Ints, slot: Ints) -> Array:
        """Dense ``(2 n, active states)``."""
        n = len(rows)
        H = np.zeros((n, 2, self._active))
        H[:, :, self.head] = rows.of_height
        for index, start, values in (
            (radar, BIASES * radar, rows.of_sensor),
            (other, BIASES * other, rows.of_other),
            (slot, self._first + NUISANCES * slot, rows.of_aircraft),
        ):
            there = np.flatnonzero(index >= 0)
            columns = start[there, None] + np.arange(values.shape[2])
            H[there[:, None, None], np.arange(2)[:, None], columns[:, None, :]] = values[there]
        return H.reshape(2 * n, -1)

    def _update_chunk(self, rows: Rows, radar: Ints, other: Ints, slot: Ints) -> tuple[Array, Array]:
        n, a = len(rows), self._active
        H = self._sensitivity(rows, radar, other, slot)
        P = self._P[:a, :a]
        innovation = rows.error_m - (H @ self._x[:a]).reshape(n, 2)
        PHt = P @ H.T
        HPHt = H @ PHt
        blocks = HPHt.reshape(n, 2, n, 2)[np.arange(n), :, np.arange(n), :]
        spread = blocks + rows.covariance_m2
        taken, error, noise = _mahalanobis2(innovation, spread) < GATE, innovation, rows.covariance_m2
        if not taken.any():
            return innovation, spread
        if not taken.all():
            both = np.repeat(taken, 2)
            PHt, HPHt, error, noise = PHt[:, both], HPHt[both][:, both], error[taken], noise[taken]
        noise = self._robust_noise(HPHt, error.reshape(-1), noise)
        self._correct(a, PHt, _plus_blocks(HPHt, noise), error.reshape(-1))
        return innovation, spread

    def _robust_noise(self, HPHt: Array, innovation: Array, noise_m2: Array) -> Array:
        """Noise of each row ``(n, 2, 2)``, widened where the row disagrees with what all rows say together.

        The distance is taken after the update, not before: while little is known, a wild plot lies well inside the
        spread of the innovation and would be believed. Huber's weight does not depend on where one starts.
        """
        widened = noise_m2
        distance2 = np.zeros(len(noise_m2))
        for _ in range(REWEIGHTINGS):
            # Residual after the update: R S^-1 innovation, here as innovation - H P Ht S^-1 innovation.
            after = innovation - HPHt @ np.linalg.solve(_plus_blocks(HPHt, widened), innovation)
            distance2 = _mahalanobis2(after.reshape(-1, 2), noise_m2)
            if (distance2 < HUBER**2).all() and widened is noise_m2:
                return noise_m2
            widened = noise_m2 * np.maximum(1.0, np.sqrt(distance2) / HUBER)[:, None, None]
        return np.where((distance2 < GATE)[:, None, None], widened, noise_m2 * REJECTED)

    def _correct(self, a: int, PHt: Array, S: Array, innovation: Array) -> None:
        gain = np.linalg.solve(S, PHt.T).T
        held = self._held_states(a)
        if held.any():
            # Considered states keep mean and variance; what is correlated with them stays consistent.
            gain[held] = 0.0
            cross = gain @ PHt.T
            self._P[:a, :a] += gain @ S @ gain.T - cross - cross.T
        else:
            self._P[:a, :a] -= gain @ PHt.T
        P = self._P[:a, :a]
        P += P.T.copy()
        P *= 0.5
        self._x[:a] += gain @ innovation

    def _held_states(self, a: int) -> Bools:
        held = np.zeros(a, dtype=np.bool_)
        held[: self.head] = np.repeat(self.considered, BIASES)
        return held

    def rescale_latency(self, slots: Ints, sigma_s: float) -> None:
        """Change the believed scatter of latencies, for the aircraft in ``slots`` as if it had been so from the start.

        Dividing a Gaussian posterior by its old prior and multiplying it with the new one is a measurement "latency
        is 0" with the difference of the two informations, which may be negative.
        """
        added = sigma_s**-2 - self.latency_sigma_s**-2
        self.latency_sigma_s = sigma_s
        if len(slots) == 0 or added == 0.0:
            return
        states = self._first + NUISANCES * slots
        a = self._active
        S = self._P[np.ix_(states, states)] + np.eye(len(slots)) / added
        self._correct(a, self._P[:a, states].copy(), S, -self._x[states])


def _plus_blocks(matrix: Array, blocks: Array) -> Array:
    """Add ``(n, 2, 2)`` to the diagonal of ``(2 n, 2 n)``."""
    n = len(blocks)
    out = matrix.copy()
    out.reshape(n, 2, n, 2)[np.arange(n), :, np.arange(n), :] += blocks
    return out


def _mahalanobis2(residual: Array, covariance: Array) -> Array:
    """Squared statistical distances of ``(n, 2)`` under ``(n, 2, 2)``."""
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    x, y = residual[:, 0], residual[:, 1]
    return (c * x**2 - 2.0 * b * x * y + a * y**2) / (a * c - b * b)
