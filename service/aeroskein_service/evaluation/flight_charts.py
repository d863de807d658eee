"""The pictures of single flights: each one as a bar, all of them as a curve, the worst one on a map and over time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.evaluation import TruthCurve
from aeroskein.evaluation.geometry import east_north_axes, rotate_to_east_north
from aeroskein.plots import Array, Ints
from aeroskein_service.evaluation.charts import colour, spread_bars, thinned
from aeroskein_service.evaluation.formats import clock
from aeroskein_service.evaluation.summary import Column
from aeroskein_service.evaluation.svg import THIRD, TWO_THIRDS, Plot, same_scale

__all__ = ["WorstFlight", "close_up", "flight_bars", "flight_curves", "flight_map", "flight_series", "worst_flight"]

# Bars that are shown, of all columns together; the worst flights come first.
BARS: Final = 48
_FEWEST_FLIGHTS: Final = 8
_PATH_POINTS: Final = 1000
# The close-up shows this much flight on both sides of the largest error, which is drawn this large. [s, 1]
_CLOSE_UP_S: Final = 45.0
_LARGEST_STICK: Final = 0.28
# Magnifications that a person can divide by.
_MAGNIFY: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)


@dataclass(slots=True, eq=False)
class WorstFlight:
    """The worst flight of a column in its own plane.

    Attributes
    ----------
    name : str
    rows : (n,) int64
        Its rows among the residuals, in time order.
    path_m : (m, 2) float64
        Truth, east and north of its middle, thinned for drawing. [m]
    truth_m, fused_m : (n, 2) float64
        Truth and fused position at each judged point, east and north of the middle. [m]
    worst : int
        Which of the rows has the largest error.
    """

    name: str
    rows: Ints
    path_m: Array
    truth_m: Array
    fused_m: Array
    worst: int


def flight_bars(columns: Sequence[Column]) -> str:
    """RMS of each flight as a bar, a whisker to its 95 %; the worst flights first."""
    spreads = [{flight.flight: flight.horizontal_m for flight in column.product.flights} for column in columns]
    names = {name for flights in spreads for name in flights}
    worst = {name: max(flights[name].rms or 0.0 for flights in spreads if name in flights) for name in names}
    shown = sorted(worst, key=lambda name: (-worst[name], name))
    shown = shown[: max(BARS // max(len(columns), 1) // 2, _FEWEST_FLIGHTS)]
    return spread_bars(shown, spreads, "Horizontal error of the worst flights", TWO_THIRDS[0])


def flight_curves(columns: Sequence[Column]) -> str:
    """Share of flights whose RMS is below a value."""
    sizes = [np.array([flight.horizontal_m.rms or 0.0 for flight in c.product.flights]) for c in columns]
    top = max((float(size.max()) for size in sizes if len(size)), default=0.0)
    plot = Plot(
        (0.0, max(top, 1e-3) * 1.05), (0.0, 100.0), x_label="RMS of a flight [m]", y_label="share of flights [%]",
        title="RMS of all flights", size=THIRD,
    )  # fmt: skip
    for index, size in enumerate(sizes):
        if len(size):
            x = np.sort(size)
            plot.line(np.repeat(x, 2), 100.0 * np.repeat(np.arange(len(x) + 1), 2)[1:-1] / len(x), colour(index))
    return plot.svg()


def worst_flight(column: Column, curve: TruthCurve) -> WorstFlight | None:
    """The flight with the largest RMS of a column, ready to be drawn; None where nothing was judged."""
    worst = column.product.worst_rms_m
    if worst is None:
        return None
    flight = curve.names.index(worst.flight)
    residuals = column.product.residuals
    rows = np.flatnonzero(residuals.flight == flight)
    rows = rows[np.argsort(residuals.time_s[rows], kind="stable")]
    part = slice(curve.first_row[flight], curve.end_row[flight])
    path, up = curve.position[part], curve.up[part]
    middle = len(path) // 2
    east, north = east_north_axes(up[middle : middle + 1])
    truth = curve.at(np.full(len(rows), flight), residuals.time_s[rows])
    own_east, own_north = east_north_axes(truth.up)
    error = residuals.error_m[rows]
    fused = truth.position + own_east * error[:, :1] + own_north * error[:, 1:]
    shown = thinned(len(path), _PATH_POINTS)
    return WorstFlight(
        name=worst.flight,
        rows=rows,
        path_m=rotate_to_east_north(path[shown] - path[middle], east, north),
        truth_m=rotate_to_east_north(truth.position - path[middle], east, north),
        fused_m=rotate_to_east_north(fused - path[middle], east, north),
        worst=int(np.argmax(residuals.horizontal_m[rows])),
    )


def flight_map(flight: WorstFlight, index: int) -> str:
    """The whole flight: truth as a line, fused points on it, the largest error ringed."""
    km = 1e-3
    x, y = same_scale(np.concatenate([flight.path_m, flight.fused_m]) * km, THIRD)
    plot = Plot(x, y, x_label="east [km]", y_label="north [km]", title=f"Map of flight {flight.name}", size=THIRD)
    plot.line(flight.path_m[:, 0] * km, flight.path_m[:, 1] * km, "truth")
    shown = thinned(len(flight.rows), _PATH_POINTS)
    plot.dots(flight.fused_m[shown, 0] * km, flight.fused_m[shown, 1] * km, f"{colour(index)} solid", 1.6)
    return _ring(plot, *(flight.fused_m[flight.worst] * km).tolist()).svg()


def close_up(column: Column, flight: WorstFlight, index: int) -> tuple[str, int]:
    """The minute and a half around the largest error, with every error drawn larger than it is.

    Returns
    -------
    str, int
        The picture; how many times larger errors are drawn than the flight.
    """
    time_s = column.product.residuals.time_s[flight.rows]
    near = np.flatnonzero(np.abs(time_s - time_s[flight.worst]) <= _CLOSE_UP_S)
    truth = flight.truth_m[near] - flight.truth_m[flight.worst]
    error = flight.fused_m[near] - flight.truth_m[near]
    size = max(float(np.ptp(truth, axis=0).max()), 50.0)
    largest = max(float(np.hypot(error[:, 0], error[:, 1]).max()), 1e-6)
    factor = max((m for m in _MAGNIFY if m * largest <= _LARGEST_STICK * size), default=1)
    drawn = truth + factor * error
    x, y = same_scale(np.concatenate([truth, drawn]), THIRD)
    plot = Plot(x, y, x_label="east [m]", y_label="north [m]", title=f"Flight {flight.name}, close up", size=THIRD)
    plot.line(truth[:, 0], truth[:, 1], "truth")
    ends = np.stack([truth, drawn], axis=1)
    px, py = plot.x(ends[..., 0]), plot.y(ends[..., 1])
    sticks = "".join(f"M{a[0]:.1f} {b[0]:.1f}L{a[1]:.1f} {b[1]:.1f}" for a, b in zip(px, py, strict=True))
    plot.add(f'<path class="stick" d="{sticks}"/>')
    plot.dots(truth[:, 0], truth[:, 1], "truthdot", 1.6).dots(drawn[:, 0], drawn[:, 1], f"{colour(index)} solid", 2.6)
    return _ring(plot, *(factor * (flight.fused_m - flight.truth_m)[flight.worst]).tolist()).svg(), factor


def flight_series(column: Column, flight: WorstFlight, index: int) -> str:
    """Error of the flight over time, its phases shaded."""
    residuals = column.product.residuals
    time_s, size = residuals.time_s[flight.rows], residuals.horizontal_m[flight.rows]
    minutes = (time_s - time_s[0]) / 60.0
    plot = Plot(
        (0.0, max(float(minutes[-1]), 0.1)), (0.0, max(float(size.max()), 1e-3) * 1.1),
        x_label=f"minutes from {clock(float(time_s[0]))} UTC", y_label="horizontal error [m]",
        title=f"Error of flight {flight.name} over time", size=THIRD,
    )  # fmt: skip
    phase = residuals.phase[flight.rows]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(phase)) + 1, [len(phase) - 1]])
    for first, last in itertools.pairwise(edges):
        name = column.evaluation.phases[phase[first]]
        plot.band(float(minutes[first]), float(minutes[last]), f"phase-{_shade(name)}", name)
    shown = thinned(len(minutes), _PATH_POINTS)
    plot.line(minutes[shown], size[shown], colour(index))
    return _ring(plot, float(minutes[flight.worst]), float(size[flight.worst])).svg()


def _ring(plot: Plot, x: float, y: float) -> Plot:
    """A ring around a point."""
    return plot.add(f'<circle class="ring" cx="{float(plot.x(x)):.1f}" cy="{float(plot.y(y)):.1f}" r="8"/>')


def _shade(phase: str) -> str:
    """Straight flight has no shade; turns the strongest."""
    return {"straight": "none", "turn": "turn", "hold": "turn"}.get(phase, "other")
