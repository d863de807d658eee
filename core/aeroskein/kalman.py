"""Kalman kernels for many tracks at once: predict, whitened update, adjoint smoothing, all as 2x2 block columns.

State order is ``[px py vx vy ax ay]`` in the fusion plane. Because the transition is the same in east and north, the
covariance is a 3x3 arrangement of 2x2 blocks P11 P12 P13 / P22 P23 / P33 (1 position, 2 velocity, 3 acceleration). It
is kept as 24 *block-upper rows* with the lanes (tracks) last and contiguous: diagonal blocks are stored whole, so that
every block, and every column of P H', is a view.

    rows  0..5  px with columns 0..5     rows 12..15 vx with columns 2..5     rows 20..21 ax with columns 4..5
    rows  6..11 py with columns 0..5     rows 16..19 vy with columns 2..5     rows 22..23 ay with columns 4..5

Updates are whitened with the LDL' factors of the innovation covariance, which the gate needs anyway; the covariance
then changes by minus a sum of two outer products and stays symmetric to the last bit. ``adjoint`` has the backward
pass. Every kernel is checked against plain 6x6 matrix algebra in the tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from aeroskein.plots import Array, Bools

__all__ = [
    "COVARIANCE_ROWS",
    "ROW_OF",
    "Gains",
    "Innovation",
    "add_jerk_noise",
    "apply",
    "block_rows",
    "blocks",
    "from_matrix",
    "innovation",
    "lagged_innovation",
    "move",
    "move_covariance",
    "outer",
    "outer_sum",
    "predict",
    "stamp_noise",
    "to_matrix",
    "update_position",
    "update_velocity",
]

COVARIANCE_ROWS: Final = 24

# Where element (i, j), i in block row not after j's, lives among the 24 rows.
ROW_OF: Final[dict[tuple[int, int], int]] = {
    **{(i, j): 6 * i + j for i in (0, 1) for j in range(6)},
    **{(2 + i, j): 12 + 4 * i + j - 2 for i in (0, 1) for j in range(2, 6)},
    **{(4 + i, j): 20 + 2 * i + j - 4 for i in (0, 1) for j in (4, 5)},
}


def to_matrix(P: Array) -> Array:
    """Block-upper rows ``(24, ..., n)`` to full matrices ``(..., n, 6, 6)``."""
    full = np.empty((*P.shape[1:], 6, 6), dtype=P.dtype)
    for (i, j), row in ROW_OF.items():
        full[..., i, j] = P[row]
        full[..., j, i] = P[row]
    return full


def from_matrix(full: Array) -> Array:
    """Full symmetric matrices ``(..., n, 6, 6)`` to block-upper rows ``(24, ..., n)``."""
    P = np.empty((COVARIANCE_ROWS, *full.shape[:-2]), dtype=full.dtype)
    for (i, j), row in ROW_OF.items():
        P[row] = full[..., i, j]
    return P


class Blocks(NamedTuple):
    """The six 2x2 blocks of a covariance as views ``(2, 2, ..., n)``."""

    p11: Array
    p12: Array
    p13: Array
    p22: Array
    p23: Array
    p33: Array


def blocks(P: Array) -> Blocks:
    """The six blocks of covariances in block-upper rows ``(24, ..., n)``; writing to them writes to ``P``."""
    r1, r2, r3 = block_rows(P)
    return Blocks(r1[:, 0:2], r1[:, 2:4], r1[:, 4:6], r2[:, 0:2], r2[:, 2:4], r3)


def block_rows(P: Array) -> tuple[Array, Array, Array]:
    """The three rows of blocks ``(2, 6, ..., n)``, ``(2, 4, ..., n)`` and ``(2, 2, ..., n)``, as views."""
    lanes = P.shape[1:]
    return P[0:12].reshape(2, 6, *lanes), P[12:20].reshape(2, 4, *lanes), P[20:24].reshape(2, 2, *lanes)


def predict(x: Array, P: Array, h: Array, q: Array) -> None:
    """Move states by ``h`` under constant acceleration with white jerk, in place.

    Parameters
    ----------
    x : (6, ..., n) array
        States.
    P : (24, ..., n) array
        Covariances in block-upper rows.
    h : (n,) array
        Time steps; zero leaves a lane as it is. [s]
    q : (..., n) array
        Power spectral density of the jerk. [m²/s⁵]
    """
    move(x, P, h)
    qh = q * h
    qh2 = qh * h
    qh3 = qh2 * h
    # Both axes at once: their rows lie evenly apart.
    P[0:8:7] += qh3 * h * h / 20.0
    P[2:10:7] += qh3 * h / 8.0
    P[4:12:7] += qh3 / 6.0
    P[12:18:5] += qh3 / 3.0
    P[14:20:5] += qh2 / 2.0
    P[20:24:3] += qh


def move(x: Array, P: Array, h: Array) -> None:
    """Move states ``(6, ..., n)`` and covariances by ``h`` ``(n,)`` [s] under constant acceleration, in place."""
    x[0:2] += h * x[2:4] + (0.5 * h * h) * x[4:6]
    x[2:4] += h * x[4:6]
    move_covariance(P, h)


def move_covariance(P: Array, h: Array) -> None:
    """P becomes F P F' in place, F that of constant acceleration over ``h`` ``(n,)`` [s].

    Blocks that stand side by side move together: at a few hundred lanes a call costs as much as what it computes.
    """
    g = 0.5 * h * h
    r1, r2, p33 = block_rows(P)
    p11, p12, p13, p22, p23 = r1[:, 0:2], r1[:, 2:4], r1[:, 4:6], r2[:, 0:2], r2[:, 2:4]
    wide = np.empty_like(r2)
    product = wide[:, 0:2]
    # F P, block by block, each in the place of what is not read any more; then the same from the right.
    p11 += np.multiply(h, p12.swapaxes(0, 1), out=product)
    p11 += np.multiply(g, p13.swapaxes(0, 1), out=product)
    r1[:, 2:6] += np.multiply(h, r2, out=wide)
    p32 = p23.swapaxes(0, 1)
    p12 += np.multiply(g, p32, out=product)
    p13 += np.multiply(g, p33, out=product)
    p22 += np.multiply(h, p32, out=product)
    p23 += np.multiply(h, p33, out=product)
    r1[:, 0:4] += np.multiply(h, r1[:, 2:6], out=wide)
    p11 += np.multiply(g, p13, out=product)
    p22 += np.multiply(h, p23, out=product)
    P[6] = P[1]
    P[16] = P[13]


def add_jerk_noise(P: Array, h: Array, density: Array) -> None:
    """Add white jerk over ``h`` ``(n,)`` [s] in place: the usual integrals of powers of time.

    ``density (2, 2, ..., n)`` is its power spectral density times ``h``. [m²/s⁴]
    """
    h2 = h * h
    lanes = P.shape[1:]
    weights = np.empty((3, *h.shape))
    weights[0], weights[1], weights[2] = h2 * h2 / 20.0, h2 * h / 8.0, h2 / 6.0
    weights = weights.reshape(3, *[1] * (P.ndim - 1), -1)
    r1 = P[0:12].reshape(2, 3, 2, *lanes)
    r1 += weights * density[:, None]
    r2 = P[12:20].reshape(2, 2, 2, *lanes)
    weights[0], weights[1] = h2 / 3.0, 0.5 * h
    r2 += weights[:2] * density[:, None]
    P[20:24].reshape(2, 2, *lanes)[...] += density


class Gains(NamedTuple):
    """What an update leaves behind for the adjoint pass; zero where the report was not used.

    ``a (2, 6, ..., n)`` are the whitened columns of P H', ``m (2, ..., n)`` the whitened innovation, ``scale (2, ...,
    n)`` and ``ell`` whiten: the second component less ``ell`` times the first, then both times their scale. ``d2`` is
    the squared statistical distance, ``det`` the determinant of the innovation covariance, ``ok`` whether it was used.
    """

    a: Array
    m: Array
    scale: Array
    ell: Array
    d2: Array
    det: Array
    ok: Bools


def _columns(P: Array, first: int) -> Array:
    """Columns of P of position (first = 0), velocity (2) or acceleration (4), ``(2, 6, ..., n)``; not to be written."""
    r1, r2, r3 = block_rows(P)
    if first == 0:
        return r1
    columns = np.empty(r1.shape)
    columns[:, 0:2] = r1[:, first : first + 2].swapaxes(0, 1)
    if first == 2:
        columns[:, 2:6] = r2
    else:
        columns[:, 2:4] = r2[:, 2:4].swapaxes(0, 1)
        columns[:, 4:6] = r3
    return columns


def outer_sum(a: Array) -> Array:
    """The stored rows ``(24, ..., n)`` of the sum of a_k a_k' over k, ``a (k, 6, ..., n)``."""
    rows = np.empty((COVARIANCE_ROWS, *a.shape[2:]))
    # Sums of products in one sweep over the lanes.
    for k, of_block in enumerate(block_rows(rows)):
        np.einsum("ki...,kj...->ij...", a[:, 2 * k : 2 * k + 2], a[:, 2 * k :], out=of_block)
    return rows


