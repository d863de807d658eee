"""What can be set: frozen dataclasses with units in their names, checked when they are made.

The service nests them in its configuration model and reads them from TOML; the key of a setting is its path here,
for example ``fusion.element_s``. Every default has its reason beside it.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Final, Literal

from aeroskein.ahp import pairwise_weights
from aeroskein.errors import SettingsError, UnknownSensorError

__all__ = [
    "AssociationSettings",
    "EngineSettings",
    "FusionSettings",
    "PatentSettings",
    "RegistrationSettings",
    "SensorKind",
    "SensorSettings",
    "TrackSettings",
]

SensorKind = Literal["adsb", "ssr", "psr", "wam"]
SENSOR_ID: Final = re.compile(r"[a-z0-9_-]{1,32}")
RADAR_KINDS: Final = ("ssr", "psr")

# Impossible outside: a bias beyond these is a fault of the installation, not of the calibration.
_SENSOR_LIMITS: Final = (
    ("lat_deg", -90.0, 90.0),
    ("lon_deg", -180.0, 180.0),
    ("height_m", -1000.0, 20_000.0),
    ("range_bias_m", -50_000.0, 50_000.0),
    ("azimuth_bias_deg", -180.0, 180.0),
    ("time_bias_s", -60.0, 60.0),
    ("range_gain", -0.5, 0.5),
    ("range_max_m", 1.0, 1.0e6),
)


def _require(condition: bool, key: str, expected: str) -> None:
    if not condition:
        raise SettingsError(key, expected)


def _positive(owner: object, prefix: str, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        _require(
            math.isfinite(value) and value > 0.0,
            f"{prefix}.{name}",
            f"expected a number above 0, got {value}",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSettings:
    """One sensor: what it is, where it stands and how well it measures."""

    id: str
    """The chunk in the sensor's key: 1 to 32 of a-z 0-9 - _."""
    kind: SensorKind
    """adsb (own position, irregular), ssr (identity, pressure altitude), psr (no identity), wam."""
    period_s: float = 1.0
    """Usual time between two reports about one target. [s]"""
    position_sigma_m: float = 10.0
    """adsb, wam: one sigma per axis where a report carries no quality of its own. [m]"""
    velocity_sigma_mps: float = 1.0
    """One sigma per axis of a reported velocity without quality of its own. [m/s]"""
    time_sigma_s: float | None = None
    """Jitter of the time stamp; absent: 0.2 for adsb, 0.05 for wam, 0.01 for a radar. [s]"""
    lat_deg: float | None = None
    """Radar site. [deg]"""
    lon_deg: float | None = None
    """Radar site. [deg]"""
    height_m: float | None = None
    """Radar antenna above the ellipsoid. [m]"""
    range_sigma_m: float = 50.0
    """Radar: one sigma of slant range. [m]"""
    azimuth_sigma_deg: float = 0.07
    """Radar: one sigma of azimuth. [deg]"""
    altitude_sigma_m: float = 8.0
    """One sigma of reported pressure altitude: 25 ft steps and the encoder. [m]"""
    time_bias_sigma_s: float = 1.0
    """Radar: prior of the constant time error; 0.05 for a GNSS-timed radar. [s]"""
    range_bias_m: float = 0.0
    """Radar: preset range bias, from which estimation starts. [m]"""
    azimuth_bias_deg: float = 0.0
    """Radar: preset azimuth bias. [deg]"""
    time_bias_s: float = 0.0
    """Radar: preset time bias. [s]"""
    range_gain: float = 0.0
    """Radar: preset range gain."""
    correction: Literal["service", "sensor"] = "service"
    """Who applies the registration: this service, or the radar's own processor."""
    range_max_m: float | None = None
    """Radar: instrumented range; absent: cover is learned from what it reports. [m]"""

    def __post_init__(self) -> None:
        prefix = f"sensors.{self.id}"
        _require(
            SENSOR_ID.fullmatch(self.id) is not None,
            "sensors.id",
            f"expected 1 to 32 of a-z 0-9 - _, got {self.id!r}",
        )
        _positive(self, prefix, "period_s", "position_sigma_m", "velocity_sigma_mps")
        _positive(
            self,
            prefix,
            "range_sigma_m",
            "azimuth_sigma_deg",
            "altitude_sigma_m",
            "time_bias_sigma_s",
        )
        _require(
            self.time_sigma_s is None or (math.isfinite(self.time_sigma_s) and self.time_sigma_s >= 0.0),
            f"{prefix}.time_sigma_s",
            f"expected 0 or more, got {self.time_sigma_s}",
        )
        if self.is_radar:
            for name in ("lat_deg", "lon_deg", "height_m"):
                _require(getattr(self, name) is not None, f"{prefix}.{name}", "a radar needs its site")
        for name, low, high in _SENSOR_LIMITS:
            value = getattr(self, name)
            _require(
                value is None or low <= value <= high,
                f"{prefix}.{name}",
                f"expected {low:g} to {high:g}, got {value}",
            )

    @property
    def is_radar(self) -> bool:
        """Whether it measures range and azimuth from a site."""
        return self.kind in RADAR_KINDS

    @property
    def effective_time_sigma_s(self) -> float:
        """``time_sigma_s``, or the usual value of its kind. [s]"""
        if self.time_sigma_s is not None:
            return self.time_sigma_s
        return {"adsb": 0.2, "wam": 0.05}.get(self.kind, 0.01)


