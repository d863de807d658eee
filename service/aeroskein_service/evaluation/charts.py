"""The pictures of all judged points together: as a distribution, by phase, over time, in age."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

import numpy as np

from aeroskein.evaluation.figures import SensorEvaluation, Spread
from aeroskein.plots import Array, Bools, Ints
from aeroskein_service.evaluation.formats import number
from aeroskein_service.evaluation.summary import Column
from aeroskein_service.evaluation.svg import HALF, THIRD, Plot

__all__ = [
    "age_curves",
    "colour",
    "error_curves",
    "error_over_time",
    "interval_curves",
    "phase_bars",
    "spread_bars",
    "tail_curves",
    "thinned",
]

# Columns have six colours; more than that nobody tells apart.
COLOURS: Final = 6
_TIME_BINS: Final = 40
# With more columns than this, thin lines beside the bold ones only confuse.
_COLUMNS_WITH_THIN: Final = 2
_CURVE_POINTS: Final = 300
_BAR_PX: Final = 7.0


def colour(index: int) -> str:
    """CSS class of a column."""
    return f"c{index % COLOURS}"


def error_curves(columns: Sequence[Column], sensors: Sequence[SensorEvaluation]) -> str:
    """Cumulative distribution of the horizontal error: fused products in colour, raw sensors dashed."""
    sizes = [column.product.residuals.horizontal_m for column in columns]
    plot = Plot(
        _error_range(columns, sensors), (0.0, 100.0), x_label="horizontal error [m]", y_label="share of points [%]",
        title="Cumulative distribution of the horizontal error", size=HALF, x_log=True,
    )  # fmt: skip
    plot.rule(y=95.0, text="95 %")
    for sensor in sensors:
        if len(sensor.sizes_m):
            x, y = _distribution(sensor.sizes_m)
            plot.line(x, y, "muted dashed")
            at = min(int(np.searchsorted(y, 50.0)), len(x) - 1)
            plot.text(float(x[at]), 50.0, f" {sensor.sensor}")
    for index, size in enumerate(sizes):
        if len(size):
            plot.line(*_distribution(size), colour(index))
    return plot.svg()


def tail_curves(columns: Sequence[Column], sensors: Sequence[SensorEvaluation]) -> str:
    """Share of points with a larger error, both axes logarithmic: how far the tail reaches."""
    every = [(colour(i), c.product.residuals.horizontal_m) for i, c in enumerate(columns)]
    every = [("muted dashed", sensor.sizes_m) for sensor in sensors] + every
    most = max((len(size) for _, size in every), default=1)
    plot = Plot(
        _error_range(columns, sensors), (max(100.0 / max(most, 100), 1e-4), 100.0), x_label="horizontal error [m]",
        y_label="share with a larger error [%]", title="Tail of the horizontal error", size=HALF,
        x_log=True, y_log=True,
    )  # fmt: skip
    for css, size in every:
        if len(size):
            ordered = np.sort(size)
            # Every point of the far tail, and evenly chosen ones before.
            rows = np.unique(
                np.concatenate([thinned(len(size), _CURVE_POINTS), np.arange(max(len(size) - 60, 0), len(size))])
            )
            plot.line(ordered[rows], 100.0 * (len(size) - rows) / len(size), css)
    return plot.svg()


def phase_bars(columns: Sequence[Column]) -> str:
    """RMS and 95 % of the horizontal error in every phase."""
    by_column = [{phase.phase: phase.accuracy.horizontal_m for phase in c.product.phases} for c in columns]
    names = list(dict.fromkeys(name for phases in by_column for name in phases))
    return spread_bars(names, by_column, "Horizontal error by phase", THIRD[0])


def spread_bars(names: Sequence[str], by_column: Sequence[dict[str, Spread]], title: str, width: float) -> str:
    """A group of bars for each name, one per column: RMS as a bar, a whisker to the 95 %; empty without names."""
    if not names:
        return ""
    top = max((flights[name].p95 or 0.0 for flights in by_column for name in names if name in flights), default=0.0)
    group = _BAR_PX * len(by_column) + 7.0
    plot = Plot(
        (0.0, max(top, 1e-3) * 1.05), (float(len(names)), 0.0), x_label="bar: RMS, whisker: 95 % [m]",
        y_label="", title=title, size=(width, 52.0 + group * len(names)), left=84.0,
    )  # fmt: skip
    plot.y_ticks = [(k + 0.5, name[:12]) for k, name in enumerate(names)]
    for row, name in enumerate(names):
        for index, found in enumerate(by_column):
            if name in found:
                _bar(plot, row * group + 3.5 + _BAR_PX * index, found[name], colour(index), name)
    return plot.svg()


def _bar(plot: Plot, top_px: float, size: Spread, css: str, name: str) -> None:
    left, y = plot.x.start, plot.y.end + top_px
    right, far = float(plot.x(size.rms or 0.0)), float(plot.x(size.p95 or 0.0))
    tip = f"<title>{escape(name)}: RMS {number(size.rms)} m, 95 % {number(size.p95)} m, {size.count} points</title>"
    box = f'x="{left:.1f}" y="{y:.1f}" width="{right - left:.1f}" height="{_BAR_PX - 1.5:.1f}"'
    plot.add(f'<rect class="bar {css}" {box}>{tip}</rect>')
    middle = y + 0.5 * (_BAR_PX - 1.5)
    plot.add(
        f'<path class="whisker {css}" d="M{right:.1f} {middle:.1f}H{far:.1f}M{far:.1f} {y:.1f}v{_BAR_PX - 1.5:.1f}"/>'
    )


def error_over_time(columns: Sequence[Column], phase: str) -> str:
    """RMS (and thin the 95 %, with few columns) of the horizontal error in one phase, over time."""
    start_s, end_s = _time_range(columns)
    edges = np.linspace(start_s, max(end_s, start_s + 1.0), _TIME_BINS + 1)
    middle = (0.5 * (edges[1:] + edges[:-1]) - start_s) / 60.0
    curves = []
    for column in columns:
        residuals = column.product.residuals
        mine = _is_phase(column, phase)
        curves.append(_binned(residuals.time_s[mine], residuals.horizontal_m[mine], edges))
    has_thin = len(columns) <= _COLUMNS_WITH_THIN
    shown = [high if has_thin else rms for rms, high in curves]
    top = max((float(np.nanmax(values)) for values in shown if np.isfinite(values).any()), default=1.0)
    plot = Plot(
        (0.0, (edges[-1] - start_s) / 60.0), (0.0, max(top, 1e-3) * 1.08), x_label="minutes",
        y_label="RMS and 95 % [m]" if has_thin else "RMS [m]", title=f"Error over time, {phase}",
        size=(THIRD[0], 220.0),
    )  # fmt: skip
    for index, (rms, high) in enumerate(curves):
        if has_thin:
            plot.line(middle, high, f"{colour(index)} thin")
        plot.line(middle, rms, colour(index))
    return plot.svg()


def age_curves(columns: Sequence[Column]) -> str:
    """Cumulative distribution of the age at publication; empty where no point says when it was published."""
    return _curves([c.product.residuals.age_s for c in columns], "age when published [s]", "Age when published")


def interval_curves(columns: Sequence[Column]) -> str:
    """Cumulative distribution of the time between two points of a track."""
    intervals = []
    for column in columns:
        residuals = column.product.residuals
        same = (np.diff(residuals.flight) == 0) & (np.diff(residuals.track_number) == 0)
        intervals.append(np.diff(residuals.time_s)[same])
    return _curves(intervals, "time to the next point [s]", "Time between points")


def _curves(values: Sequence[Array], label: str, title: str) -> str:
    """Cumulative distributions side by side up to 99.8 %; empty where there is nothing."""
    known = [value[np.isfinite(value)] for value in values]
    if not any(len(value) for value in known):
        return ""
    high = max(float(np.percentile(value, 99.8)) for value in known if len(value))
    low = min(0.0, min(float(value.min()) for value in known if len(value)))
    plot = Plot(
        (low, max(high * 1.05, low + 0.1)), (0.0, 100.0), x_label=label, y_label="share of points [%]",
        title=title, size=(HALF[0], 250.0),
    )  # fmt: skip
    plot.rule(y=99.0, text="99 %")
    for index, value in enumerate(known):
        if len(value):
            plot.line(*_distribution(value), colour(index))
    return plot.svg()


def thinned(n: int, at_most: int) -> Ints:
    """Row numbers, evenly chosen where there are too many."""
    return np.unique(np.linspace(0, n - 1, min(n, at_most)).astype(np.int64)) if n else np.zeros(0, dtype=np.int64)


def _error_range(columns: Sequence[Column], sensors: Sequence[SensorEvaluation]) -> tuple[float, float]:
    """Range of a logarithmic error axis."""
    sizes = [c.product.residuals.horizontal_m for c in columns] + [s.sizes_m for s in sensors]
    every = np.concatenate([size[size > 0.0] for size in sizes] or [np.zeros(0)])
    if not len(every):
        return 0.1, 10.0
    low, high = float(np.percentile(every, 0.5)), float(every.max())
    return low * 0.8, max(high * 1.2, low * 2.0)


def _is_phase(column: Column, phase: str) -> Bools:
    """Which points of a column are in a phase, shape ``(n,)``."""
    phases = column.evaluation.phases
    return np.asarray(column.product.residuals.phase == (phases.index(phase) if phase in phases else -2))


def _time_range(columns: Sequence[Column]) -> tuple[float, float]:
    times = [c.product.residuals.time_s for c in columns if len(c.product.residuals)]
    if not times:
        return 0.0, 1.0
    return min(float(t.min()) for t in times), max(float(t.max()) for t in times)


def _binned(time_s: Array, size: Array, edges: Array) -> tuple[Array, Array]:
    """RMS and 95 % in every bin, NaN where a bin is empty."""
    rms, high = np.full(len(edges) - 1, np.nan), np.full(len(edges) - 1, np.nan)
    order = np.argsort(time_s, kind="stable")
    size = size[order]
    cuts = np.searchsorted(time_s[order], edges)
    cuts[-1] = len(size)
    for index in range(len(rms)):
        part = size[cuts[index] : cuts[index + 1]]
        if len(part):
            rms[index], high[index] = np.sqrt(np.mean(part**2)), np.percentile(part, 95.0)
    return rms, high


def _distribution(value: Array) -> tuple[Array, Array]:
    """Points of the cumulative distribution: value and percentage."""
    ordered = np.sort(value)
    rows = thinned(len(ordered), _CURVE_POINTS)
    return ordered[rows], 100.0 * (rows + 1.0) / len(ordered)
