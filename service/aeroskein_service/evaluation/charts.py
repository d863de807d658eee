"""The pictures of all judged points together: over time, as a distribution, along and across, against chi-square."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from aeroskein.evaluation.accuracy import COVERAGE_NEES
from aeroskein.evaluation.figures import SensorEvaluation
from aeroskein.plots import Array
from aeroskein_service.evaluation.formats import number, percent
from aeroskein_service.evaluation.summary import Column
from aeroskein_service.evaluation.svg import Plot

__all__ = ["age_curves", "error_curves", "error_over_time", "nees_histogram", "scatter", "thinned"]

# Columns have six colours; more than that nobody tells apart.
COLOURS: Final = 6
_TIME_BINS: Final = 60
_SCATTER_POINTS: Final = 1500
_CURVE_POINTS: Final = 300
_NEES_BINS: Final = 30
_NEES_MAX: Final = 15.0
# Radii of the ellipses that hold 50 and 95 % of a two-dimensional Gaussian. [sigma]
_ELLIPSES: Final = ((math.sqrt(-2.0 * math.log(0.5)), "half"), (math.sqrt(COVERAGE_NEES), "full"))


def colour(index: int) -> str:
    """CSS class of a column."""
    return f"c{index % COLOURS}"


def error_over_time(columns: Sequence[Column], phase: str) -> str:
    """RMS (bold) and 95 % (thin) of the horizontal error in one phase, over time, all columns."""
    start_s, end_s = _time_range(columns)
    edges = np.linspace(start_s, max(end_s, start_s + 1.0), _TIME_BINS + 1)
    middle = (0.5 * (edges[1:] + edges[:-1]) - start_s) / 60.0
    curves = []
    for column in columns:
        residuals = column.product.residuals
        mine = _of_phase(column, phase)
        curves.append(_binned(residuals.time_s[mine], residuals.horizontal_m[mine], edges))
    top = max((float(np.nanmax(high)) for _, high in curves if np.isfinite(high).any()), default=1.0)
    plot = Plot(
        (0.0, (edges[-1] - start_s) / 60.0), (0.0, top * 1.08), x_label="minutes", y_label="horizontal error [m]",
        title=f"Horizontal error over time, {phase}", size=(420.0, 230.0),
    )  # fmt: skip
    for index, (rms, high) in enumerate(curves):
        plot.line(middle, high, f"{colour(index)} thin").line(middle, rms, colour(index))
    return plot.svg()


def error_curves(columns: Sequence[Column], sensors: Sequence[SensorEvaluation]) -> str:
    """Cumulative distribution of the horizontal error: fused products in colour, raw sensors dashed."""
    sizes = [column.product.residuals.horizontal_m for column in columns]
    raw = [(sensor.sensor, sensor.sizes_m) for sensor in sensors if len(sensor.sizes_m)]
    every = np.concatenate([size for size in (*sizes, *(size for _, size in raw)) if len(size)] or [np.ones(1)])
    low, high = _log_range(every)
    plot = Plot(
        (low, high), (0.0, 100.0), x_label="horizontal error [m]", y_label="share of points [%]",
        title="Cumulative distribution of the horizontal error", size=(680.0, 320.0), x_log=True,
    )  # fmt: skip
    plot.rule(y=95.0, text="95 %")
    for name, size in raw:
        x, y = _distribution(size)
        plot.line(x, y, "muted dashed")
        half = int(np.searchsorted(y, 50.0))
        plot.text(float(x[min(half, len(x) - 1)]), 50.0, f" {name}")
    for index, size in enumerate(sizes):
        if len(size):
            plot.line(*_distribution(size), colour(index))
    return plot.svg()


def age_curves(columns: Sequence[Column]) -> str:
    """Cumulative distribution of the age at publication; empty where no point says when it was published."""
    ages = [column.product.residuals.age_s for column in columns]
    known = [age[np.isfinite(age)] for age in ages]
    if not any(len(age) for age in known):
        return ""
    high = max(float(np.percentile(age, 99.8)) for age in known if len(age))
    low = min(0.0, min(float(age.min()) for age in known if len(age)))
    plot = Plot(
        (low, max(high * 1.05, low + 0.1)), (0.0, 100.0), x_label="age when published [s]",
        y_label="share of points [%]", title="Cumulative distribution of the age when published", size=(420.0, 320.0),
    )  # fmt: skip
    for index, age in enumerate(known):
        if len(age):
            plot.line(*_distribution(age), colour(index))
    return plot.svg()


def scatter(column: Column, index: int) -> str:
    """Errors along and across the track with the ellipses that would hold 50 and 95 % of them."""
    residuals = column.product.residuals
    known = np.isfinite(residuals.along_m)
    along, across = residuals.along_m[known], residuals.across_m[known]
    if not len(along):
        return ""
    reach = max(float(np.percentile(np.hypot(along, across), 99.5)) * 1.1, 1e-3)
    plot = Plot(
        (-reach, reach), (-reach, reach), x_label="across track, right positive [m]", y_label="along track [m]",
        title=f"Errors along and across the track, {column.name}", size=(360.0, 344.0),
    )  # fmt: skip
    plot.rule(x=0.0, css="zero").rule(y=0.0, css="zero")
    shown = thinned(len(along), _SCATTER_POINTS)
    plot.dots(across[shown], along[shown], f"{colour(index)} faint")
    if len(along) > 2:
        for radius, css in _ELLIPSES:
            plot.line(*_ellipse(across, along, radius), f"ellipse {css}")
    return plot.svg()


def nees_histogram(nees: Array, name: str, index: int) -> str:
    """Density of the NEES against that of chi-square with two degrees of freedom; empty without covariances."""
    known = nees[np.isfinite(nees)]
    if not len(known):
        return ""
    edges = np.linspace(0.0, _NEES_MAX, _NEES_BINS + 1)
    density = np.histogram(known, edges)[0] / (len(known) * (edges[1] - edges[0]))
    x = np.linspace(0.0, _NEES_MAX, 100)
    plot = Plot(
        (0.0, _NEES_MAX), (0.0, max(float(density.max()), 0.5) * 1.08), x_label="NEES", y_label="density",
        title=f"NEES of {name} against chi-square", size=(360.0, 240.0),
    )  # fmt: skip
    plot.bars(edges[:-1], edges[1:], density, f"{colour(index)}")
    plot.line(x, 0.5 * np.exp(-0.5 * x), "truth")
    plot.rule(x=COVERAGE_NEES, text=f"95 % of χ²; here {percent(float(np.mean(known <= COVERAGE_NEES)))}")
    plot.text(COVERAGE_NEES + 0.3, plot.y.high * 0.8, f"mean {number(float(known.mean()))} (honest: 2)")
    beyond = float(np.mean(known > _NEES_MAX))
    if beyond:
        plot.text(COVERAGE_NEES + 0.3, plot.y.high * 0.7, f"{percent(beyond, 2)} beyond {_NEES_MAX:g}")
    return plot.svg()


def thinned(n: int, at_most: int) -> Array:
    """Row numbers, evenly chosen where there are too many."""
    return np.unique(np.linspace(0, n - 1, min(n, at_most)).astype(np.int64)) if n else np.zeros(0, dtype=np.int64)


def _of_phase(column: Column, phase: str) -> Array:
    """Which points of a column are in a phase, shape ``(n,)``."""
    phases = column.evaluation.phases
    index = phases.index(phase) if phase in phases else -2
    return np.asarray(column.product.residuals.phase == index)


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


def _log_range(size: Array) -> tuple[float, float]:
    positive = size[size > 0.0]
    if not len(positive):
        return 0.1, 10.0
    low, high = float(np.percentile(positive, 0.5)), float(positive.max())
    return low * 0.8, max(high * 1.2, low * 2.0)


def _ellipse(x: Array, y: Array, radius: float) -> tuple[Array, Array]:
    """The ellipse of a sample's mean and covariance."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    values, vectors = np.linalg.eigh(np.cov(x, y))
    circle = np.stack([np.cos(angle), np.sin(angle)])
    path = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle) * radius
    return path[0] + float(x.mean()), path[1] + float(y.mean())
