"""What an evaluation says: a tree of frozen values that turns into JSON with stable keys.

Field names are the keys of ``aeroskein evaluate --json``; they only grow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from aeroskein.evaluation.figures import (
    Accuracy,
    Continuity,
    FlightResult,
    Gospa,
    Identity,
    Interval,
    PhaseAccuracy,
    RequirementRow,
    Roughness,
    SensorEvaluation,
    SpanCover,
    Timing,
    Worst,
)
from aeroskein.evaluation.residuals import Residuals

__all__ = ["Evaluation", "EvaluationSettings", "ProductEvaluation", "as_dict"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluationSettings:
    """How to judge."""

    from_s: float = 30.0
    """Judge from this long after the first report of a flight. [s]"""
    max_truth_gap_s: float = 15.0
    """Longest hole in truth that is bridged. [s]"""
    gate_m: float = 2000.0
    """A track without a usable address belongs to the nearest flight within this distance. [m]"""
    cutoff_m: float = 1000.0
    """GOSPA cut-off c. [m]"""
    step_s: float = 5.0
    """Step of everything counted at instants: GOSPA, swaps, false tracks. [s]"""
    resamples: int = 400
    """Bootstrap resamples."""
    seed: int = 1
    """Seed of the bootstrap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProductEvaluation:
    """Everything about one product of one fused file."""

    product: str
    points: int
    judged: int
    accuracy: Accuracy
    rms_interval_m: Interval | None
    p95_interval_m: Interval | None
    coasted: Accuracy
    phases: tuple[PhaseAccuracy, ...]
    flights: tuple[FlightResult, ...]
    worst_rms_m: Worst | None
    worst_point_m: Worst | None
    roughness: Roughness
    timing: Timing
    continuity: tuple[Continuity, ...]
    span_cover: SpanCover | None
    gospa: Gospa
    identity: Identity
    requirements: tuple[RequirementRow, ...]
    ratio_to_sensor: dict[str, float]
    residuals: Residuals = field(repr=False, metadata={"json": False})


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """One fused file against truth."""

    name: str
    settings: EvaluationSettings
    flights: int
    flights_without_points: tuple[str, ...]
    phases: tuple[str, ...]
    products: tuple[ProductEvaluation, ...]
    sensors: tuple[SensorEvaluation, ...]


def as_dict(value: Any) -> Any:
    """Plain dictionaries, lists, numbers and strings, ready for JSON; what is not finite becomes None.

    Fields marked ``metadata={"json": False}`` (the columns behind the plots) are left out.
    """
    if is_dataclass(value) and not isinstance(value, type):
        shown = (f.name for f in fields(value) if f.metadata.get("json", True))
        return {name: as_dict(getattr(value, name)) for name in shown}
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, dict):
        return {str(key): as_dict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_dict(item) for item in value]
    if isinstance(value, np.generic):
        return as_dict(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
