"""Runs of the whole engine on simulated reports, for benchmarks that judge what a user would see.

Sensor errors are those of the numerical study in docs/algorithm.md: ADS-B once a second with 10 m and a stamp jitter of
0.2 s, log-normal delay, 3 % lost, 0.2 % wild; radar 1 every 4 s with 50 m and 0.07 degrees, radar 2 every 8 s with
100 m and 0.15 degrees, 3 % missed, up to 6 s late. Reports reach the engine in order of arrival, as in ``fuse``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from aeroskein.engine import FusionEngine
from aeroskein.evaluation import EvaluationSettings, PointColumns, ProductEvaluation, Truth, evaluate
from aeroskein.plots import Array, Plots
from aeroskein.points import FusedPoints, Product
from aeroskein.settings import EngineSettings, SensorSettings
from aeroskein.simulation import SensorErrors, SimulationSettings, simulate, truth_by_track
from aeroskein.simulation.truth import Phase, TruthStates

__all__ = [
    "BIASES", "RADARS", "SENSORS", "Change", "Step", "bias_errors", "fly", "judged", "signed_biases", "true_flights",
]  # fmt: skip

RADARS: Final = (
    SensorSettings(id="radar1", kind="ssr", lat_deg=48.35, lon_deg=11.78, height_m=460.0, period_s=4.0),
    SensorSettings(
        id="radar2", kind="ssr", lat_deg=48.75, lon_deg=10.2, height_m=520.0, period_s=8.0, range_sigma_m=100.0,
        azimuth_sigma_deg=0.15,
    ),
)  # fmt: skip
SENSORS: Final = (SensorSettings(id="adsb", kind="adsb"), *RADARS)
# Sizes of the radars' true biases: range m, azimuth deg, time s.
BIASES: Final = np.array([[80.0, 0.15, 0.3], [60.0, 0.18, 0.4]])
# Elements close at the end of every step, as on the service's tick. [s]
STEP_S: Final = 1.0
# A flight lasts at least this long, so that none ends within a run. [s]
FLIGHT_S: Final = 1800.0

_TRUTH: Final = (
    "time_s", "lat_deg", "lon_deg", "height_m", "altitude_m", "ground_speed_mps", "track_angle_deg",
    "vertical_rate_mps",
)  # fmt: skip

Change = Callable[[Plots, float], Plots]


@dataclass(slots=True)
class Step:
    """What happened in one second: seconds since the start, the engine, the reports it got and what came out."""

    seconds: float
    engine: FusionEngine
    plots: Plots
    events: list[Any]


def signed_biases(seed: int) -> Array:
    """The biases of both radars ``(2, 3)``, range and azimuth with random signs."""
    sign = np.random.default_rng(1000 + seed).choice([-1.0, 1.0], size=(2, 2))
    biases: Array = BIASES * np.c_[sign, [1.0, 1.0]]
    return biases


def bias_errors(biases: Array) -> tuple[SensorErrors, ...]:
    """The same for the simulator."""
    return tuple(
        SensorErrors(sensor=radar.id, range_bias_m=r, azimuth_bias_deg=a, time_bias_s=t)
        for radar, (r, a, t) in zip(RADARS, biases.tolist(), strict=True)
    )


def fly(
    simulations: Sequence[SimulationSettings],
    settings: EngineSettings,
    *,
    only: Sequence[Collection[str] | None] = (),
    change: Change | None = None,
) -> Iterator[Step]:
    """Fly scenarios together and give the engine what the sensors say.

    Parameters
    ----------
    simulations : sequence of SimulationSettings
        Scenarios of one length that happen at once; addresses of each but the first are moved out of the way.
    settings : EngineSettings
        What the engine is told.
    only : sequence, optional
        Per scenario the sensors that see it; absent or None: all of them.
    change : callable, optional
        Changes the reports of a step, given the seconds since the start.
    """
    engine = FusionEngine(settings, epoch_ms=0)
    seen = [*only, *[None] * (len(simulations) - len(only))]
    simulations = [replace(s, flight_s=max(FLIGHT_S, s.duration_s + 60.0)) for s in simulations]
    sources = [simulate(s, settings.sensors, chunk_s=STEP_S, only=o) for s, o in zip(simulations, seen, strict=True)]
    start_s = simulations[0].start_s
    for chunks in zip(*sources, strict=True):
        now_s = chunks[0].until_s
        parts = []
        for number, chunk in enumerate(chunks):
            plots = chunk.plots
            plots.address = np.where(plots.address >= 0, plots.address + 0x200000 * number, -1).astype(np.int32)
            parts.append(plots)
        plots = Plots.concatenate(parts)
        plots = plots.take(np.argsort(plots.received_s, kind="stable"))
        if change is not None:
            plots = change(plots, now_s - start_s)
        events = engine.receive(plots, now_s=float(plots.received_s[-1])) if len(plots) else []
        yield Step(now_s - start_s, engine, plots, [*events, *engine.advance(now_s=now_s)])


def true_flights(simulation: SimulationSettings, sensors: tuple[SensorSettings, ...]) -> Truth:
    """Where the aircraft of a scenario were."""
    simulation = replace(simulation, flight_s=max(FLIGHT_S, simulation.duration_s + 60.0), truth_period_s=1.0)
    states = TruthStates.concatenate(list(truth_by_track(simulation, sensors)))
    addresses, flight = np.unique(states.address, return_inverse=True)
    columns = {name: getattr(states, name) for name in _TRUTH}
    phases = [phase.wire_name for phase in Phase]
    names = [f"{int(a):06X}" for a in addresses]
    return Truth.of(names, len(states), phases=phases, flight=flight, phase=states.phase, **columns)


def judged(events: list[Any], truth: Truth, product: Product, from_s: float = 30.0) -> ProductEvaluation:
    """What ``aeroskein evaluate`` says of one product among the events of a run."""
    points = FusedPoints.concatenate([e for e in events if isinstance(e, FusedPoints) and e.product == product])
    return evaluate(PointColumns.from_fused(points), truth, settings=EvaluationSettings(from_s=from_s)).products[0]
