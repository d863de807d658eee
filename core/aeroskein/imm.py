"""Interacting multiple models: mixing, mode probabilities and smoothing, for any models over one common state.

Blom & Bar-Shalom (1988), "The interacting multiple model algorithm for systems with Markovian switching coefficients",
IEEE Trans. Automatic Control 33(8), for the filter. Smoothing: the probabilities after Kim (1994), "Dynamic linear
models with Markov-switching", Journal of Econometrics 60; the state by Gaussian smoothing (Särkkä 2013, "Bayesian
Filtering and Smoothing", ch. 10) of the joint moments that all models together give before and after each step. Arrays
lead with the model: states ``(M, n, d)``, covariances ``(M, n, d, d)``, probabilities ``(M, n)``.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import unscented
from aeroskein.plots import Array
from aeroskein.unscented import Prediction, difference

__all__ = [
    "gaussian_log_likelihood",
    "mix",
    "mixture",
    "reweigh",
    "smooth",
    "smoothed_probabilities",
    "transition_probabilities",
]

# exp(A) = exp(A / 2^s)^(2^s): with ten halvings a minute of the fastest rates in use is a step below 0.02, where six
# terms of the series are exact to the last bit.
_HALVINGS: Final = 10
_SERIES_TERMS: Final = 6

# A model never vanishes wholly, or it could not come back after long steady flight.
LOWEST_PROBABILITY: Final = 1e-12


def transition_probabilities(rates_per_s: Array, dt_s: Array) -> Array:
    """Transition probabilities of a Markov chain in continuous time.

    Parameters
    ----------
    rates_per_s : (M, M) array
        Rate of change from row to column; the diagonal is ignored (it is minus the sum of the others). [1/s]
    dt_s : (n,) array
        Time between two reports. [s]

    Returns
    -------
    (n, M, M) array
        ``exp(A dt)``; rows sum to 1, and two steps make exactly the step of their sum.
    """
    A = np.array(rates_per_s, dtype=np.float64)
    np.fill_diagonal(A, 0.0)
    np.fill_diagonal(A, -A.sum(axis=1))
    small = A * (np.asarray(dt_s, dtype=np.float64) / 2.0**_HALVINGS)[..., None, None]
    identity = np.eye(len(A))
    T = identity + small / _SERIES_TERMS
    for k in range(_SERIES_TERMS - 1, 0, -1):
        T = identity + (small @ T) / k
    for _ in range(_HALVINGS):
        T = T @ T
    return np.asarray(T / T.sum(axis=-1, keepdims=True))


def mixture(x: Array, P: Array, weights: Array, angle: int | None) -> tuple[Array, Array]:
    """Mean ``(n, d)`` and covariance ``(n, d, d)`` of Gaussian mixtures, weights ``(M, n)`` summing to 1."""
    centre = x[0]
    mean = centre + np.einsum("mn,mnd->nd", weights, difference(x, centre, angle))
    d = difference(x, mean, angle)
    covariance = np.einsum("mn,mnij->nij", weights, P + d[..., :, None] * d[..., None, :])
    if angle is not None:
        mean = difference(mean, np.zeros(1), angle)
    return mean, covariance


def mix(x: Array, P: Array, mu: Array, T: Array, angle: int | None) -> tuple[Array, Array, Array]:
    """Let the models interact before the next prediction.

    Parameters
    ----------
    x, P, mu : (M, n, d), (M, n, d, d), (M, n) arrays
        Filtered models.
    T : (n, M, M) array
        Transition probabilities, from row to column.
    angle : int or None
        Component that is an angle.

    Returns
    -------
    x, P : (M, n, d), (M, n, d, d) arrays
        The state from which each model predicts.
    predicted : (M, n) array
        Probability of each model before the report.
    """
    joint = T.transpose(1, 2, 0) * mu[:, None, :]  # (from, to, n)
    predicted = joint.sum(axis=0)
    mixed = [mixture(x, P, joint[:, j] / predicted[j], angle) for j in range(len(x))]
    return np.stack([m for m, _ in mixed]), np.stack([c for _, c in mixed]), predicted


def gaussian_log_likelihood(innovation: Array, S: Array) -> Array:
    """Logarithm of the density of innovations ``(..., m)`` with covariances ``(..., m, m)``."""
    _, log_determinant = np.linalg.slogdet(S)
    d2 = np.einsum("...i,...i->...", innovation, np.linalg.solve(S, innovation[..., None])[..., 0])
    return np.asarray(-0.5 * (d2 + log_determinant + innovation.shape[-1] * np.log(2.0 * np.pi)))


def reweigh(predicted: Array, log_likelihood: Array) -> Array:
    """Probabilities of the models after a report, all ``(M, n)``; the logarithm keeps far reports from underflow."""
    likelihood = np.exp(log_likelihood - log_likelihood.max(axis=0))
    mu = np.maximum(predicted * likelihood, LOWEST_PROBABILITY * predicted.max(axis=0) * likelihood.max(axis=0))
    return np.asarray(mu / mu.sum(axis=0))


def smoothed_probabilities(mu: Array, T: Array, next_mu: Array) -> Array:
    """Probability of each model given all reports (Kim 1994): given the next model, the future says no more.

    Parameters
    ----------
    mu : (M, n) array
        Filtered probabilities now.
    T : (n, M, M) array
        Transition probabilities to the next instant.
    next_mu : (M, n) array
        Smoothed probabilities at the next instant.

    Returns
    -------
    (M, n) array
        Smoothed probabilities now.
    """
    joint = T.transpose(1, 2, 0) * mu[:, None, :]
    smoothed = (joint * (next_mu / joint.sum(axis=0))).sum(axis=1)
    return np.asarray(smoothed / smoothed.sum(axis=0))


def smooth(
    mixed_x: Array, mixed_P: Array, moved: Prediction, next_mu: Array, next_x: Array, next_P: Array, angle: int | None
) -> tuple[Array, Array]:
    """One step backwards through a step that several models made together.

    Each model gives one Gaussian of the states at both ends of the step (its mixed state, its prediction, and their
    cross covariance). Weighted by the smoothed probabilities of the models over that step, their moments make one joint
    Gaussian, and through that goes the Rauch-Tung-Striebel step. Smoothing model by model and mixing backwards fails
    here: each mixing hands one model's past to another, which its gain then takes for news from the future, step after
    step (along the flight it ended up worse than the filter).

    Parameters
    ----------
    mixed_x, mixed_P : (M, n, d), (M, n, d, d) arrays
        States from which each model predicted.
    moved : Prediction
        Predictions of all models and their cross covariances.
    next_mu : (M, n) array
        Smoothed probabilities of the models over the step.
    next_x, next_P : (n, d), (n, d, d) arrays
        Smoothed state after the step.
    angle : int or None
        Component that is an angle.

    Returns
    -------
    x, P : (n, d), (n, d, d) arrays
        Smoothed state before the step.
    """
    x, P = mixture(mixed_x, mixed_P, next_mu, angle)
    prior_x, prior_P = mixture(moved.x, moved.P, next_mu, angle)
    before, after = difference(mixed_x, x, angle), difference(moved.x, prior_x, angle)
    cross = np.einsum("mn,mnij->nij", next_mu, moved.cross + before[..., :, None] * after[..., None, :])
    return unscented.smooth(x, P, next_x, next_P, Prediction(prior_x, prior_P, cross), angle)
