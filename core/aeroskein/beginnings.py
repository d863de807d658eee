"""Beginnings: the first report of a track that the following ones bear out.

A filter that starts on an outlier carries it along for a minute: the first position weighs like any other, and no gate
has looked at it. When the elements of a track begin, several reports have come; the track begins with the first of
them that at least half of the others agree with.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.measurements import COLUMNS
from aeroskein.plots import Array, Bools, Ints

__all__ = ["first_believable"]

# Reports within this time of each other are compared. [s]
REACH_S: Final = 10.0
# As many of the oldest reports as may stand at the beginning; three outliers in a row are no outliers.
CANDIDATES: Final = 4
# Largest squared distance of two reports that agree, in sigmas of both and of the flight between them.
AGREE: Final = 20.0
# What an aircraft may do between two reports, and how fast it flies where nobody says. [m/s²], [m/s]
ACCELERATION: Final = 3.0
UNKNOWN_SPEED_MPS: Final = 250.0

_C: Final = {name: i for i, name in enumerate(COLUMNS)}


def first_believable(rows: Array) -> Ints:
    """Index in each ring of the report that the track should begin with.

    Parameters
    ----------
    rows : (n, depth, COLUMN_COUNT) array
        Rings that hold at least one report each.

    Returns
    -------
    (n,) int64 array
        The oldest report that half of its neighbours agree with; the oldest of all where there is none such.
    """
    time = np.where(np.isneginf(rows[:, :, _C["time_s"]]), np.inf, rows[:, :, _C["time_s"]])
    order = np.argsort(time, axis=1, kind="stable")
    lanes = np.arange(len(rows))
    chosen = order[:, 0].copy()
    found = np.zeros(len(rows), dtype=np.bool_)
    for k in range(min(CANDIDATES, rows.shape[1])):
        candidate = order[:, k]
        there = np.isfinite(time[lanes, candidate])
        good = there & ~found & _borne_out(rows, time, candidate)
        chosen[good] = candidate[good]
        found |= good
    return chosen


def _borne_out(rows: Array, time: Array, candidate: Ints) -> Bools:
    """Whether at least half of the other reports agree with the candidate, ``(n,)``."""
    lanes = np.arange(len(rows))
    own = rows[lanes, candidate]
    dt = np.where(np.isfinite(time), time - own[:, _C["time_s"]][:, None], np.inf)
    near = (np.abs(dt) <= REACH_S) & (np.arange(rows.shape[1]) != candidate[:, None])
    dt = np.where(near, dt, 0.0)
    variance = own[:, _C["velocity_variance"]]
    has_velocity = np.isfinite(variance)
    v = np.where(has_velocity[:, None], own[:, [_C["v_east_mps"], _C["v_north_mps"]]], 0.0)
    speed_variance = np.where(has_velocity, variance, UNKNOWN_SPEED_MPS**2)
    off = [
        np.where(near, rows[:, :, _C[name]] - own[:, _C[name]][:, None] - v[:, k][:, None] * dt, 0.0)
        for k, name in enumerate(("east_m", "north_m"))
    ]
    along = (rows[:, :, _C["time_variance"]] + own[:, _C["time_variance"]][:, None]) * (v**2).sum(axis=1)[:, None]
    both = rows[:, :, _C["r_ee"]] + rows[:, :, _C["r_nn"]] + (own[:, _C["r_ee"]] + own[:, _C["r_nn"]])[:, None]
    flight = 2.0 * speed_variance[:, None] * dt**2 + 0.5 * (ACCELERATION * dt**2) ** 2
    allowed = np.where(near, 0.5 * (both + along + flight), 1.0)
    agree = near & (off[0] ** 2 + off[1] ** 2 <= AGREE * allowed)
    return np.asarray(2 * agree.sum(axis=1) >= near.sum(axis=1))
