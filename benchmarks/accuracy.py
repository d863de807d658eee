"""The accuracy benchmark: every figure that is claimed, measured anew, with its goal and whether it is met.

    python -m benchmarks.accuracy [--quick] [--row NAME ...] [--seed N ...] [--jobs N] [--json FILE]

Exit status 1 when a figure that must be met is not. Everything is seeded: the same seeds give the same figures.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Final

from benchmarks.accuracy_cases import CASES, Case
from benchmarks.accuracy_outcomes import Figure, Outcome, outcome_of
from benchmarks.accuracy_rows import ROWS

__all__ = ["main"]

# A quick look: eight flights a cell instead of sixteen. The scatter of an RMS over eight flights is about 5 %.
QUICK_FLIGHTS: Final = 8


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark; returns the exit status."""
    options = _options(arguments)
    rows = [row for row in ROWS if not options.row or row.name in options.row]
    needed = [case for name, case in CASES.items() if any(name in row.cases for row in rows)]
    cases = [_sized(case, options.seed, options.quick, options.seconds) for case in needed]
    began_s = time.monotonic()
    outcomes = _outcomes(cases, options.jobs)
    figures = [figure for row in rows for figure in row.figures(outcomes)]
    print("\n".join(_table(figures)))
    missed = [f for f in figures if f.verdict == "MISSED"]
    judged = [f for f in figures if f.must is not None]
    aimed = [f for f in judged if f.verdict == "aim"]
    print(
        f"\n{len(judged)} figures with a goal: {len(judged) - len(missed)} met, {len(aimed)} of them as aimed at, "
        f"{len(missed)} missed; {time.monotonic() - began_s:.0f} s"
    )
    if options.markdown:
        Path(options.markdown).write_text("\n".join(markdown(figures)) + "\n", encoding="utf-8")
    if options.json:
        Path(options.json).write_text(json.dumps([_as_json(f) for f in figures], indent=1) + "\n", encoding="utf-8")
    return 1 if missed else 0


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy", description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="eight flights a cell instead of sixteen")
    parser.add_argument("--row", action="append", default=[], choices=[row.name for row in ROWS], help="only this row")
    parser.add_argument("--seed", action="append", type=int, default=[], help="other flights and noise (repeatable)")
    parser.add_argument("--seconds", type=float, help="length of every flight, instead of each case's own")
    parser.add_argument("--jobs", type=int, default=2, help="scenes flown side by side")
    parser.add_argument("--json", metavar="FILE", help="write the figures as JSON too")
    parser.add_argument("--markdown", metavar="FILE", help="write the tables of docs/accuracy.md too")
    return parser.parse_args(arguments)


def _sized(case: Case, seeds: list[int], quick: bool, seconds: float | None) -> Case:
    scene = case.scene
    if seconds is not None:
        scene = replace(scene, duration_s=seconds)
    if seeds:
        scene = replace(scene, seeds=tuple(seeds))
    if quick:
        scene = replace(scene, flights=max(QUICK_FLIGHTS, scene.flights // 2))
    return replace(case, scene=scene)


def _outcomes(cases: list[Case], jobs: int) -> dict[str, Outcome]:
    if jobs <= 1:
        return {case.scene.name: _outcome(case) for case in cases}
    with ProcessPoolExecutor(jobs) as pool:
        # The longest first, so that nobody waits for it at the end.
        order = sorted(cases, key=lambda c: -c.scene.flights * len(c.scene.families) * c.scene.duration_s)
        found = dict(zip([c.scene.name for c in order], pool.map(_outcome, order), strict=True))
    return {case.scene.name: found[case.scene.name] for case in cases}


def _outcome(case: Case) -> Outcome:
    began_s = time.monotonic()
    outcome = outcome_of(case.scene, case.want, case.extra)
    print(f"{case.scene.name}: {time.monotonic() - began_s:.0f} s", file=sys.stderr, flush=True)
    return outcome


def _table(figures: list[Figure]) -> list[str]:
    lines, last = [], ""
    for f in figures:
        if f.row != last:
            lines += ["", f.row]
            last = f.row
        span = "" if f.interval[0] != f.interval[0] else f"[{f.interval[0]:.3f}, {f.interval[1]:.3f}]"
        goals = f"{_goal(f.must):>11s} {_goal(f.aim):>11s}"
        lines.append(f"  {f.cell:44s} {_number(f.value):>8s} {f.unit:4s} {span:16s} {goals}  {f.verdict}".rstrip())
    return lines


def markdown(figures: list[Figure]) -> list[str]:
    """The figures as two tables of a page, one line for each row and case: with goals, and for information."""
    lines = ["| figure | measured | must | aim | |", "| --- | --- | --- | --- | --- |"]
    lines += [_line(group) for group in _grouped([f for f in figures if f.must is not None])]
    lines += ["", "| for information | measured |", "| --- | --- |"]
    return lines + [_line(group) for group in _grouped([f for f in figures if f.must is None])]


def _grouped(figures: list[Figure]) -> list[list[Figure]]:
    """Figures of one row and case, which differ in family only, together."""
    groups: dict[tuple[object, ...], list[Figure]] = {}
    for f in figures:
        groups.setdefault((f.row, f.cell.rpartition(", ")[0], f.must, f.aim), []).append(f)
    return list(groups.values())


def _line(group: list[Figure]) -> str:
    first = group[0]
    case = first.cell.rpartition(", ")[0]
    families = [f.cell.rpartition(", ")[2] for f in group]
    name = f"{first.row}: {case}{', ' if case else ''}{', '.join(families)}"
    values = f"{', '.join(_short(f) for f in group)} {first.unit}".strip()
    if first.must is None:
        return f"| {name} | {values} |"
    missed = [family for family, f in zip(families, group, strict=True) if f.verdict == "MISSED"]
    every = "aim" if all(f.verdict == "aim" for f in group) else "met"
    verdict = f"**missed**{'' if len(missed) == len(group) else ': ' + ', '.join(missed)}" if missed else every
    return f"| {name} | {values} | {_goal(first.must)} | {_goal(first.aim)} | {verdict} |"


def _short(f: Figure) -> str:
    """As on a page: counts without a fraction, hundredths where there is a unit."""
    if f.value == int(f.value if f.value == f.value else 0.0) and not f.unit:
        return f"{f.value:.0f}"
    return f"{f.value:.2f}" if f.unit and abs(f.value) < 10.0 else _number(f.value) if f.value == f.value else "unknown"


def _number(value: float) -> str:
    return f"{value:.3f}" if abs(value) < 10.0 else f"{value:.1f}"


def _goal(goal: tuple[float, float] | None) -> str:
    if goal is None:
        return ""
    low, high = goal
    return f"≤ {high:.4g}" if low == -float("inf") else f"{low:.4g}–{high:.4g}"


def _as_json(f: Figure) -> dict[str, object]:
    return {
        "row": f.row, "cell": f.cell, "value": f.value, "unit": f.unit, "interval": f.interval, "must": f.must,
        "aim": f.aim, "verdict": f.verdict.lower(),
    }  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
