"""Places: which aircraft have states of their own in a bias filter, and which are not to be trusted for now.

A filter can carry the errors of a limited number of aircraft. Each radar may bring in its share; an aircraft keeps its
place, for all radars that see it, until it has been silent for a while.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Bools, Ints

__all__ = ["Places"]

# An aircraft silent this long gives its place away: its latency is worth keeping over a gap. [s]
SILENT_S: Final = 120.0
# How long an aircraft that contradicted the others is left out. [s]
BAN_S: Final = 600.0


class Places:
    """``capacity`` places shared by ``radars`` radars."""

    def __init__(self, capacity: int, radars: int) -> None:
        self.quota = capacity // max(radars, 1)
        self.aircraft = np.full(capacity, -1, dtype=np.int64)
        self.touched_s = np.full(capacity, -np.inf)
        self._home = np.full(capacity, -1, dtype=np.int64)
        self._banned = np.empty(0, dtype=np.int64)
        self._banned_until_s = np.empty(0)

    def assign(self, aircraft: Ints, radar: Ints, time_s: float) -> tuple[Ints, Ints]:
        """Give every row the place of its aircraft.

        Parameters
        ----------
        aircraft, radar : (n,) int64
            Track number, and the radar that saw it (0 to radars - 1).
        time_s : float
            Now. [s since the epoch]

        Returns
        -------
        place : (n,) int64
            -1 where the aircraft has none: no room, or banned.
        fresh : int64 array
            Places that changed hands: their states must be cleared.
        """
        place = self._find(aircraft)
        banned = self.is_banned(aircraft, time_s)
        place[banned] = -1
        wanting = np.flatnonzero((place < 0) & ~banned)
        fresh = np.empty(0, dtype=np.int64)
        if len(wanting):
            new, first = np.unique(aircraft[wanting], return_index=True)
            fresh = self._admit(new, radar[wanting[first]], time_s)
            place = np.where(banned, -1, self._find(aircraft))
        self.touched_s[place[place >= 0]] = time_s
        return place, fresh

    def ban(self, aircraft: Ints, time_s: float) -> Ints:
        """Leave these aircraft out from now on; gives the places that became free."""
        kept = (self._banned_until_s > time_s) & ~np.isin(self._banned, aircraft)
        self._banned = np.concatenate([self._banned[kept], aircraft])
        self._banned_until_s = np.concatenate([self._banned_until_s[kept], np.full(len(aircraft), time_s + BAN_S)])
        place = self._find(aircraft)
        place = place[place >= 0]
        self._release(place)
        return place

    def is_banned(self, aircraft: Ints, time_s: float) -> Bools:
        """Which of these are left out, shape ``(n,)``."""
        if not len(self._banned):
            return np.zeros(len(aircraft), dtype=np.bool_)
        return np.isin(aircraft, self._banned[self._banned_until_s > time_s])

    def clear(self) -> None:
        """Empty all places; bans stay."""
        self._release(np.arange(len(self.aircraft)))

    def _release(self, place: Ints) -> None:
        self.aircraft[place] = -1
        self.touched_s[place] = -np.inf
        self._home[place] = -1

    def _find(self, aircraft: Ints) -> Ints:
        if len(self.aircraft) == 0:
            return np.full(len(aircraft), -1)
        order = np.argsort(self.aircraft, kind="stable")
        at = np.minimum(np.searchsorted(self.aircraft[order], aircraft), len(order) - 1)
        return np.where(self.aircraft[order[at]] == aircraft, order[at], -1)

    def _admit(self, aircraft: Ints, radar: Ints, time_s: float) -> Ints:
        self._release(np.flatnonzero(self.touched_s < time_s - SILENT_S))
        given: list[Ints] = []
        for one in np.unique(radar):
            wanting = aircraft[radar == one]
            room = max(self.quota - int((self._home == one).sum()), 0)
            place = np.flatnonzero(self.aircraft < 0)[: min(room, len(wanting))]
            self.aircraft[place] = wanting[: len(place)]
            self.touched_s[place] = time_s
            self._home[place] = one
            given.append(place)
        return np.concatenate(given)
