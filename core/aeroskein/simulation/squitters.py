"""ADS-B and wide-area multilateration: sensors that report latitude and longitude about once a second.

The time stated with a position differs from the time at which the aircraft was there: by a random error of each report
and, for some aircraft, by a constant age. That, not the position error, is most of what is wrong with ADS-B.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from aeroskein.ellipsoid import normal_and_height
from aeroskein.plots import SIMULATED, Array, Ints, Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation.delivery import delay_s, mode_c, survives, with_duplicates
from aeroskein.simulation.draws import block_generator, hash_keys, hashed_normal_pair, hashed_uniform
from aeroskein.simulation.frames import east_north, latitude_longitude_deg, track_angle_deg
from aeroskein.simulation.radar import Site
from aeroskein.simulation.settings import SensorErrors
from aeroskein.simulation.truth import Motion, States

__all__ = ["PositionSensor", "quality_indicators"]

# Squitters are not periodic: each comes within a fifth of a period after its turn (DO-260B: 0.4 to 0.6 s apart for
# two a second).
JITTER_PERIODS: Final = 0.2

# GNSS height is about half as much worse again than horizontal position.
HEIGHT_SIGMAS: Final = 1.5
# One sigma of a reported vertical rate [m/s], sent in steps of 64 ft/min [m/s].
VERTICAL_RATE_SIGMA_MPS: Final = 0.3
VERTICAL_RATE_STEP_MPS: Final = 64.0 * 0.3048 / 60.0

# 95 % bounds of NACp 1..11 [m] and NACv 1..4 [m/s], ED-102A tables 2-14 and 2-21; sigma = bound / 2.448.
EPU_M: Final = np.array([18520.0, 7408.0, 3704.0, 1852.0, 926.0, 555.6, 185.2, 92.6, 30.0, 10.0, 3.0])
HFOM_V_MPS: Final = np.array([10.0, 3.0, 1.0, 0.3])
SIGMAS_95: Final = 2.448
# Integrity containment of a usual installation with NACp 0..11: GNSS with SBAS seldom promises less than 0.1 NM.
_NIC: Final = (0, 1, 2, 3, 4, 5, 6, 7, 7, 8, 8, 9)
# Chance of being outside it: below 1e-7 an hour.
_SIL: Final = 3


def quality_indicators(position_sigma_m: float, velocity_sigma_mps: float) -> dict[str, int]:
    """NACp, NACv, NIC and SIL of an installation with these errors: the best class that still covers them."""
    nac_p = int(np.count_nonzero(SIGMAS_95 * position_sigma_m <= EPU_M))
    nac_v = int(np.count_nonzero(SIGMAS_95 * velocity_sigma_mps <= HFOM_V_MPS))
    return {"nac_p": nac_p, "nac_v": nac_v, "nic": _NIC[nac_p], "sil": _SIL}


class PositionSensor:
    """One ADS-B or WAM sensor: turns blocks of motion into reports.

    Parameters
    ----------
    sensor, index : SensorSettings, int
        The sensor and its index in the columns.
    errors : SensorErrors
        What goes wrong with it.
    seed : int
        Seed of its errors.
    start_s : float
        Start of the scenario, from which gaps are counted. [s since the epoch]
    slots : int
        How many rows a motion has.
    """

    def __init__(
        self, sensor: SensorSettings, index: int, errors: SensorErrors, *, seed: int, start_s: float, slots: int
    ) -> None:
        self._sensor, self._index, self._errors, self._seed, self._start_s = sensor, index, errors, seed, start_s
        is_adsb = sensor.kind == "adsb"
        self._is_adsb = is_adsb
        self._position_sigma_m = _or(errors.position_sigma_m, sensor.position_sigma_m)
        self._velocity_sigma_mps = _or(errors.velocity_sigma_mps, sensor.velocity_sigma_mps)
        self._time_sigma_s = _or(errors.time_sigma_s, sensor.effective_time_sigma_s)
        self._outliers = _or(errors.outlier_probability, 0.002)
        self._site = None if errors.range_max_m is None else Site(sensor)
        self._wander_m, self._wander_s = np.zeros((2, slots)), np.full(slots, -np.inf)
        self._last = np.full((4, slots), np.nan)
        self._frozen_until_s = np.full(slots, -np.inf)
        self._key = np.zeros(slots, dtype=np.uint64)

    def measure(self, motion: Motion) -> Plots:
        """The reports measured in a block, in no order."""
        rng = block_generator(self._seed, self._sensor.id, motion.index)
        rows, time_s = self._transmissions(motion)
        kept = survives(self._errors, time_s - self._start_s, rng)
        rows, time_s = rows[kept], time_s[kept]
        if self._site is not None:
            rows, time_s = self._in_range(motion, rows, time_s, self._site)
        if len(rows) == 0:
            return Plots.of(0)
        self._forget_old_flights(motion)
        states = motion.at(rows, time_s)
        columns = self._positions(motion, states, rows, time_s, rng)
        columns |= self._extras(states, rng)
        age_s = self._age_s(motion, rows)
        stated_s = time_s + age_s + self._errors.time_bias_s + self._time_sigma_s * rng.standard_normal(len(rows))
        identity = motion.identity
        plots = Plots.of(
            len(rows),
            time_s=stated_s,
            received_s=time_s + age_s + delay_s(self._sensor, self._errors, len(rows), rng),
            sensor=self._index,
            address=identity.address[rows],
            callsign=identity.callsign[rows] if self._is_adsb else None,
            mode_a=None if self._is_adsb else identity.mode_a[rows],
            flags=SIMULATED,
            **columns,
        )
        return with_duplicates(plots, self._errors, rng)

    def _transmissions(self, motion: Motion) -> tuple[Ints, Array]:
        """Rows and true times of the transmissions in a block."""
        period_s, rows = self._sensor.period_s, motion.rows
        keys = hash_keys(motion.identity.key[rows], self._index)
        phase_s = hashed_uniform(keys, 50, high=period_s)
        earliest = np.ceil((motion.start_s - phase_s) / period_s - JITTER_PERIODS).astype(np.int64)
        most = int(np.ceil((motion.end_s - motion.start_s) / period_s + JITTER_PERIODS)) + 1
        number = earliest + np.arange(most)[:, None]
        jitter = hashed_uniform(np.broadcast_to(keys, number.shape), 51, number, high=JITTER_PERIODS * period_s)
        time_s = phase_s + number * period_s + jitter
        turn, which = np.nonzero((time_s >= motion.start_s) & (time_s < motion.end_s))
        return rows[which], time_s[turn, which]

    def _in_range(self, motion: Motion, rows: Ints, time_s: Array, site: Site) -> tuple[Ints, Array]:
        """Drop what the receiver at its site cannot hear."""
        range_m, _, elevation_deg = site.see(motion.at(rows, time_s))
        heard = (range_m <= _or(self._errors.range_max_m, np.inf)) & (elevation_deg >= self._errors.elevation_min_deg)
        return rows[heard], time_s[heard]

    def _forget_old_flights(self, motion: Motion) -> None:
        """A slot that another aircraft has taken over starts without a past."""
        new = np.flatnonzero(motion.identity.key != self._key)
        self._key[new] = motion.identity.key[new]
        self._wander_s[new] = self._frozen_until_s[new] = -np.inf
        self._last[:, new] = np.nan

    def _age_s(self, motion: Motion, rows: Ints) -> Array:
        errors = self._errors
        scatter, _ = hashed_normal_pair(hash_keys(motion.identity.key[rows], self._index), 52)
        return np.maximum(errors.latency_s + errors.latency_sigma_s * scatter, 0.0)

    def _positions(
        self, motion: Motion, states: States, rows: Ints, time_s: Array, rng: np.random.Generator
    ) -> dict[str, Any]:
        """Measured position and heights; some of them repeated from before."""
        n = len(rows)
        error_m = self._position_sigma_m * rng.standard_normal((2, n))
        gross = rng.random(n) < self._outliers
        size_m = gross * rng.uniform(self._errors.outlier_min_m, self._errors.outlier_max_m, n)
        bearing = rng.uniform(0.0, 2.0 * np.pi, n)
        error_m += size_m * np.stack([np.sin(bearing), np.cos(bearing)])
        if self._errors.correlated_sigma_m > 0.0:
            error_m += self._wander(rows, time_s, rng)
        up, _ = normal_and_height(states.plane_m + _horizontal(states.up, error_m))
        lat_deg, lon_deg = latitude_longitude_deg(up)
        altitude_m = mode_c(states.altitude_m)
        height_m = states.height_m + HEIGHT_SIGMAS * self._position_sigma_m * rng.standard_normal(n)
        measured = np.stack([lat_deg, lon_deg, altitude_m, height_m])
        if self._errors.stale_probability > 0.0 or self._errors.frozen_probability > 0.0:
            measured = self._repeat(rows, time_s, measured, rng)
        with_height = self._is_adsb and self._errors.geometric_height
        return {
            "lat_deg": measured[0],
            "lon_deg": measured[1],
            "altitude_m": measured[2],
            "height_m": measured[3] if with_height else None,
        }

    def _extras(self, states: States, rng: np.random.Generator) -> dict[str, Any]:
        """Velocity and quality as far as the sensor reports them."""
        if not self._is_adsb:
            return {}
        n, sigma_mps, columns = len(states.height_m), self._velocity_sigma_mps, dict[str, Any]()
        if self._errors.velocity:
            east, north = east_north(states.up, states.velocity_mps)
            east, north = np.stack([east, north]) + sigma_mps * rng.standard_normal((2, n))
            rate_mps = states.vertical_rate_mps + VERTICAL_RATE_SIGMA_MPS * rng.standard_normal(n)
            columns["ground_speed_mps"] = np.hypot(east, north)
            columns["track_angle_deg"] = track_angle_deg(east, north)
            columns["vertical_rate_mps"] = np.round(rate_mps / VERTICAL_RATE_STEP_MPS) * VERTICAL_RATE_STEP_MPS
        if self._errors.quality == "sigma":
            columns["position_sigma_m"] = self._position_sigma_m
            columns["velocity_sigma_mps"] = sigma_mps if self._errors.velocity else None
        elif self._errors.quality == "indicators":
            columns |= quality_indicators(self._position_sigma_m, sigma_mps)
        return columns

    def _wander(self, rows: Ints, time_s: Array, rng: np.random.Generator) -> Array:
        """Correlated error of each report, ``(2, m)``: an exact Ornstein-Uhlenbeck process, aircraft by aircraft."""
        noise = rng.standard_normal((2, len(rows)))
        error_m = np.empty_like(noise)
        for this in _rounds(rows, time_s):
            row, at_s = rows[this], time_s[this]
            decay = np.exp(-(at_s - self._wander_s[row]) / self._errors.correlated_time_s)
            scatter = self._errors.correlated_sigma_m * np.sqrt(1.0 - decay**2)
            self._wander_m[:, row] = decay * self._wander_m[:, row] + scatter * noise[:, this]
            self._wander_s[row] = at_s
            error_m[:, this] = self._wander_m[:, row]
        return error_m

    def _repeat(self, rows: Ints, time_s: Array, measured: Array, rng: np.random.Generator) -> Array:
        """Replace some positions ``(4, m)`` by the last one reported for the same aircraft."""
        errors, n = self._errors, len(rows)
        stale = rng.random(n) < errors.stale_probability
        freezes = rng.random(n) < errors.frozen_probability
        until_s = time_s + rng.exponential(errors.frozen_s, n)
        sent = measured.copy()
        for this in _rounds(rows, time_s):
            row = rows[this]
            thaw_s = self._frozen_until_s[row]
            again = (stale[this] | (time_s[this] < thaw_s)) & ~np.isnan(self._last[0, row])
            sent[:, this] = np.where(again, self._last[:, row], measured[:, this])
            self._last[:, row] = sent[:, this]
            self._frozen_until_s[row] = np.where(freezes[this] & (time_s[this] >= thaw_s), until_s[this], thaw_s)
        return sent


def _or(value: float | None, usual: float) -> float:
    return usual if value is None else value


def _rounds(rows: Ints, time_s: Array) -> list[Ints]:
    """Split reports so that each part has at most one of each aircraft, first reports first."""
    order = np.lexsort((time_s, rows))
    place = np.arange(len(rows))
    first = np.r_[True, np.diff(rows[order]) != 0] if len(rows) else np.zeros(0, dtype=np.bool_)
    number = place - np.maximum.accumulate(np.where(first, place, 0))
    return [order[number == k] for k in range(int(number.max()) + 1)] if len(rows) else []


def _horizontal(up: Array, error_m: Array) -> Array:
    """Horizontal vectors ``(m, 3)`` in ECEF axes with the given components along any two perpendicular directions."""
    # Away from whichever axis is nearly vertical; the error has no preferred direction, so neither do these.
    helper = np.where(np.abs(up[:, 2:3]) < 0.9, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    first = np.cross(helper, up)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.asarray(error_m[0][:, None] * first + error_m[1][:, None] * np.cross(up, first))
