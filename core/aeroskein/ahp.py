"""Analytic hierarchy process: from "how much more important is one factor than another" to weights.

The matrix of pairwise comparisons has the weights as its principal eigenvector, and its largest eigenvalue says how
far the comparisons contradict each other. Source: Saaty (1980), "The Analytic Hierarchy Process", as the published
radar-AIS association uses it for distance, ground speed, track angle and altitude or heading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.errors import SettingsError
from aeroskein.plots import Array, Bools

__all__ = ["LARGEST_CONSISTENCY_RATIO", "PairwiseWeights", "pairwise_weights", "renormalise"]

SETTING: Final = "association.pairwise"

# Saaty's limit: with a larger ratio the comparisons are closer to chance than to a judgement.
LARGEST_CONSISTENCY_RATIO: Final = 0.1

# Saaty's mean consistency index of random reciprocal matrices of size 1 to 10.
RANDOM_INDEX: Final = (0.0, 0.0, 0.58, 0.90, 1.12, 1.24, 1.32, 1.41, 1.45, 1.49)

# How far u_ij u_ji may be from one: a matrix typed with two digits (0.33 for 1/3) is meant as reciprocal.
RECIPROCAL_TOLERANCE: Final = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class PairwiseWeights:
    """Weights of the factors, and how well the comparisons fit together.

    Attributes
    ----------
    weights : (k,) array
        Sum 1, in the order of the matrix.
    largest_eigenvalue : float
        k where the comparisons agree perfectly, else more.
    consistency_index : float
        ``(largest_eigenvalue - k) / (k - 1)``.
    consistency_ratio : float
        The index over that of random matrices; 0 for one or two factors, which cannot contradict.
    """

    weights: Array
    largest_eigenvalue: float
    consistency_index: float
    consistency_ratio: float


def pairwise_weights(matrix: Sequence[Sequence[float]] | Array) -> PairwiseWeights:
    """Turn pairwise comparisons into weights.

    Parameters
    ----------
    matrix : (k, k) nested sequence or array
        ``u_ij`` says how many times factor i is as important as factor j; 1 on the diagonal, ``u_ji = 1 / u_ij``;
        up to ten factors.

    Returns
    -------
    PairwiseWeights
        Weights, largest eigenvalue, consistency.

    Raises
    ------
    SettingsError
        With the key ``association.pairwise``: not square, not positive, not reciprocal, or a consistency ratio of
        0.1 or more.
    """
    u = _checked(matrix)
    k = len(u)
    eigenvalues, eigenvectors = np.linalg.eig(u)
    # A positive matrix has one largest eigenvalue, real and positive, with a positive eigenvector (Perron).
    first = int(eigenvalues.real.argmax())
    principal = np.abs(eigenvectors[:, first].real)
    largest = float(eigenvalues[first].real)
    index = max(0.0, (largest - k) / (k - 1)) if k > 1 else 0.0
    ratio = index / RANDOM_INDEX[k - 1] if k > 2 else 0.0
    if ratio >= LARGEST_CONSISTENCY_RATIO:
        _refuse(f"expected comparisons that agree, consistency ratio below 0.1, got {ratio:.3f}")
    return PairwiseWeights(principal / principal.sum(), largest, index, ratio)


def renormalise(weights: Array, present: Bools) -> Array:
    """Share the weight of missing factors out among those that are there.

    Parameters
    ----------
    weights : (k,) array
        Weights of all factors, positive.
    present : (n, k) bool array
        Which factors each candidate pair has; a primary plot has no altitude, a radar no heading.

    Returns
    -------
    (n, k) array
        Rows of sum 1, zero where a factor is missing; NaN in a row without any factor.
    """
    shares = np.where(present, weights, 0.0)
    total = shares.sum(axis=-1, keepdims=True)
    return shares / np.where(total > 0.0, total, np.nan)


def _checked(matrix: Sequence[Sequence[float]] | Array) -> Array:
    k = len(matrix)
    if not 1 <= k <= len(RANDOM_INDEX) or any(len(row) != k for row in matrix):
        _refuse(f"expected a square matrix of 1 to {len(RANDOM_INDEX)} factors, got rows of {[len(r) for r in matrix]}")
    u = np.asarray(matrix, dtype=np.float64)
    if not (np.isfinite(u).all() and (u > 0.0).all()):
        _refuse(f"expected numbers above 0, got {u[~(np.isfinite(u) & (u > 0.0))][0]}")
    contradiction = np.abs(np.log(u) + np.log(u.T))
    i, j = np.unravel_index(int(contradiction.argmax()), u.shape)
    if 1.0 - np.exp(-contradiction[i, j]) > RECIPROCAL_TOLERANCE:
        _refuse(f"expected row {j + 1} column {i + 1} to be 1 / {u[i, j]:g}, got {u[j, i]:g}")
    return u


def _refuse(expected: str) -> None:
    raise SettingsError(SETTING, expected)
