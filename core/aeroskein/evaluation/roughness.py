"""How a track looks to the eye: spikes (it turns back on itself) and steps (it jumps aside)."""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.figures import Roughness
from aeroskein.evaluation.geometry import ecef, up_vector
from aeroskein.evaluation.residuals import Residuals
from aeroskein.plots import Array, Bools, Ints

__all__ = ["SPIKE_ANGLE_DEG", "SPIKE_LEG_M", "STEP_M", "is_spike", "roughness_of", "steps_m"]

# Three points whose middle one is the tip of an angle this sharp: no aircraft flies that, a display shows a needle.
SPIKE_ANGLE_DEG: Final = 20.0
# Legs below this are noise of a hovering or taxiing target, not a needle that anybody sees.
SPIKE_LEG_M: Final = 10.0
# A change of error from one point to the next that a controller sees as a jump.
STEP_M: Final = 50.0
# Points further apart in time are not neighbours; ten seconds is an element and a look-ahead.
_NEIGHBOUR_S: Final = 10.0


def is_spike(series: Ints, time_s: Array, position: Array) -> Bools:
    """Which points are the tip of a spike.

    Parameters
    ----------
    series : (n,) int array
        Which track each point belongs to; sorted, and in time order inside a track.
    time_s : (n,) array
        [s]
    position : (n, 3) array
        On the ellipsoid, Earth-centred. [m]

    Returns
    -------
    (n,) bool array
    """
    tip = np.zeros(len(series), dtype=np.bool_)
    if len(series) < 3:
        return tip
    leg = np.diff(position, axis=0)
    length = np.linalg.norm(leg, axis=1)
    joined = (series[1:] == series[:-1]) & (np.diff(time_s) <= _NEIGHBOUR_S) & (length > SPIKE_LEG_M)
    # The interior angle is between the way back and the way on.
    dot = -np.sum(leg[:-1] * leg[1:], axis=1)
    sharp = dot > np.cos(np.radians(SPIKE_ANGLE_DEG)) * length[:-1] * length[1:]
    tip[1:-1] = sharp & joined[:-1] & joined[1:]
    return tip


def steps_m(residuals: Residuals) -> Array:
    """Change of the error vector from each judged point to the next of the same track and flight. [m]"""
    if len(residuals) < 2:
        return np.zeros(0)
    joined = (np.diff(residuals.flight) == 0) & (np.diff(residuals.track_number) == 0)
    joined &= np.diff(residuals.time_s) <= _NEIGHBOUR_S
    change = np.diff(residuals.error_m, axis=0)[joined]
    return np.asarray(np.hypot(change[:, 0], change[:, 1]))


def roughness_of(points: PointColumns, held: Bools, residuals: Residuals) -> Roughness:
    """Spikes among the held points of a product, steps among the judged ones."""
    rows = np.flatnonzero(held & np.isfinite(points.lat_deg) & np.isfinite(points.lon_deg))
    rows = rows[np.lexsort((points.time_s[rows], points.track_number[rows]))]
    position = ecef(up_vector(points.lat_deg[rows], points.lon_deg[rows]), np.zeros(len(rows)))
    spikes = int(is_spike(points.track_number[rows], points.time_s[rows], position).sum())
    step = steps_m(residuals)
    return Roughness(
        points=len(rows),
        spikes=spikes,
        spikes_per_10000=10_000.0 * spikes / len(rows) if len(rows) else None,
        steps=int(np.sum(step > STEP_M)),
        step_p99_m=float(np.percentile(step, 99.0)) if len(step) else None,
        step_max_m=float(step.max()) if len(step) else None,
    )