def outer(d: Array, out: Array) -> Array:
    """The stored rows of d d' of vectors ``(6, ..., n)``, written to ``out (24, ..., n)``."""
    for k, of_block in enumerate(block_rows(out)):
        np.multiply(d[2 * k : 2 * k + 2, None], d[2 * k :], out=of_block)
    return out


class Innovation(NamedTuple):
    """Innovation of a 2-vector measurement with its LDL' factors; nothing has been changed yet."""

    a: Array
    n0: Array
    n1: Array
    c00: Array
    ell: Array
    s: Array
    d2: Array


def innovation(x: Array, P: Array, first: int, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array) -> Innovation:
    """Innovation of a position (``first = 0``) or velocity (``first = 2``) measurement.

    Parameters
    ----------
    x, P : (6, ..., n), (24, ..., n) arrays
        States and covariances.
    z0, z1 : (n,) arrays
        East and north component measured.
    r00, r01, r11 : (..., n) arrays
        Its covariance.
    """
    a = _columns(P, first)
    return _innovation(a, a[:, first : first + 2], x[first : first + 2], z0, z1, r00, r01, r11)


def _innovation(
    a: Array, spread: Array, seen: Array, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array
) -> Innovation:
    c00 = spread[0, 0] + r00
    c01 = spread[0, 1] + r01
    c11 = spread[1, 1] + r11
    n0 = z0 - seen[0]
    n1 = z1 - seen[1]
    ell = c01 / c00
    s = c11 - ell * c01
    m = n1 - ell * n0
    return Innovation(a, n0, n1, c00, ell, s, n0 * n0 / c00 + m * m / s)


