"""Consistency: which aircraft contradict the others, so that none of them can teach a radar something wrong.

Over the last minute one bias per radar is fitted to all aircraft so that no aircraft counts more the further it lies
off (Huber's weight per aircraft, begun at the medians). An aircraft whose mean offset from that fit is beyond what its
latency and its satellite navigation explain is wrong: spoofed, or carrying another aircraft's address.
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
KNEE: Final = 1.5
ROW_KNEE: Final = 2.0
_ITERATIONS: Final = 10
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
    information = np.asarray(np.linalg.inv(rows.covariance_m2), dtype=np.float64)
    H, z = rows.of_sensor[:, :, :3], rows.error_m
    bias = np.zeros(3)
    # Every aircraft has one vote, not one per plot.
    bias[:2] = np.median(_grouped_medians(index, z / H[:, [0, 1], [0, 1]]), axis=0)
    offset_m = _medians(rows, index, z - H @ bias)
    distance2 = np.zeros(len(aircraft))
    for _ in range(_ITERATIONS):
        weight = information * _row_weight(rows, index, information, z - H @ bias, offset_m)[:, None, None]
        offset_m, distance2 = _offsets(rows, index, weight, z - H @ bias, latency_sigma_s)
        vote = np.minimum(1.0, KNEE / np.sqrt(np.maximum(distance2, 1e-12)))
        # Beyond six sigma no vote at all: a far outlier would still pull by its constant share.
        nearby = np.where(distance2 > 36.0, 0.0, vote)
        vote = nearby if nearby.sum() >= 2.0 else vote
        weighted = H.swapaxes(1, 2) @ weight * (vote / count)[index, None, None]
        normal = (weighted @ H).sum(axis=0) + _PRIOR_INFORMATION
        bias = np.linalg.solve(normal, np.einsum("nij,nj->i", weighted, z))
    far: Bools = (distance2 > DISTANCE2_MAX) & (np.linalg.norm(offset_m, axis=1) > OFFSET_MIN_M) & (count >= ROWS_MIN)
    # Where half or more disagree, it is not the aircraft that are wrong.
    return aircraft[far] if 2 * int(far.sum()) < len(aircraft) else np.empty(0, dtype=np.int64)


def _row_weight(rows: Rows, index: Ints, information: Array, residual_m: Array, offset_m: Array) -> Array:
    """Huber's weight of each row by its distance from its aircraft's last guess, ``(n,)``: wild plots lose theirs."""
    beside = residual_m + np.einsum("nij,nj->ni", rows.of_aircraft[:, :, 1:], offset_m[index])
    distance = np.sqrt(np.einsum("ni,nij,nj->n", beside, information, beside))
    return np.where(distance < 6.0, np.minimum(1.0, ROW_KNEE / np.maximum(distance, 1e-12)), 1e-6)


def _offsets(
    rows: Rows, index: Ints, weight_m2: Array, residual_m: Array, latency_sigma_s: float
) -> tuple[Array, Array]:
    """Mean offset of each aircraft, east and north ``(a, 2)``, and its squared statistical distance ``(a,)``."""
    G = -rows.of_aircraft[:, :, 1:]
    weighted = G.swapaxes(1, 2) @ weight_m2
    covariance = np.linalg.inv(_sum_by(index, weighted @ G) + 1e-12 * np.eye(2))
    offset_m = np.einsum("aij,aj->ai", covariance, _sum_by(index, np.einsum("nij,nj->ni", weighted, residual_m)))
    velocity = _sum_by(index, np.einsum("nij,ni->nj", G, rows.of_aircraft[:, :, 0]))
    velocity /= np.bincount(index)[:, None]
    late = velocity * latency_sigma_s
    spread = covariance + late[:, :, None] * late[:, None, :] + OFFSET_SIGMA_M**2 * np.eye(2)
    return offset_m, np.einsum("ai,ai->a", offset_m, np.linalg.solve(spread, offset_m[..., None])[..., 0])


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
