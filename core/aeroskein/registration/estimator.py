"""The default estimator of registration: one joint Kalman filter per group of radars that can share aircraft."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.comparisons import Comparisons
from aeroskein.registration.group import RadarGroup
from aeroskein.registration.rows import BIASES, Noise
from aeroskein.settings import EngineSettings

__all__ = ["AZIMUTH_SIGMA_DEG", "RANGE_SIGMA_M", "KalmanEstimator", "preset_of", "prior_sigma_of"]

# Prior of an unregistered radar: a badly aligned north is half a degree, an uncompensated delay 300 m.
RANGE_SIGMA_M: Final = 300.0
AZIMUTH_SIGMA_DEG: Final = 0.5
# Reach of a radar whose instrumented range is not given: 250 NM, the longest in use. [m]
REACH_M: Final = 470_000.0


def preset_of(settings: EngineSettings) -> Array:
    """Configured biases of every sensor, ``(sensors, 4)``."""
    return np.array([[s.range_bias_m, s.azimuth_bias_deg, s.time_bias_s, s.range_gain] for s in settings.sensors])


def prior_sigma_of(settings: EngineSettings) -> Array:
    """Prior sigma of every sensor, ``(sensors, 4)``; a range gain is not estimated at the start."""
    return np.array([[RANGE_SIGMA_M, AZIMUTH_SIGMA_DEG, s.time_bias_sigma_s, 0.0] for s in settings.sensors])


class KalmanEstimator:
    """Biases of all radars.

    Parameters
    ----------
    settings : EngineSettings
        Sensors, in the order of the sensor index.
    sites : (sensors, 12) array
        Frames at the antennas; rows of other sensors are not read.
    """

    def __init__(self, settings: EngineSettings, sites: Array) -> None:
        sensors = len(settings.sensors)
        noise = Noise.of(settings)
        period_s = np.array([s.period_s for s in settings.sensors])
        mean, sigma = preset_of(settings), prior_sigma_of(settings)
        self.groups = [
            RadarGroup(members, sites, noise, period_s, mean[members], sigma[members])
            for members in _groups_of(settings, sites)
        ]
        self._group_of = np.full(sensors, -1, dtype=np.int64)
        self._place_of = np.full(sensors, -1, dtype=np.int64)
        for g, group in enumerate(self.groups):
            self._group_of[group.members] = g
            self._place_of[group.members] = np.arange(len(group.members))
        self._preset = mean

    def add(self, rows: Comparisons) -> bool:
        """Take comparisons in; says whether any estimate has changed by now."""
        group_of, changed = self._group_of[rows.sensor], False
        for g, group in enumerate(self.groups):
            own = group_of == g
            if own.any():
                changed |= group.add(rows if own.all() else rows.take(own))
        return changed

    def advance(self, now_s: float) -> None:
        """Let time pass."""
        for group in self.groups:
            group.advance(now_s)

    def means(self) -> Array:
        """``(sensors, 4)``; the preset for sensors that are no radars."""
        out = self._preset.copy()
        for group in self.groups:
            out[group.members] = group.filter.biases
        return out

    def covariances(self) -> Array:
        """Each radar's own, ``(sensors, 4, 4)``; zero for sensors that are no radars."""
        out = np.zeros((len(self._preset), BIASES, BIASES))
        for group in self.groups:
            out[group.members] = group.covariances
        return out

    def relative_covariances(self) -> Array:
        """As ``covariances``, without the time that all radars of a group have in common where that is unknown.

        Without an anchor the common time only moves the whole picture along; it does not disturb how plots of several
        radars fit together, so it must not make them look uncertain against each other.
        """
        out = self.covariances()
        for group in self.groups:
            k = len(group.members)
            if k < 2:
                continue
            joint = group.filter.bias_covariance.reshape(k * BIASES, k * BIASES)
            times = np.arange(k) * BIASES + 2
            remove = np.eye(k * BIASES)
            remove[np.ix_(times, times)] -= 1.0 / k
            relative = (remove @ joint @ remove.T).reshape(k, BIASES, k, BIASES)[np.arange(k), :, np.arange(k), :]
            better = relative[:, 2, 2] < out[group.members][:, 2, 2]
            out[group.members[better]] = relative[better]
        return out

    def counts(self) -> tuple[Ints, Ints]:
        """Plots used and aircraft they came from, ``(sensors,)`` each."""
        samples = np.zeros(len(self._preset), dtype=np.int64)
        aircraft = np.zeros(len(self._preset), dtype=np.int64)
        for group in self.groups:
            samples[group.members] = group.samples
            aircraft[group.members] = group.aircraft
        return samples, aircraft

    def last_s(self) -> Array:
        """When each radar was last compared, ``(sensors,)``; minus infinity where never. [s since the epoch]"""
        out = np.full(len(self._preset), -np.inf)
        for group in self.groups:
            out[group.members] = group.last_s
        return out

    def jumps(self) -> Ints:
        """Jumps found so far, ``(sensors,)``."""
        out = np.zeros(len(self._preset), dtype=np.int64)
        for group in self.groups:
            out[group.members] = group.jumps
        return out

    def restart(self, sensor: int, mean: Array, sigma: Array) -> None:
        """Begin anew with one radar from the given mean and sigma, ``(4,)`` each."""
        self.groups[self._group_of[sensor]].restart(int(self._place_of[sensor]), mean, sigma)

    def adjust(self, sensor: int, change: Array, slack: Array) -> None:
        """Move one radar's biases by a known change with sigmas ``slack``, ``(4,)`` each."""
        self.groups[self._group_of[sensor]].adjust(int(self._place_of[sensor]), change, slack)

    def hold(self, sensor: int, held: bool) -> None:
        """Freeze one radar or let it go."""
        self.groups[self._group_of[sensor]].hold(int(self._place_of[sensor]), held)

    def held(self) -> Bools:
        """Which radars are frozen, ``(sensors,)``."""
        out = np.zeros(len(self._preset), dtype=np.bool_)
        for group in self.groups:
            out[group.members] = group.filter.considered
        return out

    def export(self) -> list[dict[str, Any]]:
        """Plain content of every group, for a snapshot."""
        return [group.export() for group in self.groups]

    def load(self, content: list[dict[str, Any]], indices: dict[int, int]) -> None:
        """Take an ``export`` over; ``indices`` maps its sensor indices to today's (missing: no longer there)."""
        for part in content:
            known = [(k, indices[s]) for k, s in enumerate(part["members"]) if s in indices]
            for group in self.groups:
                mine = [(k, int(self._place_of[s])) for k, s in known if s in group.members]
                if mine:
                    group.load(part, mine)


def _groups_of(settings: EngineSettings, sites: Array) -> list[Ints]:
    """Radars whose reaches touch, directly or by others, belong together."""
    radars = np.array([i for i, s in enumerate(settings.sensors) if s.is_radar], dtype=np.int64)
    if len(radars) == 0:
        return []
    reach_m = np.array([settings.sensors[i].range_max_m or REACH_M for i in radars])
    distance_m = np.linalg.norm(sites[radars, None, 0:3] - sites[None, radars, 0:3], axis=-1)
    linked = distance_m < reach_m[:, None] + reach_m[None, :]
    label = np.arange(len(radars))
    for _ in radars:
        label = np.where(linked, label[None, :], len(radars)).min(axis=1)
    return [radars[label == one] for one in np.unique(label)]
