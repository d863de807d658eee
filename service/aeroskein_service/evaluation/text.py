"""The evaluation as tables for a terminal: one column per file and product, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Final

from rich.console import Console
from rich.table import Table

from aeroskein.evaluation.figures import Accuracy, Interval, Worst
from aeroskein.evaluation.results import Evaluation, ProductEvaluation

__all__ = ["print_evaluations"]

_NOTHING: Final = "·"


def print_evaluations(evaluations: Sequence[Evaluation], console: Console) -> None:
    """Print everything a person wants to know first."""
    columns = [(evaluation, product) for evaluation in evaluations for product in evaluation.products]
    if not columns:
        console.print("No points to judge.")
        return
    console.print(_accuracy_table(columns))
    console.print(_phase_table(columns))


_Column = tuple[Evaluation, ProductEvaluation]


def _table(title: str, first: str, columns: Sequence[_Column]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", header_style="bold", box=None, pad_edge=False)
    table.add_column(first, no_wrap=True)
    for evaluation, product in columns:
        table.add_column(f"{evaluation.name}\n{product.product}", justify="right")
    return table


_Row = tuple[str, Callable[[Accuracy], str]]
_ROWS: Final[tuple[_Row, ...]] = (
    ("horizontal RMS [m]", lambda a: number(a.horizontal_m.rms)),
    ("  median", lambda a: number(a.horizontal_m.p50)),
    ("  95 %", lambda a: number(a.horizontal_m.p95)),
    ("  99 %", lambda a: number(a.horizontal_m.p99)),
    ("  max", lambda a: number(a.horizontal_m.max)),
    ("along RMS (mean) [m]", lambda a: with_mean(a.along_m.rms, a.along_m.mean)),
    ("across RMS (mean) [m]", lambda a: with_mean(a.across_m.rms, a.across_m.mean)),
    ("height RMS (mean) [m]", lambda a: with_mean(a.height_m.rms, a.height_m.mean)),
    ("altitude RMS (mean) [m]", lambda a: with_mean(a.altitude_m.rms, a.altitude_m.mean)),
    ("velocity RMS [m/s]", lambda a: number(a.velocity_mps.rms)),
    ("ground speed RMS [m/s]", lambda a: number(a.ground_speed_mps.rms)),
    ("track angle RMS [deg]", lambda a: number(a.track_angle_deg.rms)),
    ("vertical rate RMS [m/s]", lambda a: number(a.vertical_rate_mps.rms)),
    ("position NEES (ideal 2)", lambda a: number(a.position_consistency.mean_nees)),
    ("  inside 95 %", lambda a: percent(a.position_consistency.coverage_95)),
    ("velocity NEES (ideal 2)", lambda a: number(a.velocity_consistency.mean_nees)),
    ("  inside 95 %", lambda a: percent(a.velocity_consistency.coverage_95)),
)


def _accuracy_table(columns: Sequence[_Column]) -> Table:
    table = _table("Accuracy", "", columns)
    table.add_row("points judged", *(str(product.judged) for _, product in columns))
    table.add_row("flights", *(f"{len(p.flights)} of {e.flights}" for e, p in columns))
    for label, value in _ROWS:
        table.add_row(label, *(value(product.accuracy) for _, product in columns))
        if label.startswith("horizontal"):
            table.add_row("  95 % interval", *(interval(p.rms_interval_m) for _, p in columns))
    table.add_row("worst flight, RMS [m]", *(worst(p.worst_rms_m) for _, p in columns))
    table.add_row("largest error [m]", *(worst(p.worst_point_m) for _, p in columns))
    return table


def _phase_table(columns: Sequence[_Column]) -> Table:
    table = _table("Horizontal RMS / 95 % [m] by phase", "phase", columns)
    by_column = [{phase.phase: phase.accuracy for phase in product.phases} for _, product in columns]
    for phase in dict.fromkeys(name for phases in by_column for name in phases):
        cells = []
        for phases in by_column:
            found = phases.get(phase)
            spread = found.horizontal_m if found else None
            cells.append(f"{number(spread.rms)} / {number(spread.p95)}" if spread else _NOTHING)
        table.add_row(phase, *cells)
    return table


def number(value: float | None) -> str:
    """Three significant digits, as a person writes them."""
    if value is None:
        return _NOTHING
    size = abs(value)
    digits = 0 if size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 0.095 else 3
    return f"{value:.{digits}f}"


def percent(share: float | None) -> str:
    """A share as a percentage."""
    return _NOTHING if share is None else f"{100.0 * share:.1f} %"


def with_mean(rms: float | None, mean: float | None) -> str:
    """An RMS with the mean error beside it."""
    return _NOTHING if rms is None or mean is None else f"{number(rms)} ({mean:+.2f})"


def interval(value: Interval | None) -> str:
    """A confidence interval."""
    return _NOTHING if value is None else f"{number(value.low)}–{number(value.high)}"


def worst(value: Worst | None) -> str:
    """A flight, its figure, and when."""
    if value is None:
        return _NOTHING
    when = "" if value.time_s is None else f"\n{clock(value.time_s)}"
    return f"{value.flight}: {number(value.value)}{when}"


def clock(time_s: float) -> str:
    """Time of day with the day, UTC."""
    return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%d %H:%M:%S")
