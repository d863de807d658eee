"""What a filter leaves behind: one estimate per report, the same shape for all models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, taken

__all__ = ["Filtered"]


@dataclass(slots=True, eq=False)
class Filtered:
    """Estimates at the times of the reports, one row each.

    Attributes
    ----------
    position_m, position_cov_m2 : (n, 2), (n, 2, 2) float64
        East and north in the flight's plane. [m, m²]
    velocity_mps, velocity_cov_m2ps2 : (n, 2), (n, 2, 2) float64
        [m/s, m²/s²]
    accepted : (n,) bool
        Whether the position was used; where not, the estimate is the prediction.
    correction : (n,) float64
        Distance between estimate and report, in sigmas of the report (Mahalanobis, with R alone); a report that was
        not accepted counts with the gate's value, NaN where there is no position.
    """

    position_m: Array
    position_cov_m2: Array
    velocity_mps: Array
    velocity_cov_m2ps2: Array
    accepted: Bools
    correction: Array

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows."""
        return taken(self, rows)

    @classmethod
    def empty(cls, n: int) -> Self:
        """Room for ``n`` estimates."""
        pair, matrix = np.full((n, 2), np.nan), np.full((n, 2, 2), np.nan)
        return cls(pair, matrix, pair.copy(), matrix.copy(), np.zeros(n, dtype=np.bool_), np.full(n, np.nan))

    def correct(self, reported_m: Array, R: Array, gate_sigmas: float) -> None:
        """Fill ``correction`` from the reported positions ``(n, 2)`` and their covariances ``(n, 2, 2)``."""
        observed = np.isfinite(reported_m[:, 0])
        moved = np.where(observed[:, None], self.position_m - reported_m, 0.0)
        sigmas = np.sqrt(np.einsum("ni,ni->n", moved, np.linalg.solve(R, moved[..., None])[..., 0]))
        self.correction = np.where(observed, np.where(self.accepted, sigmas, gate_sigmas), np.nan)
