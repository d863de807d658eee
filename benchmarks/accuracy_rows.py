"""The table: every row of accuracy that is asked for, with its goals, out of the outcomes of the cases.

Goals are intervals: ``must`` decides the exit status, ``aim`` is what we would like. Rows without goals are shown
because nobody should have to guess them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from benchmarks.accuracy_cases import in_gaps
from benchmarks.accuracy_libraries import LIBRARIES
from benchmarks.accuracy_outcomes import Figure, Outcome

__all__ = ["ROWS", "Row"]

Outcomes = Mapping[str, Outcome]
INF: Final = float("inf")


@dataclass(frozen=True, slots=True)
class Row:
    """One row: what it is called on the command line, the cases it needs, and its figures."""

    name: str
    cases: tuple[str, ...]
    figures: Callable[[Outcomes], list[Figure]]


def _at_most(must: float, aim: float) -> dict[str, tuple[float, float]]:
    return {"must": (-INF, must), "aim": (-INF, aim)}


def _ratios(
    title: str,
    o: Outcome,
    ours: str,
    theirs: str,
    goals: Mapping[str, tuple[float, float]],
    spans: tuple[tuple[float, float], ...] = (),
) -> list[Figure]:
    """The ratio of every family of an outcome against one pair of goals."""
    made = []
    for family in o.scene.families:
        must, aim = goals[family] if family in goals else goals["*"]
        value, interval = o.ratio(ours, theirs, family, spans)
        made.append(
            Figure(row=title, cell=f"{o.scene.name}, {family}", value=value, interval=interval, **_at_most(must, aim))
        )
    return made  # fmt: skip


def _smoother(o: Outcomes) -> list[Figure]:
    title = "element / smoother of the same lag"
    made = []
    for name in ("base", "adsb alone", "no velocity", "outliers", "slow", "pole", "antimeridian", "registered"):
        made += _ratios(title, o[name], "element", "smoother", {"*": (1.03, 1.00)})
    for name in ("gaps", "gaps 2"):
        made += _ratios(f"{title}, in gaps", o[name], "element", "smoother", {"*": (1.06, 1.00)}, in_gaps())
    made += _ratios(f"{title}, radars only", o["radars"], "element", "smoother", {"*": (1.06, 1.00)})
    return made


def _live(o: Outcomes) -> list[Figure]:
    made = []
    for name in ("base", "no velocity", "slow", "gaps", "radars"):
        out = o[name]
        for family in out.scene.families:
            best = min(("imm", "imm-ukf"), key=lambda which: out.rms(which, family))
            value, interval = out.ratio("live at reports", best, family)
            made.append(
                Figure(
                    row="live / best zero-lag reference",
                    cell=f"{name}, {family} ({best})",
                    value=value,
                    interval=interval,
                    **_at_most(1.05, 0.98),
                )
            )
    return made  # fmt: skip


def _raw(o: Outcomes) -> list[Figure]:
    goals = {"cruise": (0.16, 0.13), "enroute": (0.16, 0.13), "*": (0.25, 0.19)}
    made = _ratios("element / raw ADS-B", o["base"], "element", "adsb", goals)
    return made + _ratios("element / raw ADS-B, no velocity", o["no velocity"], "element", "adsb", {"*": (0.40, 0.30)})


def _circle(o: Outcomes) -> list[Figure]:
    return _ratios("element / published circle", o["base"], "element", "circle", {"*": (0.15, 0.10)})


def _radars_help(o: Outcomes) -> list[Figure]:
    made = []
    for with_radars, alone, must, aim in (("base", "adsb alone", 1.01, 0.97), ("coarse", "coarse alone", 0.97, 0.93)):
        for family in o[with_radars].scene.families:
            value = o[with_radars].rms("element", family) / o[alone].rms("smoother", family)
            made.append(
                Figure(
                    row="with radars / ADS-B alone, smoother",
                    cell=f"{with_radars}, {family}",
                    value=value,
                    **_at_most(must, aim),
                )
            )
    return made  # fmt: skip


def _gaps(o: Outcomes) -> list[Figure]:
    title = "60 s ADS-B gap / raw radar 1"
    made = _ratios(title, o["gaps"], "element", "radar1", {"*": (0.55, 0.45)}, in_gaps())
    return made + _ratios(title, o["gaps 2"], "element", "radar1", {"*": (0.45, 0.38)}, in_gaps())


def _radars_only(o: Outcomes) -> list[Figure]:
    goals = {"cruise": (0.45, 0.38), "enroute": (0.45, 0.38), "*": (0.60, 0.50)}
    made = _ratios("radars only / raw radar 1", o["radars"], "element", "radar1", goals)
    off = o["radars, heights off"]
    for family in off.scene.families:
        value, interval = off.ratio("element", "radar1", family)
        made.append(_information("radars only / raw radar 1, heights off by 90 m", family, value, interval))
    return made


def _outliers(o: Outcomes) -> list[Figure]:
    made = []
    for family in o["outliers"].scene.families:
        rise = o["outliers"].rms("element", family) / o["base"].rms("element", family) - 1.0
        made.append(Figure(row="5 % outliers: rise of RMS", cell=family, value=rise, **_at_most(0.15, 0.05)))
    for family in o["outliers"].scene.families:
        value = o["outliers"].largest("element", family)
        made.append(
            Figure(row="5 % outliers: largest error", cell=family, value=value, unit="m", **_at_most(60.0, 40.0))
        )
    return made


def _latency(o: Outcomes) -> list[Figure]:
    extras = o["late adsb"].extras
    return [
        Figure(row="late ADS-B after 8 min", cell="one in 20, 0.3 s", value=extras["late_rms"], unit="m",
               **_at_most(15.0, 12.0)),
        Figure(row="late ADS-B after 8 min", cell="the others", value=extras["others_rms"], unit="m"),
    ]  # fmt: skip


def _velocity(o: Outcomes) -> list[Figure]:
    out, made = o["base"], []
    for family in out.scene.families:
        value = out.rms("element", family, of="velocity_mps")
        made.append(Figure(row="velocity", cell=f"element, {family}", value=value, unit="m/s", **_at_most(0.8, 0.6)))
    for family in out.scene.families:
        value = out.rms("element", family, of="track_angle_deg")
        made.append(Figure(row="track angle", cell=f"element, {family}", value=value, unit="°", **_at_most(0.35, 0.25)))
    for family in out.scene.families:
        made.append(
            Figure(row="velocity, live", cell=family, value=out.rms("live", family, of="velocity_mps"), unit="m/s")
        )
    return made


def _honesty(o: Outcomes) -> list[Figure]:
    made = []
    for product in ("element", "live"):
        for name in ("base", "adsb alone", "no velocity", "outliers"):
            made += _nees(o[name], product, (1.5, 2.5), (1.8, 2.2), (0.92, 0.98), (0.94, 0.96), ())
        made += _nees(o["radars"], product, (1.4, 3.0), (1.4, 3.0), (0.89, 0.98), (0.89, 0.98), ())
        made += _nees(o["gaps"], product, (1.4, 3.0), (1.4, 3.0), (0.89, 0.98), (0.89, 0.98), in_gaps())
    made += _nees(o["gaps 2"], "element", (1.4, 3.0), (1.4, 3.0), (0.89, 0.98), (0.89, 0.98), in_gaps())
    return sorted(made, key=lambda figure: figure.row, reverse=True)


def _nees(
    o: Outcome,
    product: str,
    must: tuple[float, float],
    aim: tuple[float, float],
    must_cover: tuple[float, float],
    aim_cover: tuple[float, float],
    spans: tuple[tuple[float, float], ...],
) -> list[Figure]:
    made = []
    for family in o.scene.families:
        cell = f"{product}, {o.scene.name}, {family}"
        nees, cover = o.nees(product, family, spans), o.coverage(product, family, spans)
        made += [
            Figure(row="NEES", cell=cell, value=nees, must=must, aim=aim),
            Figure(row="inside 95 %", cell=cell, value=cover, must=must_cover, aim=aim_cover),
        ]
    return made  # fmt: skip


def _spikes(o: Outcomes) -> list[Figure]:
    return [
        Figure(row="spikes", cell=f"{product}, {name}", value=out.spikes(product), must=(0.0, 0.0), aim=(0.0, 0.0))
        for name, out in o.items()
        for product in ("element", "live")
        if name in _SPIKE_CASES
    ]


def _steps(o: Outcomes) -> list[Figure]:
    return [
        Figure(row="step at loss or return", cell=f"{name}, largest", value=o[name].extras["step_max"], unit="σ",
               must=(0.0, np.nextafter(3.0, 0.0)), aim=(0.0, np.nextafter(2.0, 0.0)))
        for name in ("gaps", "gaps 2")
    ]  # fmt: skip


def _lateness(o: Outcomes) -> list[Figure]:
    extras, title = o["lateness"].extras, "up to 4 s late: not used"
    return [
        Figure(row=title, cell="refused", value=extras["late"], **_at_most(0.01, 0.0)),
        Figure(row=title, cell="in no element", value=extras["not_in_elements"]),
        *_ratios("up to 4 s late: element / smoother", o["lateness"], "element", "smoother", {"*": (1.03, 1.00)}),
    ]


def _cases(o: Outcomes) -> list[Figure]:
    made = []
    names = ("slow", "pole", "antimeridian", "correlated", "sigma doubled", "sigma halved", "nacp 0", "stale",
             "registering", "registered")  # fmt: skip
    for name in names:
        out = o[name]
        for family in out.scene.families:
            cell = f"{name}, {family}"
            value, interval = out.ratio("element", "smoother", family)
            made += [
                Figure(row="cases: element RMS", cell=cell, value=out.rms("element", family), unit="m"),
                Figure(row="cases: largest error", cell=cell, value=out.largest("element", family), unit="m"),
                # The reference does not look for repeated positions, so there is nothing to compare.
                *([] if name == "stale" else [_information("cases: element / smoother", cell, value, interval)]),
                Figure(row="cases: NEES", cell=cell, value=out.nees("element", family)),
            ]
    return sorted(made, key=lambda figure: figure.row)


def _information(row: str, cell: str, value: float, interval: tuple[float, float]) -> Figure:
    return Figure(row=row, cell=cell, value=value, interval=interval)


def _libraries(o: Outcomes) -> list[Figure]:
    """Other libraries on the same reports, in the same table: their errors, and ours over the best of them."""
    out, made = o["base"], []
    for family in out.scene.families:
        for name in LIBRARIES:
            made.append(
                Figure(row="other libraries, base", cell=f"{name}, {family}", value=out.rms(name, family), unit="m")
            )
    filters = [name for name in LIBRARIES if "offline" not in name]
    for family in out.scene.families:
        best = min(filters, key=lambda name: out.rms(name, family))
        for ours in ("live", "element"):
            value, interval = out.ratio(ours, best, family)
            made.append(_information(f"{ours} / best filter of other libraries", f"{family} ({best})", value, interval))
    return made


def _absolute(o: Outcomes) -> list[Figure]:
    made = []
    for name in ("base", "adsb alone", "no velocity", "radars"):
        out = o[name]
        for family in out.scene.families:
            for what in ("element", "smoother", "live", "imm", "imm-ukf", "adsb", "radar1", "circle"):
                if what in out.errors and len(out.errors[what].residuals):
                    made.append(
                        Figure(row=f"RMS, {name}", cell=f"{what}, {family}", value=out.rms(what, family), unit="m")
                    )
    return made


def _vertical(o: Outcomes) -> list[Figure]:
    made = []
    for name, families in (("base", ("enroute", "terminal")), ("slow", ("hover", "climb")), ("radars", ("enroute",))):
        for family in families:
            for product in ("element", "live"):
                cell = f"{product}, {name}, {family}"
                for title, of, unit in (
                    ("pressure altitude", "altitude_m", "m"),
                    ("geometric height", "height_m", "m"),
                    ("vertical rate", "vertical_rate_mps", "m/s"),
                ):
                    made.append(Figure(row=title, cell=cell, value=o[name].rms(product, family, of=of), unit=unit))
    return sorted(made, key=lambda figure: figure.row)


_SPIKE_CASES: Final = ("base", "no velocity", "outliers", "gaps", "radars", "slow", "stale")

ROWS: Final = (
    Row(
        "smoother",
        ("base", "adsb alone", "no velocity", "outliers", "slow", "pole", "antimeridian", "registered", "gaps",
         "gaps 2", "radars"),
        _smoother,
    ),
    Row("live", ("base", "no velocity", "slow", "gaps", "radars"), _live),
    Row("raw", ("base", "no velocity"), _raw),
    Row("circle", ("base",), _circle),
    Row("radars-help", ("base", "adsb alone", "coarse", "coarse alone"), _radars_help),
    Row("gaps", ("gaps", "gaps 2"), _gaps),
    Row("radars-only", ("radars", "radars, heights off"), _radars_only),
    Row("outliers", ("base", "outliers"), _outliers),
    Row("latency", ("late adsb",), _latency),
    Row("velocity", ("base",), _velocity),
    Row("honesty", ("base", "adsb alone", "no velocity", "outliers", "radars", "gaps", "gaps 2"), _honesty),
    Row("spikes", _SPIKE_CASES, _spikes),
    Row("steps", ("gaps", "gaps 2"), _steps),
    Row("lateness", ("lateness",), _lateness),
    Row(
        "cases",
        ("slow", "pole", "antimeridian", "correlated", "sigma doubled", "sigma halved", "nacp 0", "stale",
         "registering", "registered"),
        _cases,
    ),
    Row("vertical", ("base", "slow", "radars"), _vertical),
    Row("libraries", ("base",), _libraries),
    Row("absolute", ("base", "adsb alone", "no velocity", "radars"), _absolute),
)  # fmt: skip
"""All rows in the order of the table."""
