"""Rotating radars: slant range and azimuth of what the antenna sweeps over, once a turn.

The antenna turns at a constant rate, so the plots of different aircraft are spread over the scan by their azimuth. A
secondary radar reads Mode A, Mode C and (Mode S) the address; a primary radar sees neither identity nor altitude, and
sometimes plots that are no aircraft.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from aeroskein.errors import SettingsError
from aeroskein.geodesy import frame_rows
from aeroskein.plots import SIMULATED, Array, Ints, Plots
from aeroskein.radar_geometry import geodetic_to_radar
from aeroskein.settings import SensorSettings
from aeroskein.simulation.delivery import delay_s, mode_c, survives, with_duplicates
from aeroskein.simulation.draws import block_generator, hash_keys, hashed_uniform
from aeroskein.simulation.frames import latitude_longitude_deg
from aeroskein.simulation.settings import SensorErrors
from aeroskein.simulation.truth import Motion, States
from aeroskein.units import wrap_angle_deg, wrap_azimuth_deg

__all__ = ["RadarSensor", "Site"]

# Instrumented range of a radar whose settings name none. [m]
USUAL_RANGE_M: Final = 400_000.0


class Site:
    """Where an antenna stands, and what can be seen from there."""

    def __init__(self, sensor: SensorSettings) -> None:
        if sensor.lat_deg is None or sensor.lon_deg is None:
            raise SettingsError(f"sensors.{sensor.id}.lat_deg", "the simulator needs the site of a sensor with a range")
        place = (np.array([value]) for value in (sensor.lat_deg, sensor.lon_deg, sensor.height_m or 0.0))
        self._frame = frame_rows(*place)

    def see(self, states: States) -> tuple[Array, Array, Array]:
        """Slant range [m], azimuth clockwise from true north [deg] and elevation [deg], without errors."""
        return geodetic_to_radar(self._frame, *latitude_longitude_deg(states.up), states.height_m)


class RadarSensor:
    """One radar: turns blocks of motion into plots. Parameters as of ``PositionSensor``."""

    def __init__(
        self, sensor: SensorSettings, index: int, errors: SensorErrors, *, seed: int, start_s: float, slots: int
    ) -> None:
        self._sensor, self._index, self._errors, self._seed, self._start_s = sensor, index, errors, seed, start_s
        self._site = Site(sensor)
        usual_m = sensor.range_max_m if sensor.range_max_m is not None else USUAL_RANGE_M
        self._range_max_m = errors.range_max_m if errors.range_max_m is not None else usual_m
        self._range_sigma_m = sensor.range_sigma_m if errors.range_sigma_m is None else errors.range_sigma_m
        self._azimuth_sigma_deg = (
            sensor.azimuth_sigma_deg if errors.azimuth_sigma_deg is None else errors.azimuth_sigma_deg
        )
        self._time_sigma_s = sensor.effective_time_sigma_s if errors.time_sigma_s is None else errors.time_sigma_s
        self._outliers = errors.outlier_probability or 0.0
        # Where the antenna points at the epoch, in turns.
        self._phase = float(hashed_uniform(hash_keys(seed, index), 60)[0])

    def measure(self, motion: Motion) -> Plots:
        """The plots measured in a block, in no order."""
        rng = block_generator(self._seed, self._sensor.id, motion.index)
        rows, time_s = self._sweeps(motion)
        kept = survives(self._errors, time_s - self._start_s, rng)
        rows, time_s = rows[kept], time_s[kept]
        states = motion.at(rows, time_s)
        range_m, azimuth_deg, elevation_deg = self._site.see(states)
        errors = self._errors
        seen = (range_m >= errors.range_min_m) & (range_m <= self._range_max_m)
        seen &= (elevation_deg >= errors.elevation_min_deg) & (elevation_deg <= errors.elevation_max_deg)
        rows, time_s, range_m, azimuth_deg = rows[seen], time_s[seen], range_m[seen], azimuth_deg[seen]
        columns = self._replies(motion, rows, states.altitude_m[seen])
        plots = self._plots(time_s, range_m, azimuth_deg, columns, rng)
        if errors.false_plots > 0.0 and self._sensor.kind == "psr":
            plots = Plots.concatenate([plots, self._false_plots(motion, rng)])
        return with_duplicates(plots, errors, rng)

    def _sweeps(self, motion: Motion) -> tuple[Ints, Array]:
        """Rows and times at which the antenna sweeps over an aircraft in a block."""
        rows, n = motion.rows, len(motion.rows)
        ends = motion.at(np.tile(rows, 2), np.repeat([motion.start_s, motion.end_s], n))
        _, azimuth_deg, _ = self._site.see(ends)
        first_deg = azimuth_deg[:n]
        change = wrap_angle_deg(azimuth_deg[n:] - first_deg) / 360.0
        # The angle from aircraft to antenna, in turns; the antenna sweeps over where it passes a whole number.
        before = self._antenna_turns(motion.start_s) - first_deg / 360.0
        after = before + (motion.end_s - motion.start_s) / self._sensor.period_s - change
        most = int(np.ceil((motion.end_s - motion.start_s) / self._sensor.period_s)) + 1
        crossing = np.ceil(before) + np.arange(most)[:, None]
        turn, which = np.nonzero(crossing < after)
        share = (crossing[turn, which] - before[which]) / (after - before)[which]
        return rows[which], motion.start_s + share * (motion.end_s - motion.start_s)

    def _antenna_turns(self, time_s: float) -> float:
        """Where the antenna points, as a share of a turn."""
        return (time_s / self._sensor.period_s + self._phase) % 1.0

    def _replies(self, motion: Motion, rows: Ints, altitude_m: Array) -> dict[str, Any]:
        """What the transponder tells; nothing to a primary radar."""
        if self._sensor.kind == "psr":
            return {}
        identity = motion.identity
        # The radar's own track number: an arbitrary number that stays with the flight.
        local_track = hash_keys(identity.key[rows], self._index) % np.uint64(1_000_000)
        return {
            "address": identity.address[rows] if self._errors.mode_s else None,
            "mode_a": identity.mode_a[rows],
            "altitude_m": mode_c(altitude_m),
            "local_track": local_track.astype(np.int64),
        }

    def _plots(
        self, time_s: Array, range_m: Array, azimuth_deg: Array, columns: dict[str, Any], rng: np.random.Generator
    ) -> Plots:
        """Add the measurement errors, and the delay on the way to us."""
        errors, n = self._errors, len(time_s)
        measured_m = range_m * (1.0 + errors.range_gain) + errors.range_bias_m
        measured_m += self._range_sigma_m * rng.standard_normal(n)
        measured_deg = azimuth_deg + errors.azimuth_bias_deg + self._azimuth_sigma_deg * rng.standard_normal(n)
        if self._outliers > 0.0:
            gross_m = rng.uniform(errors.outlier_min_m, errors.outlier_max_m, n) * (rng.random(n) < self._outliers)
            bearing = rng.uniform(0.0, 2.0 * np.pi, n)
            measured_m += gross_m * np.cos(bearing)
            measured_deg += np.degrees(gross_m * np.sin(bearing) / np.maximum(range_m, 1.0))
        return Plots.of(
            n,
            time_s=time_s + errors.time_bias_s + self._time_sigma_s * rng.standard_normal(n),
            received_s=time_s + delay_s(self._sensor, errors, n, rng),
            sensor=self._index,
            range_m=np.maximum(measured_m, 0.0),
            azimuth_deg=wrap_azimuth_deg(measured_deg),
            flags=SIMULATED,
            **columns,
        )

    def _false_plots(self, motion: Motion, rng: np.random.Generator) -> Plots:
        """Plots of no aircraft, uniform over the covered area, where the antenna points at the time."""
        length_s = motion.end_s - motion.start_s
        n = int(rng.poisson(self._errors.false_plots * length_s / self._sensor.period_s))
        time_s = motion.start_s + rng.uniform(0.0, length_s, n)
        near_m, far_m = self._errors.range_min_m, self._range_max_m
        range_m = np.sqrt(rng.uniform(near_m**2, far_m**2, n))
        azimuth_deg = 360.0 * np.mod(time_s / self._sensor.period_s + self._phase, 1.0)
        return self._plots(time_s, range_m, azimuth_deg, {}, rng)
