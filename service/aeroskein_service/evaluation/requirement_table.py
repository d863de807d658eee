"""Requirement rows for the page: what is limited, how much room is left, and the verdict in words."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Final

from aeroskein.evaluation.figures import RequirementRow, Verdict
from aeroskein_service.evaluation.formats import number
from aeroskein_service.evaluation.summary import Column, rule_rows
from aeroskein_service.evaluation.text import DISCLAIMER

__all__ = ["requirement_table"]

_WORDS: Final = {Verdict.MET: "met", Verdict.NOT_MET: "not met", Verdict.NOT_MEASURABLE: "not measurable"}
_CSS: Final = {Verdict.MET: "met", Verdict.NOT_MET: "notmet", Verdict.NOT_MEASURABLE: "unknown"}

_Pairs = tuple[tuple[RequirementRow, RequirementRow], ...]


def requirement_table(columns: Sequence[Column]) -> str:
    """The rows of every standard, a column per product; what no column can answer is listed below."""
    head = "".join(f"<th>{escape(column.evaluation.name)}<br>{column.product.product}</th>" for column in columns)
    lines, silent = [], []
    for pairs in rule_rows(columns):
        if all(row.verdict is Verdict.NOT_MEASURABLE for pair in pairs for row in pair):
            row = pairs[0][0]
            silent.append(f"<li><b>{row.standard} {row.row}</b> {escape(row.item)}: {escape(row.note)}</li>")
        else:
            lines.append(_rule(pairs))
    below = f"<h3>Not measurable from these files</h3><ul>{''.join(dict.fromkeys(silent))}</ul>" if silent else ""
    return (
        f"<section><h2>Requirement rows</h2><p>{escape(DISCLAIMER)}</p>"
        '<div class="card table"><div class="scroll"><table class="rows"><thead><tr><th>row</th><th></th>'
        f"<th>for</th><th>limit</th>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table></div>{below}</div></section>"
    )


def _rule(pairs: _Pairs) -> str:
    """One rule: a line for 3 and one for 5 NM, or one for both where nothing differs."""
    near, far = pairs[0]
    is_one = near.limit == far.limit and all(a.measured == b.measured for a, b in pairs)
    span = "" if is_one else ' rowspan="2"'
    level = '<span class="level">recommended</span>' if near.level == "recommended" else ""
    note = f'<br><span class="aside">{escape(near.note)}</span>' if near.note else ""
    item = f"<th{span}>{near.standard} {near.row}</th><td{span}>{escape(near.item)} {level}{note}</td>"
    both = f"{near.column}, {far.column}" if is_one else near.column
    first = f'<tr class="first">{item}{_line(both, [pair[0] for pair in pairs])}</tr>'
    return first if is_one else first + f"<tr>{_line(far.column, [pair[1] for pair in pairs])}</tr>"


def _line(column: str, rows: Sequence[RequirementRow]) -> str:
    row = rows[0]
    sense = "≤" if row.sense == "<=" else "≥"
    unsure = "" if row.limit_is_sure else '<span class="unsure" title="limit not certain"> ?</span>'
    limit = f'<td class="limit">{sense} {row.limit:g} {escape(row.unit)}{unsure}</td>'
    return f'<td class="for">{column}</td>{limit}{"".join(_cell(row) for row in rows)}'


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
