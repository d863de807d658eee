"""Step 5 of the published ADS-B filter: which reports are outliers, and when the filter is the one that is wrong.

An observation further from its prediction than a number of sigmas (Mahalanobis) is not used; the prediction stands in
its place. The publication leaves open what happens when the filter has gone astray and refuses the truth for ever; so
after a few refusals in a row the next position is believed, with the covariance widened until it lies at one sigma.

Recorded traffic shows how filters go astray: an aircraft brakes on the runway while its reported velocity stays frozen
for a minute. So a velocity that came with a refused position counts for nothing until another value is reported.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["Gate"]

# Two reported velocities closer than this are the same value: an eighth of a knot, half the finest step in use. Turned
# into the plane a value changes by less between two reports. [m/s]
SAME_VELOCITY_MPS: Final = 0.06


class Gate:
    """Refusals in a row of each lane.

    Parameters
    ----------
    lanes : int
        Flights.
    sigmas : float
        Largest distance that is accepted.
    reopen_after : int
        Refusals in a row after which a position is believed.
    """

    def __init__(self, lanes: int, sigmas: float, reopen_after: int) -> None:
        self.limit = sigmas**2
        self.reopen_after = reopen_after
        self.refused: Ints = np.zeros(lanes, dtype=np.int64)
        self._distrusted_mps: Array = np.full((lanes, 2), np.nan)

    def judge(self, squared_distance: Array, observed: Bools, velocity_mps: Array) -> tuple[Bools, Array]:
        """Accept or refuse one report per lane.

        Parameters
        ----------
        squared_distance : (m,) array
            Mahalanobis distance of the first ``m`` lanes.
        observed : (m,) bool
            Lanes that have a position at all.
        velocity_mps : (m, 2) array
            Reported velocity, NaN where none. [m/s]

        Returns
        -------
        accepted : (m,) bool
            Lanes to update.
        widen : (m,) array
            Factor for the predicted covariance before the update, 1 usually.
        """
        refused = self.refused[: len(observed)]
        outside = observed & ~(squared_distance <= self.limit)
        believed = outside & (refused >= self.reopen_after)
        refused[:] = np.where(observed, np.where(outside & ~believed, refused + 1, 0), refused)
        self._distrusted_mps[: len(observed)][outside] = velocity_mps[outside]
        return observed & (~outside | believed), np.where(believed, squared_distance, 1.0)

    def trusts(self, velocity_mps: Array) -> Bools:
        """Lanes whose reported velocity ``(m, 2)`` [m/s] exists and is not that of a refused report, ``(m,)``."""
        distrusted = self._distrusted_mps[: len(velocity_mps)]
        same = np.hypot(*(velocity_mps - distrusted).T) < SAME_VELOCITY_MPS
        # Once another value came, the old one may come again.
        distrusted[~same] = np.nan
        return np.asarray(np.isfinite(velocity_mps[:, 0]) & ~same)
