"""Mode banks: the three-model filter of ``manoeuvre`` for all tracks, one row a track, worked on in rounds.

Two banks exist: one runs in order of arrival and gives the live product; the other runs in order of time, behind the
watermark, and says how hard each aircraft was manoeuvring when. Rows are kept one track after the other because a row
is then one copy to fetch; for work they are turned so that lanes come last.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import kalman, manoeuvre
from aeroskein.gating import GATE, GateMemory, astray_velocity_variance
from aeroskein.plots import Array, Bools, Ints

__all__ = ["ModeBank", "ModeWork"]

_X: Final = 6 * manoeuvre.MODELS
_P: Final = kalman.COVARIANCE_ROWS * manoeuvre.MODELS
ROW: Final = _X + _P + manoeuvre.MODELS
# Rows of a covariance: variances and covariance of the position, and of the velocity.
_POSITION: Final = [0, 1, 7]
_VELOCITY: Final = [12, 13, 17]


class ModeWork:
    """Some tracks' models, turned for work: ``x (6, 3, n)``, ``P (24, 3, n)``, ``mu (3, n)``, times ``(n,)``."""

    def __init__(
        self, x: Array, P: Array, mu: Array, time_s: Array, memory: GateMemory, models: manoeuvre.ModelSet
    ) -> None:
        self.x, self.P, self.mu, self.time_s = x, P, mu, time_s
        self.memory = memory
        self._models = models

    def predict(self, time_s: Array) -> Array:
        """Move the first ``len(time_s)`` lanes forward to these times, never back; returns how far each lags behind."""
        m = len(time_s)
        h = time_s - self.time_s[:m]
        lag = np.maximum(-h, 0.0)
        np.maximum(h, 0.0, out=h)
        if m == len(self.time_s):
            self.x, self.P, self.mu = manoeuvre.predict(self.x, self.P, self.mu, h, self._models)
        else:
            x, P, mu = manoeuvre.predict(self.x[:, :, :m], self.P[:, :, :m], self.mu[:, :m], h, self._models)
            self.x[:, :, :m], self.P[:, :, :m], self.mu[:, :m] = x, P, mu
        self.time_s[:m] += h
        return lag

    def update(
        self,
        columns: Array | tuple[Array, ...],
        sensor: Ints,
        lag: Array,
        usable: Bools,
    ) -> Bools:
        """Update the first m lanes by one report each.

        Parameters
        ----------
        columns : (9, m) array, or nine of (m,)
            east, north, r_ee, r_en, r_nn, v_east, v_north, velocity variance, time variance, as in ``Measurements``.
        sensor : (m,) int64
            Sensor of each report.
        lag : (m,) array
            How far it lies behind the state. [s]
        usable : (m,) bool array
            Lanes to update.

        Returns
        -------
        (m,) bool array
            Where the report was used.
        """
        east, north, r_ee, r_en, r_nn, ve, vn, rv, tv = columns
        m = len(east)
        x, P, mu = self.x[:, :, :m], self.P[:, :, :m], self.mu[:, :m]
        late = lag if (lag > 0.0).any() else None
        pending = self.memory.pending
        gate: Array | float = GATE
        if pending:
            trace = r_ee + r_nn
            opened = usable & self.memory.opens(np.arange(m), sensor, trace)
            opened = self._widen(opened, x, P, (east, north, r_ee, r_en, r_nn, tv), late)
            gate = np.where(opened, np.inf, GATE)
        mu[...], ok, _, _ = manoeuvre.step(
            x, P, mu,
            z=(east, north, ve, vn), base=(r_ee, r_en, r_nn),
            time_variance=tv, velocity_variance=rv, lag=late, usable=usable, gate=gate,
            turns=self._models.turns,
        )  # fmt: skip
        if pending or not ok[usable].all():
            noted = np.flatnonzero(usable)
            self.memory.note(noted, sensor[noted], (r_ee + r_nn)[noted], ok[noted])
        return ok

    def _widen(self, opened: Bools, x: Array, P: Array, columns: tuple[Array, ...], lag: Array | None) -> Bools:
        """Widen lanes whose gate opens and would refuse; returns which those are."""
        if not opened.any():
            return opened
        at = np.flatnonzero(opened)
        east, north, r_ee, r_en, r_nn, tv = (c[at] for c in columns)
        xs, Ps = x[:, :, at], np.ascontiguousarray(P[:, :, at])
        R = kalman.stamp_noise((r_ee, r_en, r_nn), tv, xs[2:4], Ps[12:18])
        i = manoeuvre.innovation(xs, Ps, 0, east, north, *R, None if lag is None else lag[at])
        refused = i.d2.min(axis=0) > GATE
        opened = opened.copy()
        opened[at[~refused]] = False
        off = (i.n0**2 + i.n1**2) * refused
        for row in (0, 7):
            P[row][:, at] += off
        for row in (12, 17):
            P[row][:, at] += astray_velocity_variance(off)
        return opened


