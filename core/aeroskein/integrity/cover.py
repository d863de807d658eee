"""Cover: where a radar would see an aircraft, learned from what it reports.

Plots are counted in cells of azimuth, slant range and elevation. A radar that has seen aircraft further out at a lower
elevation in the same direction sees what is nearer and higher: line of sight is all there is. Where known aircraft are
missed all the same, the cell loses its credit. With an instrumented range configured, everything above the horizon
within it is cover until misses speak against it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.ellipsoid import EARTH_M
from aeroskein.plots import Array, Bools, Ints
from aeroskein.units import wrap_azimuth_deg

__all__ = ["CoverMap", "polar_of"]

SECTORS: Final = 36
RANGE_BIN_M: Final = 10_000.0
RANGE_BINS: Final = 48
# Lower edges of elevation bins: fine near the horizon, where cover ends. [deg]
ELEVATION_EDGES_DEG: Final = np.array(
    [-2.0, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 14.0, 20.0]
)
# Above this elevation a radar may be blind: the cone of silence. [deg]
ELEVATION_MAX_DEG: Final = 30.0
# Nearer than this the radar may blank itself. [m]
RANGE_MIN_M: Final = 5_000.0
# Plots further out and lower that prove a line of sight.
PROOFS: Final = 4.0
# The same over many sectors: how many to each side, how many bins lower, and how many plots.
WIDE_SECTORS: Final = 4
WIDE_LEVELS: Final = 2
WIDE_PROOFS: Final = 12.0
# Over all sectors: from this elevation [deg], by so many plots. Radars do not stand where hills rise higher.
FREE_DEG: Final = 2.0
FREE_PROOFS: Final = 40.0
# Margin over the horizon where cover comes from an instrumented range. [deg]
HORIZON_MARGIN_DEG: Final = 0.5
# Probability of detection believed of a cell before it has been tried, and the weight of that belief in looks.
DETECTION_PRIOR: Final = 0.95
DETECTION_WEIGHT: Final = 10.0
# A cell below this is no cover; above the other nobody believes a radar.
DETECTION_MIN: Final = 0.7
DETECTION_MAX: Final = 0.97
# Looks are forgotten over this time: trees grow and filters are changed. [s]
MEMORY_S: Final = 4.0 * 3600.0
# Line of sight: an earth of 4/3 of its radius stands for refraction. [m]
EFFECTIVE_RADIUS_M: Final = 4.0 / 3.0 * EARTH_M
# Proofs are summed up anew after this time, and sooner where so much more has been seen since. [s], [share]
REFRESH_S: Final = 5.0
REFRESH_GROWTH: Final = 0.1


def polar_of(site: Array, ecef_m: Array) -> tuple[Array, Array, Array]:
    """Slant range, azimuth and geometric elevation of points ``(n, 3)`` from a radar's frame ``(12,)``: ``(n,)`` each.

    [m, m] to [m, deg, deg]
    """
    e, n, u = site[3:].reshape(3, 3) @ (ecef_m - site[0:3]).T
    range_m = np.sqrt(e * e + n * n + u * u)
    elevation = np.degrees(np.arcsin(u / np.maximum(range_m, 1.0)))
    return range_m, wrap_azimuth_deg(np.degrees(np.arctan2(e, n))), elevation


class CoverMap:
    """Cover of one radar.

    Parameters
    ----------
    range_max_m : float or None
        Instrumented range; None: only what has been learned is cover. [m]
    """

    def __init__(self, range_max_m: float | None) -> None:
        self._range_max_m = range_max_m
        shape = (SECTORS, RANGE_BINS, len(ELEVATION_EDGES_DEG))
        self._seen = np.zeros(shape)
        self._hits = np.zeros(shape)
        self._misses = np.zeros(shape)
        self._proofs = np.zeros(shape)
        self._time_s = np.nan
        self._fresh_s = -np.inf
        # Plots counted so far, and how many of them the proofs know.
        self._plots = self._proved_plots = 0

    def seen(
        self, range_m: Array, azimuth_deg: Array, elevation_deg: Array, time_s: float, tracked: Bools | None = None
    ) -> None:
        """Count plots of any aircraft, ``(n,)`` each; rows with NaN are left out.

        Plots of ``tracked`` aircraft, which the radar is known to see, are looks that found them as well.
        """
        known = np.isfinite(range_m + azimuth_deg + elevation_deg).nonzero()[0]
        self._plots += len(known)
        cells = self._cells(range_m[known], azimuth_deg[known], elevation_deg[known])
        np.add.at(self._seen.reshape(-1), cells, 1.0)
        self._age(time_s)
        if tracked is not None:
            np.add.at(self._hits.reshape(-1), cells[tracked[known]], 1.0)

    def looked(self, range_m: Array, azimuth_deg: Array, elevation_deg: Array, hit: Bools) -> None:
        """Count looks at aircraft that the radar is known to see: found or missed, ``(n,)`` each."""
        cells = self._cells(range_m, azimuth_deg, elevation_deg)
        np.add.at(self._hits.reshape(-1), cells, hit.astype(np.float64))
        np.add.at(self._misses.reshape(-1), cells, (~hit).astype(np.float64))

    def detection(self, range_m: Array, azimuth_deg: Array, elevation_deg: Array, now_s: float) -> Array:
        """Probability that a turn of the radar shows an aircraft there, ``(n,)``; 0 outside cover."""
        if now_s - self._fresh_s > REFRESH_S or self._plots > (1.0 + REFRESH_GROWTH) * self._proved_plots:
            self._refresh(now_s)
        cells = self._cells(range_m, azimuth_deg, elevation_deg)
        covered = self._proofs.reshape(-1)[cells] >= PROOFS
        if self._range_max_m is not None:
            # The geometric elevation of the horizon is that of the refracted ray.
            dip_deg = np.degrees(range_m / 2.0 * (1.0 / EARTH_M - 1.0 / EFFECTIVE_RADIUS_M))
            covered |= (range_m < self._range_max_m) & (elevation_deg + dip_deg > HORIZON_MARGIN_DEG)
        covered &= (range_m > RANGE_MIN_M) & (elevation_deg < ELEVATION_MAX_DEG)
        hits, misses = self._hits.reshape(-1)[cells], self._misses.reshape(-1)[cells]
        share = (hits + DETECTION_PRIOR * DETECTION_WEIGHT) / (hits + misses + DETECTION_WEIGHT)
        covered &= share > DETECTION_MIN
        return np.where(covered, np.minimum(share, DETECTION_MAX), 0.0)

    def _refresh(self, now_s: float) -> None:
        """Sum up, for every cell, the plots at least as far and not higher, in its sector and the two beside it."""
        self._fresh_s, self._proved_plots = now_s, self._plots
        around = self._seen + np.roll(self._seen, 1, axis=0) + np.roll(self._seen, -1, axis=0)
        further = np.cumsum(around[:, ::-1], axis=1)[:, ::-1]
        lower = np.cumsum(further, axis=2)
        # A cell's own plots may all be at its upper edge: only lower bins prove it, except with plenty in itself.
        self._proofs = np.concatenate([np.zeros_like(lower[:, :, :1]), lower[:, :, :-1]], axis=2)
        self._proofs = np.maximum(self._proofs, 0.25 * around)
        # Well above what is seen further out within 45 degrees on either side, one horizon is like the next; high
        # above the ground all directions are alike.
        wide = np.sum([np.roll(self._seen, k, axis=0) for k in range(-WIDE_SECTORS, WIDE_SECTORS + 1)], axis=0)
        self._prove_above(wide, WIDE_LEVELS, WIDE_LEVELS, WIDE_PROOFS)
        every = np.broadcast_to(self._seen.sum(axis=0), self._seen.shape)
        self._prove_above(every, WIDE_LEVELS, int(np.searchsorted(ELEVATION_EDGES_DEG, FREE_DEG)), FREE_PROOFS)

    def _prove_above(self, seen: Array, levels: int, lowest: int, needed: float) -> None:
        """Prove cells of elevation bin ``lowest`` and higher by plots further out and ``levels`` bins lower."""
        below = np.cumsum(np.cumsum(seen[:, ::-1], axis=1)[:, ::-1], axis=2)
        proofs = below[:, :, lowest - levels : below.shape[2] - levels] * (PROOFS / needed)
        self._proofs[:, :, lowest:] = np.maximum(self._proofs[:, :, lowest:], proofs)

    def _age(self, time_s: float) -> None:
        step_s = 0.0 if np.isnan(self._time_s) else time_s - self._time_s
        if np.isnan(self._time_s) or step_s > MEMORY_S / 100.0:
            keep = np.exp(-max(step_s, 0.0) / MEMORY_S)
            for table in (self._seen, self._hits, self._misses):
                table *= keep
            self._time_s = time_s

    def _cells(self, range_m: Array, azimuth_deg: Array, elevation_deg: Array) -> Ints:
        """Places ``(n,)`` in the flattened tables."""
        sector = (azimuth_deg * (SECTORS / 360.0)).astype(np.int64) % SECTORS
        ring = np.minimum(np.maximum(range_m / RANGE_BIN_M, 0), RANGE_BINS - 1).astype(np.int64)
        level = np.maximum(np.searchsorted(ELEVATION_EDGES_DEG, elevation_deg, side="right") - 1, 0)
        cells: Ints = (sector * RANGE_BINS + ring) * len(ELEVATION_EDGES_DEG) + level
        return cells
