"""Simulated scenes for the tests of the whole engine, each flown and fused once for all tests that look at it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray
from tests.builders import ADSB, RADAR1, RADAR2, START_S, Drive, distance_m, engine_settings

from aeroskein.plots import Plots
from aeroskein.points import FusedPoints
from aeroskein.simulation import SensorErrors, SimulationSettings, TruthStates, simulate
from aeroskein.simulation.settings import Scenario

SENSORS = (ADSB, RADAR1, RADAR2)


@cache
def scene(
    scenario: Scenario = "mixed",
    aircraft: int = 8,
    duration_s: float = 45.0,
    seed: int = 5,
    errors: tuple[SensorErrors, ...] = (),
    lat_deg: float | None = None,
    lon_deg: float | None = None,
) -> tuple[Plots, TruthStates]:
    """Reports in order of arrival, and the truth by track."""
    made = SimulationSettings(
        scenario=scenario, aircraft=aircraft, duration_s=duration_s, seed=seed, start_s=START_S, errors=errors,
        lat_deg=lat_deg, lon_deg=lon_deg,
    )  # fmt: skip
    chunks = list(simulate(made, SENSORS, chunk_s=20.0, truth=True))
    truths = [chunk.truth for chunk in chunks if chunk.truth is not None]
    return Plots.concatenate([chunk.plots for chunk in chunks]), TruthStates.concatenate(truths).by_track()


@cache
def fused(mode: str = "information", capacity: int = 64) -> Drive:
    """The mixed scene, fused to its end; every report's fate is told."""
    drive = Drive.of(engine_settings(*SENSORS, mode=mode, capacity=capacity))
    drive.engine.want_dispositions = True
    return drive.feed(scene()[0]).finish()


def fuse(plots: Plots, **fusion: float) -> Drive:
    """Reports in order of arrival, fused to their end."""
    return Drive.of(engine_settings(*SENSORS, **fusion)).feed(plots).finish()


def errors_m(points: FusedPoints, truth: TruthStates, *, skip_s: float = 15.0) -> NDArray[np.float64]:
    """Horizontal errors of points against the truth, from so long after the beginning of each flight on."""
    found = []
    for address in np.unique(points.address[points.address >= 0]):
        mine, at = points.address == address, truth.address == address
        time = truth.time_s[at]
        p = points.take(np.flatnonzero(mine))
        p = p.take(np.flatnonzero((p.time_s > time[0] + skip_s) & (p.time_s < time[-1])))
        lat, lon = (np.interp(p.time_s, time, column[at]) for column in (truth.lat_deg, truth.lon_deg))
        found.append(distance_m(p.lat_deg, p.lon_deg, lat, lon))
    return np.concatenate(found)


def rms(values: Iterable[float]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values)))))


def moved_m(one: FusedPoints, other: FusedPoints) -> NDArray[np.float64]:
    """How far the same elements of two runs lie apart, wherever both were published."""
    keys = [{(int(a), float(s)): row for row, (a, s) in enumerate(zip(p.address, p.span_s[:, 0], strict=True))}
            for p in (one, other)]  # fmt: skip
    both = sorted(keys[0].keys() & keys[1].keys())
    assert len(both) >= 0.98 * max(len(one), len(other))
    a, b = (p.take(np.array([k[key] for key in both])) for p, k in zip((one, other), keys, strict=True))
    return distance_m(a.lat_deg, a.lon_deg, b.lat_deg, b.lon_deg)