class ModeBank:
    """The models of all tracks at rest: ``rows (capacity, 93)``, ``time_s (capacity,)``, gates."""

    def __init__(self, capacity: int, sensors: int, models: manoeuvre.ModelSet) -> None:
        self.models = models
        self.rows = np.zeros((capacity, ROW))
        self.time_s = np.full(capacity, -np.inf)
        self.memory = GateMemory.empty(capacity, sensors)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = ModeBank(capacity - len(self.rows), self.memory.misses.shape[1], self.models)
        self.rows = np.concatenate([self.rows, more.rows])
        self.time_s = np.concatenate([self.time_s, more.time_s])
        self.memory = GateMemory(
            np.concatenate([self.memory.misses, more.memory.misses]),
            np.concatenate([self.memory.best_m2, more.memory.best_m2]),
        )

    def start(self, slots: Ints, x: Array, P: Array, time_s: Array) -> None:
        """Begin tracks with one state ``(6, n)`` and covariance ``(24, n)`` each."""
        xs, Ps, mu = manoeuvre.initial(x, P)
        memory = GateMemory.empty(len(slots), self.memory.misses.shape[1])
        self.put(slots, ModeWork(xs, Ps, mu, time_s, memory, self.models))

    def take(self, slots: Ints) -> ModeWork:
        """The models of some tracks, turned for work; ``put`` them back to keep what was done."""
        return ModeWork(*self._turned(slots), self.time_s[slots], self.memory.take(slots), self.models)

    def _turned(self, slots: Ints) -> tuple[Array, Array, Array]:
        n = len(slots)
        turned = np.ascontiguousarray(self.rows.take(slots, axis=0).T)
        x, P = turned[:_X], turned[_X : _X + _P]
        models = manoeuvre.MODELS
        return x.reshape(6, models, n), P.reshape(kalman.COVARIANCE_ROWS, models, n), turned[_X + _P :]

    def put(self, slots: Ints, work: ModeWork) -> None:
        """Keep the models of some tracks."""
        n = len(slots)
        turned = np.empty((ROW, n))
        turned[:_X], turned[_X : _X + _P], turned[_X + _P :] = work.x.reshape(_X, n), work.P.reshape(_P, n), work.mu
        self.rows[slots] = turned.T
        self.time_s[slots] = work.time_s
        self.memory.put(slots, work.memory)

    def steady(self, slots: Ints) -> tuple[Array, Array, Array, Array]:
        """Position and velocity ``(n,)`` of the steady model, for rough comparisons. [m, m/s]"""
        place = self.rows[:, : 4 * manoeuvre.MODELS : manoeuvre.MODELS][slots]
        return place[:, 0], place[:, 1], place[:, 2], place[:, 3]

    def motion_at(self, slots: Ints, time_s: Array) -> tuple[Array, Array, Array]:
        """What a point needs of ``mixture_at``, at a quarter of its cost where nothing is to be predicted.

        Returns
        -------
        x : (4, n) array
            Position and velocity. [m, m/s]
        position_cov, velocity_cov : (3, n) arrays
            ``[ee, en, nn]`` each. [m², m²/s²]
        """
        if (time_s > self.time_s[slots]).any():
            x, P = self.mixture_at(slots, time_s)
            return x[:4], P[_POSITION], P[_VELOCITY]
        models, n = manoeuvre.MODELS, len(slots)
        turned = self.rows.take(slots, axis=0).T
        mu = turned[_X + _P :]
        x = turned[: 4 * models].reshape(4, models, n)
        P = turned[_X : _X + _P].reshape(kalman.COVARIANCE_ROWS, models, n)[_POSITION + _VELOCITY]
        mean = np.einsum("cin,in->cn", x, mu)
        away = x - mean[:, None]
        pairs = away[[0, 0, 1, 2, 2, 3]] * away[[0, 1, 1, 2, 3, 3]]
        covariance = np.einsum("cin,in->cn", P + pairs, mu)
        return mean, covariance[:3], covariance[3:]

    def mixture_at(self, slots: Ints, time_s: Array) -> tuple[Array, Array]:
        """One state ``(6, n)`` and covariance ``(24, n)`` per track at the given times, not before its own."""
        x, P, mu = self._turned(slots)
        h = np.maximum(time_s - self.time_s[slots], 0.0)
        if h.any():
            x, P, mu = manoeuvre.predict(x, P, mu, h, self.models)
        return manoeuvre.mixture(x, P, mu)
