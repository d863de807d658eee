"""The pictures of single flights: every flight as a bar, the worst one as a map, close up, and over time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.evaluation import TruthCurve
from aeroskein.evaluation.geometry import east_north_axes, rotate_to_east_north
from aeroskein.plots import Array, Ints
from aeroskein_service.evaluation.charts import colour, thinned
from aeroskein_service.evaluation.formats import clock, number
from aeroskein_service.evaluation.summary import Column
from aeroskein_service.evaluation.svg import Plot

__all__ = ["WorstFlight", "close_up", "flight_bars", "flight_map", "flight_series", "worst_flight"]

# Flights shown as bars, the worst ones first.
BARS: Final = 40
_PATH_POINTS: Final = 1200
_MAP_SIZE: Final = (420.0, 380.0)


@dataclass(slots=True, eq=False)
class WorstFlight:
    """The worst flight of a column in its own plane.

    Attributes
    ----------
    name : str
    rows : (n,) int64
        Its rows among the residuals, in time order.
    truth_km : (m, 2) array
        Path of the truth, east and north of its middle. [km]
    at_m : (n, 2) array, fused_m : (n, 2) array
        Truth and fused position at each judged point, east and north of the middle. [m]
    worst : int
        Which of the rows has the largest error.
    """

    name: str
    rows: Ints
    truth_km: Array
    at_m: Array
    fused_m: Array
    worst: int


def flight_bars(columns: Sequence[Column]) -> str:
    """RMS of each flight as a bar, a whisker to its 95 %; the worst flights first."""
    spreads = [{flight.flight: flight.horizontal_m for flight in column.product.flights} for column in columns]
    names = {name for flights in spreads for name in flights}
    if not names:
        return ""
    worst = {name: max(flights[name].rms or 0.0 for flights in spreads if name in flights) for name in names}
    shown = sorted(worst, key=lambda name: (-worst[name], name))[:BARS]
    top = max(flights[name].p95 or 0.0 for flights in spreads for name in shown if name in flights)
    row_px = 8.0 * len(columns) + 8.0
    plot = Plot(
        (0.0, max(top, 1e-3) * 1.05), (float(len(shown)), 0.0), x_label="horizontal error [m]: bar RMS, whisker 95 %",
        y_label="", title="Horizontal error of each flight", size=(680.0, 60.0 + row_px * len(shown)), left=76.0,
    )  # fmt: skip
    plot.y_ticks = [(k + 0.5, name[:10]) for k, name in enumerate(shown)]
    for row, name in enumerate(shown):
        for index, flights in enumerate(spreads):
            if name in flights:
                _bar(plot, row * row_px + 4.0 + 8.0 * index, flights[name].rms, flights[name].p95, colour(index), name)
    return plot.svg()


def _bar(plot: Plot, top_px: float, rms: float | None, p95: float | None, css: str, name: str) -> None:
    left, y = plot.x.start, plot.y.end + top_px
    right, far = float(plot.x(rms or 0.0)), float(plot.x(p95 or 0.0))
    tip = f"<title>{name}: RMS {number(rms)} m, 95 % {number(p95)} m</title>"
    plot.add(f'<rect class="bar {css}" x="{left:.1f}" y="{y:.1f}" width="{right - left:.1f}" height="6">{tip}</rect>')
    plot.add(f'<path class="whisker {css}" d="M{right:.1f} {y + 3:.1f}H{far:.1f}M{far:.1f} {y:.1f}v6"/>')


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
        truth_km=rotate_to_east_north(path[shown] - path[middle], east, north) / 1000.0,
        at_m=rotate_to_east_north(truth.position - path[middle], east, north),
        fused_m=rotate_to_east_north(fused - path[middle], east, north),
        worst=int(np.argmax(residuals.horizontal_m[rows])),
    )


def flight_map(flight: WorstFlight, index: int) -> str:
    """The whole flight: truth as a line, fused points on it, the largest error ringed."""
    every = np.concatenate([flight.truth_km, flight.fused_m / 1000.0])
    plot = _square(every, f"Map of flight {flight.name}", "km")
    plot.line(flight.truth_km[:, 0], flight.truth_km[:, 1], "truth")
    shown = thinned(len(flight.rows), _PATH_POINTS)
    east_km, north_km = flight.fused_m[shown].T / 1000.0
    plot.dots(east_km, north_km, f"{colour(index)} solid", 1.6)
    x, y = flight.fused_m[flight.worst] / 1000.0
    plot.add(f'<circle class="ring" cx="{float(plot.x(x)):.1f}" cy="{float(plot.y(y)):.1f}" r="9"/>')
    return plot.svg()


def close_up(flight: WorstFlight, index: int, error_m: float) -> str:
    """Where the error is largest: truth, fused points, and from each point a line to where the aircraft was."""
    centre = flight.at_m[flight.worst]
    reach = max(2.5 * error_m, 30.0)
    near = np.flatnonzero(np.abs(flight.at_m - centre).max(axis=1) < 3.0 * reach)
    near = near[np.abs(near - flight.worst) < 200]
    box = np.array([[-reach, -reach], [reach, reach]])
    plot = _square(box, f"Flight {flight.name} where its error is largest", "m")
    at, fused = flight.at_m[near] - centre, flight.fused_m[near] - centre
    plot.line(at[:, 0], at[:, 1], "truth")
    for (x1, y1), (x2, y2) in zip(at, fused, strict=True):
        px, py = plot.x(np.array([x1, x2])), plot.y(np.array([y1, y2]))
        plot.add(f'<path class="stick" d="M{px[0]:.1f} {py[0]:.1f}L{px[1]:.1f} {py[1]:.1f}"/>')
    plot.dots(at[:, 0], at[:, 1], "truthdot", 2.2)
    plot.dots(fused[:, 0], fused[:, 1], f"{colour(index)} solid", 3.2)
    return plot.svg()


def flight_series(column: Column, flight: WorstFlight, index: int) -> str:
    """Error of the flight over time, its phases shaded."""
    residuals = column.product.residuals
    time_s, size = residuals.time_s[flight.rows], residuals.horizontal_m[flight.rows]
    minutes = (time_s - time_s[0]) / 60.0
    plot = Plot(
        (0.0, max(float(minutes[-1]), 0.1)), (0.0, max(float(size.max()), 1e-3) * 1.1),
        x_label=f"minutes from {clock(float(time_s[0]))} UTC", y_label="horizontal error [m]",
        title=f"Error of flight {flight.name} over time", size=(860.0, 220.0),
    )  # fmt: skip
    phase = residuals.phase[flight.rows]
    cuts = np.flatnonzero(np.diff(phase)) + 1
    edges = np.concatenate([[0], cuts, [len(phase) - 1]])
    for first, last in itertools.pairwise(edges):
        name = column.evaluation.phases[phase[first]]
        plot.band(float(minutes[first]), float(minutes[last]), f"phase-{_shade(name)}", name)
    shown = thinned(len(minutes), _PATH_POINTS)
    plot.line(minutes[shown], size[shown], colour(index))
    x, y = float(plot.x(minutes[flight.worst])), float(plot.y(size[flight.worst]))
    return plot.add(f'<circle class="ring" cx="{x:.1f}" cy="{y:.1f}" r="7"/>').svg()


def _shade(phase: str) -> str:
    """Straight flight has no shade; turns the strongest."""
    known = {"straight": "none", "turn": "turn", "hold": "turn"}
    return known.get(phase, "other")


def _square(points: Array, title: str, unit: str) -> Plot:
    """A plot with the same scale on both axes that shows all points."""
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = _MAP_SIZE[0] - 68.0, _MAP_SIZE[1] - 52.0
    middle = 0.5 * (low + high)
    per_px = max((high[0] - low[0]) / width, (high[1] - low[1]) / height, 1e-9) * 1.08
    x = (float(middle[0] - 0.5 * per_px * width), float(middle[0] + 0.5 * per_px * width))
    y = (float(middle[1] - 0.5 * per_px * height), float(middle[1] + 0.5 * per_px * height))
    return Plot(x, y, x_label=f"east [{unit}]", y_label=f"north [{unit}]", title=title, size=_MAP_SIZE)
