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

_TABLES: Final = ("_y", "_info", "_w1", "_w2", "_time_s")


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
        # Per sensor (the last row: all sensors, slow memory), by slot: information times difference, information, sums
        # of weights and squared weights, time.
        self._y = np.zeros((sensors + 1, slots, 2))
        self._info = np.zeros((sensors + 1, slots, 3))
        self._w1 = np.zeros((sensors + 1, slots))
        self._w2 = np.zeros((sensors + 1, slots))
        self._time_s = np.full((sensors + 1, slots), -np.inf)
        # Own differences of a track: latency [s] and offset to the right of the flight [m], and their variances.
        self._own = np.zeros((slots, 2))
        self._own_variance = np.tile(_PRIOR, (slots, 1))
        self._speed = np.zeros(slots)
        self._along = np.zeros((slots, 2))

    def grow(self, slots: int) -> None:
        """Make room for more slots."""
        fresh = Agreement(self._memory_s[:-1] / FAST_PERIODS, slots)
        for name, column in vars(self).items():
            if name in _TABLES:
                getattr(fresh, name)[:, : column.shape[1]] = column
            elif name != "_memory_s":
                getattr(fresh, name)[: len(column)] = column
        vars(self).update(vars(fresh))

    def reset(self, slot: Ints) -> None:
        """Forget these slots."""
        for name, column in vars(self).items():
            if name in _TABLES:
                column[:, slot] = -np.inf if name == "_time_s" else 0.0
            elif name != "_memory_s":
                column[slot] = _PRIOR if name == "_own_variance" else 0.0

    def forget_slow(self) -> None:
        """Empty the long memory: a radar in doubt has spoilt it."""
        for name in ("_y", "_info", "_w1", "_w2"):
            getattr(self, name)[-1] = 0.0

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
        self._remember(sensor, slot, time_s, weighted, inverse)
        every = np.full(int(sure.sum()), len(self._y) - 1)
        self._remember(every, slot[sure], time_s[sure], weighted[sure], inverse[sure])
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
        sensors = len(self._y) - 1
        age_s = now_s - self._time_s[:, slot]
        live = (age_s < 2.0 * self._memory_s[:, None]).astype(np.float64)
        by_sensor = np.stack([self._sigmas(k, k, slot, live[k : k + 1]) for k in range(sensors)])
        together = self._sigmas(0, sensors - 1, slot, live[:sensors] * sure[:, None])
        slow = self._sigmas(sensors, sensors, slot, live[sensors:])
        return np.maximum(together, slow), by_sensor

    def _sigmas(self, first: int, last: int, slot: Ints, live: Array) -> Array:
        if not live.any():
            return np.zeros(len(slot))
        rows = slice(first, last + 1)
        info = np.einsum("sk,skc->kc", live, self._info[rows][:, slot])
        y = np.einsum("sk,skc->kc", live, self._y[rows][:, slot])
        w1 = np.einsum("sk,sk->k", live, self._w1[rows][:, slot])
        w2 = np.einsum("sk,sk->k", live, self._w2[rows][:, slot])
        some = w1 > WEIGHT_MIN
        info = np.where(some[:, None], info, np.array([1.0, 0.0, 1.0]))
        covariance = _inverse(info) * (w2 / np.maximum(w1, 1e-9))[:, None]
        mean = _times(_inverse(info), y)
        size = np.linalg.norm(mean, axis=1)
        direction = mean / np.maximum(size, 1e-9)[:, None]
        sigma = np.sqrt(np.maximum(_quadratic(covariance, direction), 1e-9))
        allowed = self._allowance(slot, self._along[slot], self._speed[slot], direction)
        return np.where(some, np.maximum(size - allowed, 0.0) / sigma, 0.0)

    def _allowance(self, slot: Ints, along: Array, speed: Array, direction: Array) -> Array:
        """Honest difference in a direction, ``(n,)``. [m]"""
        cos = np.einsum("nc,nc->n", along, direction)
        late, aside = self._own_variance[slot].T
        variance = late * (speed * cos) ** 2 + aside * (1.0 - np.minimum(cos**2, 1.0))
        allowed: Array = ALLOWED_M + ALLOWED_SIGMAS * np.sqrt(variance)
        return allowed

    def _remember(self, row: Ints, slot: Ints, time_s: Array, weighted: Array, inverse: Array) -> None:
        self._fade(row, slot, time_s)
        # Two radars may look at one track in one batch: both count in the common row.
        np.add.at(self._y, (row, slot), weighted)
        np.add.at(self._info, (row, slot), inverse)
        np.add.at(self._w1, (row, slot), 1.0)
        np.add.at(self._w2, (row, slot), 1.0)

    def _fade(self, row: Ints, slot: Ints, time_s: Array) -> None:
        if not len(slot):
            return
        slots = self._time_s.shape[1]
        r, s = np.divmod(np.unique(row * slots + slot), slots)
        order = np.argsort(slot, kind="stable")
        begins = np.flatnonzero(np.diff(slot[order], prepend=-1))
        newest = np.maximum.reduceat(time_s[order], begins)[np.searchsorted(slot[order][begins], s)]
        old = self._time_s[r, s]
        step_s = np.where(np.isfinite(old), np.maximum(newest - old, 0.0), np.inf)
        keep = np.exp(-step_s / self._memory_s[r])
        self._y[r, s] *= keep[:, None]
        self._info[r, s] *= keep[:, None]
        self._w1[r, s] *= keep
        self._w2[r, s] *= keep**2
        self._time_s[r, s] = np.maximum(newest, old)

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
