"""Flights, settings and engines for the tests of the engine and its stages: small, seeded, without the simulator.

``Flight`` says where an aircraft is; ``adsb`` and ``radar`` turn it into reports; ``Drive`` gives reports to an engine
on a fixed grid of ticks, as the service does, and keeps what comes out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pyproj
from numpy.typing import NDArray

from aeroskein.engine import FusionEngine
from aeroskein.events import Dispositions, Event, Rejections, TrackChanges
from aeroskein.measurements import COLUMNS, Measurements
from aeroskein.plots import Plots
from aeroskein.points import FusedPoints, Product
from aeroskein.settings import EngineSettings, FusionSettings, RegistrationSettings, SensorSettings, TrackSettings

Array = NDArray[np.float64]

START_S: Final = 1_790_000_000.0
TICK_S: Final = 0.25
ADSB: Final = SensorSettings(id="adsb", kind="adsb")
RADAR1: Final = SensorSettings(
    id="radar1", kind="ssr", period_s=4.0, lat_deg=48.35, lon_deg=11.78, height_m=460.0, time_bias_sigma_s=0.02
)
RADAR2: Final = SensorSettings(
    id="radar2", kind="ssr", period_s=8.0, lat_deg=47.8, lon_deg=11.0, height_m=700.0, range_sigma_m=100.0,
    azimuth_sigma_deg=0.15, time_bias_sigma_s=0.02,
)  # fmt: skip
GEOD: Final = pyproj.Geod(ellps="WGS84")
_TO_ECEF: Final = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


def engine_settings(
    *sensors: SensorSettings, capacity: int = 64, registration: bool = False, **fusion: Any
) -> EngineSettings:
    """Settings with registration off, so that nothing but the fusion is looked at."""
    return EngineSettings(
        sensors=sensors or (ADSB, RADAR1),
        fusion=FusionSettings(**fusion),
        tracks=TrackSettings(capacity=capacity),
        registration=RegistrationSettings(enabled=registration),
    )


@dataclass(frozen=True)
class Flight:
    """A flight along a geodesic at constant speed and height, in degrees, metres and seconds."""

    lat_deg: float = 48.0
    lon_deg: float = 11.5
    track_deg: float = 60.0
    speed_mps: float = 200.0
    height_m: float = 9000.0
    address: int = 0x3C6444

    def at(self, after_s: Any) -> tuple[Array, Array, Array]:
        """Latitude, longitude and track angle so long after the start."""
        after_s = np.atleast_1d(np.asarray(after_s, dtype=np.float64))
        n = len(after_s)
        # The speed is that at its height; on the ground the geodesic runs a little slower.
        length = after_s * self.speed_mps / (1.0 + self.height_m / 6.371e6)
        lon, lat, back = GEOD.fwd(
            np.full(n, self.lon_deg), np.full(n, self.lat_deg), np.full(n, self.track_deg), length
        )  # fmt: skip
        return np.asarray(lat), np.asarray(lon), np.where(length == 0.0, self.track_deg, np.asarray(back) + 180.0) % 360


def adsb(
    flight: Flight,
    after_s: Any,
    *,
    sensor: int = 0,
    sigma_m: float = 0.0,
    delay_s: Any = 0.0,
    seed: int = 0,
    **columns: Any,
) -> Plots:
    """Reports of its own position at times after ``START_S``, with velocity and both kinds of height."""
    rng = np.random.default_rng(seed)
    after_s = np.atleast_1d(np.asarray(after_s, dtype=np.float64))
    n = len(after_s)
    lat, lon, track = flight.at(after_s)
    lon, lat, _ = GEOD.fwd(lon, lat, rng.uniform(0, 360, n), np.abs(rng.normal(0, 1.4, n)) * sigma_m)
    values: dict[str, Any] = {
        "time_s": START_S + after_s, "received_s": START_S + after_s + delay_s, "sensor": sensor,
        "address": flight.address, "lat_deg": lat, "lon_deg": lon, "altitude_m": flight.height_m - 50.0,
        "height_m": flight.height_m, "ground_speed_mps": flight.speed_mps, "track_angle_deg": track,
        "vertical_rate_mps": 0.0, "callsign": b"TEST1",
    }  # fmt: skip
    return Plots.of(n, **(values | columns))


def radar(
    flight: Flight,
    after_s: Any,
    settings: SensorSettings = RADAR1,
    *,
    sensor: int = 1,
    delay_s: Any = 0.0,
    seed: int = 0,
    range_sigma_m: float = 0.0,
    azimuth_sigma_deg: float = 0.0,
    **columns: Any,
) -> Plots:
    """Radar plots with pressure altitude, computed by PROJ."""
    rng = np.random.default_rng(seed)
    after_s = np.atleast_1d(np.asarray(after_s, dtype=np.float64))
    n = len(after_s)
    slant, azimuth = seen_from(settings, *flight.at(after_s)[:2], np.full(n, flight.height_m))
    values: dict[str, Any] = {
        "time_s": START_S + after_s, "received_s": START_S + after_s + delay_s, "sensor": sensor,
        "address": flight.address, "range_m": slant + rng.normal(0, 1, n) * range_sigma_m,
        "azimuth_deg": (azimuth + rng.normal(0, 1, n) * azimuth_sigma_deg) % 360.0,
        "altitude_m": flight.height_m - 50.0, "mode_a": 0o1234,
    }  # fmt: skip
    return Plots.of(n, **(values | columns))


def ecef(lat_deg: Any, lon_deg: Any, height_m: Any) -> Array:
    """Earth-centred positions ``(n, 3)`` by PROJ."""
    return np.stack(_TO_ECEF.transform(lon_deg, lat_deg, height_m), axis=-1)


def seen_from(settings: SensorSettings, lat_deg: Array, lon_deg: Array, height_m: Array) -> tuple[Array, Array]:
    """Slant range and azimuth by PROJ and a rotation written out here."""
    lat, lon = np.radians(settings.lat_deg or 0.0), np.radians(settings.lon_deg or 0.0)
    site = ecef(settings.lat_deg, settings.lon_deg, settings.height_m)
    d = ecef(lat_deg, lon_deg, height_m) - site
    east = d @ np.array([-np.sin(lon), np.cos(lon), 0.0])
    north = d @ np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    return np.linalg.norm(d, axis=1), np.degrees(np.arctan2(east, north)) % 360.0


def distance_m(lat1: Any, lon1: Any, lat2: Any, lon2: Any) -> Array:
    """Geodesic distances ``(n,)`` by PROJ."""
    ends = np.broadcast_arrays(*(np.atleast_1d(c) for c in (lon1, lat1, lon2, lat2)))
    return np.asarray(GEOD.inv(*(np.array(c, dtype=np.float64) for c in ends))[2])


def measurements(n: int, **columns: Any) -> Measurements:
    """Measurements of ADS-B quality at the origin of the plane at time 0; scalars are repeated."""
    values: dict[str, Any] = dict.fromkeys(COLUMNS[:-1], np.nan) | {
        "slot": 0, "time_s": 0.0, "received_s": 0.0, "sensor": 0.0, "east_m": 0.0, "north_m": 0.0, "r_ee": 100.0,
        "r_en": 0.0, "r_nn": 100.0, "time_variance": 0.0, "stamp_s": 0.0,
    }  # fmt: skip
    values |= columns
    kind = {"slot": np.int64}
    return Measurements(**{
        name: np.broadcast_to(np.asarray(value, dtype=kind.get(name, np.float64)), (n,)).copy()
        for name, value in values.items()
    })  # fmt: skip


@dataclass
class Drive:
    """An engine that is given reports on a grid of ticks, and everything that came out of it."""

    engine: FusionEngine
    events: list[Event] = field(default_factory=list)
    now_s: float = START_S

    @classmethod
    def of(cls, settings: EngineSettings | None = None, **engine: Any) -> Drive:
        """A new engine."""
        return cls(FusionEngine(settings or engine_settings(), epoch_ms=1, **engine))

    def feed(self, plots: Plots | Iterable[Plots], until_s: float | None = None) -> Drive:
        """Give reports in order of arrival, tick by tick, and let time pass up to ``until_s`` after ``START_S``.

        Reports that arrive within a tick are given at the tick's end, all together.
        """
        plots = plots if isinstance(plots, Plots) else Plots.concatenate(list(plots))
        plots = plots.take(np.argsort(plots.received_s, kind="stable"))
        now = round((self.now_s - START_S) / TICK_S)
        ticks = np.maximum(np.ceil((plots.received_s - START_S) / TICK_S).astype(np.int64), now + 1)
        last = int(ticks.max(initial=0)) if until_s is None else round(until_s / TICK_S)
        for tick in range(now + 1, last + 1):
            self.now_s = START_S + tick * TICK_S
            batch = plots.take(np.flatnonzero(ticks == tick))
            if len(batch):
                self.events += self.engine.receive(batch, now_s=self.now_s)
            self.events += self.engine.advance(now_s=self.now_s)
        return self

    def finish(self) -> Drive:
        """The input has ended."""
        self.events += self.engine.finish(now_s=self.now_s)
        return self

    def _points(self, product: Product) -> FusedPoints:
        return FusedPoints.concatenate([e for e in self.events if isinstance(e, FusedPoints) and e.product == product])

    @property
    def elements(self) -> FusedPoints:
        """All element points, in order of publication."""
        return self._points(Product.ELEMENT)

    @property
    def live(self) -> FusedPoints:
        """All live points, in order of publication."""
        return self._points(Product.LIVE)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Reports by sensor and reason."""
        return np.sum([e.counts for e in self.events if isinstance(e, Rejections)], axis=0)

    @property
    def changes(self) -> list[TrackChanges]:
        """Changes of status."""
        return [e for e in self.events if isinstance(e, TrackChanges)]

    @property
    def dispositions(self) -> list[Dispositions]:
        """What became of reports, where it was asked for."""
        return [e for e in self.events if isinstance(e, Dispositions)]


def by_track(points: FusedPoints) -> list[FusedPoints]:
    """The points of each track, in order of publication."""
    return [points.take(np.flatnonzero(points.track_number == n)) for n in np.unique(points.track_number)]


def shuffled(plots: Plots, delay_s: Callable[[np.random.Generator, int], Array], seed: int) -> Plots:
    """The same reports with other delays."""
    rng = np.random.default_rng(seed)
    other = plots.take(np.arange(len(plots)))
    other.received_s = other.time_s + delay_s(rng, len(plots))
    return other
