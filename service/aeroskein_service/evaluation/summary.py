"""The evaluation as tables, before anybody draws them: the terminal and the page show the same rows.

One column per file and product, side by side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from aeroskein.evaluation import Evaluation, ProductEvaluation
from aeroskein.evaluation.figures import RequirementRow, SensorEvaluation
from aeroskein_service.evaluation import formats as f

__all__ = ["Column", "Row", "Section", "columns_of", "rule_rows", "sections_of"]


@dataclass(frozen=True, slots=True)
class Column:
    """One product of one file."""

    evaluation: Evaluation
    product: ProductEvaluation

    @property
    def name(self) -> str:
        """File and product."""
        return f"{self.evaluation.name} {self.product.product}".strip()


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table; ``is_part`` belongs to the one above."""

    label: str
    cells: tuple[str, ...]
    is_part: bool = False


@dataclass(frozen=True, slots=True)
class Section:
    """A table: a title, a line that says how to read it, its columns and rows."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]


_Cell = Callable[[ProductEvaluation], str]
_Spec = tuple[str, _Cell]

# A label that begins with a blank is a part of the row above it.
_ACCURACY: Final[tuple[_Spec, ...]] = (
    ("points judged", lambda p: str(p.judged)),
    ("horizontal error, RMS [m]", lambda p: f.number(p.accuracy.horizontal_m.rms)),
    (" 95 % interval over flights", lambda p: f.interval(p.rms_interval_m)),
    (" median", lambda p: f.number(p.accuracy.horizontal_m.p50)),
    (" 95 %", lambda p: f.number(p.accuracy.horizontal_m.p95)),
    (" its 95 % interval", lambda p: f.interval(p.p95_interval_m)),
    (" 99 %", lambda p: f.number(p.accuracy.horizontal_m.p99)),
    (" largest", lambda p: f.worst(p.worst_point_m)),
    ("worst flight, RMS [m]", lambda p: f.worst(p.worst_rms_m)),
    ("along track, RMS (mean) [m]", lambda p: f.with_mean(p.accuracy.along_m.rms, p.accuracy.along_m.mean)),
    ("across track, RMS (mean) [m]", lambda p: f.with_mean(p.accuracy.across_m.rms, p.accuracy.across_m.mean)),
    ("lag of the position, mean [s]", lambda p: f.number(p.accuracy.position_latency_s.mean)),
    ("height, RMS (mean) [m]", lambda p: f.with_mean(p.accuracy.height_m.rms, p.accuracy.height_m.mean)),
    ("pressure altitude, RMS (mean) [m]", lambda p: f.with_mean(p.accuracy.altitude_m.rms, p.accuracy.altitude_m.mean)),
    ("velocity, RMS [m/s]", lambda p: f.number(p.accuracy.velocity_mps.rms)),
    ("ground speed, RMS [m/s]", lambda p: f.number(p.accuracy.ground_speed_mps.rms)),
    ("track angle above 40 kt, RMS [deg]", lambda p: f.number(p.accuracy.track_angle_deg.rms)),
    ("vertical rate, RMS [m/s]", lambda p: f.number(p.accuracy.vertical_rate_mps.rms)),
    ("position NEES (honest: 2)", lambda p: f.number(p.accuracy.position_consistency.mean_nees)),
    (" inside the 95 % ellipse", lambda p: f.percent(p.accuracy.position_consistency.coverage_95)),
    ("velocity NEES (honest: 2)", lambda p: f.number(p.accuracy.velocity_consistency.mean_nees)),
    (" inside the 95 % ellipse", lambda p: f.percent(p.accuracy.velocity_consistency.coverage_95)),
)

_CONTINUITY: Final[tuple[_Spec, ...]] = (
    ("probability of update per 5 s", lambda p: f.percent(p.continuity[0].update_probability, 2)),
    (" lowest flight", lambda p: _lowest(p, 0)),
    (" gaps beyond 16.5 s", lambda p: str(p.continuity[0].long_gaps)),
    ("probability of update per 8 s", lambda p: f.percent(p.continuity[1].update_probability, 2)),
    (" lowest flight", lambda p: _lowest(p, 1)),
    (" gaps beyond 26.4 s", lambda p: str(p.continuity[1].long_gaps)),
    ("longest time without update [s]", lambda p: f.gap(p.continuity[0].longest_gap)),
    ("between element spans: holes, overlaps [s]", lambda p: _spans(p)),
    ("flight outside any element span [s]", lambda p: f.number(p.span_cover.outside_s) if p.span_cover else f.NOTHING),
    ("numbers (seq) missing, repeated", lambda p: _pair(p.timing.seq_missing, p.timing.seq_repeated)),
    ("times repeated, going back", lambda p: _pair(p.timing.times_repeated, p.timing.times_backwards)),
    ("spikes", lambda p: str(p.roughness.spikes)),
    (" per 10,000 points", lambda p: f.number(p.roughness.spikes_per_10000)),
    ("steps beyond 50 m", lambda p: str(p.roughness.steps)),
    (" 99 % [m]", lambda p: f.number(p.roughness.step_p99_m)),
    (" largest [m]", lambda p: f.number(p.roughness.step_max_m)),
    ("age when published, median [s]", lambda p: f.number(p.timing.age.p50_s)),
    (" 95 %", lambda p: f.number(p.timing.age.p95_s)),
    (" 99 %", lambda p: f.number(p.timing.age.p99_s)),
    ("processing, median [s]", lambda p: f.number(p.timing.processing.p50_s)),
    (" 95 %", lambda p: f.number(p.timing.processing.p95_s)),
    (" 99 %", lambda p: f.number(p.timing.processing.p99_s)),
    ("time between points, median [s]", lambda p: f.number(p.timing.interval.p50_s)),
    (" 99 %", lambda p: f.number(p.timing.interval.p99_s)),
)

_TRACKS: Final[tuple[_Spec, ...]] = (
    ("aircraft judged, tracked", lambda p: _pair(p.identity.flights_judged, p.identity.flights_tracked)),
    ("tracks", lambda p: str(p.identity.tracks)),
    ("aircraft with one track throughout", lambda p: f.percent(p.identity.flights_with_one_track)),
    ("track numbers changed, swapped", lambda p: _pair(p.identity.track_changes, p.identity.swaps)),
    ("second tracks on an aircraft, share of time", lambda p: f.percent(p.identity.extra_track_ratio)),
    ("false tracks (of these flagged)", lambda p: f"{p.identity.false_tracks} ({p.identity.false_tracks_flagged})"),
    (" their time [s]", lambda p: f.number(p.identity.false_track_s)),
    ("tracks after the end of truth [s]", lambda p: f.number(p.identity.beyond_truth_s)),
    ("first report to confirmed, median [s]", lambda p: f.number(p.identity.initiation.p50_s)),
    (" 95 %", lambda p: f.number(p.identity.initiation.p95_s)),
    ("address correct", lambda p: f.percent(p.identity.address_correct, 2)),
    ("callsign correct", lambda p: f.percent(p.identity.callsign_correct, 2)),
    ("GOSPA, mean [m]", lambda p: f.number(p.gospa.mean_m)),
    (" of which localisation", lambda p: f.number(p.gospa.localisation_m)),
    (" of which missed", lambda p: f.number(p.gospa.missed_m)),
    (" of which false", lambda p: f.number(p.gospa.false_m)),
    (" aircraft missed per instant", lambda p: f.number(p.gospa.missed_per_step)),
    (" false tracks per instant", lambda p: f.number(p.gospa.false_per_step)),
)


def columns_of(evaluations: Sequence[Evaluation]) -> list[Column]:
    """One column per file and product."""
    return [Column(evaluation, product) for evaluation in evaluations for product in evaluation.products]


def sections_of(evaluations: Sequence[Evaluation]) -> list[Section]:
    """Every table but the requirement rows."""
    columns = columns_of(evaluations)
    names = tuple(f"{column.evaluation.name}\n{column.product.product}" for column in columns)
    settings = evaluations[0].settings if evaluations else None
    from_s = f"{settings.from_s:g}" if settings else ""
    judged = f"Confirmed and coasting points from {from_s} s after the first report of each flight."
    sections = [
        Section("Accuracy", judged, names, _rows(_ACCURACY, columns)),
        Section("Horizontal error by phase", "RMS / 95 % [m].", names, _phase_rows(columns)),
        Section("Continuity and timing", "A coasted point is no update.", names, _rows(_CONTINUITY, columns)),
        Section("Tracks and aircraft", "Assigned by position every five seconds.", names, _rows(_TRACKS, columns)),
    ]
    sensors = {s.sensor: s for evaluation in evaluations for s in evaluation.sensors}
    if sensors:
        sections.append(_raw(tuple(sensors.values()), columns))
    return sections


def rule_rows(columns: Sequence[Column]) -> list[tuple[tuple[RequirementRow, RequirementRow], ...]]:
    """Requirement rows rule by rule: for each column of the evaluation the rows for 3 and for 5 NM."""
    pairs = []
    for column in columns:
        rows = column.product.requirements
        pairs.append(list(zip(rows[0::2], rows[1::2], strict=True)))
    return list(zip(*pairs, strict=True))


def _rows(specs: Sequence[_Spec], columns: Sequence[Column]) -> tuple[Row, ...]:
    return tuple(
        Row(label.strip(), tuple(cell(column.product) for column in columns), label.startswith(" "))
        for label, cell in specs
    )


def _phase_rows(columns: Sequence[Column]) -> tuple[Row, ...]:
    by_column = [{phase.phase: phase.accuracy.horizontal_m for phase in c.product.phases} for c in columns]
    names = dict.fromkeys(name for phases in by_column for name in phases)
    rows = [Row(name, tuple(f.spread(phases.get(name)) for phases in by_column)) for name in names]
    rows.append(Row("coasted, whatever the phase", tuple(f.spread(c.product.coasted.horizontal_m) for c in columns)))
    return tuple(rows)


def _raw(sensors: Sequence[SensorEvaluation], columns: Sequence[Column]) -> Section:
    """Raw reports, a column per sensor, with how the products compare."""
    rows = [
        Row("reports, judged", tuple(f"{s.reports} / {s.judged}" for s in sensors)),
        Row("horizontal error, RMS [m]", tuple(f.number(s.horizontal_m.rms) for s in sensors)),
        Row("median", tuple(f.number(s.horizontal_m.p50) for s in sensors), is_part=True),
        Row("95 %", tuple(f.number(s.horizontal_m.p95) for s in sensors), is_part=True),
        Row("along, RMS (mean) [m]", tuple(f.with_mean(s.along_m.rms, s.along_m.mean) for s in sensors)),
        Row("across, RMS (mean) [m]", tuple(f.with_mean(s.across_m.rms, s.across_m.mean) for s in sensors)),
        Row("range, RMS (mean) [m]", tuple(f.with_mean(s.range_m.rms, s.range_m.mean) for s in sensors)),
        Row("azimuth, mean [deg]", tuple(f.number(s.azimuth_deg.mean) for s in sensors)),
        Row("spikes", tuple(str(s.spikes) for s in sensors)),
    ]
    for column in columns:
        ratios = column.product.ratio_to_sensor
        rows.append(Row(f"{column.name} / raw", tuple(f.number(ratios.get(s.sensor)) for s in sensors)))
    reasons = [f"{s.sensor}: {s.not_judged_because}." for s in sensors if s.not_judged_because]
    note = " ".join(["Over the same time of the same flights.", *reasons])
    return Section("Raw reports", note, tuple(s.sensor for s in sensors), tuple(rows))


def _lowest(product: ProductEvaluation, index: int) -> str:
    lowest = product.continuity[index].lowest_flight
    return f.NOTHING if lowest is None else f"{lowest.flight}: {f.percent(lowest.value)}"


def _spans(product: ProductEvaluation) -> str:
    cover = product.span_cover
    return f.NOTHING if cover is None else f"{f.number(cover.hole_s)} / {f.number(cover.overlap_s)}"


def _pair(first: int | None, second: int | None) -> str:
    return f"{f.NOTHING if first is None else first} / {f.NOTHING if second is None else second}"
