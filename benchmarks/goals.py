"""Goals of a benchmark: rows that are printed as a table and judged, or single claims; both become an exit status."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

__all__ = ["Row", "judged", "require", "verdict"]

# Claims that did not hold; a benchmark is a process of its own.
_failures: list[str] = []


@dataclass(frozen=True, slots=True)
class Row:
    """One figure: ``must`` decides the exit status, ``aim`` is what we would like; without goals it is information."""

    name: str
    value: float
    unit: str = ""
    must: float | None = None
    aim: float | None = None
    better: Literal["lower", "higher"] = "lower"

    @property
    def verdict(self) -> str:
        """``MISSED``, ``met``, ``aim`` (met and better), or nothing for information."""
        if self.must is None:
            return ""
        if not self._reaches(self.must):
            return "MISSED"
        return "aim" if self.aim is not None and self._reaches(self.aim) else "met"

    def _reaches(self, goal: float) -> bool:
        # A figure that could not be measured reaches nothing.
        return self.value <= goal if self.better == "lower" else self.value >= goal


def judged(title: str, rows: Sequence[Row]) -> int:
    """Print a table; returns 1 where a goal is missed."""
    print(f"\n{title}\n  {'':52s}{'value':>10s} {'':9s}{'must':>9s}{'aim':>9s}", flush=True)
    for row in rows:
        sign = "≤" if row.better == "lower" else "≥"
        goals = "".join(f"{'' if goal is None else f'{sign} {goal:g}':>9s}" for goal in (row.must, row.aim))
        print(f"  {row.name:52s}{row.value:10.4g} {row.unit:9s}{goals}  {row.verdict}".rstrip(), flush=True)
    return int(any(row.verdict == "MISSED" for row in rows))


def require(ok: bool, what: str) -> None:
    """Note a claim that does not hold."""
    if not ok:
        _failures.append(what)
        print(f"    MISSED: {what}")


def verdict() -> int:
    """Say whether every claim held; returns the exit status."""
    print("all goals met" if not _failures else f"{len(_failures)} goals missed")
    return int(bool(_failures))
