"""Outcomes: one scene flown, fused, estimated by the references and judged, small enough to pass between processes.

A figure is one number with its goals: ``must`` decides the exit status, ``aim`` is what we would like.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from benchmarks.accuracy_libraries import LIBRARIES
from benchmarks.accuracy_measures import Errors, Judge, coverage, in_spans, mean_nees, ratio, ratio_interval, rms
from benchmarks.accuracy_references import References
from benchmarks.accuracy_scenes import Fused, Report, Scene, Sky, fuse, simulated

from aeroskein.evaluation import PointColumns
from aeroskein.plots import Bools
from aeroskein.points import Status
from aeroskein.settings import SensorSettings

__all__ = ["Figure", "Outcome", "Want", "outcome_of"]

Range = tuple[float, float]
ANY: Final[Range] = (-np.inf, np.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Want:
    """Which comparisons a scene is flown for.

    Attributes
    ----------
    lag_s : float or None
        Lag of the smoother to compare with; None: no smoother.
    sensors : tuple of SensorSettings, optional
        What the references are told of the sensors; absent: what the engine is told.
    zero_lag : bool
        Whether the zero-lag filters are wanted.
    circle : bool
        Whether the published circle is wanted.
    libraries : bool
        Whether the estimators of other libraries are wanted.
    bias : tuple of (sensor, range m, azimuth deg, time s)
        True biases, which the references know.
    """

    lag_s: float | None = None
    sensors: tuple[SensorSettings, ...] | None = None
    zero_lag: bool = False
    circle: bool = False
    libraries: bool = False
    bias: tuple[tuple[str, float, float, float], ...] = ()


@dataclass(slots=True, eq=False)
class Outcome:
    """Errors of everything that a scene was flown for, by name.

    ``errors`` has ``element``, ``live``, the raw sensors by id, and where wanted ``smoother``, ``imm``, ``imm-ukf`` and
    ``live at reports`` (the same instants), ``circle`` and the other libraries' estimators; ``start_s`` is the first
    report of the scene.
    """

    scene: Scene
    errors: dict[str, Errors]
    start_s: float
    report: Report
    extras: dict[str, float] = field(default_factory=dict)

    def family(self, name: str) -> int:
        """Index of a family."""
        return self.scene.families.index(name)  # type: ignore[arg-type]

    def keep(self, what: str, spans: tuple[Range, ...]) -> Bools | None:
        """Which errors lie in the given spans of seconds since the start; None keeps all."""
        return in_spans(self.errors[what].residuals, self.start_s, spans) if spans else None

    def rms(
        self, what: str, family: str | None = None, spans: tuple[Range, ...] = (), of: str = "horizontal_m"
    ) -> float:
        """RMS of an error, of one family or of all."""
        number = None if family is None else self.family(family)
        return rms(getattr(self.errors[what].of(number, self.keep(what, spans)), of))

    def largest(self, what: str, family: str | None = None) -> float:
        """The largest horizontal error. [m]"""
        number = None if family is None else self.family(family)
        return float(self.errors[what].of(number).horizontal_m.max(initial=0.0))

    def ratio(
        self, ours: str, theirs: str, family: str | None = None, spans: tuple[Range, ...] = ()
    ) -> tuple[float, Range]:
        """RMS over RMS with its 95 % interval over flights."""
        number = None if family is None else self.family(family)
        a, b = (self.errors[w].of(number, self.keep(w, spans)) for w in (ours, theirs))
        return ratio(a, b), ratio_interval(a, b)

    def nees(self, what: str, family: str | None = None, spans: tuple[Range, ...] = ()) -> float:
        """Mean NEES; 2 is honest."""
        number = None if family is None else self.family(family)
        return mean_nees(self.errors[what].of(number, self.keep(what, spans)))

    def coverage(self, what: str, family: str | None = None, spans: tuple[Range, ...] = ()) -> float:
        """Share inside the 95 % ellipse."""
        number = None if family is None else self.family(family)
        return coverage(self.errors[what].of(number, self.keep(what, spans)))

    def spikes(self, what: str) -> float:
        """Spikes of all families."""
        return float(self.errors[what].spikes.sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One number of the table.

    Attributes
    ----------
    row, cell : str
        What it says, and of which flights.
    value : float
        The figure.
    must, aim : (float, float), optional
        Interval it must lie in, and the one we would like; absent: shown for information.
    interval : (float, float)
        95 % interval over flights, NaN where there is none.
    unit : str
        Unit of the value, empty for ratios.
    """

    row: str
    cell: str
    value: float
    must: Range | None = None
    aim: Range | None = None
    interval: Range = (float("nan"), float("nan"))
    unit: str = ""

    def passes(self, goal: Range | None) -> bool:
        """Whether the value lies in a goal; no goal is met by anything."""
        return goal is None or goal[0] <= self.value <= goal[1]

    @property
    def verdict(self) -> str:
        """``missed``, ``met``, ``aim`` (met and better), or nothing for information."""
        if self.must is None:
            return ""
        if not self.passes(self.must):
            return "MISSED"
        return "aim" if self.passes(self.aim) else "met"


def outcome_of(
    scene: Scene, want: Want, extra: Callable[[Scene, Sky, Fused, Judge], dict[str, float]] | None
) -> Outcome:
    """Fly a scene, fuse it, run the references, and judge all of it."""
    sky = simulated(scene)
    fused = fuse(scene, sky.plots)
    judge = Judge(scene, sky)
    columns = {
        "element": PointColumns.from_fused(fused.element, fused.element_published_s, 0),
        "live": PointColumns.from_fused(fused.live, fused.live_published_s, 0),
    }
    if want.lag_s is not None or want.zero_lag or want.circle:
        bias = {name: (r, a, t) for name, r, a, t in want.bias}
        told = scene if want.sensors is None else replace(scene, sensors=want.sensors)
        references = References(told, sky, bias=bias)
        if want.lag_s is not None:
            columns["smoother"] = references.smoother(fused.element, want.lag_s)
        if want.zero_lag:
            columns["imm"] = references.zero_lag(fused.live, "imm")
            columns["imm-ukf"] = references.zero_lag(fused.live, "imm-ukf")
            # Predictions of silent tracks have no counterpart there.
            columns["live at reports"] = columns["live"].take(fused.live.status != Status.COASTING)
        if want.circle:
            columns["circle"] = References(scene, sky, clean=True).circle(fused.element)
        if want.libraries:
            columns |= {name: references.library(name) for name in LIBRARIES}
    errors = {name: judge.errors(points) for name, points in columns.items()}
    for sensor in scene.sensors:
        errors[sensor.id] = judge.raw(sky.clean, sensor.id)
    extras = extra(scene, sky, fused, judge) if extra is not None else {}
    return Outcome(scene, errors, judge.start_s, fused.report, extras)
