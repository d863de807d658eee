"""Handover: registration of radars whose own processor applies it (``correction = "sensor"``).

What such a radar sends is already corrected by what was published before, so the estimate is only what is left. Every
so often that rest is added to the published value at once; plots of the next half minute are not used, because nobody
knows when the radar took the new value over. If the rest is still there afterwards, the radar does not apply it: then
nothing more is handed over and an operator is told.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["SIGNIFICANT", "Handover"]

# A rest smaller than this is not worth a change: range m, azimuth deg, time s, gain.
SIGNIFICANT: Final = np.array([3.0, 0.004, 0.03, 2e-5])
# ... nor one smaller than this many of its sigmas.
SIGMAS: Final = 2.0
# After a handover plots are not used: the state is published every 10 s, and the radar may need two turns. [s]
PAUSE_S: Final = 30.0
# Time between handovers; the first comes after convergence. [s]
EVERY_S: Final = 90.0
# Sigma of a handed over value, as its share: whether all of it was taken over is to be seen.
SLACK_SHARE: Final = 0.5
# Share of a handed over value that is still there when the radar does not apply it.
STILL_THERE: Final = 0.6


class Handover:
    """Per sensor: what has been handed over, and whether the radar applies it."""

    def __init__(self, by_sensor: Bools, start: Array) -> None:
        self.by_sensor = by_sensor
        # Cumulative value that the radar applies: the published bias.
        self.applied = np.where(by_sensor[:, None], start, 0.0)
        self.ignored = np.zeros(len(by_sensor), dtype=np.bool_)
        self._pending = np.zeros_like(self.applied)
        self._paused_until_s = np.full(len(by_sensor), -np.inf)
        self._next_s = np.full(len(by_sensor), -np.inf)

    def usable(self, sensor: Ints, time_s: Array) -> Bools:
        """Which plots may be used, ``(n,)``."""
        return time_s >= self._paused_until_s[sensor]

    def due(self, now_s: float, rest: Array, sigma: Array, converged: Bools) -> Ints:
        """Sensors whose rest ``(sensors, 4)`` is to be handed over now."""
        large = ((np.abs(rest) > SIGNIFICANT) & (np.abs(rest) > SIGMAS * sigma)).any(axis=1)
        return np.flatnonzero(self.by_sensor & ~self.ignored & converged & large & (now_s >= self._next_s))

    def hand_over(self, sensor: int, rest: Array, now_s: float) -> tuple[Array, Array]:
        """Add the rest to what the radar applies; gives the change of the estimate and its sigma, ``(4,)`` each."""
        pending = self._pending[sensor]
        scale = SIGNIFICANT**-2
        worth = float(pending @ (scale * pending))
        if worth > 0.0 and float(rest @ (scale * pending)) / worth > STILL_THERE:
            self.applied[sensor] -= pending
            self.ignored[sensor] = True
            return np.zeros(4), np.zeros(4)
        self.applied[sensor] += rest
        self._pending[sensor] = rest
        self._paused_until_s[sensor] = now_s + PAUSE_S
        self._next_s[sensor] = now_s + EVERY_S
        return -rest, SLACK_SHARE * np.abs(rest)

    def restart(self, sensor: int, applied: Array) -> None:
        """Begin anew: the radar is told to apply this."""
        if self.by_sensor[sensor]:
            self.applied[sensor] = applied
        self.ignored[sensor] = False
        self._pending[sensor] = 0.0
        self._paused_until_s[sensor] = self._next_s[sensor] = -np.inf

    def export(self) -> dict[str, Any]:
        """Plain content for a snapshot."""
        return {"applied": self.applied.tolist(), "ignored": self.ignored.tolist()}

    def load(self, content: dict[str, Any], old: Ints, new: Ints) -> None:
        """Take an ``export`` over for sensors ``new`` that were ``old``."""
        self.applied[new] = np.where(self.by_sensor[new, None], np.array(content["applied"])[old], 0.0)
        self.ignored[new] = np.array(content["ignored"], dtype=np.bool_)[old]
