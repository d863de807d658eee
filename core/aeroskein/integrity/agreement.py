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

from aeroskein.lanes import continues
from aeroskein.plots import Array, Bools, Ints, columns_of

__all__ = ["LEAST_SIGMAS", "Agreement"]

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

# Nobody asks how much less than this a mean is off. [sigma]
LEAST_SIGMAS: Final = 3.0

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
        self._sums = np.zeros((_SUMS, slots, sensors + 1))
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
            if name == "_sums":
                fresh._sums[:, : column.shape[1]] = column
            elif name != "_memory_s":
                getattr(fresh, name)[: len(column)] = column
        vars(self).update(vars(fresh))

    def reset(self, slot: Ints) -> None:
        """Forget these slots."""
        self._sums[:, slot] = 0.0
        self._time_s[slot] = -np.inf
        self._own[slot] = self._along[slot] = 0.0
        self._own_variance[slot] = _PRIOR
        self._speed[slot] = 0.0

    def forget_slow(self) -> None:
        """Empty the long memory: a radar in doubt has spoilt it."""
        self._sums[:, :, -1] = 0.0

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
        self._speed[slot], self._along[slot] = speed, along
        flight = along.T.copy()
        right = np.array([flight[1], -flight[0]])
        difference, covariance, own = difference_m.T, covariance_m2.T, self._own[slot].T
        rest = difference - own[0] * speed * flight - own[1] * right
        inverse = _inverse(covariance)
        distance = np.sqrt(np.maximum(_quadratic(inverse, rest), 0.0))
        clipped = rest * np.minimum(1.0, CLIP / np.maximum(distance, 1e-12))
        sums = np.ones((_SUMS, len(slot)))
        sums[0] = inverse[0] * clipped[0] + inverse[1] * clipped[1]
        sums[1] = inverse[1] * clipped[0] + inverse[2] * clipped[1]
        sums[2:5] = inverse
        cell = slot * self._time_s.shape[1]
        self._remember(cell + sensor, time_s, sums)
        # Two radars may look at one track in one batch: both count in the common row.
        self._remember(*_summed(cell[sure] + len(self._memory_s) - 1, time_s[sure], sums[:, sure]))
        late, aside = self._own_variance[slot].T
        allowed = _turned(late * speed**2 + ALLOWED_M**2 / 4.0, aside + ALLOWED_M**2 / 4.0, flight, right)
        agrees = _quadratic(_inverse(covariance + allowed), rest) < AGREES
        learn = (agrees & sure & (speed > SPEED_MIN_MPS)).nonzero()[0]
        self._learn(
            slot[learn], speed[learn], flight[:, learn], right[:, learn], difference[:, learn], covariance[:, learn]
        )
        return agrees

    def strength(self, slot: Ints, now_s: float, sure: Bools) -> tuple[Array, Array]:
        """How many sigmas of the mean the own positions are off beyond the allowance; 0 where surely few.

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
        cell = slot * (sensors + 1) + lately[:, None]
        sums = np.empty((_SUMS, len(lately) + 1, len(slot)))
        np.multiply(self._sums.reshape(_SUMS, -1)[:, cell], live[lately], out=sums[:, :-1])
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
        # A mean has in no direction more sigmas than in all, and hardly any has as many as somebody asks for.
        squared = (c * y0 * y0 - 2.0 * b * y0 * y1 + a * y1 * y1) * w1
        few = squared <= LEAST_SIGMAS**2 * (a * c - b * b) * w2
        mean, lane = ((w1 > WEIGHT_MIN) & ~few).nonzero()
        sigmas = np.zeros(w1.shape)
        if len(lane):
            sigmas[mean, lane] = self._beyond(sums[:, mean, lane], slot[lane])
        return sigmas

    def _beyond(self, sums: Array, slot: Ints) -> Array:
        """The same for means that are known, one of each slot: ``(7, n)`` to ``(n,)``."""
        y0, y1, a, b, c, w1, w2 = sums
        determinant = a * c - b * b
        mean0, mean1 = (c * y0 - b * y1) / determinant, (a * y1 - b * y0) / determinant
        size = np.hypot(mean0, mean1)
        at_least = np.maximum(size, 1e-9)
        d0, d1 = mean0 / at_least, mean1 / at_least
        variance = (c * d0 * d0 - 2.0 * b * d0 * d1 + a * d1 * d1) / determinant * (w2 / w1)
        along, speed = self._along[slot].T, self._speed[slot]
        beyond = size - self._allowance(slot, speed, along[0] * d0 + along[1] * d1)
        return np.asarray(np.maximum(beyond, 0.0) / np.sqrt(np.maximum(variance, 1e-9)))

    def _allowance(self, slot: Ints, speed: Array, cos: Array) -> Array:
        """Honest difference at an angle to the flight, given its cosine ``(n,)``. [m]"""
        late, aside = self._own_variance[slot].T
        squared = cos * cos
        variance = late * speed * speed * squared + aside * (1.0 - np.minimum(squared, 1.0))
        allowed: Array = ALLOWED_M + ALLOWED_SIGMAS * np.sqrt(variance)
        return allowed

    def _remember(self, cell: Ints, time_s: Array, sums: Array) -> None:
        """Let what the cells ``(n,)`` (slot and sensor, each once) hold fade until now, and add to it."""
        held, times = self._sums.reshape(_SUMS, -1), self._time_s.reshape(-1)
        old = times[cell]
        step_s = np.where(np.isfinite(old), np.maximum(time_s - old, 0.0), np.inf)
        keep = np.exp(-step_s / self._memory_s[cell % len(self._memory_s)])
        faded = held[:, cell] * keep
        faded[-1] *= keep
        held[:, cell] = faded + sums
        times[cell] = np.maximum(time_s, old)

    def _learn(
        self, slot: Ints, speed: Array, along: Array, right: Array, difference_m: Array, covariance_m2: Array
    ) -> None:
        """Two scalar Kalman filters per track; a track that several radars saw at once learns from one of them.

        Columns ``(n,)``, vectors ``(2, n)``, and covariances ``(3, n)``.
        """
        seen = columns_of((difference_m * along).sum(axis=0) / speed, (difference_m * right).sum(axis=0))
        noise = columns_of(_quadratic(covariance_m2, along) / speed**2, _quadratic(covariance_m2, right))
        prior = np.minimum(self._own_variance[slot] + _PRIOR * (LOOK_S / LEARNING_S), _PRIOR)
        gain = prior / (prior + noise)
        self._own[slot] += gain * (seen - self._own[slot])
        self._own_variance[slot] = (1.0 - gain) * prior


def _summed(cell: Ints, time_s: Array, sums: Array) -> tuple[Ints, Array, Array]:
    """Rows of one cell together: each cell once, its newest time, and the sum of its sums ``(7, n)``."""
    order = np.argsort(cell, kind="stable")
    first = (~continues(cell[order])).nonzero()[0]
    if len(first) == len(cell):
        return cell, time_s, sums
    return (
        cell[order][first],
        np.maximum.reduceat(time_s[order], first),
        np.add.reduceat(sums[:, order], first, axis=1),
    )


def _turned(lengthwise: Array, across: Array, along: Array, right: Array) -> Array:
    """Packed covariance ``[ee, en, nn]`` ``(3, n)`` from variances along and across a flight; vectors ``(2, n)``."""
    return np.array(
        [
            lengthwise * along[0] * along[0] + across * right[0] * right[0],
            lengthwise * along[0] * along[1] + across * right[0] * right[1],
            lengthwise * along[1] * along[1] + across * right[1] * right[1],
        ]
    )


def _inverse(packed: Array) -> Array:
    """Inverse of packed covariances ``(3, n)``."""
    a, b, c = packed
    return np.asarray(np.array([c, -b, a]) / (a * c - b * b))


def _quadratic(packed: Array, v: Array) -> Array:
    """``vᵀ C v`` of packed covariances ``(3, n)`` and vectors ``(2, n)``."""
    out: Array = packed[0] * v[0] ** 2 + 2.0 * packed[1] * v[0] * v[1] + packed[2] * v[1] ** 2
    return out
