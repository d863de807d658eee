"""Scenes of the accuracy benchmark: which flights, which sensors, what goes wrong, and the engine that fuses them.

A scene is one run of the engine over several families of flights at once, so that one run serves many figures. The
families are those of the numerical study in docs/algorithm.md, and so are the distances to the radars, with which the
errors of plots grow; every flight of a scene has an address of its own, and which family it belongs to is
remembered.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from aeroskein.engine import FusionEngine
from aeroskein.evaluation import Truth, TruthCurve
from aeroskein.events import Rejections
from aeroskein.plots import Array, Ints, Plots
from aeroskein.points import FusedPoints, Product
from aeroskein.reasons import Reason
from aeroskein.settings import EngineSettings, FusionSettings, RegistrationSettings, SensorSettings
from aeroskein.simulation import SensorErrors, SimulationSettings, simulate
from aeroskein.simulation.settings import Scenario
from aeroskein.simulation.truth import Phase, TruthStates

__all__ = ["FAMILIES", "SENSORS", "Fused", "Report", "Scene", "Sky", "fuse", "simulated"]

FAMILIES: Final[tuple[Scenario, ...]] = ("cruise", "enroute", "terminal", "hold")

SENSORS: Final = (
    SensorSettings(id="adsb", kind="adsb"),
    SensorSettings(id="radar1", kind="ssr", lat_deg=48.35, lon_deg=11.78, height_m=460.0, period_s=4.0),
    SensorSettings(
        id="radar2", kind="ssr", lat_deg=48.10, lon_deg=12.60, height_m=500.0, period_s=8.0, range_sigma_m=100.0,
        azimuth_sigma_deg=0.15,
    ),
)  # fmt: skip

# Where families fly that do not fly between the radars: some 95 km (root mean square) from radar 1 its raw plots are
# as good as in the study, 120 to 130 m. Between the radars they have the study's 70 m of the terminal area.
PLACE_DEG: Final[dict[Scenario, tuple[float, float]]] = {"cruise": (49.05, 12.19), "enroute": (49.05, 12.19)}

# Reports are taken in and elements close on this grid: the service's is finer, which moves no element. [s]
TICK_S: Final = 0.5
# First address of a scene's flights, and how many addresses each family and seed has to itself.
FIRST_ADDRESS: Final = 0x400000
ADDRESSES: Final = 0x1000

Change = Callable[[Plots, Ints], Plots]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One run: flights, sensors, what goes wrong with them, and how the engine is set.

    Attributes
    ----------
    name : str
        What figures ask for it by.
    families : tuple of str
        Scenarios of the simulator.
    flights : int
        Flights of each family and seed.
    seeds : tuple of int
        Each gives other flights and other noise.
    duration_s : float
        [s]
    errors : tuple of SensorErrors
        What the engine is not told.
    sensors : tuple of SensorSettings
        What the engine is told.
    fusion : dict
        Settings of the section ``fusion`` that are not the default.
    registered : bool
        Whether the engine estimates the radars' biases; otherwise there are none, and it knows.
    place_deg : (float, float), optional
        Middle of the area of all flights, where it is not that of their family. [deg]
    change : callable, optional
        Changes the reports ``(plots, flight of each)`` in a way the simulator has no setting for.
    from_s : float
        Flights are judged from this long after their first report. [s]
    raw : bool
        Whether raw reports without gross errors are wanted beside the result.
    height_offset_m : float, optional
        Geometric height minus pressure altitude, everywhere; absent: as the simulator has it, 70 to 110 m. [m]
    """

    name: str
    families: tuple[Scenario, ...] = FAMILIES
    flights: int = 16
    seeds: tuple[int, ...] = (101,)
    duration_s: float = 400.0
    errors: tuple[SensorErrors, ...] = ()
    sensors: tuple[SensorSettings, ...] = SENSORS
    fusion: tuple[tuple[str, Any], ...] = ()
    registered: bool = False
    place_deg: tuple[float, float] | None = None
    change: Change | None = None
    from_s: float = 30.0
    raw: bool = False
    height_offset_m: float | None = None

    def engine_settings(self) -> EngineSettings:
        """What the engine is told."""
        return EngineSettings(
            sensors=self.sensors,
            fusion=FusionSettings(**dict(self.fusion)),
            registration=RegistrationSettings(enabled=self.registered),
        )

    def simulations(self) -> list[SimulationSettings]:
        """One simulation per family and seed."""
        height = {} if self.height_offset_m is None else {
            "geometric_minus_pressure_m": self.height_offset_m, "geometric_minus_pressure_variation_m": 0.0,
        }  # fmt: skip
        return [
            SimulationSettings(
                scenario=family, aircraft=self.flights, seed=seed, duration_s=self.duration_s, errors=self.errors,
                lat_deg=place[0], lon_deg=place[1], **height,
            )
            for family in self.families
            for place in (self.place_deg or PLACE_DEG.get(family, (None, None)),)
            for seed in self.seeds
        ]  # fmt: skip


@dataclass(slots=True, eq=False)
class Report:
    """What became of the reports of a scene: how many there were, and how many of each sensor for each reason."""

    count: int
    by_reason: Array

    def share(self, reason: Reason) -> float:
        """Share of all reports that were refused for a reason."""
        return float(self.by_reason[:, int(reason)].sum()) / max(self.count, 1)


