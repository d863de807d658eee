"""Where errors point, and whether the stated covariance says so: scatter along and across, NEES against chi-square."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from aeroskein.evaluation.accuracy import COVERAGE_NEES
from aeroskein.plots import Array
from aeroskein_service.evaluation.charts import colour, thinned
from aeroskein_service.evaluation.formats import number, percent
from aeroskein_service.evaluation.summary import Column
from aeroskein_service.evaluation.svg import THIRD, Plot, same_scale

__all__ = ["nees_histogram", "scatter"]

_SCATTER_POINTS: Final = 1500
_NEES_BINS: Final = 30
_NEES_MAX: Final = 15.0
# Radii of the ellipses that hold 50 and 95 % of a two-dimensional Gaussian. [sigma]
_ELLIPSES: Final = ((math.sqrt(-2.0 * math.log(0.5)), "half"), (math.sqrt(COVERAGE_NEES), "full"))


def scatter(column: Column, index: int) -> str:
    """Errors along and across the track with the ellipses that would hold 50 and 95 % of them."""
    residuals = column.product.residuals
    known = np.isfinite(residuals.along_m)
    along, across = residuals.along_m[known], residuals.across_m[known]
    if not len(along):
        return ""
    reach = max(float(np.percentile(np.hypot(along, across), 99.5)), 1e-3)
    x, y = same_scale(np.array([[-reach, -reach], [reach, reach]]), THIRD)
    plot = Plot(
        x, y, x_label="across track, right positive [m]", y_label="along track [m]",
        title=f"Errors along and across the track, {column.name}", size=THIRD,
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
        title=f"NEES of {name} against chi-square", size=THIRD,
    )  # fmt: skip
    plot.bars(edges[:-1], edges[1:], density, colour(index))
    plot.line(x, 0.5 * np.exp(-0.5 * x), "truth")
    words = [
        f"95 % of χ²; here {percent(float(np.mean(known <= COVERAGE_NEES)))}",
        f"mean {number(float(known.mean()))} (honest: 2)",
    ]
    beyond = float(np.mean(known > _NEES_MAX))
    if beyond:
        words.append(f"{percent(beyond, 2)} beyond {_NEES_MAX:g}")
    plot.rule(x=COVERAGE_NEES)
    for line, text in enumerate(words):
        plot.text(COVERAGE_NEES + 0.3, plot.y.low * (0.05 + 0.07 * line) + plot.y.high * (0.95 - 0.07 * line), text)
    return plot.svg()


def _ellipse(x: Array, y: Array, radius: float) -> tuple[Array, Array]:
    """The ellipse of a sample's mean and covariance."""
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    values, vectors = np.linalg.eigh(np.cov(x, y))
    circle = np.stack([np.cos(angle), np.sin(angle)])
    path = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle) * radius
    return path[0] + float(x.mean()), path[1] + float(y.mean())