def stamp_noise(
    base: Sequence[Array | float] | Array, time_variance: Array, rate: Array, spread: Array
) -> tuple[Array, Array, Array]:
    """Covariance ee, en, nn of a measurement ``base`` with what its time stamp adds, ``(..., n)`` each.

    The stamp's error acts along a rate of change that is itself uncertain: its second moment counts. ``rate (2, ...,
    n)`` is the velocity for a position, the acceleration for a velocity; ``spread`` are the rows of its covariance,
    from its first variance to its last.
    """
    square = rate * rate
    square += spread[:: len(spread) - 1]
    square *= time_variance
    return base[0] + square[0], base[1] + time_variance * (rate[0] * rate[1] + spread[1]), base[2] + square[1]


def lagged_innovation(
    x: Array, P: Array, first: int, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array, lag: Array
) -> Innovation:
    """As ``innovation`` for a measurement ``lag`` ``(n,)`` [s] behind the state: H = [I, -lag I, lag²/2 I].

    The process noise between the measurement and the state is neglected, so this serves short lags only.
    """
    a = _columns(P, first) - lag * _columns(P, first + 2)
    seen = x[first : first + 2] - lag * x[first + 2 : first + 4]
    if first == 0:
        half = 0.5 * lag * lag
        a += half * _columns(P, 4)
        seen += half * x[4:6]
    spread = a[:, first : first + 2] - lag * a[:, first + 2 : first + 4]
    if first == 0:
        spread += half * a[:, 4:6]
    return _innovation(a, spread, seen, z0, z1, r00, r01, r11)


def apply(x: Array, P: Array, i: Innovation, ok: Bools) -> Gains:
    """Use the innovation where ``ok`` (shape broadcastable to the lanes), in place; gains are zero elsewhere."""
    scale = np.empty((2, *i.c00.shape))
    np.divide(ok, i.c00, out=scale[0])
    np.divide(ok, i.s, out=scale[1])
    np.sqrt(scale, out=scale)
    a = np.empty(i.a.shape)
    np.multiply(i.ell, i.a[0], out=a[1])
    np.subtract(i.a[1], a[1], out=a[1])
    a[1] *= scale[1]
    np.multiply(i.a[0], scale[0], out=a[0])
    m = np.empty(scale.shape)
    m[0] = i.n0
    np.subtract(i.n1, i.ell * i.n0, out=m[1])
    m *= scale
    x += np.einsum("kc...,k...->c...", a, m)
    P -= outer_sum(a)
    return Gains(a, m, scale, i.ell, i.d2, i.c00 * i.s, ok)


def update_position(x: Array, P: Array, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array, ok: Bools) -> Gains:
    """Innovation and update by a position in one step, in place; see ``innovation`` and ``apply``."""
    return apply(x, P, innovation(x, P, 0, z0, z1, r00, r01, r11), ok)


def update_velocity(x: Array, P: Array, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array, ok: Bools) -> Gains:
    """Innovation and update by a velocity in one step, in place; see ``innovation`` and ``apply``."""
    return apply(x, P, innovation(x, P, 2, z0, z1, r00, r01, r11), ok)
