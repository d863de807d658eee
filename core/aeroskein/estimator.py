"""The element estimator: all reports of a window, one by one in order of time, as information about its centre.

This is the element method's "weights by accuracy" carried to its end: instead of one weight per track, every report
weighs by its covariance in position, velocity and time. A forward pass filters from the settled state over the
element and the look-ahead behind it; an adjoint backward pass carries what came later back to the element's centre.
The boundary lines gate first, in axes along and across the flight; then the statistical distance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aeroskein import coordinated_turn, kalman
from aeroskein.adjoint import Adjoint
from aeroskein.closed import Estimate
from aeroskein.elements import BOUNDARY_SIGMAS, clamped_half_width
from aeroskein.gating import GATE, GateMemory, astray_velocity_variance
from aeroskein.manoeuvre import HOVER_MPS
from aeroskein.plots import Array, Bools, Ints
from aeroskein.reasons import Reason
from aeroskein.windows import CENTRE, REPORT, SETTLED, Window

__all__ = ["estimate", "go_on"]

# White jerk along and across the flight, as shares of the density that the detector asks for: thrust changes slowly,
# bank fast.
ALONG_SHARE: Final = 0.25
ACROSS_SHARE: Final = 2.5


def go_on() -> None:
    """Give way to nobody."""


@dataclass(slots=True)
class _Step:
    """One round of the forward pass, as the backward pass needs it."""

    lanes: int
    h: Array
    turned: coordinated_turn.Turned
    updates: list[tuple[int, kalman.Gains]] = field(default_factory=list)


class _Reports(NamedTuple):
    """The columns of a window with harmless numbers where there is no report, ``(K, n)`` each."""

    east: Array
    north: Array
    ree: Array
    ren: Array
    rnn: Array
    time_variance: Array
    v_east: Array
    v_north: Array
    velocity_variance: Array
    is_report: Bools
    has_velocity: Bools
    sensor: Ints

    @classmethod
    def of(cls, w: Window) -> _Reports:
        is_report = w.kind == REPORT
        has_velocity = is_report & np.isfinite(w.velocity_variance)

        def plain(column: Array, mask: Bools, otherwise: float = 0.0) -> Array:
            return np.where(mask, column, otherwise)

        return cls(
            plain(w.east_m, is_report), plain(w.north_m, is_report),
            plain(w.r_ee, is_report, 1.0), plain(w.r_en, is_report), plain(w.r_nn, is_report, 1.0),
            plain(w.time_variance, is_report),
            plain(w.v_east_mps, has_velocity), plain(w.v_north_mps, has_velocity),
            plain(w.velocity_variance, has_velocity, 1.0),
            is_report, has_velocity, w.sensor_index,
        )  # fmt: skip

    def round(self, k: int, m: int) -> _Reports:
        """The k-th report of the first m lanes, ``(m,)`` columns."""
        return _Reports._make(column[k, :m] for column in self)


class _Forward:
    """The forward pass over one window."""

    def __init__(self, window: Window, x: Array, P: Array, t: Array, memory: GateMemory) -> None:
        self.window = window
        self.reports = _Reports.of(window)
        self.x, self.P, self.t = x, P, t
        self.memory = memory
        self.steps: list[_Step] = []
        n = len(t)
        self.centre_x, self.centre_P = x.copy(), P.copy()
        self.settled_x, self.settled_P = x.copy(), P.copy()
        self.settled_memory = memory.take(np.arange(n))
        self._one_mark = ~(window.kind == SETTLED).any(axis=0)
        self.reason = np.zeros(window.kind.shape, dtype=np.uint8)
        # Innovation covariances (ee, en, nn) and directions of flight, for the boundary lines.
        self.innovation_cov = np.ones((3, *window.kind.shape))
        self.velocity = np.ones((2, *window.kind.shape))
        self.distance2 = np.zeros(window.kind.shape)

    def run(self, q: Array, give_way: Callable[[], None]) -> None:
        for k, m in enumerate(self.window.active):
            give_way()
            x, P = self.x[:, :m], self.P[:, :m]
            time = self.window.time_s[k, :m]
            h = time - self.t[:m]
            turned = coordinated_turn.predict(x, P, h, ALONG_SHARE * q[k, :m], ACROSS_SHARE * q[k, :m])
            step = _Step(m, h, turned)
            self.t[:m] = time
            reports = self.reports.round(k, m)
            if reports.is_report.any():
                self._update(k, x, P, reports, step)
            self._mark(self.window.kind[k, :m], x, P)
            self.steps.append(step)

    def _update(self, k: int, x: Array, P: Array, r: _Reports, step: _Step) -> None:
        m = len(r.east)
        r00, r01, r11 = kalman.stamp_noise((r.ree, r.ren, r.rnn), r.time_variance, x[2:4], P[12:18])
        i = kalman.innovation(x, P, 0, r.east, r.north, r00, r01, r11)
        cov, velocity = self.innovation_cov[:, k, :m], self.velocity[:, k, :m]
        cov[0] = i.c00
        np.multiply(i.ell, i.c00, out=cov[1])
        np.add(i.s, i.ell * cov[1], out=cov[2])
        velocity[:] = x[2:4]
        ok = r.is_report & (i.d2 <= GATE)
        # Within four sigma in every direction is within the boundary lines too; only the others need a look.
        doubtful = np.flatnonzero(r.is_report & (i.d2 > BOUNDARY_SIGMAS**2))
        if len(doubtful):
            outside = doubtful[~self._inside(k, doubtful, i)]
            ok[outside] = False
            self.reason[k, :m] = np.where(r.is_report & ~ok, Reason.OUTLIER, 0)
            self.reason[k, outside] = Reason.OUTSIDE_BOUNDARY
        if len(doubtful) or self.memory.pending:
            i = self._reopen(k, x, P, r, i, ok, (r00, r01, r11))
        self.distance2[k, :m] = i.d2
        step.updates.append((0, kalman.apply(x, P, i, ok)))
        has_velocity = ok & r.has_velocity
        if has_velocity.any():
            base = (r.velocity_variance, 0.0, r.velocity_variance)
            R = kalman.stamp_noise(base, r.time_variance, x[4:6], P[20:24])
            iv = kalman.innovation(x, P, 2, r.v_east, r.v_north, *R)
            step.updates.append((2, kalman.apply(x, P, iv, has_velocity & (iv.d2 <= GATE))))

    def _reopen(
        self, k: int, x: Array, P: Array, r: _Reports, i: kalman.Innovation, ok: Bools, R: tuple[Array, ...]
    ) -> kalman.Innovation:
        """Believe sources that were refused too often (changes ``ok``), and remember what was refused."""
        m = len(ok)
        trace = r.ree + r.rnn
        opened = r.is_report & ~ok & self.memory.opens(np.arange(m), r.sensor, trace)
        if opened.any():
            _widen(P, i, opened)
            i = kalman.innovation(x, P, 0, r.east, r.north, *R)
            ok |= opened
            self.reason[k, :m][opened] = 0
        noted = np.flatnonzero(r.is_report)
        self.memory.note(noted, r.sensor[noted], trace[noted], ok[noted])
        return i

    def _inside(self, k: int, lanes: Ints, i: kalman.Innovation) -> Bools:
        """Which of these lanes' reports lie between the boundary lines, and not too far along."""
        vx, vy = self.velocity[:, k, lanes]
        e0, e1, moving = _direction(vx, vy)
        cov = self.innovation_cov[:, k, lanes]
        across, along = _half_width(cov, -e1, e0), _half_width(cov, e0, e1)
        offset_across = np.abs(-e1 * i.n0[lanes] + e0 * i.n1[lanes])
        offset_along = np.abs(e0 * i.n0[lanes] + e1 * i.n1[lanes])
        disc = np.maximum(across, along)
        between = (offset_across <= across) & (offset_along <= along)
        return np.where(moving, between, np.hypot(offset_across, offset_along) <= disc)

    def half_width(self) -> Array:
        """Half distance of the boundary lines for each report, NaN where there is none, ``(K, n)``. [m]"""
        e0, e1, moving = _direction(*self.velocity)
        across = _half_width(self.innovation_cov, -e1, e0)
        disc = np.maximum(across, _half_width(self.innovation_cov, e0, e1))
        return np.where(self.reports.is_report, np.where(moving, across, disc), np.nan)

    def _mark(self, kind: NDArray[np.int8], x: Array, P: Array) -> None:
        at = np.flatnonzero(kind >= CENTRE)
        if not len(at):
            return
        centre = at[kind[at] == CENTRE]
        self.centre_x[:, centre] = x[:, centre]
        self.centre_P[:, centre] = P[:, centre]
        # Where the settled time has no mark of its own it is the centre.
        settled = at[(kind[at] == SETTLED) | self._one_mark[at]]
        self.settled_x[:, settled] = x[:, settled]
        self.settled_P[:, settled] = P[:, settled]
        self.settled_memory.put(settled, self.memory.take(settled))


