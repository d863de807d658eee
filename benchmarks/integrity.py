"""Integrity: time to suspect ghosts, jumps and drifts, and false alarms; fails when a goal is missed.

    python -m benchmarks.integrity [--runs N] [--hours H]

Two radars (4 s and 8 s), 24 aircraft within 95 km of the first; see benchmarks/integrity_scene.py for the noise.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from benchmarks.goals import require, verdict
from benchmarks.integrity_scene import Run, World

from aeroskein.integrity import Belief
from aeroskein.plots import Array, Ints

GHOST_GOAL_S = DRIFT_GOAL_S = 30.0
DRIFT_FROM_M = 500.0
FALSE_PER_1000_HOURS = 1.0
VICTIM = 3


def play(world: World, seconds: float) -> Run:
    """Play a world from its start."""
    run = Run(world)
    for s in range(1, int(seconds) + 1):
        run.second(float(s))
    return run


def bystanders(run: Run, victims: tuple[int, ...]) -> int:
    """Honest aircraft that became suspect."""
    return len({a for _, a, b in run.changes if b == Belief.SUSPECT and a not in victims})


def ghosts(runs: int) -> None:
    """An aircraft that only says it is there, inside the instrumented range of both radars, or inside learned cover."""
    for name, range_max_m, goal in (
        ("instrumented range", 370_000.0, True),
        ("cover learned in 10 minutes", None, False),
    ):
        times = []
        for seed in range(runs):
            run = play(World(seed=seed, aircraft=25, ghosts=(24,), ghost_from_s=600.0, range_max_m=range_max_m), 660.0)
            times.append(run.first_suspect(24) - 600.0)
            require(bystanders(run, (24,)) == 0, f"ghost, run {seed}: no honest aircraft suspect")
        print(f"ghost, {name}: suspect after {np.median(times):.0f} s (median), {max(times):.0f} s at most")
        require(not goal or max(times) <= GHOST_GOAL_S, f"ghost suspect within {GHOST_GOAL_S:.0f} s")


def wrong_positions(runs: int) -> None:
    """Drifts of several speeds, and jumps."""
    for rate in (2.0, 5.0, 10.0, 20.0):
        times, offsets = [], []
        for seed in range(runs):
            run, found_s = _displaced(seed, rate, DRIFT_FROM_M / rate + 90.0)
            times.append(found_s - DRIFT_FROM_M / rate)
            offsets.append(found_s * rate)
            require(bystanders(run, (VICTIM,)) == 0, f"drift, run {seed}: no honest aircraft suspect")
        print(f"drift {rate:4.0f} m/s: suspect at {np.median(offsets):4.0f} m (median), {max(offsets):4.0f} m at most;"
              f" {max(max(times), 0.0):.0f} s after {DRIFT_FROM_M:.0f} m at most")  # fmt: skip
        require(max(times) <= DRIFT_GOAL_S, f"drift of {rate} m/s within {DRIFT_GOAL_S:.0f} s of {DRIFT_FROM_M:.0f} m")
    for jump_m in (500.0, 1000.0, 3000.0):
        times = [_displaced(seed, 0.0, 90.0, jump_m)[1] for seed in range(runs)]
        print(f"jump {jump_m:5.0f} m: suspect after {np.median(times):.0f} s (median), {max(times):.0f} s at most")
        require(max(times) <= DRIFT_GOAL_S, f"jump of {jump_m} m within {DRIFT_GOAL_S:.0f} s")


def _displaced(seed: int, rate_mps: float, seconds: float, jump_m: float = 0.0) -> tuple[Run, float]:
    """From 300 s on aircraft ``VICTIM`` reports itself beside where it is; seconds until suspect."""
    angle = np.random.default_rng(seed + 77).uniform(0.0, 2.0 * np.pi)
    direction = np.array([np.sin(angle), np.cos(angle)])

    def displaced(aircraft: Ints, s: float) -> Array:
        size = jump_m + rate_mps * (s - 300.0) if s >= 300.0 else 0.0
        return np.where((aircraft == VICTIM)[:, None], size * direction, 0.0)

    run = play(World(seed=seed, displaced=displaced), 300.0 + seconds)
    return run, run.first_suspect(VICTIM) - 300.0


def common_errors() -> None:
    """A radar that turned its north, and satellite navigation that is disturbed for most."""
    for shift_deg in (0.1, 0.2, 0.5):
        run = play(World(seed=1, radar_shift_deg=lambda k, s, d=shift_deg: d if k == 0 and s > 300.0 else 0.0), 420.0)
        alarm_s = min((s for s, a in run.alarms if "radar1" in a), default=np.inf) - 300.0
        print(f"radar 1 turned by {shift_deg} deg: {bystanders(run, ())} aircraft suspect, alarm after {alarm_s:.0f} s")
        require(bystanders(run, ()) == 0, f"radar turned by {shift_deg}: no aircraft suspect")

    def spoofed(aircraft: Ints, s: float) -> Array:
        return np.where((aircraft < 16)[:, None] & (s > 300.0), np.array([800.0, 500.0]), 0.0)

    run = play(World(seed=1, displaced=spoofed), 420.0)
    region_s = min((s for s, a in run.alarms if "satellite" in a), default=np.inf) - 300.0
    print(f"satellite navigation of 16 of 24 aircraft off by 940 m: alarm for the region after {region_s:.0f} s")
    require(region_s <= DRIFT_GOAL_S, "regional alarm")


def false_alarms(hours: float) -> None:
    """Honest traffic only."""
    flown, alarms, seed = 0.0, 0, 100
    while flown < hours:
        run = play(World(seed=seed, aircraft=100), 3600.0)
        flown, alarms, seed = flown + 100.0, alarms + bystanders(run, ()), seed + 1
    print(f"honest traffic: {alarms} false alarms in {flown:.0f} flight hours")
    require(1000.0 * alarms / flown <= FALSE_PER_1000_HOURS, "false alarms")


def main() -> int:
    """Print everything; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--hours", type=float, default=300.0, help="flight hours of honest traffic")
    arguments = parser.parse_args()
    ghosts(arguments.runs)
    wrong_positions(arguments.runs)
    common_errors()
    false_alarms(arguments.hours)
    return verdict()


if __name__ == "__main__":
    sys.exit(main())