@dataclass(frozen=True, slots=True, kw_only=True)
class FusionSettings:
    """The element product and the live product."""

    mode: Literal["information", "weighted", "patent"] = "information"
    """How one element becomes one fused point."""
    element_s: float = 4.0
    """Element length, in seconds of flight along the master track; doubled while no source is faster than 4 s. [s]"""
    lookahead: int = 1
    """Elements to wait for before one is published."""
    watermark_max_s: float = 4.0
    """The wait follows a fast sensor whose reports usually come later than the watermark, up to this. [s]"""
    watermark_s: float = 1.0
    """How long the element product waits behind the clock for reports that are under way. [s]"""
    live: bool = True
    """Whether the zero-lag product is published."""
    max_age_s: float = 30.0
    """A report older than this against the clock is too old. [s]"""
    max_future_s: float = 5.0
    """A report further ahead of the clock than this is rejected. [s]"""

    def __post_init__(self) -> None:
        _require(
            math.isfinite(self.element_s) and 0.5 <= self.element_s <= 30.0,
            "fusion.element_s",
            f"expected 0.5 to 30 s, got {self.element_s}",
        )
        _require(0 <= self.lookahead <= 5, "fusion.lookahead", f"expected 0 to 5, got {self.lookahead}")
        _require(
            math.isfinite(self.watermark_max_s) and 0.0 <= self.watermark_max_s <= 10.0,
            "fusion.watermark_max_s",
            f"expected 0 to 10 s, got {self.watermark_max_s}",
        )
        _require(
            math.isfinite(self.watermark_s) and 0.0 <= self.watermark_s <= 10.0,
            "fusion.watermark_s",
            f"expected 0 to 10 s, got {self.watermark_s}",
        )
        _positive(self, "fusion", "max_age_s", "max_future_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class PatentSettings:
    """The published form of the element method (mode ``patent``)."""

    half_width_m: float = 550.0
    """Half distance of the boundary lines: 500 m path deviation plus 50 m device offset, as published. [m]"""
    axis: Literal["polyline", "chord"] = "polyline"
    """The axis inside an element: pieces of one second, or one chord from end to end."""
    series: Literal["natural", "odd", "even"] = "natural"
    """Which division points bound the elements."""

    def __post_init__(self) -> None:
        _positive(self, "patent", "half_width_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackSettings:
    """Life cycle of tracks."""

    confirm_reports: int = 3
    """Accepted reports that confirm a track with an identity."""
    terminate_s: float = 30.0
    """A track without any report for this long is terminated. [s]"""
    coast_min_s: float = 3.0
    """A track coasts after this, or 1.5 periods of its fastest live sensor, without a report. [s]"""
    capacity: int = 1024
    """Track slots allocated at the start; grows by a quarter."""

    def __post_init__(self) -> None:
        _require(
            self.confirm_reports >= 1,
            "tracks.confirm_reports",
            f"expected 1 or more, got {self.confirm_reports}",
        )
        _require(self.capacity >= 1, "tracks.capacity", f"expected 1 or more, got {self.capacity}")
        _positive(self, "tracks", "terminate_s", "coast_min_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistrationSettings:
    """Estimation of the radars' systematic errors."""

    enabled: bool = True
    """Whether radars are registered against the fused picture."""
    method: Literal["kalman", "feedback"] = "kalman"
    """kalman: polar and time Kalman filter; feedback: the published loop."""
    feedback_gain: float = 0.02
    """Method feedback: share of each residual that is taken over."""

    def __post_init__(self) -> None:
        _require(
            0.0 < self.feedback_gain <= 1.0,
            "registration.feedback_gain",
            f"expected above 0, at most 1, got {self.feedback_gain}",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class AssociationSettings:
    """Which track a plot without identity belongs to."""

    method: Literal["mahalanobis", "ahp"] = "mahalanobis"
    """mahalanobis: statistical distance; ahp: the published multi-factor distance."""
    pairwise: tuple[tuple[float, ...], ...] = (
        (1.0, 4.0, 3.0, 5.0),
        (1 / 4, 1.0, 1 / 2, 2.0),
        (1 / 3, 2.0, 1.0, 2.0),
        (1 / 5, 1 / 2, 1 / 2, 1.0),
    )
    """Method ahp: importance of distance, ground speed, track angle and altitude (or heading) over each other."""
    coarse_gate_m: float = 5000.0
    """Coarse association: largest distance of a candidate. [m]"""

    def __post_init__(self) -> None:
        _positive(self, "association", "coarse_gate_m")
        size = len(self.pairwise[0]) if self.pairwise else 0
        _require(
            size == 4
            and len(self.pairwise) == size
            and all(len(row) == size and all(math.isfinite(u) and u > 0.0 for u in row) for row in self.pairwise),
            "association.pairwise",
            "expected 4 rows of 4 numbers above 0",
        )
        _require(
            all(
                math.isclose(self.pairwise[i][j] * self.pairwise[j][i], 1.0, rel_tol=0.02)
                for i in range(size)
                for j in range(size)
            ),
            "association.pairwise",
            "expected u_ji = 1 / u_ij and 1 on the diagonal",
        )
        pairwise_weights(self.pairwise)  # refuses comparisons that contradict each other


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineSettings:
    """Everything the engine needs to know before the first report."""

    sensors: tuple[SensorSettings, ...]
    """At least one; the order gives the sensor index used in columns."""
    fusion: FusionSettings = field(default_factory=FusionSettings)
    patent: PatentSettings = field(default_factory=PatentSettings)
    tracks: TrackSettings = field(default_factory=TrackSettings)
    registration: RegistrationSettings = field(default_factory=RegistrationSettings)
    association: AssociationSettings = field(default_factory=AssociationSettings)

    def __post_init__(self) -> None:
        _require(len(self.sensors) > 0, "sensors", "at least one sensor is needed")
        ids = [s.id for s in self.sensors]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        _require(not twice, "sensors.id", f"sensor {twice[0] if twice else ''!r} stands twice")

    def sensor_index(self, sensor_id: str) -> int:
        """Index of a sensor in the columns. Raises ``UnknownSensorError``."""
        for index, sensor in enumerate(self.sensors):
            if sensor.id == sensor_id:
                return index
        raise UnknownSensorError(sensor_id)
