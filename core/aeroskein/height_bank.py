"""Filters of one flight at several heights, each of two kinds of flight: straight and even, or turning.

State per filter: position and velocity in a plane, ``(n, 4, kinds, heights)``; covariances are kept as ten rows,
``(n, 10, kinds, heights)``: position ``ee en nn``, position by velocity ``e·ve e·vn n·ve n·vn``, velocity ``ee en nn``.
The two kinds of one height are mixed as interacting models (Blom and Bar-Shalom 1988); heights never mix, because an
aircraft does not jump from one to another.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array

__all__ = ["COVARIANCE_ROWS", "KINDS", "mix", "moments", "predict", "update"]

KINDS: Final = 2
COVARIANCE_ROWS: Final = 10
# How fast the velocity wanders: wind and thrust on a straight flight; along the flight and across it on others. [m²/s³]
STRAIGHT_DENSITY: Final = 0.04
ALONG_DENSITY: Final = 0.4
ACROSS_DENSITY: Final = 150.0
# Mean times between turns, and of one turn. [s]
STRAIGHT_S: Final = 300.0
TURNING_S: Final = 40.0
# Slower flight has no direction. [m/s]
SPEED_MIN_MPS: Final = 30.0
# Places of two components of the state among the rows of a covariance.
_PLACES: Final = ((0, 0), (0, 1), (1, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3))


def mix(x: Array, P: Array, kind: Array, step_s: Array) -> tuple[Array, Array, Array]:
    """Let the kinds of flight change for a while.

    Parameters
    ----------
    x, P : (n, 4, kinds, heights), (n, 10, kinds, heights) arrays
        States and covariances. [m, m/s]
    kind : (n, kinds, heights) array
        Chance of each kind, given the height.
    step_s : (n,) array
        [s]

    Returns
    -------
    x, P, kind
        The same afterwards.
    """
    # Chance to be of the other kind after the step: of a two-state process with these mean times.
    rate = 1.0 / STRAIGHT_S + 1.0 / TURNING_S
    changed = -np.expm1(-rate * step_s)[:, None]
    from_straight, from_turning = changed / (STRAIGHT_S * rate), changed / (TURNING_S * rate)
    came = np.stack([kind[:, 1] * from_turning, kind[:, 0] * from_straight], axis=1)
    after = kind * np.stack([1.0 - from_straight, 1.0 - from_turning], axis=1) + came
    share = (came / np.maximum(after, 1e-300))[:, None]
    apart = x[:, :, ::-1] - x
    spread = np.stack([apart[:, i, 0] * apart[:, j, 0] for i, j in _PLACES], axis=1)[:, :, None]
    P = P + share * (P[:, :, ::-1] - P) + share * (1.0 - share) * spread
    return x + share * apart, P, after


def predict(x: Array, P: Array, step_s: Array) -> tuple[Array, Array]:
    """Straight on, with an acceleration that is small, or on a turning flight small along it and large across it."""
    t = step_s[:, None, None]
    e, n, v_e, v_n = x.swapaxes(0, 1)
    ee, en, nn, e_ve, e_vn, n_ve, n_vn, v_ee, v_en, v_nn = P.swapaxes(0, 1)
    d_ee, d_en, d_nn = _densities(v_e, v_n, t)
    x = np.stack([e + t * v_e, n + t * v_n, v_e, v_n], axis=1)
    half, third = 0.5 * t * t, t**3 / 3.0
    P = np.stack(
        [
            ee + t * (2.0 * e_ve + t * v_ee) + third * d_ee,
            en + t * (e_vn + n_ve + t * v_en) + third * d_en,
            nn + t * (2.0 * n_vn + t * v_nn) + third * d_nn,
            e_ve + t * v_ee + half * d_ee,
            e_vn + t * v_en + half * d_en,
            n_ve + t * v_en + half * d_en,
            n_vn + t * v_nn + half * d_nn,
            v_ee + t * d_ee,
            v_en + t * d_en,
            v_nn + t * d_nn,
        ],
        axis=1,
    )
    return x, P


def _densities(v_e: Array, v_n: Array, t: Array) -> tuple[Array, Array, Array]:
    """Densities of the acceleration in the plane, ``(n, kinds, heights)`` each. [m²/s³]"""
    speed = np.maximum(np.hypot(v_e[:, 1], v_n[:, 1]), SPEED_MIN_MPS)
    along_e, along_n = v_e[:, 1] / speed, v_n[:, 1] / speed
    # What is across at the beginning of the step is along by a little at its end.
    bent = ACROSS_DENSITY * t[:, 0] / (2.0 * speed)
    less = np.maximum(ACROSS_DENSITY - ALONG_DENSITY - bent**2, 0.0)
    straight = np.full_like(speed, STRAIGHT_DENSITY)
    return (
        np.stack([straight, ACROSS_DENSITY - less * along_e**2], axis=1),
        np.stack([np.zeros_like(speed), -less * along_e * along_n], axis=1),
        np.stack([straight, ACROSS_DENSITY - less * along_n**2], axis=1),
    )


def update(x: Array, P: Array, kind: Array, z: Array, R: Array) -> tuple[Array, Array, Array, Array]:
    """Take a plot in, where it is at each height.

    Parameters
    ----------
    x, P, kind
        As predicted.
    z, R : (n, 2, heights), (n, 3, heights) arrays
        Its position and the covariance of that. [m, m²]

    Returns
    -------
    x, P, kind
        Updated.
    says : (n, heights) array
        Log likelihood of the plot at each height, but for a constant.
    """
    ee, en, nn, e_ve, e_vn, n_ve, n_vn = P[:, :7].swapaxes(0, 1)
    s_ee, s_en, s_nn = ee + R[:, 0, None], en + R[:, 1, None], nn + R[:, 2, None]
    det = s_ee * s_nn - s_en * s_en
    i_ee, i_en, i_nn = s_nn / det, -s_en / det, s_ee / det
    y_e, y_n = z[:, 0, None] - x[:, 0], z[:, 1, None] - x[:, 1]
    distance2 = i_ee * y_e**2 + 2.0 * i_en * y_e * y_n + i_nn * y_n**2
    # Rows of P Hᵀ, and gains.
    to_e, to_n = (ee, en, e_ve, e_vn), (en, nn, n_ve, n_vn)
    gain = [(a * i_ee + b * i_en, a * i_en + b * i_nn) for a, b in zip(to_e, to_n, strict=True)]
    x = np.stack([x[:, k] + g * y_e + h * y_n for k, (g, h) in enumerate(gain)], axis=1)
    P = np.stack(
        [P[:, row] - gain[i][0] * to_e[j] - gain[i][1] * to_n[j] for row, (i, j) in enumerate(_PLACES)], axis=1
    )
    log = np.log(np.maximum(kind, 1e-300)) - 0.5 * (distance2 + np.log(det))
    top = log.max(axis=1)
    likely = np.exp(log - top[:, None])
    total = likely.sum(axis=1)
    return x, P, likely / total[:, None], top + np.log(total)


def moments(x: Array, P: Array, weight: Array) -> tuple[Array, Array]:
    """Mean ``(n, 4)`` and covariance ``(n, 4, 4)`` of filters with weights ``(n, kinds, heights)`` that add up to 1."""
    mean = np.einsum("nckh,nkh->nc", x, weight)
    away = x - mean[:, :, None, None]
    rows = np.einsum("nckh,nkh->nc", P, weight)
    spread = np.einsum("nckh,ndkh,nkh->ncd", away, away, weight, optimize=True)
    covariance = np.empty((len(x), 4, 4))
    for row, (i, j) in enumerate(_PLACES):
        covariance[:, i, j] = covariance[:, j, i] = rows[:, row] + spread[:, i, j]
    return mean, covariance
