"""Traffic and radars for the registration study: truth, plots with known biases, and the references beside them.

All randomness comes from one generator. Reference errors follow the noise model of the study in docs/registration.md:
an Ornstein-Uhlenbeck position offset per aircraft and a constant ADS-B latency per aircraft.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aeroskein.ellipsoid import ecef_axes, from_ecef, to_ecef
from aeroskein.geodesy import frame_rows
from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.comparisons import Comparisons
from aeroskein.settings import EngineSettings, RegistrationSettings, SensorSettings

STEP_S = 0.5
CENTRE = (48.5, 11.0)
START_S = 1_790_000_000.0


@dataclass
class Radar:
    """One simulated radar with its true biases."""

    settings: SensorSettings
    range_m: float = 0.0
    azimuth_deg: float = 0.0
    time_s: float = 0.0
    gain: float = 0.0
    jump_s: float = np.inf
    jump: tuple[float, float, float] = (0.0, 0.0, 0.0)
    phase_s: float = 0.0

    def biases_at(self, seconds: Array) -> Array:
        """(n, 4) true biases."""
        base = np.array([self.range_m, self.azimuth_deg, self.time_s, self.gain])
        return base + (seconds >= self.jump_s)[:, None] * np.array([*self.jump, 0.0])


@dataclass
class Scene:
    """What happens: radars, aircraft and the errors of references."""

    radars: list[Radar]
    aircraft: int = 20
    duration_s: float = 300.0
    offset_sigma_m: float = 8.0
    offset_memory_s: float = 60.0
    latency_sigma_s: float = 0.1
    latency_mean_s: float = 0.0
    height_sigma_m: float = 30.0
    # Error that all heights have in common, and what is claimed of each. [m]
    height_offset_m: float = 0.0
    height_claim_m: float = 30.0
    detection: float = 0.97
    outliers: float = 0.0
    extent_m: float = 120_000.0
    turning: bool = True
    anchored: bool = True
    seed: int = 0
    spoofed: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    spoof_m: tuple[float, float] = (0.0, 0.0)


def two_radars(rng: np.random.Generator, **overrides: object) -> list[Radar]:
    """The two radars of the study, their biases with random signs."""
    sign = rng.choice([-1.0, 1.0], size=(2, 2))
    first = SensorSettings(
        id="radar1", kind="ssr", lat_deg=48.35, lon_deg=11.78, height_m=460.0, period_s=4.0,
        range_sigma_m=50.0, azimuth_sigma_deg=0.07, **overrides,
    )  # fmt: skip
    second = SensorSettings(
        id="radar2", kind="ssr", lat_deg=48.75, lon_deg=10.2, height_m=520.0, period_s=8.0,
        range_sigma_m=100.0, azimuth_sigma_deg=0.15, **overrides,
    )  # fmt: skip
    return [
        Radar(first, 80.0 * sign[0, 0], 0.15 * sign[0, 1], 0.3),
        Radar(second, 60.0 * sign[1, 0], 0.18 * sign[1, 1], 0.4, phase_s=1.3),
    ]


def engine_settings(radars: list[Radar], method: str = "kalman", **registration: object) -> EngineSettings:
    """ADS-B first, then the radars."""
    adsb = SensorSettings(id="adsb", kind="adsb")
    settings = RegistrationSettings(method=method, **registration)  # type: ignore[arg-type]
    return EngineSettings(sensors=(adsb, *(r.settings for r in radars)), registration=settings)


class Flights:
    """True motion on a grid of ``STEP_S``: position (n, T, 2) in a plane, height, and from them WGS-84."""

    def __init__(self, scene: Scene, rng: np.random.Generator) -> None:
        n, steps = scene.aircraft, int((scene.duration_s + 40.0) / STEP_S) + 2
        self.height_m = rng.uniform(3000.0, 11500.0, n)
        self.height_error_m = scene.height_offset_m + rng.normal(size=n) * scene.height_sigma_m
        speed = rng.uniform(120.0, 240.0, n)
        course = rng.uniform(0.0, 2 * np.pi, n)
        rate = np.zeros((n, steps))
        if scene.turning:
            for i in range(n):
                for start in np.flatnonzero(rng.random(steps) < STEP_S / 120.0):
                    rate[i, start : start + int(rng.uniform(10, 40) / STEP_S)] = np.radians(rng.choice([-1.5, 1.5]))
        angle = course[:, None] + np.cumsum(rate, axis=1) * STEP_S
        velocity = speed[:, None, None] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        start = rng.uniform(-scene.extent_m, scene.extent_m, (n, 2)) - velocity.mean(axis=1) * scene.duration_s / 2
        self.position_m = start[:, None, :] + np.cumsum(velocity, axis=1) * STEP_S
        self.position_m -= velocity * STEP_S / 2
        frame = frame_rows(np.array([CENTRE[0]]), np.array([CENTRE[1]]))[0]
        flat = frame[0:3] + self.position_m[..., :1] * frame[3:6] + self.position_m[..., 1:] * frame[6:9]
        lat, lon, _ = from_ecef(flat.reshape(-1, 3))
        self.ecef_m = to_ecef(lat, lon, np.repeat(self.height_m, steps)).reshape(n, steps, 3)

    def at(self, aircraft: Ints, seconds: Array) -> Array:
        """ECEF position (n, 3) at seconds after the start (which lies 20 s into the grid)."""
        place = (seconds + 20.0) / STEP_S
        low = place.astype(np.int64)
        part = (place - low)[:, None]
        return self.ecef_m[aircraft, low] * (1 - part) + self.ecef_m[aircraft, low + 1] * part


def _ou(rng: np.random.Generator, n: int, steps: int, sigma: float, memory_s: float) -> Array:
    keep = np.exp(-1.0 / memory_s)
    noise = rng.normal(size=(steps, n, 2)) * sigma * np.sqrt(1 - keep**2)
    out = np.empty((steps, n, 2))
    out[0] = rng.normal(size=(n, 2)) * sigma
    for k in range(1, steps):
        out[k] = keep * out[k - 1] + noise[k]
    return out


def comparisons(scene: Scene) -> Comparisons:
    """All plots of the scene with their references, in order of time."""
    rng = np.random.default_rng(scene.seed)
    flights = Flights(scene, rng)
    offsets = _ou(rng, scene.aircraft, int(scene.duration_s) + 2, scene.offset_sigma_m, scene.offset_memory_s)
    latency = scene.latency_mean_s + rng.normal(size=scene.aircraft) * scene.latency_sigma_s
    parts = [_of_radar(scene, k, flights, offsets, latency, rng) for k in range(len(scene.radars))]
    rows = Comparisons.concatenate(parts)
    return rows.take(np.argsort(rows.time_s, kind="stable"))


def _of_radar(
    scene: Scene, k: int, flights: Flights, offsets: Array, latency: Array, rng: np.random.Generator
) -> Comparisons:
    radar = scene.radars[k]
    s = radar.settings
    assert s.lat_deg is not None
    assert s.lon_deg is not None
    assert s.height_m is not None
    scans = int(scene.duration_s / s.period_s)
    aircraft = np.tile(np.arange(scene.aircraft), scans)
    turn_phase = np.repeat(rng.uniform(0, s.period_s, scene.aircraft)[None], scans, axis=0).reshape(-1)
    seconds = np.repeat(np.arange(scans) * s.period_s, scene.aircraft) * 1.0 + (turn_phase + radar.phase_s) % s.period_s
    seen = rng.random(len(seconds)) < scene.detection
    aircraft, seconds = aircraft[seen], np.clip(seconds[seen], 0.0, scene.duration_s - 1e-3)
    n = len(seconds)
    site = frame_rows(np.array([s.lat_deg]), np.array([s.lon_deg]), s.height_m)[0]
    away = flights.at(aircraft, seconds) - site[:3]
    e, nn = away @ site[3:6], away @ site[6:9]
    bias = radar.biases_at(seconds)
    slant = np.linalg.norm(away, axis=1)
    range_m = slant * (1 + bias[:, 3]) + bias[:, 0] + rng.normal(size=n) * s.range_sigma_m
    azimuth = np.degrees(np.arctan2(e, nn)) + bias[:, 1] + rng.normal(size=n) * s.azimuth_sigma_deg
    wild = rng.random(n) < scene.outliers
    range_m = range_m + wild * rng.normal(size=n) * 2000.0
    azimuth = azimuth + wild * rng.normal(size=n) * 3.0
    stamp = seconds + bias[:, 2] + rng.normal(size=n) * s.effective_time_sigma_s
    reference_s = np.clip(stamp, 0.0, scene.duration_s - 1e-3)
    return _reference(scene, flights, offsets, latency, k, aircraft, stamp, reference_s, range_m, azimuth)


def _reference(
    scene: Scene, flights: Flights, offsets: Array, latency: Array, k: int, aircraft: Ints,
    stamp: Array, reference_s: Array, range_m: Array, azimuth: Array,
) -> Comparisons:  # fmt: skip
    seen_s = reference_s - latency[aircraft]
    lat, lon, height = from_ecef(flights.at(aircraft, seen_s))
    velocity = (flights.at(aircraft, seen_s + 0.5) - flights.at(aircraft, seen_s - 0.5)) / 1.0
    east, north, _ = ecef_axes(lat, lon)
    whole = reference_s.astype(np.int64)
    part = (reference_s - whole)[:, None]
    offset = offsets[whole, aircraft] * (1 - part) + offsets[whole + 1, aircraft] * part
    spoofed: Bools = np.isin(aircraft, scene.spoofed)
    offset = offset + spoofed[:, None] * np.array(scene.spoof_m)
    frame = frame_rows(lat, lon, height)
    lat, lon, _ = from_ecef(frame[:, 0:3] + offset[:, :1] * east + offset[:, 1:] * north)
    sigma2 = scene.offset_sigma_m**2
    return Comparisons.of(
        sensor=np.full(len(stamp), k + 1), aircraft=aircraft + 100, time_s=START_S + stamp,
        range_m=range_m, azimuth_deg=np.mod(azimuth, 360.0), reference_time_s=START_S + reference_s,
        lat_deg=lat, lon_deg=lon, height_m=height + flights.height_error_m[aircraft],
        v_east_mps=np.einsum("nc,nc->n", velocity, east), v_north_mps=np.einsum("nc,nc->n", velocity, north),
        vertical_rate_mps=np.zeros(len(stamp)),
        position_cov_m2=np.tile([sigma2, 0.0, sigma2], (len(stamp), 1)),
        height_sigma_m=np.full(len(stamp), scene.height_claim_m), anchored=np.full(len(stamp), scene.anchored),
    )  # fmt: skip
