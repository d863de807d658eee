"""Tentative tracks of one sensor: chains of plots that one flight could have made."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from aeroskein.association.gating import PointGrid
from aeroskein.association.scoring import GATE_BY_DOF
from aeroskein.plots import Array, Bools, Ints

__all__ = ["HITS_KEPT", "Tentative"]

# Nothing that flies on is faster than this over ground. [m/s]
SPEED_MAX_MPS: Final = 360.0
# Acceleration that a chain may show, one sigma per axis. [m/s²]
ACCELERATION_SIGMA: Final = 2.0
# Plots kept per chain: as many as may be wanted.
HITS_KEPT: Final = 8
# Chains kept at most; beyond it the oldest single plots go.
CHAINS_MAX: Final = 20_000
# Two reports nearer than this share of the period are of one scan.
SCAN_SHARE: Final = 0.5

# A chain is not continued after a longer gap.
AGE_MAX_PERIODS: Final = 2.5

_COLUMNS: Final = ("time_s", "first_s", "x", "P", "hits", "contested", "plots", "positions", "mode_a", "local_track",
                   "log_area", "fresh")  # fmt: skip


class Tentative:
    """Chains of plots, one row each; a row with one plot is a possible beginning.

    Attributes
    ----------
    time_s, first_s : (k,) float64
        Newest and first plot. [s since the epoch]
    x, P : (k, 4), (k, 4, 4) float64
        East, north and their velocities in the sensor's plane.
    hits, contested : (k,) int64
        Plots, and how many of them lay in the gate of a track.
    plots, positions : (k, 8), (k, 8, 2)
        The plots, newest first, and where they were.
    log_area : (k,) float64
        Sum over the plots after the first of the logarithm of the area that is as near to the expected place. [ln m²]
    fresh : (k,) bool
        Continued by the last call.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.time_s = self.first_s = np.empty(0)
        self.x, self.P = np.empty((0, 4)), np.empty((0, 4, 4))
        self.hits = self.contested = np.empty(0, dtype=np.int64)
        self.plots = np.empty((0, HITS_KEPT), dtype=np.int64)
        self.positions = np.empty((0, HITS_KEPT, 2))
        self.mode_a = self.local_track = np.empty(0, dtype=np.int64)
        self.log_area = np.empty(0)
        self.fresh = np.empty(0, dtype=np.bool_)

    def drop_stale(self, now_s: float, missed_max: int) -> None:
        """Drop chains that have missed more scans than allowed, all in all."""
        scans = np.round((now_s - SCAN_SHARE * self._period_s - self.first_s) / self._period_s) + 1
        # The scan that is under way is not counted as missed.
        self._keep(scans - self.hits <= missed_max)
        if len(self.time_s) > CHAINS_MAX:
            order = np.lexsort((-self.time_s, -self.hits))
            kept = np.zeros(len(order), dtype=np.bool_)
            kept[order[:CHAINS_MAX]] = True
            self._keep(kept)

    def drop_sharing(self, plots: Ints) -> None:
        """Drop chains that contain any of these plots."""
        if len(plots):
            shared = np.isin(self.plots, plots).sum(axis=1)
            self._keep(shared == 0)

    def extend(
        self, time_s: Array, position: Array, covariance: Array, name: Ints,
        mode_a: Ints, local_track: Ints, contested: Bools,
    ) -> None:  # fmt: skip
        """Continue chains by plots of less than one scan, and begin new ones."""
        n = len(time_s)
        arrays = (time_s, position, covariance, name, mode_a, local_track, contested)
        chain, plot = self._allowed(time_s, position, covariance, mode_a, local_track)
        single = self.hits[chain] == 1
        grown = self._continue(chain[~single], plot[~single], arrays)
        begun = self._begin(chain[single], plot[single], arrays)
        # Chains stay as they were beside their continuations only while they are single: another plot may fit better
        # later in the same scan. Continued chains are replaced.
        replaced = np.zeros(len(self.time_s), dtype=np.bool_)
        replaced[grown["source"]] = True
        self._keep(~replaced)
        self.fresh = np.zeros(len(self.time_s), dtype=np.bool_)
        single_x = np.concatenate([position, np.zeros((n, 2))], axis=1)
        single_P = np.zeros((n, 4, 4))
        single_P[:, :2, :2] = covariance
        names = np.full((n, HITS_KEPT), -1, dtype=np.int64)
        names[:, 0] = name
        places = np.zeros((n, HITS_KEPT, 2))
        places[:, 0] = position
        alone = {
            "time_s": time_s, "first_s": time_s, "x": single_x, "P": single_P, "hits": np.ones(n, dtype=np.int64),
            "contested": contested.astype(np.int64), "plots": names, "positions": places, "mode_a": mode_a,
            "local_track": local_track, "log_area": np.zeros(n), "fresh": np.zeros(n, dtype=np.bool_),
        }  # fmt: skip
        for column in _COLUMNS:
            setattr(self, column, np.concatenate([getattr(self, column), grown[column], begun[column], alone[column]]))

    # -- inside --------------------------------------------------------------------------------------------------
    def _keep(self, rows: Bools) -> None:
        if not rows.all():
            for column in _COLUMNS:
                setattr(self, column, getattr(self, column)[rows])

    def _allowed(
        self, time_s: Array, position: Array, covariance: Array, mode_a: Ints, local_track: Ints
    ) -> tuple[Ints, Ints]:
        """Pairs of a chain and a plot that place, time and identity allow; sensors number their targets for good."""
        if not len(self.time_s) or not len(time_s):
            none = np.empty(0, dtype=np.int64)
            return none, none
        sigma_m = np.sqrt(max(np.trace(c).max() for c in (covariance.T, self.P[:, :2, :2].T)))
        reach_m = SPEED_MAX_MPS * AGE_MAX_PERIODS * self._period_s + 6.0 * sigma_m
        grid = PointGrid(np.pad(self.x[:, :2], ((0, 0), (0, 1))), reach_m)
        plot, chain = grid.near(np.pad(position, ((0, 0), (0, 1))), reach_m)
        step_s = time_s[plot] - self.time_s[chain]
        allowed = step_s > SCAN_SHARE * self._period_s
        # A second plot must come in the very next scan.
        limit = np.where(self.hits[chain] > 1, AGE_MAX_PERIODS, 1.5) * self._period_s
        allowed &= step_s < limit
        for own, other in ((self.mode_a, mode_a), (self.local_track, local_track)):
            allowed &= (own[chain] < 0) | (other[plot] < 0) | (own[chain] == other[plot])
        return chain[allowed], plot[allowed]

    def _continue(self, chain: Ints, plot: Ints, arrays: tuple[Any, ...]) -> dict[str, Any]:
        """Chains of two plots and more, each with the plot that fits it best."""
        time_s, position, covariance = arrays[:3]
        x, P = _predicted(self.x[chain], self.P[chain], time_s[plot] - self.time_s[chain])
        innovation = position[plot] - x[:, :2]
        S = P[:, :2, :2] + covariance[plot]
        distance2, determinant = _distance2(innovation, S)
        inside = np.flatnonzero(distance2 < GATE_BY_DOF[2])
        order = inside[np.lexsort((distance2[inside], chain[inside]))]
        best = order[np.unique(chain[order], return_index=True)[1]]
        chain, plot, x, P = chain[best], plot[best], x[best], P[best]
        gain = np.linalg.solve(S[best], P[:, :2, :]).swapaxes(1, 2)
        x = x + np.einsum("kij,kj->ki", gain, innovation[best])
        P = P - gain @ P[:, :2, :]
        # Never smaller than the ellipse of one sigma: a lucky hit is not proof.
        area = np.pi * np.maximum(distance2[best], 1.0) * np.sqrt(determinant[best])
        return self._grown(chain, plot, arrays, x, P, area)

    def _begin(self, chain: Ints, plot: Ints, arrays: tuple[Any, ...]) -> dict[str, Any]:
        """Two plots that a flight could connect: position and velocity by difference."""
        time_s, position, covariance = arrays[:3]
        step_s = time_s[plot] - self.time_s[chain]
        step = position[plot] - self.x[chain, :2]
        length = np.linalg.norm(step, axis=1)
        both = self.P[chain][:, :2, :2] + covariance[plot]
        along = step / np.maximum(length, 1e-9)[:, None]
        slack = 3.0 * np.sqrt(np.einsum("ki,kij,kj->k", along, both, along))
        near = length < SPEED_MAX_MPS * step_s + slack
        chain, plot, step, step_s, both = chain[near], plot[near], step[near], step_s[near], both[near]
        x = np.concatenate([position[plot], step / step_s[:, None]], axis=1)
        R = covariance[plot]
        dt = step_s[:, None, None]
        P = np.zeros((len(chain), 4, 4))
        P[:, :2, :2] = R
        P[:, :2, 2:] = P[:, 2:, :2] = R / dt
        P[:, 2:, 2:] = both / dt**2
        radius = SPEED_MAX_MPS * step_s + slack[near]
        return self._grown(chain, plot, arrays, x, P, np.pi * radius**2)

    def _grown(
        self, chain: Ints, plot: Ints, arrays: tuple[Any, ...], x: Array, P: Array, area: Array
    ) -> dict[str, Any]:
        time_s, position, _, name, mode_a, local_track, contested = arrays
        return {
            "source": chain,
            "time_s": time_s[plot],
            "first_s": self.first_s[chain],
            "x": x,
            "P": P,
            "hits": self.hits[chain] + 1,
            "contested": self.contested[chain] + contested[plot],
            "plots": np.concatenate([name[plot][:, None], self.plots[chain][:, :-1]], axis=1),
            "positions": np.concatenate([position[plot][:, None], self.positions[chain][:, :-1]], axis=1),
            "mode_a": np.where(mode_a[plot] >= 0, mode_a[plot], self.mode_a[chain]),
            "local_track": np.where(local_track[plot] >= 0, local_track[plot], self.local_track[chain]),
            "log_area": self.log_area[chain] + np.log(area),
            "fresh": np.ones(len(chain), dtype=np.bool_),
        }


def _predicted(x: Array, P: Array, step_s: Array) -> tuple[Array, Array]:
    """Constant velocity with acceleration that is constant over the step."""
    F = np.tile(np.eye(4), (len(x), 1, 1))
    F[:, 0, 2] = F[:, 1, 3] = step_s
    G = np.zeros((len(x), 4, 2))
    G[:, 0, 0] = G[:, 1, 1] = 0.5 * step_s**2
    G[:, 2, 0] = G[:, 3, 1] = step_s
    return np.einsum("kij,kj->ki", F, x), F @ P @ F.swapaxes(1, 2) + ACCELERATION_SIGMA**2 * (G @ G.swapaxes(1, 2))


def _distance2(step: Array, covariance: Array) -> tuple[Array, Array]:
    a, b, c = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    determinant = a * c - b * b
    return (c * step[:, 0] ** 2 - 2.0 * b * step[:, 0] * step[:, 1] + a * step[:, 1] ** 2) / determinant, determinant
