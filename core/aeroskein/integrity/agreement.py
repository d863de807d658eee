"""Agreement: do an aircraft's own positions fit what radars see?

Per radar and track the last seconds of differences (radar plot minus own position) are averaged with fading memory;
over all radars also with a longer one. The test is on the mean, less an allowance for what may honestly differ
(latency, satellite navigation, registration), in sigmas of the mean: a jump shows in three looks, a slow drift in the
longer memory, and single wild plots do not, because no look counts more than five sigmas. What an aircraft has always
differed by, its own latency above all, is learned and taken out.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints, columns_of

__all__ = ["Agreement"]

# Memory of each radar's own mean, in its periods, and of the mean over all radars. [s]
FAST_PERIODS: Final = 2.5
SLOW_S: Final = 40.0
# One look counts at most this many sigmas.
CLIP: Final = 5.0
# Sum of fading weights from which there is a mean: three looks, never two.
WEIGHT_MIN: Final = 2.05
# Honest differences of one aircraft, one sigma: latency [s] and position beside the flight [m]; learned looks are
# forgotten over the memory [s].
LATENCY_SIGMA_S: Final = 0.15
ASIDE_SIGMA_M: Final = 12.0
LEARNING_S: Final = 600.0
# What may differ beyond what has been learned: this many of its sigmas, and a rest. [m]
ALLOWED_SIGMAS: Final = 2.5
ALLOWED_M: Final = 20.0
# A look agrees within this squared distance: 99.9 %.
AGREES: Final = 13.8

# Usual time between looks, for forgetting. [s]
LOOK_S: Final = 4.0
# Slower flight has no along. [m/s]
SPEED_MIN_MPS: Final = 40.0
_PRIOR: Final = np.array([LATENCY_SIGMA_S**2, ASIDE_SIGMA_M**2])

# Columns of the sums that a mean is made of: information times difference (2), information (3), sums of weights and of
# squared weights.
_SUMS: Final = 7


class Agreement:
    """Means of differences per sensor and slot.

    Parameters
    ----------
    period_s : (sensors,) array
        Time between two looks of each sensor. [s]
    slots : int
        Track slots.
    """

    def __init__(self, period_s: Array, slots: int) -> None:
        sensors = len(period_s)
        self._memory_s = np.append(FAST_PERIODS * period_s, SLOW_S)
        # By slot and sensor (the last: all sensors, slow memory).
        self._sums = np.zeros((slots, sensors + 1, _SUMS))
        self._time_s = np.full((slots, sensors + 1), -np.inf)
        # Own differences of a track: latency [s] and offset to the right of the flight [m], and their variances.
        self._own = np.zeros((slots, 2))
        self._own_variance = np.tile(_PRIOR, (slots, 1))
        self._speed = np.zeros(slots)
        self._along = np.zeros((slots, 2))

    def grow(self, slots: int) -> None:
        """Make room for more slots."""
        fresh = Agreement(self._memory_s[:-1] / FAST_PERIODS, slots)
        for name, column in vars(self).items():
            if name != "_memory_s":
                getattr(fresh, name)[: len(column)] = column
        vars(self).update(vars(fresh))

    def reset(self, slot: Ints) -> None:
        """Forget these slots."""
        self._sums[slot] = 0.0
        self._time_s[slot] = -np.inf
        self._own[slot] = self._along[slot] = 0.0
        self._own_variance[slot] = _PRIOR
        self._speed[slot] = 0.0

    def forget_slow(self) -> None:
        """Empty the long memory: a radar in doubt has spoilt it."""
        self._sums[:, -1] = 0.0

    def add(
        self,
        sensor: Ints,
        slot: Ints,
        time_s: Array,
        difference_m: Array,
        covariance_m2: Array,
        velocity_mps: Array,
        sure: Bools,
    ) -> Bools:
        """Take looks in, each slot and sensor at most once; gives which of them agree.

        Parameters
        ----------
        sensor, slot : (n,) int64
            Which radar looked at which track.
        time_s : (n,) array
            When. [s since the epoch]
        difference_m : (n, 2) array
            Radar plot minus own position, east and north. [m]
        covariance_m2 : (n, 3) array
            ``[ee, en, nn]`` of it, without the allowances. [m²]
        velocity_mps : (n, 2) array
            Of the aircraft. [m/s]
        sure : (n,) bool array
            False for radars in doubt: their looks are kept apart in their own short memory.
        """
        speed = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1])
        along = velocity_mps / np.maximum(speed, 1.0)[:, None]
        right = columns_of(along[:, 1], -along[:, 0])
        self._speed[slot], self._along[slot] = speed, along
        own = self._own[slot]
        rest = difference_m - (own[:, 0] * speed)[:, None] * along - own[:, 1:2] * right
        inverse = _inverse(covariance_m2)
        distance = np.sqrt(np.maximum(_quadratic(inverse, rest), 0.0))
        weighted = _times(inverse, rest * np.minimum(1.0, CLIP / np.maximum(distance, 1e-12))[:, None])
        one = np.ones(len(slot))
        sums = columns_of(weighted[:, 0], weighted[:, 1], inverse[:, 0], inverse[:, 1], inverse[:, 2], one, one)
        cell = slot * self._time_s.shape[1]
        slow = cell[sure] + len(self._memory_s) - 1
        self._remember(
            np.concatenate([cell + sensor, slow]),
            np.concatenate([time_s, time_s[sure]]),
            np.concatenate([sums, sums[sure]]),
        )
        allowed = self._own_variance[slot] * columns_of(speed**2, np.ones_like(speed))
        agrees = (
            _quadratic(_inverse(covariance_m2 + _turned(allowed + ALLOWED_M**2 / 4.0, along, right)), rest) < AGREES
        )
        learn = agrees & sure & (speed > SPEED_MIN_MPS)
        self._learn(slot[learn], speed[learn], along[learn], right[learn], difference_m[learn], covariance_m2[learn])
        return agrees

    def strength(self, slot: Ints, now_s: float, sure: Bools) -> tuple[Array, Array]:
        """How many sigmas of the mean the own positions are off beyond the allowance.

        Parameters
        ----------
        slot : (n,) int64
            Tracks.
        now_s : float
            [s since the epoch]
        sure : (sensors,) bool array
            Radars whose word counts in the combined mean.

        Returns
        -------
        combined : (n,) array
            Larger of the fast (all sure sensors together) and the slow mean.
        by_sensor : (sensors, n) array
            Of each sensor's own fast mean; 0 where it has not looked lately.
        """
        sensors = len(self._memory_s) - 1
        live = now_s - self._time_s[slot].T < 2.0 * self._memory_s[:, None]
        # Who has looked lately: most sensors never do, ADS-B for one.
        lately = np.flatnonzero(live.any(axis=1))
        by_sensor = np.zeros((sensors, len(slot)))
        if not len(lately):
            return np.zeros(len(slot)), by_sensor
        sums = np.empty((_SUMS, len(lately) + 1, len(slot)))
        np.multiply(self._sums[slot[:, None], lately].T, live[lately], out=sums[:, :-1])
        fast = np.flatnonzero((lately < sensors) & np.append(sure, False)[lately])
        sums[:, -1] = sums[:, fast].sum(axis=1)
        sigmas = self._sigmas(sums, slot)
        of_sensor = lately < sensors
        by_sensor[lately[of_sensor]] = sigmas[:-1][of_sensor]
        slow = sigmas[-2] if lately[-1] == sensors else np.zeros(len(slot))
        return np.maximum(sigmas[-1], slow), by_sensor

    def _sigmas(self, sums: Array, slot: Ints) -> Array:
        """Sigmas beyond the allowance of means given by their sums ``(7, means, n)``: ``(means, n)``."""
        y0, y1, a, b, c, w1, w2 = sums
        some = w1 > WEIGHT_MIN
        determinant = np.where(some, a * c - b * b, 1.0)
        mean0, mean1 = (c * y0 - b * y1) / determinant, (a * y1 - b * y0) / determinant
        size = np.hypot(mean0, mean1)
        at_least = np.maximum(size, 1e-9)
        d0, d1 = mean0 / at_least, mean1 / at_least
        variance = (c * d0 * d0 - 2.0 * b * d0 * d1 + a * d1 * d1) / determinant * (w2 / np.maximum(w1, 1e-9))
        along, speed = self._along[slot].T, self._speed[slot]
        beyond = size - self._allowance(slot, speed, along[0] * d0 + along[1] * d1)
        return np.where(some, np.maximum(beyond, 0.0) / np.sqrt(np.maximum(variance, 1e-9)), 0.0)

    def _allowance(self, slot: Ints, speed: Array, cos: Array) -> Array:
        """Honest difference at an angle to the flight, given its cosine ``(means, n)``. [m]"""
        late, aside = self._own_variance[slot].T
        squared = cos * cos
        variance = late * speed * speed * squared + aside * (1.0 - np.minimum(squared, 1.0))
        allowed: Array = ALLOWED_M + ALLOWED_SIGMAS * np.sqrt(variance)
        return allowed

    def _remember(self, cell: Ints, time_s: Array, sums: Array) -> None:
        """Let what the cells ``(n,)`` (slot and sensor) hold fade until now, and add to it."""
        order = np.argsort(cell, kind="stable")
        begins = np.flatnonzero(np.diff(cell[order], prepend=-1))
        if len(begins) < len(cell):
            # Two radars may look at one track in one batch: both count in the common row.
            time_s = np.maximum.reduceat(time_s[order], begins)
            sums = np.add.reduceat(sums[order], begins, axis=0)
            cell = cell[order][begins]
        held, times = self._sums.reshape(-1, _SUMS), self._time_s.reshape(-1)
        old = times[cell]
        step_s = np.where(np.isfinite(old), np.maximum(time_s - old, 0.0), np.inf)
        keep = np.exp(-step_s / self._memory_s[cell % len(self._memory_s)])
        faded = held[cell] * keep[:, None]
        faded[:, -1] *= keep
        held[cell] = faded + sums
        times[cell] = np.maximum(time_s, old)

    def _learn(
        self, slot: Ints, speed: Array, along: Array, right: Array, difference_m: Array, covariance_m2: Array
    ) -> None:
        """Two scalar Kalman filters per track; a track that several radars saw at once learns from one of them."""
        seen = np.stack([np.einsum("nc,nc->n", difference_m, a) for a in (along, right)], axis=-1)
        noise = np.stack([_quadratic(covariance_m2, a) for a in (along, right)], axis=-1)
        seen[:, 0] /= speed
        noise[:, 0] /= speed**2
        prior = np.minimum(self._own_variance[slot] + _PRIOR * (LOOK_S / LEARNING_S), _PRIOR)
        gain = prior / (prior + noise)
        self._own[slot] += gain * (seen - self._own[slot])
        self._own_variance[slot] = (1.0 - gain) * prior


def _turned(along_and_right: Array, along: Array, right: Array) -> Array:
    """Packed covariance ``[ee, en, nn]`` from variances along and across a flight, ``(n, 2)``."""
    a, r = along_and_right[:, 0:1], along_and_right[:, 1:2]
    return a * along[:, [0, 0, 1]] * along[:, [0, 1, 1]] + r * right[:, [0, 0, 1]] * right[:, [0, 1, 1]]


def _inverse(packed: Array) -> Array:
    a, b, c = packed[:, 0], packed[:, 1], packed[:, 2]
    return columns_of(c, -b, a) / (a * c - b * b)[:, None]


def _quadratic(packed: Array, v: Array) -> Array:
    out: Array = packed[:, 0] * v[:, 0] ** 2 + 2.0 * packed[:, 1] * v[:, 0] * v[:, 1] + packed[:, 2] * v[:, 1] ** 2
    return out


def _times(packed: Array, v: Array) -> Array:
    return np.stack(
        [packed[:, 0] * v[:, 0] + packed[:, 1] * v[:, 1], packed[:, 1] * v[:, 0] + packed[:, 2] * v[:, 1]], axis=-1
    )
