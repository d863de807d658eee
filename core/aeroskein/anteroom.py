"""The anteroom: where plots without any name wait for the other plots of their scan.

Whose plot it is in a formation can only be decided for all plots of the formation together, and they do not arrive
together. So a radar plot that has neither an address nor a number of the radar's own tracker waits until it is two
seconds old: long enough for its neighbours, too short for an element to miss it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Plots

__all__ = ["Anteroom"]

# Usual delays of radar plots are below this. [s]
AGE_S: Final = 2.0
NOBODY: Final = Plots.of(0)


class Anteroom:
    """Holds nameless plots back.

    Parameters
    ----------
    is_radar : (sensors,) bool array
        Which sensors are radars.
    """

    def __init__(self, is_radar: Bools) -> None:
        self._is_radar = is_radar
        self._waiting = NOBODY
        self._until_s: Array = np.zeros(0)

    def let_in(self, plots: Plots, now_s: float) -> Plots:
        """Reports whose turn it is: those that waited long enough, then those that need not wait."""
        out = self.due(now_s)
        nameless = self._is_radar[plots.sensor] & (plots.address < 0) & (plots.local_track < 0)
        if not nameless.any():
            return Plots.concatenate([out, plots]) if len(out) else plots
        # A clock that is ahead must not keep a plot waiting longer.
        until_s = np.fmin(np.fmin(plots.time_s, plots.received_s), now_s) + AGE_S
        stays = nameless & (until_s > now_s)
        kept = np.flatnonzero(stays)
        self._waiting = Plots.concatenate([self._waiting, plots.take(kept)])
        self._until_s = np.concatenate([self._until_s, until_s[kept]])
        return Plots.concatenate([out, plots.take(np.flatnonzero(~stays))])

    def due(self, now_s: float) -> Plots:
        """Plots that have waited long enough; all of them at the end of time."""
        done = self._until_s <= now_s
        if not done.any():
            return NOBODY
        out = self._waiting.take(np.flatnonzero(done))
        self._waiting, self._until_s = self._waiting.take(np.flatnonzero(~done)), self._until_s[~done]
        return out

    @property
    def next_s(self) -> float:
        """When the next plot has waited long enough; infinity where none waits. [s since the epoch]"""
        return float(self._until_s.min(initial=np.inf))
