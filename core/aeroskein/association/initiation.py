"""Initiation: new tracks from plots without identity that no track wanted, without making tracks of false plots.

Two plots of neighbouring scans that a flight could connect begin a tentative track; later plots continue it if they lie
where a constant velocity flight with a little acceleration would be. Plots may belong to several tentative tracks until
one of them is confirmed; then the others that share its plots go. Confirmation takes three plots in four scans *and* a
chain of plots that false ones would not form: the expected number of equally good chains per hour, from the density of
false plots measured around it (after Sittler 1964 and the product rule of track-before-confirm), must be small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.association.clutter import ClutterMap
from aeroskein.association.tentative import HITS_KEPT, Tentative
from aeroskein.geodesy import frame_rows, to_plane
from aeroskein.plots import Array, Bools, Ints
from aeroskein.settings import EngineSettings

__all__ = ["FreePlots", "Initiated", "Initiator"]

# Three plots in four scans, as usual for radar data processing.
HITS_MIN: Final = 3
SCANS_MAX_MISSED: Final = 1
# Where most plots lie in the gate of an existing track the new one may be its echo: this many are wanted.
HITS_MIN_CONTESTED: Final = 6
# Expected chains of false plots per hour that are as good as this one.
FALSE_PER_HOUR_MAX: Final = 0.02
# Slower than this, what comes back every scan is the ground. [m/s]
SPEED_MIN_MPS: Final = 20.0
# Part of a scan that is handled at once: within it no target is seen twice.
SLICE: Final = 0.4


@dataclass(slots=True, eq=False)
class FreePlots:
    """Plots that no track wanted, ``(n,)`` columns.

    Attributes
    ----------
    plot : int64
        Any number that names the plot; comes back in ``Initiated.plots``.
    sensor : int64
        Index of the sensor.
    time_s : float64
        Corrected time. [s since the epoch]
    lat_deg, lon_deg : float64
        Corrected position. [deg]
    mode_a, local_track : int64
        -1 where absent.
    contested : bool
        In the gate of a track that got another plot.
    """

    plot: Ints
    sensor: Ints
    time_s: Array
    lat_deg: Array
    lon_deg: Array
    mode_a: Ints
    local_track: Ints
    contested: Bools

    def take(self, rows: NDArray[np.int64]) -> FreePlots:
        """The given rows, in that order."""
        return FreePlots(*(getattr(self, name)[rows] for name in self.__slots__))


@dataclass(slots=True, eq=False)
class Initiated:
    """Tracks that were confirmed, one row each.

    Attributes
    ----------
    sensor : (k,) int64
        The sensor that saw them.
    plots : (k, 8) int64
        Names of their plots, newest first, -1 where there are fewer.
    time_s : (k,) float64
        Of the newest. [s since the epoch]
    lat_deg, lon_deg : (k,) float64
        Of the newest plot. [deg]
    v_east_mps, v_north_mps : (k,) float64
        Velocity estimate in the sensor's plane. [m/s]
    """

    sensor: Ints
    plots: Ints
    time_s: Array
    lat_deg: Array
    lon_deg: Array
    v_east_mps: Array
    v_north_mps: Array

    def __len__(self) -> int:
        return len(self.sensor)


class Initiator:
    """Tentative tracks of all sensors.

    Parameters
    ----------
    settings : EngineSettings
        Sensors with their periods and accuracies.
    """

    def __init__(self, settings: EngineSettings) -> None:
        self._sensors = settings.sensors
        self._frames: dict[int, Array] = {}
        self._tentative: dict[int, Tentative] = {}
        self._clutter: dict[int, ClutterMap] = {}

    def add(self, plots: FreePlots) -> Initiated:
        """Take plots in, in any number; gives the tracks that they confirm."""
        made: list[Initiated] = []
        for sensor in np.unique(plots.sensor):
            rows = np.flatnonzero(plots.sensor == sensor)
            rows = rows[np.argsort(plots.time_s[rows], kind="stable")]
            slice_s = SLICE * self._sensors[sensor].period_s
            number = np.floor((plots.time_s[rows] - plots.time_s[rows[0]]) / slice_s)
            # Not a loop over plots: one turn per part of a scan, one in all for a live batch.
            for part in np.split(rows, np.flatnonzero(np.diff(number)) + 1):
                made.append(self._add_slice(int(sensor), plots.take(part)))
        return _together(made)

    def tentative_count(self) -> int:
        """How many tentative tracks with two plots or more are followed."""
        return sum(int((t.hits >= 2).sum()) for t in self._tentative.values())

    def _add_slice(self, sensor: int, plots: FreePlots) -> Initiated:
        tentative, clutter, frame = self._of_sensor(sensor, plots)
        e_m, n_m = to_plane(frame[None, :], plots.lat_deg, plots.lon_deg)
        position = np.stack([e_m, n_m], axis=-1)
        covariance = self._covariance(sensor, position)
        newest_s = float(plots.time_s.max())
        clutter.add(position, newest_s)
        tentative.drop_stale(newest_s, SCANS_MAX_MISSED)
        tentative.extend(
            plots.time_s, position, covariance, plots.plot, plots.mode_a, plots.local_track, plots.contested
        )
        done = self._confirmed(tentative, clutter)
        at = np.array([np.flatnonzero(plots.plot == p)[0] for p in tentative.plots[done, 0]], dtype=np.int64)
        result = Initiated(
            np.full(len(done), sensor), tentative.plots[done].copy(), tentative.time_s[done].copy(),
            plots.lat_deg[at], plots.lon_deg[at], tentative.x[done, 2].copy(), tentative.x[done, 3].copy(),
        )  # fmt: skip
        used = tentative.plots[done]
        clutter.take_out(tentative.positions[done].reshape(-1, 2)[(used >= 0).reshape(-1)])
        tentative.drop_sharing(used[used >= 0])
        return result

    def _confirmed(self, tentative: Tentative, clutter: ClutterMap) -> Ints:
        """Tentative tracks to confirm now, best first, no two of which share a plot."""
        wanted = np.where(2 * tentative.contested > tentative.hits, HITS_MIN_CONTESTED, HITS_MIN)
        enough = tentative.fresh & (tentative.hits >= wanted)
        rows = np.flatnonzero(enough & (np.hypot(tentative.x[:, 2], tentative.x[:, 3]) > SPEED_MIN_MPS))
        if not len(rows):
            return rows
        density = clutter.density(tentative.x[rows, :2])
        log_chance = tentative.log_area[rows] + (tentative.hits[rows] - 1) * np.log(density)
        log_chance += np.log(clutter.plots_per_hour())
        good = log_chance < np.log(FALSE_PER_HOUR_MAX)
        rows, log_chance = rows[good], log_chance[good]
        rows = rows[np.argsort(log_chance, kind="stable")]
        kept: Ints = rows[_first_without_sharing(tentative.plots[rows])]
        return kept

    def _of_sensor(self, sensor: int, plots: FreePlots) -> tuple[Tentative, ClutterMap, Array]:
        if sensor not in self._frames:
            s = self._sensors[sensor]
            lat = plots.lat_deg[0] if s.lat_deg is None else s.lat_deg
            lon = plots.lon_deg[0] if s.lon_deg is None else s.lon_deg
            self._frames[sensor] = frame_rows(np.array([lat]), np.array([lon]))[0]
            self._tentative[sensor] = Tentative(s.period_s)
            self._clutter[sensor] = ClutterMap(s.period_s)
        return self._tentative[sensor], self._clutter[sensor], self._frames[sensor]

    def _covariance(self, sensor: int, position: Array) -> Array:
        s = self._sensors[sensor]
        if not s.is_radar:
            return np.broadcast_to(np.eye(2) * s.position_sigma_m**2, (len(position), 2, 2)).copy()
        ground = np.maximum(np.linalg.norm(position, axis=1), 1.0)
        u = position / ground[:, None]
        across = np.stack([u[:, 1], -u[:, 0]], axis=-1)
        across_sigma = ground * np.radians(s.azimuth_sigma_deg)
        covariance: Array = s.range_sigma_m**2 * u[:, :, None] * u[:, None, :]
        covariance += (across_sigma**2)[:, None, None] * across[:, :, None] * across[:, None, :]
        return covariance


def _first_without_sharing(plots: Ints) -> Ints:
    """Rows of ``(k, 8)`` that share no plot with an earlier row kept; few rows, the best first."""
    seen: set[int] = set()
    kept = []
    for row, names in enumerate(plots.tolist()):
        own = {name for name in names if name >= 0}
        if not own & seen:
            kept.append(row)
            seen |= own
    return np.array(kept, dtype=np.int64)


def _together(parts: list[Initiated]) -> Initiated:
    if not parts:
        none = np.empty(0)
        return Initiated(none.astype(np.int64), np.empty((0, HITS_KEPT), dtype=np.int64), none, none, none, none, none)
    return Initiated(*(np.concatenate([getattr(p, name) for p in parts]) for name in Initiated.__slots__))
