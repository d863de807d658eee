"""Cubic Hermite interpolation of vectors over time, on columns (de Boor, A Practical Guide to Splines, ch. IV)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints

__all__ = ["hermite", "parabola_tangents"]


def hermite(value: Array, slope: Array, left: Ints, u: Array, span_s: Array) -> tuple[Array, Array]:
    """Value and rate between samples ``left`` and ``left + 1``.

    Parameters
    ----------
    value, slope : (m, k) array
        Samples and their rates. [x, x/s]
    left : (n,) int array
        Row of the sample before each instant.
    u : (n,) array
        Where in the interval, 0 to 1. [1]
    span_s : (n,) array
        Length of the interval. [s]

    Returns
    -------
    (n, k) array, (n, k) array
        Value and rate. [x, x/s]
    """
    u, span = u[:, None], span_s[:, None]
    p0, p1 = value[left], value[left + 1]
    m0, m1 = slope[left] * span, slope[left + 1] * span
    step = p1 - p0
    # Horner form about the left sample, so that Earth-sized values keep their last digits.
    c2 = 3.0 * step - 2.0 * m0 - m1
    c3 = m0 + m1 - 2.0 * step
    return p0 + u * (m0 + u * (c2 + u * c3)), (m0 + u * (2.0 * c2 + 3.0 * u * c3)) / span


def parabola_tangents(time_s: Array, value: Array, group: NDArray[Any]) -> Array:
    """Rate at each sample from the parabola through it and its two neighbours of the same group.

    Parameters
    ----------
    time_s : (n,) array
        Strictly increasing inside a group. [s]
    value : (n, k) array
        Samples. [x]
    group : (n,) int array
        Rows of one group are contiguous.

    Returns
    -------
    (n, k) array
        One-sided at the ends of a group, 0 where a sample stands alone. [x/s]
    """
    if len(time_s) < 2:
        return np.zeros_like(value)
    joined = group[1:] == group[:-1]
    span = np.where(joined, np.diff(time_s), 1.0)[:, None]
    chord = np.where(joined[:, None], np.diff(value, axis=0) / span, 0.0)
    # A side that does not exist gets weight 0; a parabola weighs each chord with the length of the other side.
    none = np.zeros((1, 1))
    before = np.concatenate([none, np.where(joined[:, None], span, 0.0)])
    after = np.concatenate([np.where(joined[:, None], span, 0.0), none])
    chord_before = np.concatenate([np.zeros((1, value.shape[1])), chord])
    chord_after = np.concatenate([chord, np.zeros((1, value.shape[1]))])
    weight_before = np.where((before > 0.0) & (after > 0.0), after, np.where(before > 0.0, 1.0, 0.0))
    weight_after = np.where((before > 0.0) & (after > 0.0), before, np.where(after > 0.0, 1.0, 0.0))
    total = weight_before + weight_after
    weighted = weight_before * chord_before + weight_after * chord_after
    return np.asarray(weighted / np.where(total > 0.0, total, 1.0))
