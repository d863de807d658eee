"""Own positions (ADS-B) as integrity remembers them: the newest of every track, unless it stands alone.

Now and then a report lies kilometres beside the flight, and the next one is right again. Two radars that look within
that second would both speak against an honest aircraft, so a position that does not follow from the one before waits
for the next: if that does not follow either, the aircraft, or what is said of it, has really moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.lanes import newest_of_each
from aeroskein.plots import Array, Bools, Ints

__all__ = ["OWN_AGE_S", "NewestOwn", "OwnPositions"]

# Own positions older than this are not extrapolated to a plot, nor expected to be seen. [s]
OWN_AGE_S: Final = 4.0
# What does not follow from the position before lies further from where that leads. [sigma], [m], [m/s²]
SLIP_SIGMAS: Final = 6.0
SLIP_M: Final = 50.0
SLIP_MPS2: Final = 6.0


@dataclass(slots=True, eq=False)
class OwnPositions:
    """ADS-B reports, ``(n,)`` columns: slot, time, place and velocity in the track's plane, covariance of the place.

    Attributes
    ----------
    slot : int64
        Track slot.
    time_s : float64
        [s since the epoch]
    place_m, velocity_mps : (n, 2) float64
        East and north. [m, m/s]
    covariance_m2 : (n, 3) float64
        ``[ee, en, nn]``, with the part from the time stamp. [m²]
    """

    slot: Ints
    time_s: Array
    place_m: Array
    velocity_mps: Array
    covariance_m2: Array


class NewestOwn:
    """By slot: ``time_s (slots,)``, -inf where there is none, and ``rows (slots, 7)``: place, velocity, covariance."""

    def __init__(self, slots: int) -> None:
        self.time_s = np.full(slots, -np.inf)
        self.rows = np.zeros((slots, 7))
        # Whether the last report stood alone.
        self._slipped = np.zeros(slots, dtype=np.bool_)

    def grow(self, slots: int) -> None:
        """Make room for more slots."""
        more = NewestOwn(slots - len(self.time_s))
        for name, column in vars(self).items():
            setattr(self, name, np.concatenate([column, getattr(more, name)]))

    def forget(self, slot: Ints) -> None:
        """These slots have none: new tracks, or tracks whose plane has moved."""
        self.time_s[slot] = -np.inf
        self._slipped[slot] = False

    def take(self, reports: OwnPositions) -> None:
        """Take reports in; of several of one track the newest counts."""
        place, velocity = reports.place_m.T, reports.velocity_mps.T
        finite = np.isfinite(place[0] + place[1] + velocity[0] + velocity[1])
        rows = (finite & (reports.time_s > self.time_s[reports.slot])).nonzero()[0]
        rows = rows[newest_of_each(reports.slot[rows], reports.time_s[rows])]
        slot = reports.slot[rows]
        time_s = reports.time_s[rows]
        own = np.concatenate((reports.place_m[rows], reports.velocity_mps[rows], reports.covariance_m2[rows]), axis=1)
        believed = self._follows(slot, time_s, own) | self._slipped[slot]
        self._slipped[slot] = ~believed
        self.time_s[slot[believed]] = time_s[believed]
        self.rows[slot[believed]] = own[believed]

    def _follows(self, slot: Ints, time_s: Array, own: Array) -> Bools:
        """Which of these follow from the one before, as far as that is recent enough to say, ``(n,)``."""
        step_s, before = time_s - self.time_s[slot], self.rows[slot]
        recent = step_s < OWN_AGE_S
        step_s = np.where(recent, step_s, 0.0)
        away = own[:, 0:2] - before[:, 0:2] - before[:, 2:4] * step_s[:, None]
        sigma = np.sqrt(own[:, 4] + own[:, 6] + before[:, 4] + before[:, 6])
        limit = SLIP_M + SLIP_SIGMAS * sigma + 0.5 * SLIP_MPS2 * step_s**2
        follows: Bools = ~recent | (np.hypot(away[:, 0], away[:, 1]) <= limit)
        return follows
