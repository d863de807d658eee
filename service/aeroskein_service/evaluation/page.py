"""The evaluation as one HTML file: plots first, tables below, nothing loaded from anywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Final

from aeroskein.evaluation import Evaluation, ProductEvaluation, TruthCurve
from aeroskein.evaluation.figures import SensorEvaluation
from aeroskein_service.evaluation import charts, covariance_charts, flight_charts
from aeroskein_service.evaluation import formats as f
from aeroskein_service.evaluation.requirement_table import requirement_table
from aeroskein_service.evaluation.summary import Column, Section, columns_of, sections_of

__all__ = ["page", "write_page"]

_Figure = Callable[[ProductEvaluation], str]

# Phases with a picture of their own; rarer ones are in the table.
_PHASES: Final = 5


def write_page(path: Path, evaluations: Sequence[Evaluation], curve: TruthCurve, inputs: Sequence[str]) -> None:
    """Write the page. Raises ``OSError``."""
    path.write_text(page(evaluations, curve, inputs), encoding="utf-8")


def page(evaluations: Sequence[Evaluation], curve: TruthCurve, inputs: Sequence[str]) -> str:
    """The page as text.

    Parameters
    ----------
    evaluations : sequence of Evaluation
        One per fused file, all against the same truth.
    curve : TruthCurve
        That truth, for the maps.
    inputs : sequence of str
        The files that were read, to be named.
    """
    columns = columns_of(evaluations)
    style = files("aeroskein_service.evaluation").joinpath("report.css").read_text("utf-8")
    names = ", ".join(evaluation.name for evaluation in evaluations)
    body = "".join(_body(evaluations, columns, curve)) if columns else "<p>There are no fused points to judge.</p>"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Evaluation of {escape(names)}</title><style>{style}</style></head><body><main>"
        f"<header><h1>Evaluation against truth</h1>{_lead(evaluations, columns)}{_legend(columns)}</header>{body}"
        f"<footer><p>Read from {escape(', '.join(inputs))}.</p></footer></main></body></html>\n"
    )


def _body(evaluations: Sequence[Evaluation], columns: Sequence[Column], curve: TruthCurve) -> Sequence[str]:
    sensors = tuple({s.sensor: s for evaluation in evaluations for s in evaluation.sensors}.values())
    sections = sections_of(evaluations)
    return [
        _tiles(columns),
        _distribution(columns, sensors),
        _over_time(columns),
        _ages(columns),
        _honesty(columns),
        _flights(columns, curve),
        requirement_table(columns),
        _block("Every figure", "", "".join(_table(section) for section in sections), "stack"),
        _absent(evaluations),
    ]


def _lead(evaluations: Sequence[Evaluation], columns: Sequence[Column]) -> str:
    if not columns:
        return ""
    first = evaluations[0]
    points = sum(column.product.judged for column in columns)
    return (
        f"<p>{points:,} fused points of {first.flights} flights, confirmed or coasting, "
        f"from {first.settings.from_s:g} s after the first report of each flight.</p>"
    )


def _legend(columns: Sequence[Column]) -> str:
    items = "".join(f'<li class="{charts.colour(i)}">{escape(c.name)}</li>' for i, c in enumerate(columns))
    return f'<ul class="legend">{items}</ul>'


def _tiles(columns: Sequence[Column]) -> str:
    """The figures a person asks for first."""
    rows: tuple[tuple[str, str, _Figure, _Figure], ...] = (
        ("RMS", "m", lambda p: f.number(p.accuracy.horizontal_m.rms), lambda p: f.interval(p.rms_interval_m)),
        ("95 %", "m", lambda p: f.number(p.accuracy.horizontal_m.p95), lambda p: f.interval(p.p95_interval_m)),
        ("velocity", "m/s", lambda p: f.number(p.accuracy.velocity_mps.rms), lambda p: "RMS"),
        ("update per 5 s", "", lambda p: f.percent(p.continuity[0].update_probability, 2), lambda p: ""),
        ("inside 95 % ellipse", "", lambda p: f.percent(p.accuracy.position_consistency.coverage_95), lambda p: ""),
        ("spikes", "", lambda p: str(p.roughness.spikes), lambda p: ""),
    )
    cards = []
    for index, column in enumerate(columns):
        product = column.product
        figures = "".join(
            f"<div><dt>{escape(label)}</dt><dd>{value(product)}<small> {unit}</small></dd>"
            f"<dd class='aside'>{escape(aside(product).replace(f.NOTHING, ''))}</dd></div>"
            for label, unit, value, aside in rows
        )
        cards.append(
            f'<article class="tiles {charts.colour(index)}"><h3>{escape(column.name)}</h3><dl>{figures}</dl></article>'
        )
    return f'<section class="stack">{"".join(cards)}</section>'


def _distribution(columns: Sequence[Column], sensors: Sequence[SensorEvaluation]) -> str:
    cards = (
        _card("Share of points below an error", charts.error_curves(columns, sensors), "half"),
        _card("Share of points above it: the tail", charts.tail_curves(columns, sensors), "half"),
    )
    note = "Further left and steeper is better." + (" Dashed: raw sensor reports." if sensors else "")
    return _block("How large are the errors?", note, "".join(cards))


def _over_time(columns: Sequence[Column]) -> str:
    phases = list(dict.fromkeys(phase.phase for column in columns for phase in column.product.phases))[:_PHASES]
    cards = [_card("By phase of flight", charts.phase_bars(columns))]
    cards += [_card(f"Over time: {phase}", charts.error_over_time(columns, phase)) for phase in phases]
    return _block("When are they large?", "", "".join(cards))


def _ages(columns: Sequence[Column]) -> str:
    cards = (
        _card("Age when published", charts.age_curves(columns), "half"),
        _card("Time between points", charts.interval_curves(columns), "half"),
    )
    return _block("How old are the points, and how often do they come?", "", "".join(cards))


def _honesty(columns: Sequence[Column]) -> str:
    cards = []
    for index, column in enumerate(columns):
        residuals = column.product.residuals
        cards.append(_card(f"{column.name}: along and across", covariance_charts.scatter(column, index)))
        for what, nees in (("position", residuals.position_nees), ("velocity", residuals.velocity_nees)):
            picture = covariance_charts.nees_histogram(nees, f"{column.name} {what}", index)
            cards.append(_card(f"{column.name}: {what} NEES", picture))
    note = (
        "Ellipses hold 50 and 95 % of a Gaussian with this mean and spread. "
        "NEES is the squared error in units of the stated covariance; the line is what an honest one gives."
    )
    return _block("Where do they point, and does the covariance say so?", note, "".join(cards))


def _flights(columns: Sequence[Column], curve: TruthCurve) -> str:
    cards = [
        _card("The worst flights", flight_charts.flight_bars(columns), "wide"),
        _card("All flights", flight_charts.flight_curves(columns)),
    ]
    for index, column in enumerate(columns):
        flight = flight_charts.worst_flight(column, curve)
        if flight is None:
            continue
        residuals = column.product.residuals
        row = flight.rows[flight.worst]
        error, when = float(residuals.horizontal_m[row]), f.clock(float(residuals.time_s[row]))[11:]
        picture, factor = flight_charts.close_up(column, flight, index)
        title = f"{column.name}, flight {flight.name}"
        cards.append(_card(title, flight_charts.flight_map(flight, index)))
        cards.append(_card(f"{f.number(error)} m at {when}, errors drawn × {factor}", picture))
        cards.append(_card("Its error over time", flight_charts.flight_series(column, flight, index)))
    note = (
        "Maps show the flight with the largest RMS: truth as a line, fused points in colour, the largest error ringed. "
        "Shaded in time: turns orange, other manoeuvres violet."
    )
    return _block("Which flights?", note, "".join(cards))


def _absent(evaluations: Sequence[Evaluation]) -> str:
    """Flights that no point speaks of."""
    parts = [
        f"<p><b>{escape(e.name)}</b>: no point about {', '.join(map(escape, e.flights_without_points))}.</p>"
        for e in evaluations
        if e.flights_without_points
    ]
    return _block("Flights without points", "", "".join(parts), "stack") if parts else ""


def _table(section: Section) -> str:
    head = "".join(f"<th>{escape(name).replace(chr(10), '<br>')}</th>" for name in section.columns)
    rows = "".join(
        f"<tr{' class=part' if row.is_part else ''}><th>{escape(row.label)}</th>"
        + "".join(f"<td>{escape(cell).replace(chr(10), '<br>')}</td>" for cell in row.cells)
        + "</tr>"
        for row in section.rows
    )
    table = f"<table><thead><tr><th></th>{head}</tr></thead><tbody>{rows}</tbody></table>"
    title = f"<h3>{escape(section.title)}</h3><p>{escape(section.note)}</p>"
    return f'<article class="card table">{title}<div class="scroll">{table}</div></article>'


def _card(title: str, picture: str, width: str = "third") -> str:
    if not picture:
        return ""
    return f'<article class="card {width}"><h3>{escape(title)}</h3>{picture}</article>'


def _block(title: str, note: str, content: str, layout: str = "grid") -> str:
    about = f"<p>{escape(note)}</p>" if note else ""
    return f'<section><h2>{escape(title)}</h2>{about}<div class="{layout}">{content}</div></section>'