@dataclass(slots=True, eq=False)
class Sky:
    """What really happened in a scene, and what the sensors said of it.

    Attributes
    ----------
    plots : Plots
        All reports in order of arrival.
    clean : Plots
        The same reports without gross position errors, for comparison with raw data.
    curve : TruthCurve
        Truth of all flights.
    family : (flights,) int64
        Index into the scene's families.
    offset_m : (flights,) float64
        Geometric height minus pressure altitude, which a radar's reference needs. [m]
    """

    plots: Plots
    clean: Plots
    curve: TruthCurve
    family: Ints
    offset_m: Array


@dataclass(slots=True, eq=False)
class Fused:
    """What the engine published of a scene, with the time of publication of each point."""

    element: FusedPoints
    live: FusedPoints
    element_published_s: Array
    live_published_s: Array
    report: Report


def simulated(scene: Scene) -> Sky:
    """Fly a scene."""
    parts, clean, truths, family = list[Plots](), list[Plots](), list[TruthStates](), list[int]()
    for number, settings in enumerate(scene.simulations()):
        plots, truth = _fly(settings, scene.sensors, number)
        parts.append(plots)
        clean.append(_fly(_without_outliers(settings), scene.sensors, number)[0] if scene.raw else plots)
        truths.append(truth)
        family += [number // len(scene.seeds)] * len(np.unique(truth.address))
    truth = TruthStates.concatenate(truths)
    addresses, flight = np.unique(truth.address, return_inverse=True)
    count = np.bincount(flight)
    offset_m = np.bincount(flight, weights=truth.height_m - truth.altitude_m) / count
    curve = TruthCurve(_truth(truth, addresses, flight))
    made = []
    for plots in (Plots.concatenate(parts), Plots.concatenate(clean)):
        if scene.change is not None:
            plots = scene.change(plots, np.searchsorted(addresses, plots.address))
        made.append(plots.take(np.argsort(plots.received_s, kind="stable")))
    return Sky(made[0], made[1], curve, np.array(family, dtype=np.int64), offset_m)


def _without_outliers(settings: SimulationSettings) -> SimulationSettings:
    """The same scenario to the last random number, but for the gross errors."""
    named = {e.sensor: e for e in settings.errors}
    adsb = named.pop("adsb", SensorErrors(sensor="adsb"))
    return replace(settings, errors=(replace(adsb, outlier_probability=0.0), *named.values()))


def _fly(settings: SimulationSettings, sensors: tuple[SensorSettings, ...], number: int) -> tuple[Plots, TruthStates]:
    """Reports and truth of one simulation, its flights moved to addresses of their own."""
    parts, truths = list[Plots](), list[TruthStates]()
    for chunk in simulate(settings, sensors, chunk_s=60.0, truth=True):
        parts.append(chunk.plots)
        if chunk.truth is not None:
            truths.append(chunk.truth)
    plots, truth = Plots.concatenate(parts), TruthStates.concatenate(truths)
    known = np.unique(truth.address)
    first = FIRST_ADDRESS + number * ADDRESSES
    plots.address = (first + np.searchsorted(known, plots.address)).astype(np.int32)
    truth.address = (first + np.searchsorted(known, truth.address)).astype(np.int32)
    return plots, truth


def _truth(truth: TruthStates, addresses: Array, flight: Ints) -> Truth:
    return Truth.of(
        [f"{int(a):06X}" for a in addresses],
        len(truth),
        phases=[p.wire_name for p in Phase],
        flight=flight,
        phase=truth.phase,
        **{
            name: getattr(truth, name)
            for name in (
                "time_s", "lat_deg", "lon_deg", "height_m", "altitude_m", "ground_speed_mps", "track_angle_deg",
                "vertical_rate_mps",
            )
        },
    )  # fmt: skip


def fuse(scene: Scene, plots: Plots) -> Fused:
    """Run the engine over reports in order of arrival, as the command ``fuse`` does."""
    engine = FusionEngine(scene.engine_settings(), epoch_ms=0)
    found: dict[Product, list[tuple[float, FusedPoints]]] = {p: [] for p in Product}
    counts = np.zeros((len(scene.sensors), max(Reason) + 1))

    def note(events: list[Any], now_s: float) -> None:
        for event in events:
            if isinstance(event, FusedPoints):
                found[event.product].append((now_s, event))
            elif isinstance(event, Rejections):
                counts[:, : event.counts.shape[1]] += event.counts

    ticks = np.floor(plots.received_s / TICK_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(ticks, prepend=ticks[0] - 1))
    now_s = float(plots.received_s[0])
    for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(ticks)], strict=True):
        now_s = max(now_s, float(plots.received_s[end - 1]))
        note(engine.receive(plots.take(np.arange(start, end)), now_s=now_s), now_s)
        now_s = math.ceil(now_s / TICK_S) * TICK_S
        note(engine.advance(now_s=now_s), now_s)
    note(engine.finish(now_s=now_s), now_s)
    element, live = (_joined(found[p]) for p in (Product.ELEMENT, Product.LIVE))
    return Fused(element[0], live[0], element[1], live[1], Report(len(plots), counts))


def _joined(parts: list[tuple[float, FusedPoints]]) -> tuple[FusedPoints, Array]:
    published_s = np.concatenate([np.full(len(points), now_s) for now_s, points in parts])
    return FusedPoints.concatenate([points for _, points in parts]), published_s
