"""The single figures of an evaluation: small frozen values, each one table cell or one line of a report.

None means "not measurable here". Field names are keys of ``aeroskein evaluate --json``; they only grow.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from aeroskein.plots import Array

__all__ = [
    "Accuracy",
    "Consistency",
    "Continuity",
    "Delay",
    "FlightResult",
    "Gap",
    "Gospa",
    "Identity",
    "Interval",
    "PhaseAccuracy",
    "RequirementRow",
    "Roughness",
    "SensorEvaluation",
    "SignedSpread",
    "SpanCover",
    "Spread",
    "Timing",
    "Verdict",
    "Worst",
]


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
    position_latency_s: SignedSpread
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
class Roughness:
    """What a display would show: needles and jumps."""

    points: int
    spikes: int
    spikes_per_10000: float | None
    steps: int
    step_p99_m: float | None
    step_max_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """Times. [s]"""

    count: int = 0
    p50_s: float | None = None
    p95_s: float | None = None
    p99_s: float | None = None
    max_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Age when published (``published_s - time_s``), processing (``published_s - input_received_s``), time between
    points of a track; times and numbers that repeat, go back or are left out."""

    age: Delay
    processing: Delay
    interval: Delay
    times_repeated: int
    times_backwards: int
    seq_missing: int | None
    seq_repeated: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """A time without update."""

    flight: str
    start_s: float
    length_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Continuity:
    """Updates per interval over the judged time of all flights."""

    interval_s: float
    expected: int
    updated: int
    update_probability: float | None
    lowest_flight: Worst | None
    flights_below_97_percent: int
    long_gap_limit_s: float
    long_gaps: int
    long_gap_ratio: float | None
    longest_gap: Gap | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SpanCover:
    """Spans of elements: between those of one track, and over the judged time of all flights. [s]"""

    elements: int
    hole_s: float
    overlap_s: float
    judged_s: float
    outside_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gospa:
    """GOSPA (alpha 2, p 2), means over all steps; the parts are roots of their own squares. [m]"""

    cutoff_m: float
    steps: int = 0
    mean_m: float | None = None
    localisation_m: float | None = None
    missed_m: float | None = None
    false_m: float | None = None
    aircraft_per_step: float | None = None
    missed_per_step: float | None = None
    false_per_step: float | None = None
    pair_rms_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Tracks and aircraft."""

    tracks: int
    flights_judged: int
    flights_tracked: int
    tracks_per_flight: float | None
    flights_with_one_track: float | None
    track_changes: int
    swaps: int
    extra_track_ratio: float | None
    false_tracks: int
    false_tracks_flagged: int
    false_track_s: float
    beyond_truth_s: float
    initiation: Delay
    address_correct: float | None
    callsign_correct: float | None


class Verdict(Enum):
    """What a requirement row comes to, as this program reads it."""

    MET = 0
    NOT_MET = 1
    NOT_MEASURABLE = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class RequirementRow:
    """One row of a published requirement table, as this program reads it; no statement of conformity."""

    standard: str
    row: str
    column: str
    item: str
    level: str
    sense: str
    limit: float | None
    unit: str
    limit_is_sure: bool
    measured: float | None
    verdict: Verdict
    note: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorEvaluation:
    """Raw reports of one sensor against truth."""

    sensor: str
    reports: int
    judged: int
    not_judged_because: str
    horizontal_m: Spread
    along_m: SignedSpread
    across_m: SignedSpread
    range_m: SignedSpread
    azimuth_deg: SignedSpread
    spikes: int
    sizes_m: Array = field(repr=False, metadata={"json": False})
