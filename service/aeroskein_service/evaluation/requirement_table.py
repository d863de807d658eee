"""Requirement rows for the page: what is limited, how much room is left, and the verdict in words."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

from aeroskein.evaluation.figures import RequirementRow, Verdict
from aeroskein_service.evaluation.formats import number
from aeroskein_service.evaluation.summary import Column
from aeroskein_service.evaluation.text import DISCLAIMER

__all__ = ["requirement_table"]

_WORDS: Final = {Verdict.MET: "met", Verdict.NOT_MET: "not met", Verdict.NOT_MEASURABLE: "not measurable"}
_CSS: Final = {Verdict.MET: "met", Verdict.NOT_MET: "notmet", Verdict.NOT_MEASURABLE: "unknown"}


def requirement_table(columns: Sequence[Column]) -> str:
    """The rows of every standard, two lines a row (3 and 5 NM), a column per product."""
    head = "".join(f"<th>{escape(column.evaluation.name)}<br>{column.product.product}</th>" for column in columns)
    lines = [_line(rows) for rows in zip(*(column.product.requirements for column in columns), strict=True)]
    return (
        f"<section><h2>Requirement rows</h2><p>{escape(DISCLAIMER)}</p>"
        '<div class="card table wide"><div class="scroll"><table class="rows"><thead><tr><th>row</th><th></th>'
        f"<th>for</th><th>limit</th>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table></div></div></section>"
    )


def _line(rows: Sequence[RequirementRow]) -> str:
    row = rows[0]
    level = '<span class="level">recommended</span>' if row.level == "recommended" else ""
    note = f'<br><span class="aside">{escape(row.note)}</span>' if row.note else ""
    sense = "≤" if row.sense == "<=" else "≥"
    unsure = "" if row.limit_is_sure else '<span class="unsure" title="limit not certain"> ?</span>'
    is_first = row.column in ("3 NM", "TMA")
    item = f"<th>{row.standard} {row.row}</th><td>{escape(row.item)} {level}{note}</td>"
    lead = item if is_first else "<th></th><td></td>"
    cells = "".join(_cell(r) for r in rows)
    limit = f"{sense} {row.limit:g} {escape(row.unit)}{unsure}"
    return f'<tr class="{"first" if is_first else "second"}">{lead}<td>{row.column}</td><td>{limit}</td>{cells}</tr>'


def _cell(row: RequirementRow) -> str:
    if row.verdict is Verdict.NOT_MEASURABLE:
        return '<td class="verdict unknown">not measurable</td>'
    measured = number(row.measured)
    return f'<td class="verdict {_CSS[row.verdict]}">{measured} <b>{_WORDS[row.verdict]}</b>{_room(row)}</td>'


def _room(row: RequirementRow) -> str:
    """A bar that fills up as an upper limit is approached."""
    if row.sense != "<=" or not row.limit or row.measured is None:
        return ""
    share = min(max(row.measured / row.limit, 0.0), 1.0)
    return f'<i class="room"><i style="width:{100.0 * share:.0f}%"></i></i>'
