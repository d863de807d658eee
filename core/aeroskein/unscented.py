"""The unscented Kalman filter for many states at once, with angles among them.

Sigma points and weights after van der Merwe (2004), "Sigma-Point Kalman Filters for Probabilistic Inference in Dynamic
State-Space Models", scaled form; smoothing after Särkkä (2008), "Unscented Rauch-Tung-Striebel Smoother", IEEE Trans.
Automatic Control 53(3). Angles: every difference is wrapped, and the mean is taken of the differences to the central
point, so it neither depends on where the circle is cut nor bends for unequal weights, as a mean of sines would.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aeroskein.motion import wrap_yaw
from aeroskein.plots import Array

__all__ = [
    "Prediction",
    "SigmaPoints",
    "difference",
    "positive",
    "predict",
    "predict_measurement",
    "smooth",
    "update",
]


@dataclass(frozen=True, slots=True)
class SigmaPoints:
    """Van der Merwe's scaled sigma points.

    Attributes
    ----------
    alpha : float
        Spread of the points, 0 < alpha <= 1.
    beta : float
        2 is best for a Gaussian.
    kappa : float
        Secondary scale; ``alpha**2 * (d + kappa)`` must stay above 0.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def weights(self, d: int) -> tuple[Array, Array, float]:
        """Weights of mean and covariance ``(2d+1,)`` and the factor of the covariance's root, for dimension ``d``."""
        scale = self.alpha**2 * (d + self.kappa)
        mean = np.full(2 * d + 1, 0.5 / scale)
        mean[0] = (scale - d) / scale
        covariance = mean.copy()
        covariance[0] += 1.0 - self.alpha**2 + self.beta
        return mean, covariance, scale

    def of(self, x: Array, P: Array) -> Array:
        """Points ``(..., 2d+1, d)`` of states ``(..., d)`` with covariances ``(..., d, d)``; angles are not wrapped."""
        _, _, scale = self.weights(x.shape[-1])
        steps = np.swapaxes(root(P * scale), -1, -2)
        centre = x[..., None, :]
        return np.concatenate([centre, centre + steps, centre - steps], axis=-2)


class Prediction(NamedTuple):
    """A state after a step: mean ``(..., d)``, covariance, and cross covariance with the state before."""

    x: Array
    P: Array
    cross: Array


def root(P: Array) -> Array:
    """Lower triangular root of covariances ``(..., d, d)``; what rounding made indefinite is lifted to zero first."""
    try:
        return np.asarray(np.linalg.cholesky(P))
    except np.linalg.LinAlgError:
        values, vectors = _lifted(P)
        # A root only has to satisfy L L' = P; the triangle is the QR factor of the symmetric one.
        halves = np.sqrt(values)[..., :, None] * np.swapaxes(vectors, -1, -2)
        return np.asarray(np.swapaxes(np.linalg.qr(halves, mode="r"), -1, -2))


def positive(P: Array) -> Array:
    """Covariances ``(..., d, d)`` made symmetric, and positive where rounding has made them indefinite.

    After a minute without reports variances of 10¹⁰ m² stand beside such of 10⁻⁶ rad², and a difference of two such
    matrices is only as good as double precision. Each component keeps its own unit: the matrix is scaled to a unit
    diagonal before its eigenvalues are looked at.
    """
    P = 0.5 * (P + np.swapaxes(P, -1, -2))
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        scale = np.sqrt(np.maximum(np.abs(np.diagonal(P, axis1=-2, axis2=-1)), np.finfo(np.float64).tiny))
        correlations = P / (scale[..., :, None] * scale[..., None, :])
        values, vectors = _lifted(correlations)
        lifted = (vectors * values[..., None, :]) @ np.swapaxes(vectors, -1, -2)
        P = lifted * scale[..., :, None] * scale[..., None, :]
    return P


def _lifted(P: Array) -> tuple[Array, Array]:
    """Eigenvalues, none below a hair of the largest, and eigenvectors."""
    values, vectors = np.linalg.eigh(0.5 * (P + np.swapaxes(P, -1, -2)))
    # Relative to the largest, far below what any report could tell.
    return np.maximum(values, 1e-13 * np.abs(values[..., -1:])), vectors


