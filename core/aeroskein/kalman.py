"""Kalman kernels for many tracks at once: predict, whitened update, adjoint smoothing, all as 2x2 block columns.

State order is ``[px py vx vy ax ay]`` in the fusion plane. Because the transition is the same in east and north, the
covariance is a 3x3 arrangement of 2x2 blocks P11 P12 P13 / P22 P23 / P33 (1 position, 2 velocity, 3 acceleration). It
is kept as 24 *block-upper rows* with the lanes (tracks) last and contiguous: diagonal blocks are stored whole, so that
every block, and every column of P H', is a view.

    rows  0..5  px with columns 0..5     rows 12..15 vx with columns 2..5     rows 20..21 ax with columns 4..5
    rows  6..11 py with columns 0..5     rows 16..19 vy with columns 2..5     rows 22..23 ay with columns 4..5

Updates are whitened with the LDL' factors of the innovation covariance, which the gate needs anyway; the covariance
then changes by minus a sum of two outer products and stays symmetric to the last bit. Smoothing uses the adjoint form
(modified Bryson-Frazier; Bierman 1977, "Factorization Methods for Discrete Sequential Estimation"): no matrix is
inverted. Every kernel is checked against plain 6x6 matrix algebra in the tests.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = [
    "COVARIANCE_ROWS",
    "ROW_OF",
    "Adjoint",
    "Gains",
    "Innovation",
    "apply",
    "blocks",
    "from_matrix",
    "innovation",
    "lagged_innovation",
    "outer",
    "predict",
    "subtract_outer",
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
    lanes = P.shape[1:]
    r1 = P[0:12].reshape(2, 6, *lanes)
    r2 = P[12:20].reshape(2, 4, *lanes)
    r3 = P[20:24].reshape(2, 2, *lanes)
    return Blocks(r1[:, 0:2], r1[:, 2:4], r1[:, 4:6], r2[:, 0:2], r2[:, 2:4], r3)


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
    g = 0.5 * h * h
    p11, p12, p13, p22, p23, p33 = blocks(P)
    x[0:2] += h * x[2:4] + g * x[4:6]
    x[2:4] += h * x[4:6]
    p21, p31, p32 = p12.swapaxes(0, 1), p13.swapaxes(0, 1), p23.swapaxes(0, 1)
    # F P, block by block, each in the place of what is not read any more; then the same from the right.
    product = np.empty_like(p33)
    p11 += np.multiply(h, p21, out=product)
    p11 += np.multiply(g, p31, out=product)
    p12 += np.multiply(h, p22, out=product)
    p12 += np.multiply(g, p32, out=product)
    p22 += np.multiply(h, p32, out=product)
    p13 += np.multiply(h, p23, out=product)
    p13 += np.multiply(g, p33, out=product)
    p23 += np.multiply(h, p33, out=product)
    p11 += np.multiply(h, p12, out=product)
    p11 += np.multiply(g, p13, out=product)
    p12 += np.multiply(h, p13, out=product)
    p22 += np.multiply(h, p23, out=product)
    p11[1, 0] = p11[0, 1]
    p22[1, 0] = p22[0, 1]
    _add_jerk_noise(P, h, q)


def _add_jerk_noise(P: Array, h: Array, q: Array) -> None:
    """White jerk of density ``q`` over ``h``: the usual integrals of h^k on both axes."""
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


class Gains(NamedTuple):
    """What an update leaves behind for the adjoint pass; zero columns where the report was not used.

    ``a0, a1`` are the whitened columns of P H' ``(6, n)``, ``m0, m1`` the whitened innovation, ``h00, h10, h11`` the
    whitening of the rows of H, ``d2`` the squared statistical distance, ``det`` the
    determinant of the innovation covariance, ``ok`` whether it was used.
    """

    a0: Array
    a1: Array
    m0: Array
    m1: Array
    h00: Array
    h10: Array
    h11: Array
    d2: Array
    det: Array
    ok: Bools


def _columns(P: Array, first: int) -> tuple[Array, Array]:
    """Columns of P for position (first = 0) or velocity (first = 2) as ``(6, ..., n)``."""
    lanes = P.shape[1:]
    r1 = P[0:12].reshape(2, 6, *lanes)
    if first == 0:
        return r1[0], r1[1]
    r2 = P[12:20].reshape(2, 4, *lanes)
    return np.concatenate([r1[:, 2], r2[0]]), np.concatenate([r1[:, 3], r2[1]])


def subtract_outer(P: Array, a0: Array, a1: Array) -> None:
    """P -= a0 a0' + a1 a1', on the stored rows only."""
    lanes = P.shape[1:]
    r1 = P[0:12].reshape(2, 6, *lanes)
    r2 = P[12:20].reshape(2, 4, *lanes)
    r3 = P[20:24].reshape(2, 2, *lanes)
    product = np.empty_like(r1)  # one for all six: making an array costs as much as filling it
    for a in (a0, a1):
        r1 -= np.multiply(a[0:2, None], a[None], out=product)
        r2 -= np.multiply(a[2:4, None], a[None, 2:], out=product[:, 2:])
        r3 -= np.multiply(a[4:6, None], a[None, 4:], out=product[:, 4:])


def outer(d: Array, out: Array) -> Array:
    """The stored rows of d d' of vectors ``(6, n)``, written to ``out (24, n)``."""
    lanes = d.shape[1:]
    np.multiply(d[0:2, None], d[None], out=out[0:12].reshape(2, 6, *lanes))
    np.multiply(d[2:4, None], d[None, 2:], out=out[12:20].reshape(2, 4, *lanes))
    np.multiply(d[4:6, None], d[None, 4:], out=out[20:24].reshape(2, 2, *lanes))
    return out


