"""Consistency: which aircraft contradict the others, so that none of them can teach a radar something wrong.

Over the last minute every aircraft has a mean offset from its plots. One bias per radar is fitted to these offsets so
that no aircraft counts more the further it lies off (Huber's loss, which has one minimum, then a few steps in which far
ones do not count at all). An aircraft whose offset from that fit is beyond what its latency, its satellite navigation
and the fit itself explain is wrong: spoofed, or carrying another aircraft's address.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.filter import OFFSET_SIGMA_M
from aeroskein.registration.rows import Rows

__all__ = ["contradicting_aircraft"]

# With fewer aircraft nobody knows who is wrong.
AIRCRAFT_MIN: Final = 3
# Plots of an aircraft before it is judged.
ROWS_MIN: Final = 5
# Squared statistical distance (two components) of a mean offset: 3e-7 by chance.
DISTANCE2_MAX: Final = 30.0
# An offset is judged only if it matters: below this the aircraft's own states take it up. [m]
OFFSET_MIN_M: Final = 60.0
# Sigmas beyond which an aircraft, and a plot beside the others of its aircraft, loses weight.
KNEE: Final = 1.5
ROW_KNEE: Final = 2.0
# Sigmas beyond which they do not count.
FAR: Final = 6.0
# Rounds with Huber's weight, and rounds after that without the far ones.
HUBER_ROUNDS: Final = 15
LAST_ROUNDS: Final = 4
# Weak prior of a radar's bias for directions that the traffic does not show: 1 km, 2 deg, 1.5 s.
_PRIOR_INFORMATION: Final = np.diag([1e-6, 0.25, 0.44])


def contradicting_aircraft(rows: Rows, latency_sigma_s: float) -> Ints:
    """Find aircraft whose anchored comparisons do not fit those of the others.

    Parameters
    ----------
    rows : Rows
        Anchored measurements of the last minute, of any radars.
    latency_sigma_s : float
        Believed scatter of latencies. [s]

    Returns
    -------
    int64 array
        Their track numbers, sorted.
    """
    wrong = [_of_radar(rows.take(rows.sensor == sensor), latency_sigma_s) for sensor in np.unique(rows.sensor)]
    return np.unique(np.concatenate([*wrong, np.empty(0, dtype=np.int64)]))


def _of_radar(rows: Rows, latency_sigma_s: float) -> Ints:
    aircraft, index, count = np.unique(rows.aircraft, return_inverse=True, return_counts=True)
    if len(aircraft) < AIRCRAFT_MIN:
        return np.empty(0, dtype=np.int64)
    H = rows.of_sensor[:, :, :3]
    bias = np.zeros(3)
    bias[:2] = np.median(_grouped_medians(index, rows.error_m / H[:, [0, 1], [0, 1]]), axis=0)
    # Twice, because which plots are wild is seen better with a better bias.
    for _ in range(2):
        offset, of_bias, spread = _mean_offsets(rows, index, rows.error_m - H @ bias, latency_sigma_s)
        step, covariance = _robust_fit(offset, of_bias, spread)
        bias = bias + step
    rest = offset - of_bias @ step
    distance2 = _squares(rest, spread + of_bias @ covariance @ of_bias.swapaxes(1, 2))
    far: Bools = (distance2 > DISTANCE2_MAX) & (np.linalg.norm(rest, axis=1) > OFFSET_MIN_M) & (count >= ROWS_MIN)
    # Where half or more disagree, it is not the aircraft that are wrong.
    return aircraft[far] if 2 * int(far.sum()) < len(aircraft) else np.empty(0, dtype=np.int64)


def _mean_offsets(rows: Rows, index: Ints, residual_m: Array, latency_sigma_s: float) -> tuple[Array, Array, Array]:
    """Mean offset of each aircraft, how it depends on the bias, and its covariance.

    Returns
    -------
    offset_m : (a, 2) array
        Plots minus reference, east and north. [m]
    of_bias : (a, 2, 3) array
        Its change with range, azimuth and time bias.
    spread_m2 : (a, 2, 2) array
        Noise of the mean, latency along the flight, satellite navigation. [m²]
    """
    G, H = -rows.of_aircraft[:, :, 1:], rows.of_sensor[:, :, :3]
    information = np.linalg.inv(rows.covariance_m2)
    beside = residual_m - np.einsum("nij,nj->ni", G, _medians(rows, index, residual_m)[index])
    distance = np.sqrt(np.einsum("ni,nij,nj->n", beside, information, beside))
    weight = np.where(distance < FAR, np.minimum(1.0, ROW_KNEE / np.maximum(distance, 1e-12)), 1e-6)
    weighted = G.swapaxes(1, 2) @ information * weight[:, None, None]
    covariance = np.linalg.inv(_sum_by(index, weighted @ G) + 1e-12 * np.eye(2))
    offset_m = np.einsum("aij,aj->ai", covariance, _sum_by(index, np.einsum("nij,nj->ni", weighted, residual_m)))
    of_bias = covariance @ _sum_by(index, weighted @ H)
    velocity = _sum_by(index, np.einsum("nij,ni->nj", G, rows.of_aircraft[:, :, 0])) / np.bincount(index)[:, None]
    late = velocity * latency_sigma_s
    spread = covariance + late[:, :, None] * late[:, None, :] + OFFSET_SIGMA_M**2 * np.eye(2)
    return offset_m, of_bias, spread


def _robust_fit(offset_m: Array, of_bias: Array, spread_m2: Array) -> tuple[Array, Array]:
    """Bias ``(3,)`` that explains the offsets of most aircraft, and its covariance."""
    weighted = of_bias.swapaxes(1, 2) @ np.linalg.inv(spread_m2)
    normal, right = weighted @ of_bias, np.einsum("aij,aj->ai", weighted, offset_m)
    bias, covariance = np.zeros(3), np.linalg.inv(_PRIOR_INFORMATION)
    for turn in range(HUBER_ROUNDS + LAST_ROUNDS):
        distance = np.sqrt(_squares(offset_m - of_bias @ bias, spread_m2))
        vote = np.minimum(1.0, KNEE / np.maximum(distance, 1e-12))
        nearby = np.where(distance < FAR, vote, 0.0)
        if turn >= HUBER_ROUNDS and nearby.sum() >= 2.0:
            vote = nearby
        covariance = np.linalg.inv(np.einsum("a,aij->ij", vote, normal) + _PRIOR_INFORMATION)
        bias = covariance @ np.einsum("a,ai->i", vote, right)
    return bias, covariance


def _squares(residual: Array, covariance: Array) -> Array:
    squares: Array = np.einsum("ai,ai->a", residual, np.linalg.solve(covariance, residual[..., None])[..., 0])
    return squares


def _medians(rows: Rows, index: Ints, residual_m: Array) -> Array:
    """Median residual of each aircraft in east and north, ``(a, 2)``."""
    return _grouped_medians(index, np.einsum("nij,ni->nj", -rows.of_aircraft[:, :, 1:], residual_m))


def _grouped_medians(index: Ints, values: Array) -> Array:
    """Medians of the columns of ``(n, c)`` within each group."""
    count = np.bincount(index)
    first = np.cumsum(count) - count
    ordered = np.stack([v[np.lexsort((v, index))] for v in values.T], axis=-1)
    medians: Array = 0.5 * (ordered[first + (count - 1) // 2] + ordered[first + count // 2])
    return medians


def _sum_by(index: Ints, values: Array) -> Array:
    out = np.zeros((int(index.max()) + 1, *values.shape[1:]))
    np.add.at(out, index, values)
    return out
