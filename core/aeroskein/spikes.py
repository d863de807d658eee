"""Spikes: where a published track would turn back on itself, and the nearest place where it does not.

No aircraft flies a needle, and a display that shows one is not believed. An element's point is checked before it is
published; a live point cannot know the next report, so what the next report takes back is held back instead.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools

__all__ = ["held", "turns_back"]

# A track turns back with a smaller angle than this, and its legs are more than noise. A little stricter than how
# spikes are counted on the ellipsoid, for the plane bends angles and lengths by parts in a thousand. [deg], [m]
SPIKE_DEG: Final = 21.0
SPIKE_LEG_M: Final = 9.9


def turns_back(before: Array, place: Array) -> Bools:
    """Where places ``(2, n)`` make a spike of the last one of ``before`` ``(4, n)``: the track would turn back. [m]"""
    leg, following = before[2:] - before[:2], place - before[2:]
    along: Array = (leg * following).sum(axis=0)
    turned = along < 0.0
    at = turned.nonzero()[0]
    if len(at):  # most fly on
        lengths = np.hypot(leg[0, at], leg[1, at]), np.hypot(following[0, at], following[1, at])
        long = (lengths[0] > SPIKE_LEG_M) & (lengths[1] > SPIKE_LEG_M)
        turned[at] = long & (-along[at] > math.cos(math.radians(SPIKE_DEG)) * lengths[0] * lengths[1])
    return turned


def held(before: Array, place: Array) -> Array:
    """What to add to places so that the track stops instead of flying backwards; zero where it makes no spike.

    Only the way back along the last leg is taken out; a correction to the side is published at once.

    Parameters
    ----------
    before : (4, n) array
        The two places before, the older one first; NaN where there is none. [m]
    place : (2, n) array
        [m]

    Returns
    -------
    (2, n) array
        [m]
    """
    back = turns_back(before, place).nonzero()[0]
    shift = np.zeros(place.shape)
    if len(back):
        leg = before[2:, back] - before[:2, back]
        along = (leg * (place[:, back] - before[2:, back])).sum(axis=0) / (leg * leg).sum(axis=0)
        shift[:, back] = -along * leg
    return shift
