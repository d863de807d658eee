"""Integrity as a user sees it: flags of the live points that the whole engine publishes on simulated reports.

    python -m benchmarks.integrity_engine [--runs N] [--hours H] [--seed N] [--case NAME ...]

Radars are biased and registered while it runs. Without an instrumented range in the configuration the cover of a radar
is learned from what it reports; both are measured. Ghosts are aircraft of another scenario that only ADS-B hears.
Exit status 1 when a goal is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from benchmarks.engine_runs import RADARS, SENSORS, Change, bias_errors, fly, signed_biases
from benchmarks.goals import require, verdict

from aeroskein.geodesy import frame_rows, to_ecef
from aeroskein.integrity.cover import CoverMap, polar_of
from aeroskein.plots import Plots
from aeroskein.points import Flag, FusedPoints, Product, Status
from aeroskein.settings import EngineSettings
from aeroskein.simulation import SimulationSettings
from aeroskein.simulation.settings import Scenario

GHOST_GOAL_S = DRIFT_GOAL_S = 30.0
DRIFT_FROM_M: Final = 500.0
FALSE_PER_1000_HOURS: Final = 1.0
# Instrumented range where one is configured: 200 NM. [m]
INSTRUMENTED_M: Final = 370_000.0
# Traffic among which one aircraft is wrong, and how long it is watched before. [aircraft], [s]
AIRCRAFT: Final = 24
WARM_UP_S: Final = 300.0
EARTH_M: Final = 6_371_000.0
FIRST_ADDRESS: Final = 0x400000
ADDRESS_STEP: Final = 16
# Addresses of the aircraft that drift: speed [m/s], and when it begins [s]; and how long they are watched. [s]
DRIFTS: Final = {0x400030: (2.0, 150.0), 0x400090: (20.0, 180.0), 0x4000F0: (10.0, 250.0), 0x400150: (5.0, 330.0)}
DRIFT_RUN_S: Final = 490.0


@dataclass(slots=True)
class Watch:
    """When each address was first confirmed and first suspect, and what the alarms said. [s]"""

    confirmed_s: dict[int, float] = field(default_factory=dict)
    suspect_s: dict[int, float] = field(default_factory=dict)
    alarms_s: dict[str, float] = field(default_factory=dict)

    def note(self, points: FusedPoints, seconds: float) -> None:
        """Take live points in."""
        confirmed = points.status == Status.CONFIRMED
        suspect = (points.flags & Flag.ADSB_SUSPECT) != 0
        for rows, first in ((confirmed, self.confirmed_s), (suspect, self.suspect_s)):
            for address in np.unique(points.address[rows]).tolist():
                first.setdefault(address, seconds)


def watch(
    seed: int, seconds: float, *, aircraft: int = AIRCRAFT, scenario: Scenario = "enroute", ghosts: int = 0,
    range_max_m: float | None = None, change: Change | None = None,
) -> Watch:  # fmt: skip
    """Fly a scenario, with ghosts from a scenario of their own, and watch the flags."""
    sensors = tuple(replace(s, range_max_m=range_max_m) if s.is_radar else s for s in SENSORS)
    real = SimulationSettings(
        scenario=scenario, aircraft=aircraft, seed=seed, duration_s=seconds, errors=bias_errors(signed_biases(seed))
    )
    scenes, only = [real], list[Collection[str] | None]([None])
    if ghosts:
        only.append({"adsb"})
        scenes.append(SimulationSettings(scenario=scenario, aircraft=ghosts, seed=seed + 500, duration_s=seconds))
    found = Watch()
    for step in fly(scenes, EngineSettings(sensors=sensors), only=only, change=change):
        for event in step.events:
            if isinstance(event, FusedPoints) and event.product == Product.LIVE:
                found.note(event, step.seconds)
        for alarm in step.engine.alarms():
            found.alarms_s.setdefault(alarm, step.seconds)
    return found


def address_of(number: int, ghost: bool = False) -> int:
    """Address of an aircraft of the simulator by its number."""
    return FIRST_ADDRESS + ADDRESS_STEP * number + (0x200000 if ghost else 0)


def bystanders(found: Watch, victims: set[int]) -> int:
    """Honest aircraft that became suspect."""
    return len(set(found.suspect_s) - victims)


class InCover:
    """How many radars' cover holds an aircraft when the goal's time is over: the radars' plots so far say so."""

    def __init__(self, address: int, range_max_m: float | None) -> None:
        self.radars = 0
        self._inside = [False for _ in RADARS]
        self._address = address
        self._covers = [CoverMap(range_max_m) for _ in RADARS]
        self._sites = [
            frame_rows(np.array([r.lat_deg], float), np.array([r.lon_deg], float), r.height_m or 0.0)[0] for r in RADARS
        ]

    def note(self, plots: Plots, seconds: float) -> None:
        """Take the reports of a second in."""
        own = np.flatnonzero(plots.address == self._address)
        for k, (cover, site) in enumerate(zip(self._covers, self._sites, strict=True)):
            seen = plots.take(np.flatnonzero(plots.sensor == k + 1))
            up = (seen.altitude_m - (RADARS[k].height_m or 0.0)) / seen.range_m - seen.range_m / (2.0 * EARTH_M)
            cover.seen(seen.range_m, seen.azimuth_deg, np.degrees(np.arcsin(up)), seconds)
            if len(own) and seconds <= GHOST_GOAL_S:
                at = own[-1:]
                place = polar_of(site, to_ecef(plots.lat_deg[at], plots.lon_deg[at], plots.height_m[at]))
                self._inside[k] = bool(cover.detection(*place, seconds)[0] > 0.0)
        self.radars = sum(self._inside)


