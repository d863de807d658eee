"""Jumps: has a radar's bias changed at once, as after maintenance?

A generalised likelihood ratio over the last seconds of innovations: how much better are they explained by one common
shift of range, azimuth and time than by none? Both sides are counted with Huber's cost, so that a few wild plots decide
nothing, and most rows, of at least two aircraft, must be better off. Rows outside the filter's gate are looked at too,
because after a large jump all of them are outside.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Ints

__all__ = ["JumpWatch"]

# How far back innovations are compared. [s]
WINDOW_S: Final = 40.0
# Rows kept: 40 s of a 4 s radar over 50 aircraft.
CAPACITY: Final = 512
# Rows needed before a shift is believed.
ROWS_MIN: Final = 12
# Gain in twice the log likelihood that counts as a jump: chi-square with 3 degrees of freedom reaches 60 with
# probability 6e-13; the margin is for noise that is not what the settings say.
GAIN_MIN: Final = 60.0
# It must stay above for this long: one odd scan is not a jump. [s]
PERSIST_S: Final = 8.0
# Share of rows that the shift must explain better.
SHARE_MIN: Final = 0.65
# Smaller shifts [m, deg, s] are left to the drift of the filter.
SHIFT_MIN: Final = np.array([15.0, 0.02, 0.1])
# Knee of Huber's cost, in sigmas.
KNEE: Final = 2.0
_ITERATIONS: Final = 6
# A weak prior keeps directions that the traffic does not show at zero.
_PRIOR: Final = np.diag([1.0 / 3000.0**2, 1.0 / 5.0**2, 1.0 / 5.0**2])


class JumpWatch:
    """Sliding window over one radar's innovations."""

    def __init__(self) -> None:
        self.clear()
        self.quiet_until_s = -np.inf

    def clear(self) -> None:
        """Forget the window."""
        self._time_s = np.empty(0)
        self._aircraft = np.empty(0, dtype=np.int64)
        # Whitened innovations and sensitivities: unit variance, so that costs are plain squares.
        self._white = np.empty((0, 2))
        self._of_shift = np.empty((0, 2, 3))
        self._since_s = np.inf

    def add(self, time_s: Array, aircraft: Ints, innovation_m: Array, spread_m2: Array, of_bias: Array) -> None:
        """Take innovations in: ``(n,)``, ``(n,)``, ``(n, 2)``, ``(n, 2, 2)`` and ``(n, 2, 4)``, ordered by time."""
        whiten = np.linalg.inv(np.linalg.cholesky(spread_m2))
        self._time_s = np.concatenate([self._time_s, time_s])[-CAPACITY:]
        self._aircraft = np.concatenate([self._aircraft, aircraft])[-CAPACITY:]
        self._white = np.concatenate([self._white, np.einsum("nij,nj->ni", whiten, innovation_m)])[-CAPACITY:]
        self._of_shift = np.concatenate([self._of_shift, whiten @ of_bias[:, :, :3]])[-CAPACITY:]

    def check(self, now_s: float) -> tuple[float, Array] | None:
        """How surely a shift has happened, and the shift ``[range m, azimuth deg, time s]``; None where none has."""
        keep = self._time_s > now_s - WINDOW_S
        if not keep.all():
            self._time_s, self._aircraft = self._time_s[keep], self._aircraft[keep]
            self._white, self._of_shift = self._white[keep], self._of_shift[keep]
        if now_s < self.quiet_until_s or len(self._time_s) < ROWS_MIN or (self._aircraft == self._aircraft[0]).all():
            return None
        shift = self._best_shift()
        before, after = _huber(_length(self._white)), _huber(_length(self._white - self._of_shift @ shift))
        gain = float(before.sum() - after.sum())
        is_jump = gain > GAIN_MIN and bool((np.abs(shift) > SHIFT_MIN).any())
        # One aircraft, one voice: each counts by the share of its own rows that are better off.
        if not is_jump or _mean_by(self._aircraft, (after < before).astype(np.float64)).mean() <= SHARE_MIN:
            self._since_s = np.inf
            return None
        self._since_s = min(self._since_s, now_s)
        return (gain, shift) if now_s - self._since_s >= PERSIST_S else None

    def _best_shift(self) -> Array:
        """Least squares with Huber's weights, begun at the medians, so that a jump of any size is found."""
        diagonal = np.maximum(np.abs(self._of_shift[:, [0, 1], [0, 1]]), 1e-12)
        shift = np.zeros(3)
        shift[:2] = np.median(self._white / diagonal, axis=0)
        # Both components of every row below each other.
        white, of_shift = self._white.ravel(), self._of_shift.reshape(-1, 3)
        for _ in range(_ITERATIONS):
            distance = _length((white - of_shift @ shift).reshape(-1, 2))
            weight = np.minimum(1.0, KNEE / np.maximum(distance, 1e-12))
            weighted = (of_shift * np.repeat(weight, 2)[:, None]).T
            shift = np.linalg.solve(weighted @ of_shift + _PRIOR, weighted @ white)
        return shift


def _length(vectors: Array) -> Array:
    """Lengths of vectors ``(n, 2)``."""
    return np.hypot(vectors[:, 0], vectors[:, 1])


def _huber(distance: Array) -> Array:
    """Twice the negative log likelihood: square up to the knee, then straight."""
    return np.where(distance < KNEE, distance**2, KNEE * (2.0 * distance - KNEE))


def _mean_by(key: Ints, value: Array) -> Array:
    _, index, count = np.unique(key, return_inverse=True, return_counts=True)
    return np.bincount(index, weights=value) / count
