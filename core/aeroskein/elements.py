"""Differential elements: the flight's axis cut into pieces, each with its rectangle between two boundary lines.

The geometry of the element method (CN 114186635 A) with its formulas mended. With A = (0, 0), B = (x, y), L = |AB|,
e = (x, y)/L along the flight, n = (-y, x)/L to its left, b the half width of the boundary and P(m) the m-th of the
division points, m/N of the way for N elements:

* element m = 1..N lies between the normals at P(m-1) and P(m), its vertices are A, D = P(m-1), P(m) + b n on the left
  border and B, C = P(m-1), P(m) - b n on the right one (published with y for x in B, and for the first element only);
* the full width is d_max = |AB| = 2 b (published once as d_max, once as half of it);
* a point is in the element if (m-1) L/N <= s < m L/N and |c| <= b, with s and c its coordinates along and across. The
  published equations of the sides have slopes x/y, the reciprocal of the right ones, and are singular for flights
  along an axis; as equations of normals they hold in every direction.

Everything is on columns: leading axes of the arguments run over flights.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from aeroskein.axis import SHORTEST_PIECE_M
from aeroskein.plots import Array, Bools, Ints

__all__ = [
    "boundary_half_width",
    "clamped_half_width",
    "division_fractions",
    "division_points",
    "element_boundaries",
    "inside_boundary",
    "membership",
    "published_half_width",
    "rectangle_vertices",
    "side_equations",
]

Series = Literal["natural", "odd", "even"]

# A report belongs inside four sigma: one in 16,000 good ones is lost across the flight.
BOUNDARY_SIGMAS: Final = 4.0

# The boundary never comes nearer than this, whatever sensors claim: a flight's own deviation within an element. [m]
SMALLEST_HALF_WIDTH_M: Final = 150.0

# Nor is it wider than this: beyond, a report is about another aircraft. [m]
LARGEST_HALF_WIDTH_M: Final = 3000.0

# Published example: the largest deviation of an aircraft from its path, and the offsets of two devices. [m]
PUBLISHED_PATH_DEVIATION_M: Final = 500.0
PUBLISHED_DEVICE_OFFSETS_M: Final = (50.0, 30.0)


def division_fractions(elements: int, series: Series = "natural") -> Array:
    """Where the division points of a series lie, as fractions of the axis.

    The natural series m/n gives the n + 1 boundaries of n elements. The odd series (2m-1)/(2n) gives their n centres,
    where fused points are stationed, and the even one 2m/(2n) the boundaries again. As published the denominators of
    odd and even lack the 2, which carries their points up to 1.8 times the length of the flight (n = 10).

    Parameters
    ----------
    elements : int
        Number of elements n, at least 1.
    series : {"natural", "odd", "even"}
        Which points.

    Returns
    -------
    (n + 1,) or (n,) array
        Increasing fractions; n of them for the odd series.
    """
    if elements < 1:
        raise ValueError(f"expected at least one element, got {elements}")
    m = np.arange(elements + 1, dtype=np.float64)
    if series == "odd":
        return (2.0 * m[1:] - 1.0) / (2.0 * elements)
    if series == "even":
        return 2.0 * m / (2.0 * elements)
    return m / elements


def division_points(start: Array, end: Array, elements: int, series: Series = "natural") -> Array:
    """Division points on chords from ``start`` to ``end``, ``(..., 2)``: ``(..., count, 2)``. [m]"""
    share = division_fractions(elements, series)[:, None]
    return start[..., None, :] + share * (end - start)[..., None, :]


def element_boundaries(elements: int, series: Series = "natural") -> Array:
    """Fractions of the axis at which elements begin and end when a series bounds them.

    The natural and the even series are boundaries as they stand. The odd series leaves half an element at each end;
    these halves become elements of their own, so that the elements cover the whole axis without hole or overlap.

    Parameters
    ----------
    elements : int
        Number n of elements of full length that the axis has.
    series : {"natural", "odd", "even"}
        Which division points bound the elements.

    Returns
    -------
    (n + 1,) or (n + 2,) array
        Increasing from 0 to 1.
    """
    fractions = division_fractions(elements, series)
    return np.concatenate([[0.0], fractions, [1.0]]) if series == "odd" else fractions


def rectangle_vertices(start: Array, end: Array, elements: int, half_width_m: Array | float) -> Array:
    """Corners of the elements of chords, in the order A, B, C, D of the publication.

    Parameters
    ----------
    start, end : (..., 2) array
        Start A and end B of the master's function image. [m]
    elements : int
        Number of elements n.
    half_width_m : (...) array or float
        Half width b of the boundary; A to B measures 2 b. [m]

    Returns
    -------
    (..., n, 4, 2) array
        A, D left of the flight, B, C right of it; A, B at the beginning of the element. NaN where the chord has no
        length and so no direction. [m]
    """
    _, left = _directions(start, end)
    boundaries = division_points(start, end, elements)
    before, behind = boundaries[..., :-1, :], boundaries[..., 1:, :]
    step = (np.asarray(half_width_m)[..., None] * left)[..., None, :]
    return np.stack([before + step, before - step, behind - step, behind + step], axis=-2)


def side_equations(start: Array, end: Array, elements: int, half_width_m: Array | float) -> Array:
    """Straight lines through the sides of the elements, ``a x + b y = c`` with ``a² + b² = 1``.

    Parameters
    ----------
    start, end, elements, half_width_m
        As for ``rectangle_vertices``.

    Returns
    -------
    (..., n, 4, 3) array
        a, b, c of the sides A-B, B-C, C-D, D-A: for A-B and C-D the normal e, for B-C and D-A the normal n.
    """
    along, left = _directions(start, end)
    boundaries = division_points(start, end, elements)
    s = np.einsum("...mc,...c->...m", boundaries, along)
    c = np.broadcast_to(np.einsum("...c,...c->...", start, left)[..., None], s[..., 1:].shape)
    half = np.asarray(half_width_m)[..., None]
    offsets = np.stack([s[..., :-1], c - half, s[..., 1:], c + half], axis=-1)
    normals = np.stack([along, left, along, left], axis=-2)[..., None, :, :]
    return np.concatenate([np.broadcast_to(normals, (*offsets.shape, 2)), offsets[..., None]], axis=-1)


def membership(along: Array, boundaries: Array, *, closed_end: bool = False) -> Ints:
    """Find the element of each point by its place along the axis: arc length, or time.

    Intervals are half-open, ``S_k <= along < S_k+1``: a point between the first boundary and the last lies in exactly
    one element.

    Parameters
    ----------
    along : (n, K) array
        Arc length [m] or time [s] of the points of each flight; NaN lies in no element.
    boundaries : (n, E + 1) array
        Non-decreasing boundaries of the elements; flights with fewer end in NaN.
    closed_end : bool
        Whether the last boundary of a flight belongs to its last element: at the end of a finite track.

    Returns
    -------
    (n, K) int64 array
        Index of the element, -1 outside.
    """
    index = (along[:, :, None] >= boundaries[:, None, :]).sum(axis=-1) - 1
    elements = np.isfinite(boundaries).sum(axis=-1)[:, None] - 1
    beyond = index >= elements
    if closed_end:
        end = np.take_along_axis(boundaries, np.maximum(elements, 0), axis=1)
        at_end = (along == end) & (elements > 0)
        return np.where(at_end, elements - 1, np.where(beyond, -1, index))
    return np.where(beyond, -1, index)


def inside_boundary(across_m: Array, half_width_m: Array | float) -> Bools:
    """Whether points lie between the boundary lines, which belong to the inside; NaN does not."""
    return np.abs(across_m) <= half_width_m


def boundary_half_width(
    report_covariance: Array,
    axis_covariance: Array,
    direction: Array,
    bias_bound_m: Array,
    sagitta_m: Array | float = 0.0,
) -> Array:
    """Half width of the boundary as wide as a report's and the axis' errors make it.

    Published as one width for all, from where a device sits on the aircraft; a ground radar's error grows with its
    range. ``b = clamp(4 sqrt(nᵀ (R + P) n) + |nᵀ bias| + sagitta, 150 m, 3 km)``, and the same along the flight with
    e for n.

    Parameters
    ----------
    report_covariance, axis_covariance : (..., 3) array
        Packed ``[ee, en, nn]`` of the report and of the axis where it lies. [m²]
    direction : (..., 2) array
        Unit vector across the flight, or along it.
    bias_bound_m : (..., 2) array
        Largest displacement by the sensor's remaining bias, east and north. [m]
    sagitta_m : (...) array or float
        How far the flight may bulge from its axis inside a piece. [m]

    Returns
    -------
    (...) array
        Half width. [m]
    """
    total = report_covariance + axis_covariance
    e, n = direction[..., 0], direction[..., 1]
    variance = total[..., 0] * e * e + 2.0 * total[..., 1] * e * n + total[..., 2] * n * n
    bias_m = np.abs(bias_bound_m[..., 0] * e + bias_bound_m[..., 1] * n)
    return clamped_half_width(variance, bias_m + sagitta_m)


def clamped_half_width(variance_m2: Array, more_m: Array | float = 0.0) -> Array:
    """Half width from the variance across it (any shape) and what comes on top, within the limits. [m², m, m]"""
    wide_m = BOUNDARY_SIGMAS * np.sqrt(np.maximum(variance_m2, 0.0)) + more_m
    return np.asarray(np.minimum(np.maximum(wide_m, SMALLEST_HALF_WIDTH_M), LARGEST_HALF_WIDTH_M))


def published_half_width(
    path_deviation_m: float = PUBLISHED_PATH_DEVIATION_M,
    device_offsets_m: tuple[float, ...] = PUBLISHED_DEVICE_OFFSETS_M,
) -> float:
    """The fixed half width of the publication: deviation from the path plus the largest offset of a device. [m]"""
    return path_deviation_m + max(device_offsets_m)


def _directions(start: Array, end: Array) -> tuple[Array, Array]:
    """Unit vectors along the chords and to their left; NaN where there is no length."""
    chord = end - start
    length = np.hypot(chord[..., 0], chord[..., 1])[..., None]
    along = chord / np.where(length > SHORTEST_PIECE_M, length, np.nan)
    return along, np.stack([-along[..., 1], along[..., 0]], axis=-1)
