"""The backward pass over many tracks at once: what later reports say about an earlier state.

Smoothing in adjoint form (modified Bryson-Frazier; Bierman 1977, "Factorization Methods for Discrete Sequential
Estimation"): no matrix is inverted, and nothing is needed of the forward pass but the gains of its updates. Lanes come
last and contiguous, as in ``kalman``, whose states and covariance rows these are.
"""

from __future__ import annotations

import numpy as np

from aeroskein.kalman import Gains, to_matrix
from aeroskein.plots import Array, Ints

__all__ = ["Adjoint"]


class Adjoint:
    """The backward pass: what later reports say about an earlier state, as (lambda, Lambda).

    Walk the events from last to first: ``through_update`` for each update (velocity, then position), then for the time
    step before it ``through_turn`` and ``through_step``. At any instant the smoothed state is ``x - P lambda`` with
    covariance ``P - P Lambda P``, x and P being the filter's there.
    """

    def __init__(self, n: int) -> None:
        # Lambda in columns 0 to 5 and lambda in column 6: what goes over rows goes over both.
        self.columns = np.zeros((6, 7, n))

    @property
    def vector(self) -> Array:
        """lambda ``(6, n)``, a view."""
        return self.columns[:, 6]

    @property
    def matrix(self) -> Array:
        """Lambda ``(6, 6, n)``, a view."""
        return self.columns[:, :6]

    def lanes(self, m: int) -> Adjoint:
        """The first ``m`` lanes, as a view."""
        part = Adjoint.__new__(Adjoint)
        part.columns = self.columns[:, :, :m]
        return part

    def through_update(self, first: int, g: Gains) -> None:
        """Go back through an update of position (``first = 0``) or velocity (``first = 2``)."""
        C, rows = self.columns, slice(first, first + 2)
        # a' Lambda, a' lambda + m and G = I + a' Lambda a side by side. a and m are zero where nothing was used.
        B = np.empty((2, 9, C.shape[2]))
        np.einsum("ijn,kin->kjn", C, g.a, out=B[:, :7])
        B[:, 6] += g.m
        np.einsum("kin,lin->kln", B[:, :6], g.a, out=B[:, 7:9])
        B[0, 7] += 1.0
        B[1, 8] += 1.0
        # H' times all that, H whitened like the rest; its scale is zero where nothing was used.
        B *= g.scale[:, None]
        B[0] -= g.ell * B[1]
        C[rows] -= B[:, :7]
        C[:, rows] -= B[:, :6].swapaxes(0, 1)
        G = B[:, 7:9] * g.scale
        G[:, 0] -= g.ell * G[:, 1]
        # Symmetric to the last bit, or long gaps would lose half of their digits.
        G[1, 0] = G[0, 1]
        C[rows, rows] += G

    def through_turn(self, lanes: Ints, cos: Array, sin: Array) -> None:
        """Go back through a turn of some lanes' acceleration: by the transposed rotation."""
        C = self.columns[:, :, lanes]
        C[4], C[5] = cos * C[4] + sin * C[5], cos * C[5] - sin * C[4]
        C[:, 4], C[:, 5] = cos * C[:, 4] + sin * C[:, 5], cos * C[:, 5] - sin * C[:, 4]
        self.columns[:, :, lanes] = C

    def through_step(self, h: Array) -> None:
        """Go back over a time step ``h`` ``(n,)`` [s]: Lambda becomes F' Lambda F."""
        C = self.columns
        g = 0.5 * h * h
        C[2:6] += h * C[0:4]
        C[4:6] += g * C[0:2]
        C[:, 2:6] += h * C[:, 0:4]
        C[:, 4:6] += g * C[:, 0:2]

    def smooth(self, x: Array, P: Array) -> tuple[Array, Array]:
        """Smoothed state ``(6, n)`` and full covariance ``(n, 6, 6)`` where the filter had ``x`` and ``P``."""
        full = to_matrix(P)
        L = self.matrix.transpose(2, 0, 1)
        smoothed = x - np.einsum("nij,jn->in", full, self.vector)
        return smoothed, full - full @ L @ full
