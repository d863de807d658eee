"""The smallest circle that contains all points of a set, for many sets at once.

The element method takes its centre as the fused point of an element (CN 114186635 A). Published as "the circumcircle
of the triangle", which is right for acute triangles only; here it is the true smallest circle for any number of points.

Method: Welzl (1991), "Smallest enclosing disks", as an LP-type problem with Gärtner's (1999) pivot rule. Each set keeps
a basis of up to three points that determine its circle. The point farthest outside must lie on the rim of the next
circle, which is the smallest of the circles through it and one or two points of the basis that holds all four. The
radius grows with each step, so no basis comes back; a handful of steps is usual, and all sets step together.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["smallest_circles"]

# Circles through the new point and one or two points of the basis: which points of the basis. A pair is written with
# its point twice, as a basis with fewer than three different points is.
_FIRST: Final = np.array([0, 1, 2, 0, 0, 1])
_SECOND: Final = np.array([0, 1, 2, 1, 2, 2])
_PAIRS: Final = 3


def smallest_circles(points: Array, mask: Bools | None = None) -> tuple[Array, Array]:
    """Find the smallest circle around each set of points.

    Parameters
    ----------
    points : (n, K, 2) array
        Up to K points a set. [m]
    mask : (n, K) bool array, optional
        Which of them count; absent: all.

    Returns
    -------
    centers : (n, 2) array
        Centres; NaN for a set without points, or with a point that is not finite. [m]
    radii : (n,) array
        Radii: the distance of the farthest point, 0 for a single point. [m]
    """
    n, size = points.shape[:2]
    centers, radii = np.full((n, 2), np.nan), np.full(n, np.nan)
    if n == 0 or size == 0:
        return centers, radii
    mask = np.ones((n, size), dtype=np.bool_) if mask is None else mask
    broken = (mask & ~np.isfinite(points).all(axis=-1)).any(axis=1)
    sound = np.flatnonzero(mask.any(axis=1) & ~broken)
    if not sound.size:
        return centers, radii
    local, offset, scale = _conditioned(points[sound], mask[sound])
    found = _grow(local)
    centers[sound] = found * scale[:, None] + offset
    # Measured from the centre as returned, so that the circle holds its points after rounding too.
    away = points[sound] - centers[sound, None, :]
    radii[sound] = np.where(mask[sound], np.hypot(away[..., 0], away[..., 1]), 0.0).max(axis=1)
    return centers, radii


def _conditioned(points: Array, mask: Bools) -> tuple[Array, Array, Array]:
    """Points about their mean, scaled to about one, the masked ones replaced by one that counts."""
    rows = np.arange(len(points))
    filled = np.where(mask[..., None], points, points[rows, mask.argmax(axis=1)][:, None, :])
    offset = filled.mean(axis=1)
    local = filled - offset[:, None, :]
    # A power of two changes no digit of any coordinate.
    scale = np.ldexp(1.0, np.frexp(np.abs(local).max(axis=(1, 2)))[1])
    return local / scale[:, None, None], offset, scale


def _grow(points: Array) -> Array:
    """Centres of the smallest circles of full sets ``(n, K, 2)``."""
    n = len(points)
    basis = np.repeat(points[:, :1], 3, axis=1)
    center, radius = points[:, 0].copy(), np.zeros(n)
    active = np.arange(n)
    while active.size:
        farthest, distance = _farthest(points[active], center[active])
        outside = distance > radius[active]
        active, farthest = active[outside], farthest[outside]
        new = points[active, farthest]
        new_basis, new_center, new_radius = _pivot(basis[active], new)
        # No growth means that the point was outside by rounding only: the circle is found.
        grown = new_radius > radius[active]
        active = active[grown]
        basis[active], center[active], radius[active] = new_basis[grown], new_center[grown], new_radius[grown]
    return center


def _farthest(points: Array, center: Array) -> tuple[Ints, Array]:
    away = points - center[:, None, :]
    distance = np.hypot(away[..., 0], away[..., 1])
    which = distance.argmax(axis=1)
    return which, distance[np.arange(len(points)), which]


def _pivot(basis: Array, new: Array) -> tuple[Array, Array, Array]:
    """Smallest circle of the basis ``(n, 3, 2)`` and a point ``(n, 2)`` outside its circle: basis, centre, radius.

    Each candidate is taken with the radius that holds all four points, so nothing is compared with a tolerance: the
    smallest circle is among the candidates, and every other one is larger.
    """
    rows = np.arange(len(new))
    to_basis = basis - new[:, None, :]
    offsets = _circumcenters(to_basis[:, _FIRST], to_basis[:, _SECOND])
    offsets[:, :_PAIRS] = 0.5 * to_basis
    four = np.concatenate([to_basis, np.zeros((len(new), 1, 2))], axis=1)
    away = four[:, None, :, :] - offsets[:, :, None, :]
    radii = np.hypot(away[..., 0], away[..., 1]).max(axis=2)
    radii = np.where(np.isfinite(radii), radii, np.inf)
    best = radii.argmin(axis=1)
    made = np.stack([new, basis[rows, _FIRST[best]], basis[rows, _SECOND[best]]], axis=1)
    return made, new + offsets[rows, best], radii[rows, best]


def _circumcenters(a: Array, b: Array) -> Array:
    """Centres of the circles through the origin, a and b; not finite where the three lie on a line."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        half_turn = 0.5 / (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
        aa, bb = (a * a).sum(axis=-1), (b * b).sum(axis=-1)
        x = (b[..., 1] * aa - a[..., 1] * bb) * half_turn
        y = (a[..., 0] * bb - b[..., 0] * aa) * half_turn
    centers: Array = np.stack([x, y], axis=-1)
    return centers
