"""What an evaluation says: a tree of frozen values that turns into JSON with stable keys.

None means "not measurable here". Field names are the keys of ``aeroskein evaluate --json``; they only grow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from aeroskein.evaluation.residuals import Residuals

__all__ = [
    "Accuracy",
    "Consistency",
    "Evaluation",
    "EvaluationSettings",
    "FlightResult",
    "Interval",
    "PhaseAccuracy",
    "ProductEvaluation",
    "SignedSpread",
    "Spread",
    "Worst",
    "as_dict",
]


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
class Interval:
    """A 95 % confidence interval."""

    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Sizes of errors, in the unit of the quantity."""

    count: int = 0
    rms: float | None = None
    p50: float | None = None
    p95: float | None = None
    p99: float | None = None
    max: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SignedSpread:
    """Errors with a sign; ``p95`` and ``max`` are of the absolute value."""

    count: int = 0
    mean: float | None = None
    rms: float | None = None
    p95: float | None = None
    max: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """Whether the stated covariance is honest: mean NEES (ideal 2) and share inside the 95 % ellipse."""

    count: int = 0
    mean_nees: float | None = None
    coverage_95: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Errors of a set of points. [m, m/s, deg]"""

    horizontal_m: Spread
    along_m: SignedSpread
    across_m: SignedSpread
    height_m: SignedSpread
    altitude_m: SignedSpread
    velocity_mps: Spread
    ground_speed_mps: SignedSpread
    track_angle_deg: SignedSpread
    vertical_rate_mps: SignedSpread
    position_consistency: Consistency
    velocity_consistency: Consistency


@dataclass(frozen=True, slots=True, kw_only=True)
class PhaseAccuracy:
    """Errors in one phase of flight."""

    phase: str
    accuracy: Accuracy


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
    """The largest of something: which flight, how much, when."""

    flight: str
    value: float
    time_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightResult:
    """One flight."""

    flight: str
    points: int
    horizontal_m: Spread
    max_time_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ProductEvaluation:
    """Everything about one product of one fused file."""

    product: str
    points: int
    judged: int
    accuracy: Accuracy
    rms_interval_m: Interval | None
    p95_interval_m: Interval | None
    phases: tuple[PhaseAccuracy, ...]
    flights: tuple[FlightResult, ...]
    worst_rms_m: Worst | None
    worst_point_m: Worst | None
    residuals: Residuals = field(repr=False, metadata={"json": False})


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """One fused file against truth."""

    name: str
    settings: EvaluationSettings
    flights: int
    flights_without_points: tuple[str, ...]
    products: tuple[ProductEvaluation, ...]


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
