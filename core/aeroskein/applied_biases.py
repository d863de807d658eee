"""Applied biases: the registration that is in force for reports stamped in the present block and in the one before."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, Ints, Plots
from aeroskein.units import wrap_azimuth_deg

__all__ = ["CORRECTED", "AppliedBiases"]

# The columns of reports that registration corrects.
CORRECTED: Final = ("range_m", "azimuth_deg", "time_s")


class AppliedBiases:
    """Tables by block (0 present, 1 before) and sensor.

    Parameters
    ----------
    correction, sigma : (sensors, 4) arrays
        Range, azimuth, time and gain to take out, and one sigma of what is left then. [m, deg, s, 1]
    uncertain : (sensors,) bool array
        Radars whose registration has not converged.
    """

    def __init__(self, correction: Array, sigma: Array, uncertain: Bools) -> None:
        self.uncertain = uncertain
        self._correction = np.stack([correction, correction])
        self._sigma = np.stack([sigma, sigma])

    def begin_block(self, correction: Array, sigma: Array, uncertain: Bools) -> None:
        """A new block begins with these; what was in force still serves for the one before."""
        self.uncertain = uncertain
        self._correction = np.stack([correction, self._correction[0]])
        self._sigma = np.stack([sigma, self._sigma[0]])

    def replace(self, correction: Array, sigma: Array, uncertain: Bools) -> None:
        """These are in force at once, for both blocks."""
        self.__init__(correction, sigma, uncertain)  # type: ignore[misc]

    def correct(self, raw: Plots, before: Bools, rows: Ints) -> Plots:
        """Take the biases out of some rows; ``before`` ``(n,)`` marks reports of the block before."""
        if not len(rows):
            return raw
        bias = self._correction[before[rows].astype(np.int64), raw.sensor[rows]].T
        range_m, azimuth_deg, time_s = raw.range_m.copy(), raw.azimuth_deg.copy(), raw.time_s.copy()
        range_m[rows] = np.maximum((range_m[rows] - bias[0]) / (1.0 + bias[3]), 0.0)
        azimuth_deg[rows] = wrap_azimuth_deg(azimuth_deg[rows] - bias[1])
        time_s[rows] -= bias[2]
        return replace(raw, range_m=range_m, azimuth_deg=azimuth_deg, time_s=time_s)

    def sigmas(self, sensor: NDArray[np.int16], before: Bools) -> Array:
        """One sigma of what is left in range, azimuth, time and gain, ``(n, 4)``. [m, deg, s, 1]"""
        return np.asarray(self._sigma[before.astype(np.int64), sensor])

    def time_sigma_s(self, sensor: NDArray[np.int16], before: Bools) -> Array:
        """The third of these alone, ``(n,)``. [s]"""
        return np.asarray(self._sigma[before.astype(np.int64), sensor, 2])
