"""Step 5 of the published ADS-B filter: which reports are outliers, and when the filter is the one that is wrong.

An observation further from its prediction than a number of sigmas (Mahalanobis) is not used; the prediction stands in
its place. The publication leaves open what happens when the filter has gone astray and refuses the truth for ever; so
after a few refusals in a row the next position is believed, with the covariance widened until it lies at one sigma.
"""

from __future__ import annotations

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["Gate"]


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

    def judge(self, squared_distance: Array, observed: Bools) -> tuple[Bools, Array]:
        """Accept or refuse one report per lane.

        Parameters
        ----------
        squared_distance : (m,) array
            Mahalanobis distance of the first ``m`` lanes.
        observed : (m,) bool
            Lanes that have a position at all.

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
        return observed & (~outside | believed), np.where(believed, squared_distance, 1.0)
