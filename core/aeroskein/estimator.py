"""The element estimator: all reports of a window, one by one in order of time, as information about its centre.

This is the element method's "weights by accuracy" carried to its end: instead of one weight per track, every report
weighs by its covariance in position, velocity and time. A forward pass filters from the settled state over the
element and the look-ahead behind it; an adjoint backward pass carries what came later back to the element's centre.
The boundary lines gate first, in axes along and across the flight; then the statistical distance.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein import kalman
from aeroskein.closed import Estimate
from aeroskein.gating import GATE, GateMemory
from aeroskein.plots import Array, Bools, Ints
from aeroskein.reasons import Reason
from aeroskein.windows import CENTRE, REPORT, SETTLED, Window

__all__ = ["boundary_half_width", "estimate"]

# Boundary lines: four sigma of report and axis together, never narrower than a wake and a chord's bend need,
# never wider than separation would bear. [sigma], [m]
BOUNDARY_SIGMAS: Final = 4.0
BOUNDARY_MIN_M: Final = 150.0
BOUNDARY_MAX_M: Final = 3000.0
# Below this an aircraft has no direction worth the name: hovering, or standing. [m/s]
HOVER_MPS: Final = 15.0
# A report that is believed in spite of its gate: the state may have been wrong for about this long. [s]
ASTRAY_S: Final = 4.0


def boundary_half_width(s_ee: Array, s_en: Array, s_nn: Array, across_e: Array, across_n: Array) -> Array:
    """Half distance of the boundary lines from the covariance of report and axis together. [m]"""
    variance = s_ee * across_e**2 + 2.0 * s_en * across_e * across_n + s_nn * across_n**2
    return np.clip(BOUNDARY_SIGMAS * np.sqrt(np.maximum(variance, 0.0)), BOUNDARY_MIN_M, BOUNDARY_MAX_M)


@dataclass(slots=True)
class _Step:
    """One round of the forward pass, as the backward pass needs it."""

    lanes: int
    h: Array
    updates: list[tuple[int, kalman.Gains]] = field(default_factory=list)


class _Forward:
    """The forward pass over one window."""

    def __init__(self, window: Window, x: Array, P: Array, t: Array, memory: GateMemory) -> None:
        self.window = window
        self.x, self.P, self.t = x, P, t
        self.memory = memory
        self.steps: list[_Step] = []
        n = len(t)
        self.centre_x, self.centre_P = x.copy(), P.copy()
        self.settled_x, self.settled_P = x.copy(), P.copy()
        self.settled_memory = memory.take(np.arange(n))
        self.reason = np.zeros(window.kind.shape, dtype=np.uint8)
        self.half_width = np.full(window.kind.shape, np.nan)

    def run(self, q: Array) -> None:
        sensor = self.window.sensor_index
        for k, m in enumerate(self.window.active):
            x, P = self.x[:, :m], self.P[:, :m]
            time = self.window.time_s[k, :m]
            step = _Step(m, time - self.t[:m])
            kalman.predict(x, P, step.h, q[k, :m])
            self.t[:m] = time
            kind = self.window.kind[k, :m]
            is_report = kind == REPORT
            if is_report.any():
                self._update(k, m, x, P, sensor[k, :m], is_report, step)
            self._mark(kind, x, P)
            self.steps.append(step)

    def _update(self, k: int, m: int, x: Array, P: Array, sensor: Ints, is_report: Bools, step: _Step) -> None:
        w = self.window
        vx, vy = x[2], x[3]
        tv = w.time_variance[k, :m]
        r00 = w.r_ee[k, :m] + tv * vx * vx
        r01 = w.r_en[k, :m] + tv * vx * vy
        r11 = w.r_nn[k, :m] + tv * vy * vy
        r00, r11 = np.where(is_report, r00, 1.0), np.where(is_report, r11, 1.0)
        r01 = np.where(is_report, r01, 0.0)
        z0 = np.where(is_report, w.east_m[k, :m], x[0])
        z1 = np.where(is_report, w.north_m[k, :m], x[1])
        i = kalman.innovation(x, P, 0, z0, z1, r00, r01, r11)
        inside, half_width = self._inside(i, vx, vy)
        trace = w.r_ee[k, :m] + w.r_nn[k, :m]
        lanes = np.arange(m)
        passes = inside & (i.d2 <= GATE)
        opened = is_report & ~passes
        if opened.any():
            opened &= self.memory.opens(lanes, sensor, trace)
            if opened.any():
                _widen(P, i, opened)
                i = kalman.innovation(x, P, 0, z0, z1, r00, r01, r11)
        ok = is_report & (passes | opened)
        self.reason[k, :m] = np.where(ok | ~is_report, 0, np.where(inside, Reason.OUTLIER, Reason.OUTSIDE_BOUNDARY))
        self.half_width[k, :m] = np.where(is_report, half_width, np.nan)
        noted = np.flatnonzero(is_report)
        self.memory.note(noted, sensor[noted], trace[noted], ok[noted])
        step.updates.append((0, kalman.apply(x, P, i, ok)))
        rv = w.velocity_variance[k, :m]
        has_velocity = ok & np.isfinite(rv)
        if has_velocity.any():
            rv = np.where(has_velocity, rv + tv * (x[4] ** 2 + x[5] ** 2), 1.0)
            iv = kalman.innovation(
                x, P, 2,
                np.where(has_velocity, w.v_east_mps[k, :m], x[2]),
                np.where(has_velocity, w.v_north_mps[k, :m], x[3]),
                rv, np.zeros(m), rv,
            )  # fmt: skip
            step.updates.append((2, kalman.apply(x, P, iv, has_velocity & (iv.d2 <= GATE))))

    def _inside(self, i: kalman.Innovation, vx: Array, vy: Array) -> tuple[Bools, Array]:
        """Between the boundary lines and not too far along; a disc where there is no direction."""
        speed = np.hypot(vx, vy)
        moving = speed >= HOVER_MPS
        e0 = np.where(moving, vx / np.maximum(speed, HOVER_MPS), 1.0)
        e1 = np.where(moving, vy / np.maximum(speed, HOVER_MPS), 0.0)
        c01 = i.ell * i.c00
        c11 = i.s + i.ell * c01
        across = boundary_half_width(i.c00, c01, c11, -e1, e0)
        along = boundary_half_width(i.c00, c01, c11, e0, e1)
        offset_across = np.abs(-e1 * i.n0 + e0 * i.n1)
        offset_along = np.abs(e0 * i.n0 + e1 * i.n1)
        disc = np.maximum(across, along)
        inside = np.where(
            moving,
            (offset_across <= across) & (offset_along <= along),
            offset_across**2 + offset_along**2 <= disc**2,
        )
        return inside, np.where(moving, across, disc)

    def _mark(self, kind: NDArray[np.int8], x: Array, P: Array) -> None:
        at = np.flatnonzero(kind >= CENTRE)
        if not len(at):
            return
        centre = at[kind[at] == CENTRE]
        self.centre_x[:, centre] = x[:, centre]
        self.centre_P[:, centre] = P[:, centre]
        # Where there is no mark of its own, the settled state is the one at the centre; a later mark overwrites.
        settled = at[(kind[at] == SETTLED) | ((kind[at] == CENTRE) & self._one_mark[at])]
        self.settled_x[:, settled] = x[:, settled]
        self.settled_P[:, settled] = P[:, settled]
        self.settled_memory.put(settled, self.memory.take(settled))

    @property
    def _one_mark(self) -> Bools:
        return ~(self.window.kind == SETTLED).any(axis=0)


def _widen(P: Array, i: kalman.Innovation, where: Bools) -> None:
    """Widen position and velocity of lanes that have evidently gone astray, as process noise would."""
    off = np.where(where, i.n0**2 + i.n1**2, 0.0)
    P[[0, 7]] += off
    P[[12, 17]] += off / ASTRAY_S**2


def estimate(window: Window, q: Array, x: Array, P: Array, t: Array, memory: GateMemory) -> Estimate:
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
    """
    forward = _Forward(window, x, P, t, memory)
    forward.run(q)
    kind = window.kind
    n = kind.shape[1]
    adjoint = kalman.Adjoint(n)
    centre = kalman.Adjoint(n)
    first_centre = int((kind == CENTRE).argmax(axis=0).min()) if n else 0
    for k in range(len(forward.steps) - 1, first_centre - 1, -1):
        step = forward.steps[k]
        part = adjoint.lanes(step.lanes)
        at = np.flatnonzero(kind[k, : step.lanes] == CENTRE)
        centre.vector[:, at] = part.vector[:, at]
        centre.matrix[:, :, at] = part.matrix[:, :, at]
        for first, gains in reversed(step.updates):
            part.through_update(first, gains)
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
        forward.half_width,
    )
