"""Recorded traffic: three hours of real ADS-B around Paris as reports, and as motion for simulated radars.

The recording is the sample ``quickstart`` of the Python package ``traffic`` (OpenSky state vectors at 1 Hz). Only its
data file is read, found without importing the package, so nothing that the package needs has to be installed. ADS-B is
played as recorded, with its gaps, stale repeats and wrong ground flags; there was no recording of radars beside it, so
radars are simulated from the recorded positions.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.ellipsoid import ecef_axes, to_ecef
from aeroskein.plots import ON_GROUND, Array, Bools, Ints, Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation import Chunk, SimulationSettings, in_chunks, sensor_models
from aeroskein.simulation.delivery import delay_s
from aeroskein.simulation.draws import block_generator, hash_keys
from aeroskein.simulation.frames import above
from aeroskein.simulation.settings import SensorErrors
from aeroskein.simulation.truth import Identity, Motion, States
from aeroskein_service.recording import Recording

__all__ = ["RecordedTraffic"]

# Positions are interpolated over gaps up to this; the radars do not see an aircraft in a longer one. [s]
GAP_S: Final = 30.0

# Length of a block of motion, as in the simulator. [s]
BLOCK_S: Final = 2.0

# A radar further from the traffic than this sees none of it. [m]
OUT_OF_SIGHT_M: Final = 450_000.0


class RecordedTraffic:
    """A recording made playable: what the simulator gives, from real flights.

    Parameters
    ----------
    recording : Recording
        The reports.
    sensors : tuple of SensorSettings
        ADS-B sensors get the recorded reports, all others are simulated.
    settings : SimulationSettings
        Seed and errors of the simulated sensors; geometric-minus-pressure difference.
    """

    def __init__(self, recording: Recording, sensors: tuple[SensorSettings, ...], settings: SimulationSettings) -> None:
        self._recording, self._sensors, self._settings = recording, sensors, settings
        self._paths = _Paths(recording, settings.geometric_minus_pressure_m)

    @property
    def duration_s(self) -> float:
        """Length of the recording. [s]"""
        return float(self._recording.time_s[-1] - self._recording.time_s[0])

    @property
    def centre_deg(self) -> tuple[float, float]:
        """Latitude and longitude around which the traffic is. [deg]"""
        return float(np.median(self._recording.lat_deg)), float(np.median(self._recording.lon_deg))

    def notes(self) -> list[str]:
        """What whoever watches must be told: what is real, what is not, and what will not be seen."""
        recording, (lat_deg, lon_deg) = self._recording, self.centre_deg
        played = [sensor.id for sensor in self._sensors if sensor.kind == "adsb"]
        made = [sensor.id for sensor in self._sensors if sensor.kind != "adsb"]
        told = [
            f"{', '.join(played) or 'no sensor'}: recorded ADS-B, {len(recording.address)} aircraft and "
            f"{len(recording.time_s)} reports in {self.duration_s / 3600.0:.1f} hours around "
            f"{lat_deg:.2f}, {lon_deg:.2f} (delivery delays are simulated)"
        ]
        if recording.unusable:
            told.append(f"{recording.unusable} recorded rows have no position or address and are no reports")
        if made:
            told.append(f"{', '.join(made)}: SIMULATED from the recorded positions, no radar was recorded")
        middle_m = to_ecef(np.array([lat_deg]), np.array([lon_deg]))[0]
        for sensor in self._sensors:
            if sensor.is_radar and sensor.lat_deg is not None and sensor.lon_deg is not None:
                site_m = to_ecef(np.array([sensor.lat_deg]), np.array([sensor.lon_deg]))[0]
                away_m = float(np.linalg.norm(site_m - middle_m))
                if away_m > OUT_OF_SIGHT_M:
                    told.append(f"{sensor.id} stands {away_m / 1000.0:.0f} km from the recorded traffic and sees none")
        return told

    def chunks(
        self,
        *,
        start_s: float,
        end_s: float,
        chunk_s: float,
        only: Collection[str] | None = None,
        anchor_s: float | None = None,
    ) -> Iterator[Chunk]:
        """Play from ``start_s`` to ``end_s``, or to the end of the recording; the chunks carry no truth.

        The recording begins at ``anchor_s``, absent: at the start, and again each time when it is over: one call plays
        the round into which ``start_s`` falls. Processes with the same anchor agree.
        """
        anchor_s = start_s if anchor_s is None else anchor_s
        anchor_s += max(0.0, (start_s - anchor_s) // self.duration_s * self.duration_s)
        simulated = {s.id for s in self._sensors if s.kind != "adsb" and (only is None or s.id in only)}
        shift_s = anchor_s - float(self._recording.time_s[0])
        end_s = min(end_s, anchor_s + self.duration_s)
        made = sensor_models(
            self._settings, self._sensors, start_s=start_s, slots=len(self._recording.address), only=simulated
        )
        played = [
            _RecordedSensor(
                self._recording, sensor, index, self._settings.errors_of(sensor.id), self._settings.seed, shift_s
            )
            for index, sensor in enumerate(self._sensors)
            if sensor.kind == "adsb" and (only is None or sensor.id in only)
        ]
        return in_chunks(
            self._blocks(start_s, end_s, shift_s), [*played, *made], start_s=start_s, end_s=end_s, chunk_s=chunk_s
        )

    def _blocks(self, start_s: float, end_s: float, shift_s: float) -> Iterator[Motion]:
        for index in range(math.ceil((end_s - start_s) / BLOCK_S)):
            yield self._paths.block(index, start_s + index * BLOCK_S, shift_s)


class _RecordedSensor:
    """The recorded reports of a block."""

    def __init__(
        self, recording: Recording, sensor: SensorSettings, index: int, errors: SensorErrors, seed: int, shift_s: float
    ) -> None:
        self._recording, self._sensor, self._index = recording, sensor, index
        self._errors, self._seed, self._shift_s = errors, seed, shift_s

    def measure(self, motion: Motion) -> Plots:
        """The reports with times in a block."""
        rec, shift_s = self._recording, self._shift_s
        first, last = np.searchsorted(rec.time_s, [motion.start_s - shift_s, motion.end_s - shift_s])
        rows = np.arange(first, last)
        time_s = rec.time_s[rows] + shift_s
        rng = block_generator(self._seed, self._sensor.id, motion.index)
        return Plots.of(
            len(rows),
            time_s=time_s,
            received_s=time_s + delay_s(self._sensor, self._errors, len(rows), rng),
            sensor=self._index,
            address=rec.address[rec.slot[rows]],
            callsign=rec.callsign[rows],
            mode_a=rec.mode_a[rows],
            lat_deg=rec.lat_deg[rows],
            lon_deg=rec.lon_deg[rows],
            altitude_m=rec.altitude_m[rows],
            ground_speed_mps=rec.ground_speed_mps[rows],
            track_angle_deg=rec.track_angle_deg[rows],
            vertical_rate_mps=rec.vertical_rate_mps[rows],
            flags=np.where(rec.on_ground[rows], ON_GROUND, 0),
        )


class _Paths:
    """Where each aircraft was between its recorded positions, for the radars."""

    def __init__(self, recording: Recording, above_pressure_m: float) -> None:
        order = np.lexsort((recording.time_s, recording.slot))
        # On the ground no radar of ours sees anything; without an altitude there is no slant range.
        flying = ~recording.on_ground[order] & np.isfinite(recording.altitude_m[order])
        rows = order[flying]
        slot, lat_deg, lon_deg = recording.slot[rows], recording.lat_deg[rows], recording.lon_deg[rows]
        # A position that is only repeated says nothing about where the aircraft was.
        again = np.zeros(len(rows), dtype=np.bool_)
        again[1:] = (slot[1:] == slot[:-1]) & (lat_deg[1:] == lat_deg[:-1]) & (lon_deg[1:] == lon_deg[:-1])
        rows = rows[~again]
        self._slot, self._time_s = recording.slot[rows], recording.time_s[rows]
        self._up = ecef_axes(recording.lat_deg[rows], recording.lon_deg[rows])[2]
        self._altitude_m, self._above_pressure_m = recording.altitude_m[rows], above_pressure_m
        self._mode_a = recording.last_mode_a[rows]
        # One sorted key for all aircraft, so that one search finds everybody's neighbours in time.
        self._begin_s = float(recording.time_s[0])
        self._stride_s = 2.0 * float(recording.time_s[-1] - self._begin_s) + 1.0
        self._key = self._slot * self._stride_s + (self._time_s - self._begin_s)
        step_s, same = np.diff(self._time_s), np.diff(self._slot) == 0
        closed = np.r_[same & (step_s <= GAP_S), False]
        self._open_before = np.r_[0, np.cumsum(~closed)]
        n = len(recording.address)
        self._identity = Identity(
            hash_keys(np.arange(n)), recording.address, np.full(n, -1, dtype=np.int16), np.full(n, b"", dtype="S8")
        )

    def block(self, index: int, start_s: float, shift_s: float) -> _Block:
        """The motion of a block."""
        slots = np.arange(len(self._identity.address))
        first = self.before(slots, np.full(len(slots), start_s - shift_s))
        last = self.before(slots, np.full(len(slots), start_s + BLOCK_S - shift_s))
        known = self._inside(first, slots) & self._inside(last, slots)
        # No gap begins between the first and the last neighbour.
        known &= self._open_before[np.maximum(last, 0) + 1] == self._open_before[np.maximum(first, 0)]
        identity = self._identity
        identity.mode_a[known] = self._mode_a[first[known]]
        return _Block(index, start_s, start_s + BLOCK_S, np.flatnonzero(known), identity, self, shift_s)

    def _inside(self, position: Ints, slots: Ints) -> Bools:
        return np.asarray((position >= 0) & (self._slot[np.maximum(position, 0)] == slots))

    def before(self, slots: Ints, time_s: Array) -> Ints:
        """The last recorded position of each slot up to a time: its place among all, or that of another slot's."""
        return np.searchsorted(self._key, slots * self._stride_s + (time_s - self._begin_s), side="right") - 1

    def at(self, slots: Ints, time_s: Array) -> States:
        """States of slots that are known at these times of the recording."""
        i = np.minimum(self.before(slots, time_s), len(self._key) - 2)
        u = ((time_s - self._time_s[i]) / (self._time_s[i + 1] - self._time_s[i]))[:, None]
        up = (1.0 - u) * self._up[i] + u * self._up[i + 1]
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        altitude_m = (1.0 - u[:, 0]) * self._altitude_m[i] + u[:, 0] * self._altitude_m[i + 1]
        height_m = altitude_m + self._above_pressure_m
        still = np.zeros(len(slots))
        return States(up, above(up, height_m), height_m, altitude_m, np.zeros_like(up), still)


@dataclass(slots=True, eq=False)
class _Block:
    """Two seconds of recorded motion: implements ``Motion``."""

    index: int
    start_s: float
    end_s: float
    rows: Ints
    identity: Identity
    paths: _Paths
    shift_s: float

    def at(self, rows: Ints, time_s: Array) -> States:
        """States of rows at times inside the block."""
        return self.paths.at(rows, time_s - self.shift_s)
