"""What can be set about the simulator: which flights there are, and what goes wrong with each sensor.

How well a sensor measures stands in ``SensorSettings``, because the fusion must know it; what the fusion is not told
(biases, gaps, late and lost reports, outliers) stands here, in ``SensorErrors``. The defaults are the error model of
the numerical study in docs/algorithm.md; what recordings of real ADS-B and radar data show beyond it (stale repeats,
frozen positions, correlated GNSS error) can be switched on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

from aeroskein.errors import SettingsError, UnknownSensorError
from aeroskein.settings import SensorSettings

__all__ = ["SCENARIOS", "Scenario", "SensorErrors", "SimulationSettings"]

Scenario = Literal[
    "mixed",
    "cruise",
    "enroute",
    "terminal",
    "hold",
    "approach",
    "climb",
    "acceleration",
    "hover",
    "crossing",
    "formation",
]
SCENARIOS: Final[tuple[Scenario, ...]] = (
    "mixed", "cruise", "enroute", "terminal", "hold", "approach", "climb", "acceleration", "hover", "crossing",
    "formation",
)  # fmt: skip

# Slots are 18 bits of the ICAO address, so that every flight of a long run has an address of its own.
MAX_AIRCRAFT: Final = 200_000

# Each slot is flown by a new aircraft after this many flights at the earliest with the same address.
FLIGHTS_PER_SLOT: Final = 16


def _require(condition: bool, key: str, expected: str) -> None:
    if not condition:
        raise SettingsError(key, expected)


def _within(owner: object, prefix: str, low: float, high: float, *names: str) -> None:
    """Each named value is absent or a finite number in ``low..high``."""
    for name in names:
        value = getattr(owner, name)
        _require(
            value is None or (math.isfinite(value) and low <= value <= high),
            f"{prefix}.{name}",
            f"expected {low:g} to {high:g}, got {value}",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorErrors:
    """What goes wrong with one simulated sensor. A value that is absent takes the usual one of the sensor's kind."""

    sensor: str
    """Id of the sensor these errors belong to."""
    position_sigma_m: float | None = None
    """ADS-B, WAM: true one sigma per axis; absent: as the sensor's settings say. [m]"""
    velocity_sigma_mps: float | None = None
    """ADS-B: true one sigma per axis; absent: as the sensor's settings say. [m/s]"""
    range_sigma_m: float | None = None
    """Radar: true one sigma of slant range; absent: as the sensor's settings say. [m]"""
    azimuth_sigma_deg: float | None = None
    """Radar: true one sigma of azimuth; absent: as the sensor's settings say. [deg]"""
    time_sigma_s: float | None = None
    """True one sigma of the time stamp; absent: as the sensor's settings say. [s]"""
    miss_probability: float = 0.03
    """Share of reports that never come: 1 - P_d of a radar, lost squitters of ADS-B."""
    outlier_probability: float | None = None
    """Share of reports with a gross position error; absent: 0.002 for ADS-B and WAM, none for a radar."""
    outlier_min_m: float = 150.0
    """Smallest gross error. [m]"""
    outlier_max_m: float = 3000.0
    """Largest gross error. [m]"""
    duplicate_probability: float = 0.0
    """Share of reports that come twice, the second up to 1 s later."""
    gaps_s: tuple[tuple[float, float], ...] = ()
    """Intervals ``[from, to)`` after the scenario's start in which the sensor says nothing. [s]"""
    delay_median_s: float = 0.35
    """ADS-B, WAM: median of the log-normal delivery delay. [s]"""
    delay_spread: float = 0.5
    """ADS-B, WAM: standard deviation of the delay's natural logarithm."""
    delay_min_s: float = 0.3
    """Radar: least delivery delay. [s]"""
    delay_max_s: float = 2.0
    """Radar: usual greatest delivery delay; delays are uniform between the two. [s]"""
    late_probability: float = 0.02
    """Radar: share of plots that come later than that."""
    late_max_s: float = 6.0
    """Radar: the latest of them. [s]"""
    latency_s: float = 0.0
    """ADS-B: how old a position is at its stated time, mean over the aircraft. [s]"""
    latency_sigma_s: float = 0.0
    """ADS-B: scatter of that age between aircraft; constant for each, never negative. [s]"""
    velocity: bool = True
    """ADS-B: whether reports carry a velocity."""
    geometric_height: bool = True
    """ADS-B: whether reports carry the geometric height beside the pressure altitude."""
    quality: Literal["absent", "indicators", "sigma"] = "absent"
    """ADS-B: nothing, NACp/NACv/NIC/SIL that fit the true sigma, or the true sigma itself in each report."""
    correlated_sigma_m: float = 0.0
    """ADS-B: one sigma per axis of the slowly wandering GNSS error. [m]"""
    correlated_time_s: float = 120.0
    """ADS-B: correlation time of that error. [s]"""
    stale_probability: float = 0.0
    """ADS-B: share of reports that repeat the last position with a new time."""
    frozen_probability: float = 0.0
    """ADS-B: chance, per report, that the position freezes."""
    frozen_s: float = 60.0
    """ADS-B: mean duration of a frozen position. [s]"""
    range_bias_m: float = 0.0
    """Radar: what it measures too much in range. [m]"""
    range_gain: float = 0.0
    """Radar: what it measures too much in range, as a share of the range."""
    azimuth_bias_deg: float = 0.0
    """Radar: what it measures too much in azimuth. [deg]"""
    time_bias_s: float = 0.0
    """What the sensor's clock is ahead. [s]"""
    mode_s: bool = True
    """SSR: whether it reads ICAO addresses; without, Mode A and C only."""
    range_max_m: float | None = None
    """How far the sensor sees; absent: the radar's instrumented range or 400 km, no limit for ADS-B. [m]"""
    range_min_m: float = 1000.0
    """Radar: closer targets are not seen. [m]"""
    elevation_min_deg: float = -2.0
    """Radar: lower targets are not seen. [deg]"""
    elevation_max_deg: float = 50.0
    """Radar: higher targets are not seen (cone of silence). [deg]"""
    false_plots: float = 0.0
    """Primary radar: mean number of false plots in a scan."""

    def __post_init__(self) -> None:
        prefix = f"simulation.errors.{self.sensor}"
        _within(self, prefix, 0.0, 1e5, "position_sigma_m", "velocity_sigma_mps", "range_sigma_m", "outlier_min_m")
        _within(self, prefix, 0.0, 1e5, "outlier_max_m", "correlated_sigma_m", "false_plots")
        _within(self, prefix, 0.0, 10.0, "azimuth_sigma_deg", "time_sigma_s", "delay_spread", "latency_sigma_s")
        _within(
            self, prefix, 0.0, 1.0, "miss_probability", "outlier_probability", "duplicate_probability",
            "late_probability", "stale_probability", "frozen_probability",
        )  # fmt: skip
        _within(self, prefix, 0.0, 600.0, "delay_median_s", "delay_min_s", "delay_max_s", "late_max_s", "latency_s")
        _within(self, prefix, 1e-3, 1e6, "correlated_time_s", "frozen_s")
        _within(self, prefix, 1.0, 2e7, "range_max_m")
        _within(self, prefix, -1e5, 1e5, "range_bias_m", "range_min_m")
        _within(self, prefix, -180.0, 180.0, "azimuth_bias_deg")
        _within(self, prefix, -90.0, 90.0, "elevation_min_deg", "elevation_max_deg")
        _within(self, prefix, -600.0, 600.0, "time_bias_s")
        _within(self, prefix, -0.5, 0.5, "range_gain")
        _require(
            self.outlier_min_m <= self.outlier_max_m,
            f"{prefix}.outlier_max_m",
            f"expected at least outlier_min_m, got {self.outlier_max_m}",
        )
        _require(
            self.delay_min_s <= self.delay_max_s <= self.late_max_s,
            f"{prefix}.delay_max_s",
            "expected delay_min_s <= delay_max_s <= late_max_s",
        )
        for gap in self.gaps_s:
            _require(gap[0] < gap[1], f"{prefix}.gaps_s", f"expected [from, to] with from < to, got {list(gap)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationSettings:
    """Which flights there are, where, and with which sensor errors."""

    scenario: Scenario = "mixed"
    """What is flown; every scenario can be placed anywhere on the globe."""
    aircraft: int = 30
    """How many aircraft are in the air at a time."""
    seed: int = 1
    """The same seed gives the same flights and the same reports, bit for bit."""
    duration_s: float = 600.0
    """Length of a report file; a live feed runs until it is stopped. [s]"""
    flight_s: float = 1800.0
    """After this a flight ends, and another one takes its place. [s]"""
    start_s: float = 1_790_000_000.0
    """When a report file starts; a live feed starts now. [s since the epoch, UTC]"""
    lat_deg: float | None = None
    """Middle of the area; absent: the middle of the radar sites. [deg]"""
    lon_deg: float | None = None
    """Middle of the area; absent: the middle of the radar sites. [deg]"""
    radius_m: float | None = None
    """Radius of the area; absent: 60 km for up to 30 aircraft, growing with their number up to 200 km. [m]"""
    truth_period_s: float = 0.2
    """Time between two samples of the truth. [s]"""
    gust_mps2: float = 0.03
    """One sigma per axis of the gusts, an Ornstein-Uhlenbeck process of 10 s. [m/s²]"""
    geometric_minus_pressure_m: float = 90.0
    """Geometric height minus pressure altitude, mean over region and time. [m]"""
    geometric_minus_pressure_variation_m: float = 20.0
    """How far that difference swings, over some 1,000 km and 6 hours. [m]"""
    altimeter_sigma_m: float = 4.0
    """One sigma of the constant error of each aircraft's altitude encoder. [m]"""
    errors: tuple[SensorErrors, ...] = ()
    """What goes wrong with each sensor; one that is not listed has the usual errors of its kind."""

    def __post_init__(self) -> None:
        _require(
            self.scenario in SCENARIOS, "simulation.scenario", f"expected {', '.join(SCENARIOS)}, got {self.scenario!r}"
        )
        _require(
            1 <= self.aircraft <= MAX_AIRCRAFT,
            "simulation.aircraft",
            f"expected 1 to {MAX_AIRCRAFT}, got {self.aircraft}",
        )
        _require(self.seed >= 0, "simulation.seed", f"expected 0 or more, got {self.seed}")
        _require((self.lat_deg is None) == (self.lon_deg is None), "simulation.lat_deg", "lat_deg and lon_deg together")
        _within(self, "simulation", 1.0, 1e7, "duration_s")
        _within(self, "simulation", 120.0, 1e6, "flight_s")
        _within(self, "simulation", 0.0, 1e11, "start_s")
        _within(self, "simulation", -90.0, 90.0, "lat_deg")
        _within(self, "simulation", -180.0, 180.0, "lon_deg")
        _within(self, "simulation", 1000.0, 2e6, "radius_m")
        _within(self, "simulation", 0.05, 60.0, "truth_period_s")
        _within(self, "simulation", 0.0, 10.0, "gust_mps2")
        _within(self, "simulation", -1000.0, 1000.0, "geometric_minus_pressure_m")
        _within(self, "simulation", 0.0, 1000.0, "geometric_minus_pressure_variation_m", "altimeter_sigma_m")
        named = [errors.sensor for errors in self.errors]
        twice = sorted({name for name in named if named.count(name) > 1})
        _require(not twice, "simulation.errors", f"sensor {twice[0] if twice else ''!r} stands twice")

    def errors_of(self, sensor_id: str) -> SensorErrors:
        """The errors of one sensor, the usual ones where none are listed."""
        for errors in self.errors:
            if errors.sensor == sensor_id:
                return errors
        return SensorErrors(sensor=sensor_id)

    def check_sensors(self, sensors: tuple[SensorSettings, ...]) -> None:
        """Raise ``UnknownSensorError`` where errors are given for a sensor that does not exist."""
        known = {sensor.id for sensor in sensors}
        for errors in self.errors:
            if errors.sensor not in known:
                raise UnknownSensorError(errors.sensor)

    def centre_deg(self, sensors: tuple[SensorSettings, ...]) -> tuple[float, float]:
        """Middle of the area: as set, else of the radar sites, else Munich. [deg]"""
        if self.lat_deg is not None and self.lon_deg is not None:
            return self.lat_deg, self.lon_deg
        sites = [(s.lat_deg, s.lon_deg) for s in sensors if s.lat_deg is not None and s.lon_deg is not None]
        if not sites:
            return 48.1, 11.6
        first_lon = sites[0][1]
        # Longitudes are averaged as differences, so that sites on both sides of the antimeridian work.
        turned = [(lon - first_lon + 180.0) % 360.0 - 180.0 for _, lon in sites]
        lon = (first_lon + sum(turned) / len(sites) + 180.0) % 360.0 - 180.0
        return sum(lat for lat, _ in sites) / len(sites), lon

    def effective_radius_m(self) -> float:
        """``radius_m``, or one that grows with the number of aircraft. [m]"""
        if self.radius_m is not None:
            return self.radius_m
        return min(200_000.0, max(60_000.0, 60_000.0 * math.sqrt(self.aircraft / 30.0)))
