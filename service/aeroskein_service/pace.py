"""How the worker shares its time: when it rests so that input gathers, and what it gives up when there is too much.

Light traffic is worked on as it comes. The busier the worker, the longer it rests after a turn, because a larger batch
costs less per report. Elements close while no input waits for long; else input comes first, for a live point is wanted
now, until elements are late: then each gets half of the worker, whatever one of their portions takes. When input waits
too long all the same, live points are thinned first; when it waits longer still, as much of it is dropped as could not
be worked on in time. All of it ends by itself. Times are arguments.
"""

from __future__ import annotations

from math import exp, inf
from typing import Final

__all__ = ["TURN_BYTES", "Pace"]

# Input worked on in one turn, a few thousand reports: more would cost no less per report, and keep elements waiting.
TURN_BYTES: Final = 500_000
# How far back the worker looks to say how busy it is. [s]
BUSY_S: Final = 0.5
# Below this share of its time it does not rest; at the upper one it rests the longest.
RESTS_FROM, RESTS_MOST_AT = 0.65, 0.95
LINGER_S: Final = 0.02
# Above this share it works on as much as it can at a time.
BUSY_FROM: Final = 0.75
# After a turn of fewer bytes, about a hundred reports, it rests less in proportion: little gathers meanwhile.
GATHERS: Final = 15_000
# Its speed is that of the last few seconds of work. [s]
SPEED_S: Final = 2.0
# Live points are thinned when input has waited this share of the patience, and less so again below the lower one.
THINS_FROM, THINS_UNTIL = 0.5, 0.25
# One live point of a track in so long, step by step, each of them at least this long. [s]
STEPS_S: Final = (0.0, 1.0, 2.0, 4.0)
STEP_S: Final = 0.7
# Input may wait this long for elements that are due. Else they get this share of the time that input takes, and as much
# as it takes when they are late; what one of them has had too much is forgotten beyond a few portions. [s]
WAITS_S: Final = 0.02
# A pass that closes many elements for a busy worker is interrupted by input that has waited so long. [s]
INTERRUPTS_S: Final = 0.05
SHARE: Final = 0.5
LATE_S: Final = 2.0
OWED_S: Final = 0.25
# What is left after dropping waits this share of the patience, so that nothing is dropped at once again. One turn is
# always left: a worker that was only held up has seen too few reports at a time to know how fast it is.
KEEP: Final = 0.5


class Pace:
    """Rest, thinning and dropping.

    Parameters
    ----------
    patience_s : float
        Input that waits longer than this is an overload. [s]
    """

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._busy = 0.0
        self._noted_s = -inf
        self._bytes = self._spent_s = 0.0
        self._taken = 0
        self._step = 0
        self._stepped_s = -inf
        self._owed_s = 0.0

    def worked(self, began_s: float, ended_s: float, taken: int) -> None:
        """Note a turn, and how many bytes of input it worked on."""
        spent_s = ended_s - began_s
        since_s = ended_s - self._noted_s
        self._noted_s, self._taken = ended_s, taken
        self._busy = self._busy * exp(-since_s / BUSY_S) + (1.0 - exp(-min(spent_s, since_s) / BUSY_S))
        fade = exp(-spent_s / SPEED_S)
        self._bytes, self._spent_s = self._bytes * fade + taken, self._spent_s * fade + spent_s

    @property
    def busy(self) -> bool:
        """Whether what costs least matters more than what can wait least."""
        return self._busy > BUSY_FROM

    @property
    def linger_s(self) -> float:
        """How long to rest before input is taken again. [s]"""
        share = (self._busy - RESTS_FROM) / (RESTS_MOST_AT - RESTS_FROM)
        return LINGER_S * min(max(share, 0.0), 1.0) * min(self._taken / GATHERS, 1.0)

    @property
    def patience_while_closing_s(self) -> float:
        """How long input may wait while elements close: the busier the worker, the more is taken in at a time. [s]"""
        return INTERRUPTS_S if self.busy else self.linger_s

    def took_in(self, spent_s: float, late_s: float) -> None:
        """Note how long input was worked on, and how long the oldest element has been due."""
        self._owed_s = min(self._owed_s + spent_s * (1.0 if late_s > LATE_S else SHARE), OWED_S)

    def closed(self, spent_s: float) -> None:
        """Note how long elements were closed."""
        self._owed_s = max(self._owed_s - spent_s, -OWED_S)

    def may_close(self, waited_s: float) -> bool:
        """Whether elements come before input whose oldest has waited so long."""
        return waited_s < WAITS_S or self._owed_s > 0.0

    def excess(self, waited_s: float) -> int | None:
        """How many bytes of input may stay when the oldest has waited so long; None where nothing is to be dropped."""
        if waited_s <= self._patience_s or not self._spent_s:
            return None
        return max(int(KEEP * self._patience_s * self._bytes / self._spent_s), TURN_BYTES)

    def thinning_s(self, waited_s: float, now_s: float) -> float:
        """How far apart the live points of one track are to be, as the oldest input has waited so long. [s]"""
        share = waited_s / self._patience_s
        change = (share > THINS_FROM) - (share < THINS_UNTIL)
        if change and now_s - self._stepped_s >= STEP_S:
            step = min(max(self._step + change, 0), len(STEPS_S) - 1)
            if step != self._step:
                self._step, self._stepped_s = step, now_s
        return STEPS_S[self._step]
