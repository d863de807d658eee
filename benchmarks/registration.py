"""Registration against known biases: prints the tables of docs/registration.md and fails when a goal is missed.

    python -m benchmarks.registration [--runs N]

Every run has its own seed: traffic, noise, signs of the biases. Errors are RMS over runs; NEES is the squared error in
units of the claimed covariance per component (1 is honest, above 1 is too sure of itself).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable
from typing import Any

import numpy as np
from benchmarks.goals import require, verdict
from benchmarks.registration_scene import START_S, Scene, comparisons, engine_settings, two_radars

from aeroskein.plots import Array, Bools
from aeroskein.registration import Registration

# Seconds between calls, as a service that takes what is there would make them.
BATCH_S = 0.25
GOALS = {
    # name: limits of range m, azimuth deg, time s for radar 1 and radar 2
    "20 aircraft, 5 min": ((8.0, 0.005, 0.06), (12.0, 0.010, 0.08)),
    "5 aircraft, 15 min": ((10.0, 0.010, 0.08), (10.0, 0.010, 0.08)),
    "no ADS-B, 20 aircraft, 15 min": ((12.0, 0.008, 0.05), (12.0, 0.008, 0.05)),
}
DISPLACEMENT_GOAL_M = (10.0, 25.0)
NEES_GOAL = (0.5, 2.0)
JUMP_GOAL_S = 180.0


def play(scene: Scene, marks: Iterable[float], **settings: Any) -> tuple[Registration, list[tuple[Array, Array]]]:
    """Feed a scene; gives biases ``(2, 4)`` and covariances ``(2, 4, 4)`` at the marks."""
    registration = Registration(engine_settings(scene.radars, **settings))
    rows = comparisons(scene)
    seconds = rows.time_s - START_S
    edges = np.arange(0.0, scene.duration_s + BATCH_S, BATCH_S)
    cuts = np.searchsorted(seconds, edges)
    out, wanted = [], list(marks)
    for begin, end, edge in zip(cuts[:-1], cuts[1:], edges[1:], strict=True):
        registration.update(rows.take(slice(begin, end)))  # type: ignore[arg-type]
        registration.advance(now_s=START_S + float(edge))
        while wanted and edge >= wanted[0] - 1e-9:
            wanted.pop(0)
            out.append(registration.estimates())
    return registration, [(mean[1:], covariance[1:]) for mean, covariance in out]


def truth_of(scene: Scene, seconds: float) -> Array:
    """True biases ``(2, 4)``."""
    return np.concatenate([r.biases_at(np.array([seconds])) for r in scene.radars])


def study(name: str, aircraft: int, marks: tuple[float, ...], runs: int, relative: bool = False, **scene: Any) -> None:
    """One table: errors, claims, NEES at every mark."""
    errors = np.empty((runs, len(marks), 2, 4))
    claims = np.empty((runs, len(marks), 2, 3))
    nees = np.empty((runs, len(marks), 2))
    started = time.process_time()
    for run in range(runs):
        rng = np.random.default_rng(1000 + run)
        s = Scene(two_radars(rng), aircraft=aircraft, duration_s=max(marks), seed=run, **scene)
        _, states = play(s, marks)
        for k, (mean, covariance) in enumerate(states):
            errors[run, k] = mean - truth_of(s, marks[k])
            parts = 2 if relative else 3
            for radar in range(2):
                e, P = errors[run, k, radar, :parts], covariance[radar, :parts, :parts]
                nees[run, k, radar] = e @ np.linalg.solve(P, e) / parts
            claims[run, k] = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, :3])
    if relative:
        # Without an anchor the common time cannot be seen; what counts is the difference.
        errors[..., 2] = (errors[:, :, 0, 2] - errors[:, :, 1, 2])[:, :, None]
    rms = np.sqrt((errors[..., :3] ** 2).mean(axis=0))
    claimed = np.sqrt((claims**2).mean(axis=0))
    cost_s = (time.process_time() - started) / runs
    print(f"{name} ({runs} runs, {cost_s:.1f} s of CPU each)")
    for k, mark in enumerate(marks):
        for radar in range(2):
            r, c = rms[k, radar], claimed[k, radar]
            print(
                f"    {mark:5.0f} s radar {radar + 1}: {r[0]:6.2f} m {r[1]:.4f} deg {r[2]:.3f} s  claimed {c[0]:6.2f} m"
                f" {c[1]:.4f} deg {c[2]:.3f} s   NEES {nees[:, k, radar].mean():.2f}"
            )
    last = len(marks) - 1
    if name in GOALS:
        for radar, limits in enumerate(GOALS[name]):
            require(bool((rms[last, radar] <= limits).all()), f"{name}: radar {radar + 1} within {limits}")
        mean_nees = float(nees[:, last].mean())
        require(NEES_GOAL[0] <= mean_nees <= NEES_GOAL[1], f"{name}: NEES {mean_nees:.2f} within {NEES_GOAL}")


def displacement(method: str, runs: int, cartesian_gain: float | None = None, anchored: bool = True) -> Array:
    """RMS displacement of plots before and after registration, 20 aircraft, after 5 minutes: ``(2 radars, 2)``."""
    squares = np.zeros((2, 2))
    for run in range(runs):
        rng = np.random.default_rng(1000 + run)
        s = Scene(two_radars(rng), aircraft=20, duration_s=300.0, seed=run, anchored=anchored)
        if cartesian_gain is None:
            left = truth_of(s, 300.0) - play(s, [300.0], method=method)[1][0][0]
        rows = comparisons(s)
        late = rows.take(rows.time_s > START_S + 240.0)
        for radar in range(2):
            own = late.take(late.sensor == radar + 1)
            before = _displaced(own, truth_of(s, 300.0)[radar])
            if cartesian_gain is None:
                after = _displaced(own, left[radar])
            else:
                every = rows.take(rows.sensor == radar + 1)
                after = before + _cartesian(every, cartesian_gain)
            squares[radar] += [(before**2).sum(axis=1).mean(), (after**2).sum(axis=1).mean()]
    return np.sqrt(squares / runs)


def _displaced(rows: Any, bias: Array) -> Array:
    """Where a bias moves plots, east and north [m]."""
    rad = np.radians(rows.azimuth_deg)
    u = np.stack([np.sin(rad), np.cos(rad)], axis=-1)
    n = np.stack([np.cos(rad), -np.sin(rad)], axis=-1)
    velocity = np.stack([rows.v_east_mps, rows.v_north_mps], axis=-1)
    return bias[0] * u + (np.radians(bias[1]) * rows.range_m)[:, None] * n - bias[2] * velocity


def _cartesian(rows: Any, gain: float) -> Array:
    """The published loop read literally: one Cartesian error vector per radar, fed back with a gain; its last value."""
    from aeroskein.registration.comparisons import geometry_of

    settings = engine_settings(Scene(two_radars(np.random.default_rng(0))).radars)
    geometry = geometry_of(rows, Registration(settings).sites)
    rad = np.radians(rows.azimuth_deg)
    u = np.stack([np.sin(rad), np.cos(rad)], axis=-1)
    n = np.stack([np.cos(rad), -np.sin(rad)], axis=-1)
    error = -(geometry.range_error_m[:, None] * u + geometry.across_error_m[:, None] * n)
    weight = gain * (1.0 - gain) ** np.arange(len(error) - 1, -1, -1)
    return weight @ error


def jumps(runs: int) -> None:
    """A maintenance visit at five minutes: when is it found, and what is left three minutes later."""
    print("a jump of 100 m and 0.2 degrees after 5 minutes, 20 aircraft")
    for anchored in (True, False):
        found, left = [], []
        for run in range(runs):
            radars = two_radars(np.random.default_rng(50 + run))
            which = run % 2
            radars[which].jump_s, radars[which].jump = 300.0, (100.0, 0.2, 0.0)
            s = Scene(radars, aircraft=20, duration_s=480.0, seed=run, anchored=anchored)
            marks = list(np.arange(300.0, 481.0, 5.0))
            registration, states = play(s, marks)
            sure = [_recovered(mean, truth_of(s, 400.0))[which] for mean, _ in states[1:]]
            found.append(5.0 * (1 + sure.index(True)) if True in sure else np.inf)
            left.append(states[-1][0][which, :2] - truth_of(s, 400.0)[which, :2])
            require(registration.jumps()[1 + which] == 1, f"exactly one jump found (anchored={anchored}, run {run})")
            require(
                registration.jumps()[2 - which] == 0, f"no jump of the other radar (anchored={anchored}, run {run})"
            )
        rms = np.sqrt((np.array(left) ** 2).mean(axis=0))
        print(
            f"    {'ADS-B' if anchored else 'radars only'}: within 30 m and 0.05 deg again after {max(found):.0f} s"
            f" at most, after 180 s {rms[0]:.1f} m {rms[1]:.4f} deg left"
        )
        require(max(found) <= JUMP_GOAL_S, f"jump found and taken out within {JUMP_GOAL_S} s (anchored={anchored})")


def _recovered(mean: Array, truth: Array) -> Bools:
    error = np.abs(mean - truth)
    return np.asarray((error[:, 0] < 30.0) & (error[:, 1] < 0.05))


def main() -> int:
    """Print everything; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=12)
    runs = parser.parse_args().runs
    study("20 aircraft, 5 min", 20, (60.0, 300.0), runs)
    study("5 aircraft, 15 min", 5, (300.0, 900.0), runs)
    study("no ADS-B, 20 aircraft, 15 min", 20, (300.0, 900.0), runs, relative=True, anchored=False)
    study("20 aircraft, 3 % wild plots", 20, (300.0,), runs, outliers=0.03)
    spoof = {"spoofed": np.array([3, 4, 5, 6, 7]), "spoof_m": (500.0, 300.0)}
    study("20 aircraft, 5 of them spoofed by 580 m", 20, (300.0,), runs, **spoof)
    jumps(max(runs // 3, 2))
    print("displacement of plots, 20 aircraft, 5 min: radar 1 before -> after, radar 2 before -> after [m]")
    for name, arguments in (
        ("kalman", ("kalman", runs)),
        ("feedback, polar, gain 0.02", ("feedback", runs)),
        ("feedback, Cartesian as published, gain 0.02", ("feedback", runs, 0.02)),
        ("feedback, Cartesian as published, gain 1", ("feedback", runs, 1.0)),
    ):
        d = displacement(*arguments)  # type: ignore[arg-type]
        print(f"    {name:44s} {d[0, 0]:4.0f} -> {d[0, 1]:4.0f}   {d[1, 0]:4.0f} -> {d[1, 1]:4.0f}")
        if name == "kalman":
            for radar in range(2):
                require(bool(d[radar, 1] <= DISPLACEMENT_GOAL_M[radar]), f"displacement left, radar {radar + 1}")
    return verdict()


if __name__ == "__main__":
    sys.exit(main())