def difference(a: Array, b: Array, angle: int | None) -> Array:
    """``a - b`` with component ``angle`` (if any) brought into -π..π."""
    d = a - b
    if angle is not None:
        d[..., angle] = wrap_yaw(d[..., angle])
    return np.asarray(d)


def _moments(points: Array, mean_weights: Array, angle: int | None) -> tuple[Array, Array]:
    """Weighted mean ``(..., d)`` of points ``(..., p, d)``, and their differences to it."""
    centre = points[..., 0, :]
    mean = centre + np.einsum("p,...pd->...d", mean_weights, difference(points, centre[..., None, :], angle))
    if angle is not None:
        mean[..., angle] = wrap_yaw(mean[..., angle])
    return mean, difference(points, mean[..., None, :], angle)


def _cross(a: Array, b: Array, weights: Array) -> Array:
    return np.asarray(np.swapaxes(a * weights[:, None], -1, -2) @ b)


def predict(
    x: Array, P: Array, transition: Callable[[Array], Array], Q: Array, points: SigmaPoints, angle: int | None
) -> Prediction:
    """Move states and covariances through a transition.

    Parameters
    ----------
    x, P : (..., d), (..., d, d) arrays
        State before.
    transition : callable
        Maps points ``(..., 2d+1, d)`` to points of the same shape.
    Q : (..., d, d) array
        Process noise.
    points : SigmaPoints
        How the points are laid.
    angle : int or None
        Component that is an angle in -π..π.
    """
    mean_weights, covariance_weights, _ = points.weights(x.shape[-1])
    before = points.of(x, P)
    mean, after = _moments(transition(before), mean_weights, angle)
    P_after = _cross(after, after, covariance_weights) + Q
    return Prediction(mean, P_after, _cross(difference(before, x[..., None, :], angle), after, covariance_weights))


def predict_measurement(
    x: Array, P: Array, measure: Callable[[Array], Array], R: Array, points: SigmaPoints, angle: int | None
) -> Prediction:
    """Expected measurement ``(..., m)``, its covariance ``(..., m, m)`` with ``R``, and the cross covariance.

    Parameters
    ----------
    x, P : (..., d), (..., d, d) arrays
        Predicted state.
    measure : callable
        Maps points ``(..., 2d+1, d)`` to measurements ``(..., 2d+1, m)`` without angles.
    R : (..., m, m) array
        Covariance of the measurement.
    points, angle
        As in ``predict``.
    """
    mean_weights, covariance_weights, _ = points.weights(x.shape[-1])
    before = points.of(x, P)
    mean, after = _moments(measure(before), mean_weights, None)
    S = _cross(after, after, covariance_weights) + R
    return Prediction(mean, S, _cross(difference(before, x[..., None, :], angle), after, covariance_weights))


def update(x: Array, P: Array, expected: Prediction, innovation: Array, angle: int | None) -> tuple[Array, Array]:
    """Take a measurement in, given what was expected (``predict_measurement``) and the difference ``(..., m)``."""
    K = np.swapaxes(np.linalg.solve(expected.P, np.swapaxes(expected.cross, -1, -2)), -1, -2)
    x = x + np.einsum("...dm,...m->...d", K, innovation)
    if angle is not None:
        x[..., angle] = wrap_yaw(x[..., angle])
    return x, positive(P - K @ expected.P @ np.swapaxes(K, -1, -2))


def smooth(
    x: Array, P: Array, next_x: Array, next_P: Array, prediction: Prediction, angle: int | None
) -> tuple[Array, Array]:
    """One step of Rauch-Tung-Striebel smoothing backwards.

    Parameters
    ----------
    x, P : (..., d), (..., d, d) arrays
        Filtered state.
    next_x, next_P : (..., d), (..., d, d) arrays
        Smoothed state one step later.
    prediction : Prediction
        What the filter predicted for that later instant from ``x, P``.
    angle : int or None
        Component that is an angle.

    Returns
    -------
    x, P
        Smoothed state.
    """
    G = np.swapaxes(np.linalg.solve(prediction.P, np.swapaxes(prediction.cross, -1, -2)), -1, -2)
    x = x + np.einsum("...ij,...j->...i", G, difference(next_x, prediction.x, angle))
    if angle is not None:
        x[..., angle] = wrap_yaw(x[..., angle])
    return x, positive(P + G @ (next_P - prediction.P) @ np.swapaxes(G, -1, -2))
