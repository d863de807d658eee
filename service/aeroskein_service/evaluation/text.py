"""The evaluation on a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from aeroskein.evaluation import Evaluation
from aeroskein.evaluation.figures import RequirementRow, Verdict
from aeroskein_service.evaluation.formats import NOTHING, number
from aeroskein_service.evaluation.summary import Column, Section, columns_of, rule_rows, sections_of

__all__ = ["DISCLAIMER", "print_evaluations"]

DISCLAIMER: Final = (
    "Limits and measures as this program reads them ('?': limit not certain). "
    "No statement of conformity: that takes operational data, the specifications themselves and an assessor."
)
_STYLES: Final = {Verdict.MET: "green", Verdict.NOT_MET: "bold red", Verdict.NOT_MEASURABLE: "dim"}
_WORDS: Final = {Verdict.MET: "met", Verdict.NOT_MET: "NOT MET", Verdict.NOT_MEASURABLE: NOTHING}


def print_evaluations(evaluations: Sequence[Evaluation], console: Console) -> None:
    """Print all tables; failures of requirement rows come last, where the eye stays."""
    columns = columns_of(evaluations)
    if not columns:
        console.print("There are no fused points to judge.")
        return
    for section in sections_of(evaluations):
        console.print(_table(section))
        console.print()
    for evaluation in evaluations:
        _print_absent(evaluation, console)
    console.print(_requirements(columns))
    console.print(Text(DISCLAIMER, style="dim"))


def _table(section: Section) -> Table:
    table = _new_table(section.title, section.note)
    table.add_column("", no_wrap=True)
    for name in section.columns:
        table.add_column(name, justify="right", overflow="fold")
    for row in section.rows:
        table.add_row(f"  {row.label}" if row.is_part else row.label, *row.cells)
    return table


def _requirements(columns: Sequence[Column]) -> Table:
    """One line a rule; a rule that no column can answer is only named."""
    table = _new_table("Requirement rows", "Limits for 3 / 5 NM separation; ED-142: TMA / en route.")
    for name in ("row", "", "limit"):
        table.add_column(name, no_wrap=name == "row")
    for column in columns:
        table.add_column(f"{column.evaluation.name}\n{column.product.product}", justify="right")
    silent = []
    for pairs in rule_rows(columns):
        near, far = pairs[0]
        if all(row.verdict is Verdict.NOT_MEASURABLE for pair in pairs for row in pair):
            silent.append(f"{near.standard} {near.row} {near.item}")
            continue
        item = f"{near.item}, recommended" if near.level == "recommended" else near.item
        table.add_row(f"{near.standard} {near.row}", item, _limit(near, far), *(_verdict(*pair) for pair in pairs))
    if silent:
        table.caption = "Not measurable from these files: " + "; ".join(dict.fromkeys(silent)) + "."
    return table


def _limit(near: RequirementRow, far: RequirementRow) -> str:
    sense = "≤" if near.sense == "<=" else "≥"
    values = f"{near.limit:g}" if near.limit == far.limit else f"{near.limit:g} / {far.limit:g}"
    return f"{sense} {values} {near.unit}{'' if near.limit_is_sure else ' ?'}"


def _verdict(near: RequirementRow, far: RequirementRow) -> Text:
    if near.verdict is far.verdict and near.measured == far.measured:
        return _one(near)
    if near.verdict is far.verdict:
        return Text(
            f"{number(near.measured)} / {number(far.measured)} {_WORDS[near.verdict]}", style=_STYLES[near.verdict]
        )
    return Text.assemble(_one(near), " / ", _one(far))


def _one(row: RequirementRow) -> Text:
    measured = "" if row.measured is None else f"{number(row.measured)} "
    return Text(f"{measured}{_WORDS[row.verdict]}", style=_STYLES[row.verdict])


def _print_absent(evaluation: Evaluation, console: Console) -> None:
    """Flights of truth that no fused point speaks of."""
    absent = evaluation.flights_without_points
    if absent:
        shown = ", ".join(absent[:10]) + (f" and {len(absent) - 10} more" if len(absent) > 10 else "")
        console.print(Text(f"{evaluation.name}: no point about {len(absent)} of {evaluation.flights} flights: {shown}"))


def _new_table(title: str, note: str) -> Table:
    heading = Text(title, style="bold")
    if note:
        heading.append(f"  {note}", style="dim not bold")
    return Table(title=heading, title_justify="left", caption_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
