"""Flights, ADS-B and two radars for the integrity study, in one plane around the first radar.

ADS-B once a second, 10 m, stamp jitter 0.2 s, latency 0.1 s between aircraft; radar 1 every 4 s (50 m, 0.07 degrees),
radar 2 every 8 s (100 m, 0.15 degrees), detection 0.97. What an aircraft *says* may differ from where it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from aeroskein.geodesy import frame_rows, from_plane
from aeroskein.integrity import Belief, Integrity, Looks, OwnPositions
from aeroskein.plots import Array, Ints
from aeroskein.settings import EngineSettings, SensorSettings

SITES_M = np.array([[0.0, 0.0], [-115_000.0, 45_000.0]])
SIGMAS = ((50.0, 0.07), (100.0, 0.15))
PERIODS_S = (4.0, 8.0)
START_S = 1_790_000_000.0
FRAME = frame_rows(np.array([48.35]), np.array([11.78]))


def settings(range_max_m: float | None = None) -> EngineSettings:
    """ADS-B and the two radars."""
    lat, lon = from_plane(FRAME, SITES_M[:, 0], SITES_M[:, 1])
    radars = tuple(
        SensorSettings(
            id=f"radar{k + 1}", kind="ssr", lat_deg=float(lat[k]), lon_deg=float(lon[k]), height_m=0.0,
            period_s=PERIODS_S[k], range_sigma_m=SIGMAS[k][0], azimuth_sigma_deg=SIGMAS[k][1], range_max_m=range_max_m,
        )
        for k in range(2)
    )  # fmt: skip
    return EngineSettings(sensors=(SensorSettings(id="adsb", kind="adsb"), *radars))


@dataclass
class World:
    """Aircraft and what goes wrong with them.

    ``displaced(aircraft, seconds)`` is what is added to the place an aircraft reports, ``(n, 2)``; ``ghosts`` report
    from ``ghost_from_s`` on and no radar sees them.
    """

    aircraft: int = 24
    seed: int = 0
    detection: float = 0.97
    wild: float = 0.001
    latency_sigma_s: float = 0.1
    range_max_m: float | None = None
    displaced: Callable[[Ints, float], Array] = field(default=lambda a, _s: np.zeros((len(a), 2)))
    radar_shift_deg: Callable[[int, float], float] = field(default=lambda _k, _s: 0.0)
    ghosts: tuple[int, ...] = ()
    ghost_from_s: float = np.inf


class Run:
    """Plays a world second by second into ``Integrity`` and notes when beliefs change."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.rng = np.random.default_rng(world.seed)
        self.settings = settings(world.range_max_m)
        self.integrity = Integrity(self.settings, world.aircraft)
        n = world.aircraft
        self.place = self.rng.uniform(-90e3, 60e3, (n, 2))
        speed, self.course = self.rng.uniform(120.0, 240.0, n), self.rng.uniform(0, 2 * np.pi, n)
        self.speed = speed
        self.rate = np.zeros(n)
        self.height = self.rng.uniform(4000.0, 11000.0, n)
        self.latency = self.rng.normal(size=n) * world.latency_sigma_s
        self.changes: list[tuple[float, int, int]] = []
        self.alarms: list[tuple[float, str]] = []

    @property
    def velocity(self) -> Array:
        return self.speed[:, None] * np.stack([np.sin(self.course), np.cos(self.course)], axis=-1)

    def second(self, s: float) -> None:
        """One second of flight, reports, plots and judgement."""
        w, rng, n = self.world, self.rng, self.world.aircraft
        self._fly()
        every = np.arange(n)
        there = ~np.isin(every, w.ghosts) | (s >= w.ghost_from_s)
        own_s = s + rng.uniform(-0.5, 0.5, n)
        stamp_error = rng.normal(size=n) * 0.2 - self.latency
        v = self.velocity
        said = self.place + v * (own_s - s + stamp_error)[:, None] + rng.normal(size=(n, 2)) * 10.0
        said += w.displaced(every, s)
        cov = 100.0 * np.array([1.0, 0.0, 1.0]) + 0.04 * np.stack([v[:, 0] ** 2, v[:, 0] * v[:, 1], v[:, 1] ** 2], -1)
        heard = there & (rng.random(n) < 0.97)
        said_v = v + rng.normal(size=(n, 2))
        self.integrity.own(OwnPositions(every[heard], START_S + own_s[heard], said[heard], said_v[heard], cov[heard]))
        self._radars(s, every)
        lat, lon = from_plane(FRAME, said[:, 0], said[:, 1])
        for slot in self.integrity.check(START_S + s, every[there], lat[there], lon[there], self.height[there]):
            self.changes.append((s, int(slot), int(self.integrity.belief(np.array([slot]))[0])))
        self.alarms += [(s, a) for a in self.integrity.alarms() if "suspect" not in a]

    def _fly(self) -> None:
        turning = self.rng.random(self.world.aircraft) < 1 / 120
        self.rate = np.where(
            turning, np.radians(self.rng.choice([-1.5, 0.0, 0.0, 1.5], self.world.aircraft)), self.rate
        )
        # Turn back at the edge, so that everybody stays in cover.
        out = np.linalg.norm(self.place + 15e3, axis=1) > 95e3
        home = np.arctan2(*(-15e3 - self.place).T)
        off = np.mod(home - self.course + np.pi, 2 * np.pi) - np.pi
        self.course = self.course + np.where(out, np.clip(off, -0.03, 0.03), self.rate)
        self.place = self.place + self.velocity

    def _radars(self, s: float, every: Ints) -> None:
        w, rng = self.world, self.rng
        for k, site in enumerate(SITES_M):
            away = self.place - site
            azimuth = np.mod(np.degrees(np.arctan2(away[:, 0], away[:, 1])), 360.0)
            turn = np.mod(s / PERIODS_S[k] * 360.0, 360.0)
            due = np.mod(turn - azimuth, 360.0) < 360.0 / PERIODS_S[k]
            seen = np.flatnonzero(due & (rng.random(w.aircraft) < w.detection) & ~np.isin(every, w.ghosts))
            if not len(seen):
                continue
            self._plots(k, site, seen, away[seen], azimuth[seen], s)

    def _plots(self, k: int, site: Array, seen: Ints, away: Array, azimuth: Array, s: float) -> None:
        w, rng = self.world, self.rng
        ground = np.linalg.norm(away, axis=1)
        u = away / ground[:, None]
        across = np.stack([u[:, 1], -u[:, 0]], axis=-1)
        sr, sa = SIGMAS[k][0], ground * np.radians(SIGMAS[k][1])
        wild = np.where(rng.random(len(seen)) < w.wild, 20.0, 1.0)
        noise_r, noise_a = rng.normal(size=(2, len(seen))) * wild
        shift = np.radians(w.radar_shift_deg(k, s)) * ground
        place = self.place[seen] + u * (noise_r * sr)[:, None] + across * (noise_a * sa + shift)[:, None]
        cov = np.stack([sr**2 * u[:, 0] ** 2 + sa**2 * across[:, 0] ** 2,
                        sr**2 * u[:, 0] * u[:, 1] + sa**2 * across[:, 0] * across[:, 1],
                        sr**2 * u[:, 1] ** 2 + sa**2 * across[:, 1] ** 2], axis=-1)  # fmt: skip
        self.integrity.looks(
            Looks(np.full(len(seen), k + 1), seen, np.full(len(seen), START_S + s), place, cov,
                  np.hypot(ground, self.height[seen]), azimuth, self.height[seen])
        )  # fmt: skip

    def first_suspect(self, aircraft: int) -> float:
        """Second at which an aircraft was first suspect; infinity where never."""
        return min((s for s, a, b in self.changes if a == aircraft and b == Belief.SUSPECT), default=np.inf)