class Innovation(NamedTuple):
    """Innovation of a 2-vector measurement with its LDL' factors; nothing has been changed yet."""

    a0: Array
    a1: Array
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
    a0, a1 = _columns(P, first)
    c00 = a0[first] + r00
    c01 = a0[first + 1] + r01
    c11 = a1[first + 1] + r11
    n0 = z0 - x[first]
    n1 = z1 - x[first + 1]
    ell = c01 / c00
    s = c11 - ell * c01
    m = n1 - ell * n0
    return Innovation(a0, a1, n0, n1, c00, ell, s, n0 * n0 / c00 + m * m / s)


def _all_columns(P: Array) -> tuple[Array, ...]:
    """The six columns of P, ``(6, ..., n)`` each."""
    lanes = P.shape[1:]
    r1 = P[0:12].reshape(2, 6, *lanes)
    r2 = P[12:20].reshape(2, 4, *lanes)
    r3 = P[20:24].reshape(2, 2, *lanes)
    columns = [r1[0], r1[1]]
    columns += [np.concatenate([r1[:, 2 + k], r2[k]]) for k in (0, 1)]
    columns += [np.concatenate([r1[:, 4 + k], r2[:, 2 + k], r3[k]]) for k in (0, 1)]
    return tuple(columns)


def lagged_innovation(
    x: Array, P: Array, first: int, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array, lag: Array
) -> Innovation:
    """As ``innovation`` for a measurement ``lag`` ``(n,)`` [s] behind the state: H = [I, -lag I, lag²/2 I].

    The process noise between the measurement and the state is neglected, so this serves short lags only.
    """
    c = _all_columns(P)
    half = 0.5 * lag * lag
    if first == 0:
        a0 = c[0] - lag * c[2] + half * c[4]
        a1 = c[1] - lag * c[3] + half * c[5]
        seen = x[0:2] - lag * x[2:4] + half * x[4:6]
        s0 = a0[0:2] - lag * a0[2:4] + half * a0[4:6]
        s1 = a1[0:2] - lag * a1[2:4] + half * a1[4:6]
    else:
        a0 = c[2] - lag * c[4]
        a1 = c[3] - lag * c[5]
        seen = x[2:4] - lag * x[4:6]
        s0 = a0[2:4] - lag * a0[4:6]
        s1 = a1[2:4] - lag * a1[4:6]
    c00 = s0[0] + r00
    c01 = s0[1] + r01
    c11 = s1[1] + r11
    n0 = z0 - seen[0]
    n1 = z1 - seen[1]
    ell = c01 / c00
    s = c11 - ell * c01
    m = n1 - ell * n0
    return Innovation(a0, a1, n0, n1, c00, ell, s, n0 * n0 / c00 + m * m / s)


def apply(x: Array, P: Array, i: Innovation, ok: Bools) -> Gains:
    """Use the innovation where ``ok`` (shape broadcastable to the lanes), in place; gains are zero elsewhere."""
    i0 = np.sqrt(ok / i.c00)
    i1 = np.sqrt(ok / i.s)
    a1 = i1 * (i.a1 - i.ell * i.a0)
    a0 = i0 * i.a0
    m0 = i0 * i.n0
    m1 = i1 * (i.n1 - i.ell * i.n0)
    x += a0 * m0
    x += a1 * m1
    subtract_outer(P, a0, a1)
    return Gains(a0, a1, m0, m1, i0, -i.ell * i1, i1, i.d2, i.c00 * i.s, ok)


