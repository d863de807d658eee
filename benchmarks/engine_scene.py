"""Traffic for the engine's speed benchmarks: racetracks over a wide area, seen by ADS-B and two radars, with the truth.

Every aircraft flies a racetrack of its own (legs of one to four minutes, turns at 1.5 to 3 degrees a second), so that a
run may last for an hour without anybody leaving. ADS-B once a second (10 m, velocity 1 m/s, 0.1 to 0.6 s late), radars
every 4 s and 8 s (50 m and 0.07 degrees; 0.3 to 1.2 s late). The same seed gives the same reports.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.plots import Array, Ints, Plots
from aeroskein.radar_geometry import geodetic_to_radar
from aeroskein.settings import EngineSettings, SensorSettings, TrackSettings

__all__ = ["REPORTS_PER_S", "SENSORS", "START_S", "Traffic", "settings"]

START_S: Final = 1_790_000_000.0
SPREAD_M: Final = 300_000.0
POSITION_SIGMA_M, VELOCITY_SIGMA_MPS = 10.0, 1.0
RANGE_SIGMA_M, AZIMUTH_SIGMA_DEG = 50.0, 0.07
SENSORS: Final = (
    SensorSettings(
        id="adsb", kind="adsb", position_sigma_m=POSITION_SIGMA_M, velocity_sigma_mps=VELOCITY_SIGMA_MPS,
        time_sigma_s=0.01,
    ),
    SensorSettings(
        id="radar1", kind="ssr", period_s=4.0, lat_deg=48.35, lon_deg=11.78, height_m=460.0,
        range_sigma_m=RANGE_SIGMA_M, azimuth_sigma_deg=AZIMUTH_SIGMA_DEG,
    ),
    SensorSettings(
        id="radar2", kind="ssr", period_s=8.0, lat_deg=48.9, lon_deg=12.9, height_m=600.0,
        range_sigma_m=RANGE_SIGMA_M, azimuth_sigma_deg=AZIMUTH_SIGMA_DEG,
    ),
)  # fmt: skip
DELAYS_S: Final = ((0.1, 0.6), (0.3, 1.2), (0.3, 1.2))
# Reports of one aircraft in a second.
REPORTS_PER_S: Final = sum(1.0 / sensor.period_s for sensor in SENSORS)


def settings(capacity: int = 1024) -> EngineSettings:
    """Everything on, as in the service."""
    return EngineSettings(sensors=SENSORS, tracks=TrackSettings(capacity=capacity))


class Traffic:
    """``n`` aircraft; columns are per aircraft."""

    def __init__(self, n: int, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        self.n, self._rng = n, rng
        self.address = (0x100000 + np.arange(n)).astype(np.int32)
        lat = 48.35 + rng.uniform(-SPREAD_M, SPREAD_M, n) / 111_320.0
        lon = 11.78 + rng.uniform(-SPREAD_M, SPREAD_M, n) / (111_320.0 * np.cos(np.radians(48.35)))
        self.frames = geodesy.frame_rows(lat, lon)
        self.height_m = rng.uniform(8_000.0, 12_000.0, n)
        self.speed_mps = rng.uniform(180.0, 250.0, n)
        self._heading = rng.uniform(0.0, 2.0 * np.pi, n)
        self._leg_s = rng.uniform(60.0, 240.0, n)
        self._turn_s = np.pi / np.radians(rng.uniform(1.5, 3.0, n))
        self._begun_s = rng.uniform(0.0, 600.0, n)
        # Flights do not begin all in one second: neither do their elements.
        self._appears_s = rng.uniform(0.0, 8.0, n)
        self._phase = [rng.uniform(0.0, 1.0, n) for _ in SENSORS]
        self._under_way = Plots.of(0)
        self._measured_s = 0.0

    def state(self, rows: Ints, after_s: Array) -> tuple[Array, Array, Array]:
        """Place ``(2, n)`` and velocity ``(2, n)`` in each one's plane, and heading, so long after the start."""
        v, leg, turn = self.speed_mps[rows], self._leg_s[rows], self._turn_s[rows]
        rate = np.pi / turn
        phase = np.mod(after_s + self._begun_s[rows], 2.0 * (leg + turn))
        back = phase >= leg + turn
        phase = np.where(back, phase - leg - turn, phase)
        turning = np.maximum(phase - leg, 0.0)
        angle = rate * turning
        along = v * np.minimum(phase, leg) + v / rate * np.sin(angle)
        aside = v / rate * (1.0 - np.cos(angle))
        # The way back is the way out, turned by 180 degrees around the middle of the racetrack.
        along, aside = np.where(back, v * leg - along, along), np.where(back, 2.0 * v / rate - aside, aside)
        heading = self._heading[rows] + angle + np.where(back, np.pi, 0.0)
        c, s = np.cos(self._heading[rows]), np.sin(self._heading[rows])
        place = np.stack([s * along + c * aside, c * along - s * aside])
        return place, v * np.stack([np.sin(heading), np.cos(heading)]), heading

    def plots(self, until_s: float) -> Plots:
        """What has arrived since the last call, until so long after the start, in order of arrival."""
        made = [self._under_way]
        for sensor in range(len(SENSORS)):
            period, phase = SENSORS[sensor].period_s, self._phase[sensor]
            first = np.ceil(self._measured_s / period - phase)
            times = (first[:, None] + phase[:, None] + np.arange(int(until_s / period) + 2 - int(first.min()))) * period
            due = (times >= self._measured_s) & (times < until_s) & (times >= self._appears_s[:, None])
            rows, turn = np.nonzero(due)
            made.append(self._measure(sensor, rows, times[rows, turn]))
        self._measured_s = until_s
        plots = Plots.concatenate(made)
        plots = plots.take(np.argsort(plots.received_s, kind="stable"))
        here = plots.received_s < START_S + until_s
        self._under_way = plots.take(~here)
        return plots.take(here)

    def _measure(self, sensor: int, rows: Ints, after_s: Array) -> Plots:
        n, rng, height = len(rows), self._rng, self.height_m[rows]
        place, velocity, _ = self.state(rows, after_s)
        low, high = DELAYS_S[sensor]
        common = {
            "time_s": START_S + after_s, "received_s": START_S + after_s + rng.uniform(low, high, n),
            "sensor": sensor, "address": self.address[rows], "altitude_m": height,
        }  # fmt: skip
        frames = self.frames[rows]
        if SENSORS[sensor].is_radar:
            site = SENSORS[sensor]
            at = [np.array([value], dtype=np.float64) for value in (site.lat_deg, site.lon_deg, site.height_m)]
            lat, lon = geodesy.from_plane(frames, place[0], place[1])
            slant, azimuth, _ = geodetic_to_radar(geodesy.frame_rows(*at), lat, lon, height)
            slant += rng.normal(0.0, RANGE_SIGMA_M, n)
            azimuth += rng.normal(0.0, AZIMUTH_SIGMA_DEG, n)
            return Plots.of(n, **common, range_m=slant, azimuth_deg=np.mod(azimuth, 360.0) % 360.0, mode_a=0o1234)
        noise = rng.normal(0.0, POSITION_SIGMA_M, (2, n))
        lat, lon = geodesy.from_plane(frames, place[0] + noise[0], place[1] + noise[1])
        back = geodesy.invert_axes(geodesy.local_axes(frames, lat, lon, height))
        east, north = geodesy.rotate_vector(back, velocity[0], velocity[1])
        east, north = east + rng.normal(0.0, VELOCITY_SIGMA_MPS, n), north + rng.normal(0.0, VELOCITY_SIGMA_MPS, n)
        return Plots.of(
            n, **common, lat_deg=lat, lon_deg=lon, height_m=height, ground_speed_mps=np.hypot(east, north),
            track_angle_deg=np.mod(np.degrees(np.arctan2(east, north)), 360.0) % 360.0, vertical_rate_mps=0.0,
            position_sigma_m=POSITION_SIGMA_M, velocity_sigma_mps=VELOCITY_SIGMA_MPS,
        )  # fmt: skip

    def ticks(self, seconds: float, tick_s: float) -> Iterator[tuple[float, Plots]]:
        """The clock [s since the epoch] and what has arrived, tick after tick."""
        for k in range(1, round(seconds / tick_s) + 1):
            yield START_S + k * tick_s, self.plots(k * tick_s)