def _direction(vx: Array, vy: Array) -> tuple[Array, Array, Bools]:
    """Unit vector along the flight, and whether there is one: a hovering aircraft has none."""
    speed = np.hypot(vx, vy)
    moving = speed >= HOVER_MPS
    at_least = np.maximum(speed, HOVER_MPS)
    return np.where(moving, vx / at_least, 1.0), np.where(moving, vy / at_least, 0.0), moving


def _half_width(cov: Array, e: Array, n: Array) -> Array:
    """Half distance of the boundary lines from the covariance of report and axis together. [m]"""
    return clamped_half_width(cov[0] * e * e + 2.0 * cov[1] * e * n + cov[2] * n * n)


def _widen(P: Array, i: kalman.Innovation, where: Bools) -> None:
    """Widen position and velocity of lanes that have evidently gone astray, as process noise would."""
    off = np.where(where, i.n0**2 + i.n1**2, 0.0)
    P[[0, 7]] += off
    P[[12, 17]] += astray_velocity_variance(off)


def estimate(
    window: Window,
    q: Array,
    x: Array,
    P: Array,
    t: Array,
    memory: GateMemory,
    give_way: Callable[[], None] = go_on,
) -> Estimate:
    """Estimate the state at the centre of each lane's element.

    Parameters
    ----------
    window : Window
        Events of n lanes, with a ``CENTRE`` mark in each.
    q : (K, n) array
        Density of jerk for the step into each event. [m²/s⁵]
    x, P, t : (6, n), (24, n), (n,) arrays
        Settled state and its time, in the window's order of lanes; overwritten.
    memory : GateMemory
        Gates at the settled time, in the window's order of lanes; overwritten.
    give_way : callable
        Called between rounds.
    """
    forward = _Forward(window, x, P, t, memory)
    forward.run(q, give_way)
    kind = window.kind
    n = kind.shape[1]
    adjoint = Adjoint(n)
    centre = Adjoint(n)
    first_centre = int((kind == CENTRE).argmax(axis=0).min()) if n else 0
    for k in range(len(forward.steps) - 1, first_centre - 1, -1):
        give_way()
        step = forward.steps[k]
        part = adjoint.lanes(step.lanes)
        at = np.flatnonzero(kind[k, : step.lanes] == CENTRE)
        centre.columns[:, :, at] = part.columns[:, :, at]
        for first, gains in reversed(step.updates):
            part.through_update(first, gains)
        if len(step.turned.lanes):
            part.through_turn(*step.turned)
        part.through_step(step.h)
    smoothed_x, smoothed_P = centre.smooth(forward.centre_x, forward.centre_P)
    return Estimate(
        smoothed_x,
        smoothed_P,
        forward.centre_x,
        forward.centre_P,
        forward.settled_x,
        forward.settled_P,
        forward.settled_memory,
        forward.reason,
        forward.half_width(),
        forward.distance2,
    )