def update_position(x: Array, P: Array, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array, ok: Bools) -> Gains:
    """Innovation and update by a position in one step, in place; see ``innovation`` and ``apply``."""
    return apply(x, P, innovation(x, P, 0, z0, z1, r00, r01, r11), ok)


def update_velocity(x: Array, P: Array, z0: Array, z1: Array, r00: Array, r01: Array, r11: Array, ok: Bools) -> Gains:
    """Innovation and update by a velocity in one step, in place; see ``innovation`` and ``apply``."""
    return apply(x, P, innovation(x, P, 2, z0, z1, r00, r01, r11), ok)


class Adjoint:
    """The backward pass: what later reports say about an earlier state, as (lambda, Lambda).

    Walk the events from last to first: ``through_update`` for each update (velocity, then position), then for the time
    step before it ``through_turn`` and ``through_step``. At any instant the smoothed state is ``x - P lambda`` with
    covariance ``P - P Lambda P``, x and P being the filter's there.
    """

    def __init__(self, n: int) -> None:
        self.vector = np.zeros((6, n))
        self.matrix = np.zeros((6, 6, n))

    def lanes(self, m: int) -> Adjoint:
        """The first ``m`` lanes, as a view."""
        part = Adjoint.__new__(Adjoint)
        part.vector = self.vector[:, :m]
        part.matrix = self.matrix[:, :, :m]
        return part

    def through_update(self, first: int, g: Gains) -> None:
        """Go back through an update of position (``first = 0``) or velocity (``first = 2``)."""
        lam, L = self.vector, self.matrix
        b0 = np.einsum("ijn,jn->in", L, g.a0)
        b1 = np.einsum("ijn,jn->in", L, g.a1)
        e0 = np.einsum("in,in->n", g.a0, lam) + g.m0
        e1 = np.einsum("in,in->n", g.a1, lam) + g.m1
        # G is I + a' Lambda a on the lanes where the update was used; the whitening is zero elsewhere.
        g00 = 1.0 + np.einsum("in,in->n", g.a0, b0)
        g01 = np.einsum("in,in->n", g.a0, b1)
        g11 = 1.0 + np.einsum("in,in->n", g.a1, b1)
        c, d = first, first + 1
        # Rows of H whitened: Ht = [[h00, 0], [h10, h11]]; each product below is Ht' times something.
        lam[c] -= g.h00 * e0 + g.h10 * e1
        lam[d] -= g.h11 * e1
        u0 = g.h00 * b0 + g.h10 * b1
        u1 = g.h11 * b1
        L[c] -= u0
        L[d] -= u1
        L[:, c] -= u0
        L[:, d] -= u1
        w00 = g.h00 * g00 + g.h10 * g01
        w10 = g.h00 * g01 + g.h10 * g11
        L[c, c] += w00 * g.h00 + w10 * g.h10
        L[c, d] += w10 * g.h11
        L[d, c] += w10 * g.h11
        L[d, d] += g.h11 * g11 * g.h11

    def through_turn(self, lanes: Ints, cos: Array, sin: Array) -> None:
        """Go back through a turn of some lanes' acceleration: by the transposed rotation."""
        lam, L = self.vector[4:6, lanes], self.matrix[:, :, lanes]
        self.vector[4:6, lanes] = cos * lam[0] + sin * lam[1], cos * lam[1] - sin * lam[0]
        L[4], L[5] = cos * L[4] + sin * L[5], cos * L[5] - sin * L[4]
        L[:, 4], L[:, 5] = cos * L[:, 4] + sin * L[:, 5], cos * L[:, 5] - sin * L[:, 4]
        self.matrix[:, :, lanes] = L

    def through_step(self, h: Array) -> None:
        """Go back over a time step ``h`` ``(n,)`` [s]: Lambda becomes F' Lambda F."""
        lam, L = self.vector, self.matrix
        g = 0.5 * h * h
        L[4:6] += h * L[2:4] + g * L[0:2]
        L[2:4] += h * L[0:2]
        L[:, 4:6] += h * L[:, 2:4] + g * L[:, 0:2]
        L[:, 2:4] += h * L[:, 0:2]
        lam[4:6] += h * lam[2:4] + g * lam[0:2]
        lam[2:4] += h * lam[0:2]

    def smooth(self, x: Array, P: Array) -> tuple[Array, Array]:
        """Smoothed state ``(6, n)`` and full covariance ``(n, 6, 6)`` where the filter had ``x`` and ``P``."""
        full = to_matrix(P)
        L = self.matrix.transpose(2, 0, 1)
        smoothed = x - np.einsum("nij,jn->in", full, self.vector)
        return smoothed, full - full @ L @ full
