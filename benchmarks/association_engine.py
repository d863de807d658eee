"""Association as a user sees it: plots without a name go through the whole engine; what became of each is looked up.

    python -m benchmarks.association_engine [--seeds N] [--hours H] [--case NAME ...]

In cases ``plots`` and ``tracks`` aircraft have ADS-B, and a radar (4 s, 100 m, 0.15 degrees, detection 0.9) sees them
without address and code; in ``primary`` and ``false-tracks`` only primary radars see them. Right association is the
share of plots that were given their own aircraft's track, of those that were given one. Tracks per aircraft, swaps and
false tracks are those of ``aeroskein evaluate``. Exit status 1 when a goal is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from benchmarks.engine_runs import RADARS, SENSORS, fly, judged, true_flights
from benchmarks.goals import require, verdict

from aeroskein.evaluation import Truth, TruthCurve
from aeroskein.evaluation.neighbours import near_pairs
from aeroskein.events import Dispositions
from aeroskein.plots import Array, Plots
from aeroskein.points import FusedPoints, Product
from aeroskein.reasons import Reason
from aeroskein.settings import AssociationSettings, EngineSettings, RegistrationSettings, SensorSettings
from aeroskein.simulation import SensorErrors, SimulationSettings
from aeroskein.simulation.settings import Scenario

Method = Literal["mahalanobis", "ahp"]
METHODS: Final[tuple[Method, ...]] = ("mahalanobis", "ahp")
COARSE: Final = replace(RADARS[0], range_sigma_m=100.0, azimuth_sigma_deg=0.15)
PRIMARY: Final = replace(RADARS[1], kind="psr")
VELOCITY_SIGMA_MPS: Final = 8.0
AIRCRAFT: Final = 18
SECONDS: Final = 180.0
# Before this the first plots are not counted: there is no track yet. [s]
FROM_S: Final = 20.0
# Scenario, velocity given, targets numbered by the radar: share that must be right, method mahalanobis. [%] Formations
# fly 320 to 440 m apart here, where the goal is for 300 to 900 m: beyond 50 km that is less than three sigmas.
GOALS: Final[dict[tuple[Scenario, bool, bool], float]] = {
    ("enroute", True, False): 99.9,
    ("crossing", True, False): 99.5,
    ("formation", True, False): 98.5,
    ("formation", True, True): 99.5,
}
FALSE_TRACKS_PER_HOUR: Final = 1.0
# A track has gone over to another aircraft when it is nearer to it for so long. While two pass each other within the
# errors of their tracks, either track may be nearer to either. [s], [blocks]
BLOCK_S: Final = 10.0
LASTING_BLOCKS: Final = 3
# Beyond this a track has nothing to do with an aircraft. [m]
NEAR_M: Final = 5000.0
# Tracks that end before this are not judged. [s]
JUDGED_FROM_S: Final = 60.0
PRIMARY_S: Final = 300.0


@dataclass
class Nameless:
    """Takes the names off the radar's plots and remembers them; gives them the velocity of the radar's own tracker."""

    velocity: bool
    numbered: bool
    rng: np.random.Generator

    def __post_init__(self) -> None:
        # Address by the time that a plot states: no two plots state the same.
        self.truth: dict[float, int] = {}
        self._flown: dict[int, tuple[float, float]] = {}

    def __call__(self, plots: Plots, seconds: float) -> Plots:
        """The same plots without address and code."""
        radar = plots.sensor == 1
        address = plots.address.astype(np.int64)
        self.truth |= dict(zip(plots.time_s[radar].tolist(), address[radar].tolist(), strict=True))
        own = np.flatnonzero(~radar)
        angle = np.radians(plots.track_angle_deg[own])
        flown = plots.ground_speed_mps[own, None] * np.stack([np.sin(angle), np.cos(angle)], axis=1)
        self._flown |= dict(zip(address[own].tolist(), map(tuple, flown.tolist()), strict=True))
        if self.velocity:
            v = np.array([self._flown.get(a, (np.nan, np.nan)) for a in address.tolist()]).reshape(-1, 2)
            v = v + VELOCITY_SIGMA_MPS * self.rng.normal(size=v.shape)
            speed, course = np.hypot(v[:, 0], v[:, 1]), np.mod(np.degrees(np.arctan2(v[:, 0], v[:, 1])), 360.0)
            plots.ground_speed_mps = np.where(radar, speed, plots.ground_speed_mps)
            plots.track_angle_deg = np.where(radar, course, plots.track_angle_deg)
        plots.address = np.where(radar, -1, plots.address).astype(np.int32)
        plots.mode_a = np.where(radar, -1, plots.mode_a).astype(np.int16)
        if not self.numbered:
            plots.local_track = np.full(len(plots), -1, dtype=np.int64)
        return plots


def fates(scenario: Scenario, velocity: bool, numbered: bool, method: Method, seed: int) -> tuple[Array, Any]:
    """Radar plots that came to the right track, to a wrong one, to none ``(3,)``; and the identity of the tracks."""
    sensors = (SENSORS[0], COARSE)
    settings = EngineSettings(
        sensors=sensors,
        registration=RegistrationSettings(enabled=False),
        association=AssociationSettings(method=method),
    )
    errors = (SensorErrors(sensor="radar1", miss_probability=0.1),)
    flights = SimulationSettings(
        scenario=scenario, aircraft=AIRCRAFT, seed=seed, duration_s=SECONDS, errors=errors, radius_m=90_000.0
    )
    stripped = Nameless(velocity, numbered, np.random.default_rng(seed))
    counts, events = np.zeros(3), list[Any]()
    for step in fly([flights], settings, change=stripped):
        step.engine.want_dispositions = True
        for event in step.events:
            if isinstance(event, Dispositions) and step.seconds > FROM_S:
                # Each report is told of at its arrival, and again with its element.
                told = np.flatnonzero((event.sensor == 1) & (event.element < 0))
                given = event.reason[told] != Reason.UNASSOCIATED
                right = event.label[told] == [stripped.truth[t] for t in event.time_s[told].tolist()]
                counts += [(given & right).sum(), (given & ~right).sum(), (~given).sum()]
        events += step.events
    return counts, judged(events, true_flights(flights, sensors), Product.LIVE).identity


def plots_find_their_tracks(seeds: int) -> None:
    """Right association by kind of traffic and method."""
    print("right association [%] (given no track [%])   tracks per aircraft, swaps, false tracks")
    kinds: tuple[tuple[Scenario, bool, bool], ...] = (
        ("enroute", True, False), ("crossing", False, False), ("crossing", True, False), ("formation", True, False),
        ("formation", True, True),
    )  # fmt: skip
    for scenario, velocity, numbered in kinds:
        for method in METHODS:
            runs = [fates(scenario, velocity, numbered, method, seed) for seed in range(1, seeds + 1)]
            right, wrong, alone = np.sum([counts for counts, _ in runs], axis=0)
            share, lost = 100.0 * right / (right + wrong), 100.0 * alone / (right + wrong + alone)
            per_aircraft = float(np.mean([i.tracks / i.flights_judged for _, i in runs]))
            swaps, false = sum(i.swaps for _, i in runs), sum(i.false_tracks for _, i in runs)
            name = f"{scenario}{', velocity' if velocity else ''}{', numbered' if numbered else ''}"
            print(f"    {name:32s} {method:12s} {share:6.2f} ({lost:.2f})   {per_aircraft:.3f} {swaps} {false}")
            goal = GOALS.get((scenario, velocity, numbered))
            require(method == "ahp" or goal is None or share >= goal, f"{name}: {share:.2f} >= {goal}")
            require(swaps == 0 and per_aircraft == 1.0, f"{name}, {method}: one track per aircraft and no swap")


def tracks(seeds: int) -> None:
    """Aircraft with ADS-B, seen by a radar that knows codes only, and a primary radar with ten false plots a scan."""
    sensors: tuple[SensorSettings, ...] = (SENSORS[0], RADARS[0], PRIMARY)
    errors = (SensorErrors(sensor="radar1", mode_s=False), SensorErrors(sensor="radar2", false_plots=10.0))
    scenarios: tuple[Scenario, ...] = ("crossing", "formation", "mixed")
    for scenario in scenarios:
        for method in METHODS:
            settings = EngineSettings(sensors=sensors, association=AssociationSettings(method=method))
            summary = _summary(scenario, sensors, errors, settings, seeds)
            print(f"{scenario}, ADS-B, codes and primary plots, {method}: {summary}")


def _summary(
    scenario: Scenario, sensors: tuple[SensorSettings, ...], errors: tuple[SensorErrors, ...],
    settings: EngineSettings, seeds: int,
) -> str:  # fmt: skip
    counted = np.zeros(4)
    for seed in range(1, seeds + 1):
        flights = SimulationSettings(scenario=scenario, aircraft=AIRCRAFT, seed=seed, duration_s=SECONDS, errors=errors)
        events = [event for step in fly([flights], settings) for event in step.events]
        found = judged(_lived(events), true_flights(flights, sensors), Product.ELEMENT).identity
        counted += [found.tracks, found.flights_tracked, found.swaps, found.false_tracks]
    made, aircraft, swaps, false = counted
    require(made == aircraft and swaps == 0, f"{scenario}: one track per aircraft and no swap")
    return f"{made / aircraft:.3f} tracks per aircraft, {swaps:.0f} swaps, {false:.0f} false tracks ({seeds} runs)"


def _lived(events: list[Any]) -> list[Any]:
    """The element points of tracks that lived beyond the first minute: who leaves before it is not judged."""
    points = FusedPoints.concatenate([e for e in events if isinstance(e, FusedPoints) and e.product == Product.ELEMENT])
    late = points.time_s > points.time_s.min() + JUDGED_FROM_S
    return [points.take(np.isin(points.track_number, points.track_number[late]))]


def primary(seeds: int) -> None:
    """Aircraft that only primary radars see, ten false plots a scan; they meet in pairs, or over the first radar."""
    scenarios: tuple[Scenario, ...] = ("crossing", "cruise")
    for radars in (2, 1):
        sensors = tuple(replace(r, kind="psr") for r in RADARS[:radars])
        errors = tuple(SensorErrors(sensor=r.id, false_plots=10.0, range_max_m=200_000.0) for r in sensors)
        for scenario in scenarios:
            counted, square = np.zeros(5), 0.0
            for seed in range(1, seeds + 1):
                flights = SimulationSettings(
                    scenario=scenario, aircraft=AIRCRAFT, seed=seed, duration_s=PRIMARY_S, errors=errors
                )
                events = [event for step in fly([flights], EngineSettings(sensors=sensors)) for event in step.events]
                truth = true_flights(flights, sensors)
                found = judged(events, truth, Product.LIVE)
                who, rms = found.identity, found.accuracy.horizontal_m.rms
                counted += [who.tracks, who.flights_judged, exchanges(events, truth), who.swaps, who.false_tracks]
                square += np.nan if rms is None else rms**2 / seeds
            made, aircraft, lasting, swaps, false = counted
            name = f"{scenario}, {radars} primary radar{'s' if radars > 1 else ''} only"
            print(f"{name}: {made / aircraft:.3f} tracks per aircraft, {lasting:.0f} exchanged for good, {swaps:.0f} at"
                  f" an instant, {false:.0f} false tracks, {np.sqrt(square):.0f} m ({seeds} runs)")  # fmt: skip
            require(lasting == 0, f"{name}: no aircraft exchange their tracks")
            require(made == aircraft, f"{name}: one track per aircraft")
            require(radars == 1 or false == 0, f"{name}: no false track")


def exchanges(events: list[Any], truth: Truth) -> int:
    """How often a track went over to another aircraft for good."""
    points = FusedPoints.concatenate([e for e in events if isinstance(e, FusedPoints) and e.product == Product.LIVE])
    near = near_pairs(points.time_s, points.lat_deg, points.lon_deg, TruthCurve(truth), NEAR_M)
    block = np.floor(points.time_s[near.point] / BLOCK_S).astype(np.int64)
    rows = np.stack([points.track_number[near.point], block, near.flight], axis=1)
    cells, at = np.unique(rows, axis=0, return_inverse=True)
    # Farther than the gate counts as the gate.
    gain = np.bincount(at.reshape(-1), weights=NEAR_M - near.distance_m)
    best = np.lexsort((-gain, cells[:, 1], cells[:, 0]))
    _, first = np.unique(cells[best, :2], axis=0, return_index=True)
    track, _, flight = cells[best[first]].T
    found = 0
    for number in np.unique(track):
        own = flight[track == number]
        runs = np.split(own, np.flatnonzero(np.diff(own)) + 1)
        found += int((np.diff([run[0] for run in runs if len(run) >= LASTING_BLOCKS]) != 0).sum())
    return found


def false_tracks(hours: float) -> None:
    """A primary radar with ten false plots a scan, some aircraft without anything else, for hours."""
    made, flown_h, found, aircraft = 0, 0.0, 0, 0
    seed = 1
    while flown_h < hours:
        errors = (SensorErrors(sensor="radar1", false_plots=10.0, range_max_m=200_000.0),)
        flights = SimulationSettings(scenario="cruise", aircraft=6, seed=seed, duration_s=1800.0, errors=errors)
        sensors = (replace(RADARS[0], kind="psr"),)
        settings = EngineSettings(sensors=sensors)
        events = [event for step in fly([flights], settings) for event in step.events]
        seen = judged(events, true_flights(flights, sensors), Product.LIVE).identity
        made, found, aircraft = made + seen.false_tracks, found + seen.flights_tracked, aircraft + seen.flights_judged
        flown_h, seed = flown_h + 0.5, seed + 1
    print(f"primary radar alone, ten false plots a scan: {made} false tracks in {flown_h:.1f} hours,"
          f" {found} of {aircraft} aircraft found")  # fmt: skip
    require(made / flown_h <= FALSE_TRACKS_PER_HOUR, "false tracks per hour")


def main() -> int:
    """Print everything; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--hours", type=float, default=4.0)
    cases: dict[str, Callable[[], None]] = {
        "plots": lambda: plots_find_their_tracks(options.seeds),
        "tracks": lambda: tracks(options.seeds),
        "primary": lambda: primary(options.seeds),
        "false-tracks": lambda: false_tracks(options.hours),
    }
    parser.add_argument("--case", action="append", default=[], choices=[*cases])
    options = parser.parse_args()
    for name in options.case or cases:
        cases[name]()
    return verdict()


if __name__ == "__main__":
    sys.exit(main())