def ghosts(runs: int) -> None:
    """Two ghosts: one from the first second, while nothing is known of cover or biases, one after five minutes."""
    names = (address_of(0, ghost=True), address_of(1, ghost=True))
    for name, range_max_m in (("instrumented range", INSTRUMENTED_M), ("learned cover", None)):
        times, radars = [], []
        for seed in range(runs):
            cover = InCover(names[0], range_max_m)

            def late(plots: Plots, seconds: float, cover: InCover = cover) -> Plots:
                cover.note(plots, seconds)
                return plots.take(np.flatnonzero((plots.address != names[1]) | (seconds >= WARM_UP_S)))

            found = watch(seed, WARM_UP_S + 60.0, ghosts=2, range_max_m=range_max_m, change=late)
            times.append([found.suspect_s.get(g, np.inf) - found.confirmed_s.get(g, np.nan) for g in names])
            radars.append(cover.radars)
            require(bystanders(found, set(names)) == 0, f"ghosts, run {seed}: no honest aircraft suspect")
        first, second = np.array(times).T
        by_two = first[np.array(radars) == len(RADARS)]
        print(f"ghost, {name}: suspect {np.median(second):.0f} s after its confirmation (median), {second.max():.0f} s"
              f" at most; from the first second on {np.median(first):.0f} s, {first.max():.0f} s at most, where both"
              f" radars' cover holds it {by_two.max(initial=0.0):.0f} s ({len(by_two)} of {runs} runs)"
        )  # fmt: skip
        for when, after_s in (("after five minutes", second), ("from the first second on", by_two)):
            slowest = after_s.max(initial=0.0)
            require(slowest <= GHOST_GOAL_S, f"ghost {when}, {name}: suspect within {GHOST_GOAL_S:.0f} s")


def drifts(runs: int) -> None:
    """Four aircraft report themselves further and further aside, each at a speed of its own."""
    found = [watch(seed, DRIFT_RUN_S, change=_drift(seed)) for seed in range(runs)]
    for seed, run in enumerate(found):
        require(bystanders(run, {*DRIFTS}) == 0, f"drifts, run {seed}: no honest aircraft suspect")
    for victim, (rate, from_s) in DRIFTS.items():
        after_s = np.array([run.suspect_s.get(victim, np.inf) - from_s for run in found])
        late_s = float(after_s.max()) - DRIFT_FROM_M / rate
        median_m, most_m = np.median(after_s) * rate, after_s.max() * rate
        print(f"drift of {rate:.0f} m/s: suspect at {median_m:.0f} m (median), {most_m:.0f} m at most;"
              f" {late_s:.0f} s from {DRIFT_FROM_M:.0f} m at most ({runs} runs)")  # fmt: skip
        require(late_s <= DRIFT_GOAL_S, f"drift of {rate:.0f} m/s within {DRIFT_GOAL_S:.0f} s of 500 m")


def _drift(seed: int) -> Change:
    angles = np.random.default_rng(seed + 77).uniform(0.0, 2.0 * np.pi, len(DRIFTS))
    start_s = SimulationSettings().start_s

    def drift(plots: Plots, seconds: float) -> Plots:
        for angle, (victim, (rate_mps, from_s)) in zip(angles, DRIFTS.items(), strict=True):
            mine = (plots.sensor == 0) & (plots.address == victim)
            off_m = np.where(mine, rate_mps * np.maximum(plots.time_s - start_s - from_s, 0.0), 0.0)
            plots.lat_deg = plots.lat_deg + off_m * np.cos(angle) / 111_200.0
            plots.lon_deg = plots.lon_deg + off_m * np.sin(angle) / (111_200.0 * np.cos(np.radians(48.5)))
        return plots

    return drift


def false_alarms(hours: float, seed: int) -> None:
    """Honest traffic only, of all kinds, with comings and goings."""
    flown, alarms = 0.0, 0
    while flown < hours:
        found = watch(seed, 900.0, aircraft=100, scenario="mixed")
        flown, alarms, seed = flown + 25.0, alarms + bystanders(found, set()), seed + 1
    print(f"honest traffic: {alarms} false alarms in {flown:.0f} flight hours")
    require(1000.0 * alarms / flown <= FALSE_PER_1000_HOURS, "false alarms")


def main() -> int:
    """Print everything; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--hours", type=float, default=100.0, help="flight hours of honest traffic")
    parser.add_argument("--seed", type=int, default=100, help="first seed of honest traffic, 25 flight hours each")
    cases: dict[str, Callable[[], None]] = {
        "ghosts": lambda: ghosts(options.runs),
        "drifts": lambda: drifts(options.runs),
        "false-alarms": lambda: false_alarms(options.hours, options.seed),
    }
    parser.add_argument("--case", action="append", default=[], choices=[*cases])
    options = parser.parse_args()
    for name in options.case or cases:
        cases[name]()
    return verdict()


if __name__ == "__main__":
    sys.exit(main())
