"""The Kalman filter in plain matrices, for many states at once: what the fast kernels are measured against.

Written to be obviously right: full ``(n, d, d)`` matrices, Joseph's form, one textbook line per operation (Bar-Shalom,
Li & Kirubarajan 2001, ch. 5; Rauch, Tung & Striebel 1965). The offline filters and the reference smoother use it.
"""

from __future__ import annotations

import numpy as np

from aeroskein.plots import Array

__all__ = ["innovation_covariance", "predict", "smooth", "squared_distance", "update"]


def _transposed(M: Array) -> Array:
    return np.swapaxes(M, -1, -2)


def predict(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """Move states ``(..., d)`` and covariances ``(..., d, d)`` by transitions ``F`` with process noise ``Q``."""
    return np.einsum("...ij,...j->...i", F, x), F @ P @ _transposed(F) + Q


def innovation_covariance(P: Array, H: Array, R: Array) -> Array:
    """Covariance ``(..., m, m)`` of the difference between measurement and prediction: ``H P H' + R``."""
    return np.asarray(H @ P @ _transposed(H) + R)


def squared_distance(innovation: Array, S: Array) -> Array:
    """Squared Mahalanobis distance ``(...)`` of innovations ``(..., m)`` with covariances ``(..., m, m)``."""
    whitened = np.linalg.solve(S, innovation[..., None])[..., 0]
    return np.asarray(np.einsum("...i,...i->...", innovation, whitened))


def update(x: Array, P: Array, innovation: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Take measurements in.

    Parameters
    ----------
    x, P : (..., d), (..., d, d) arrays
        Predicted states.
    innovation : (..., m) array
        Measurement minus ``H x``.
    H : (m, d) or (..., m, d) array
        Measurement matrix.
    R : (..., m, m) array
        Covariance of the measurement.

    Returns
    -------
    x, P
        Updated states; covariances by Joseph's form, which stays positive for any gain.
    """
    S = innovation_covariance(P, H, R)
    K = _transposed(np.asarray(np.linalg.solve(S, H @ P), dtype=np.float64))
    x = x + np.einsum("...dm,...m->...d", K, innovation)
    A = np.eye(P.shape[-1]) - K @ H
    return x, A @ P @ _transposed(A) + K @ R @ _transposed(K)


def smooth(
    x: Array, P: Array, F: Array, prior_x: Array, prior_P: Array, next_x: Array, next_P: Array
) -> tuple[Array, Array]:
    """One Rauch-Tung-Striebel step backwards.

    Parameters
    ----------
    x, P : (..., d), (..., d, d) arrays
        Filtered states now.
    F : (..., d, d) array
        Transition to the next instant.
    prior_x, prior_P : (..., d), (..., d, d) arrays
        What was predicted for the next instant from ``x, P``.
    next_x, next_P : (..., d), (..., d, d) arrays
        Smoothed states at the next instant.

    Returns
    -------
    x, P
        Smoothed states now.
    """
    G = _transposed(np.asarray(np.linalg.solve(prior_P, F @ P), dtype=np.float64))
    x = x + np.einsum("...ij,...j->...i", G, next_x - prior_x)
    P = P + G @ (next_P - prior_P) @ _transposed(G)
    return x, 0.5 * (P + _transposed(P))
