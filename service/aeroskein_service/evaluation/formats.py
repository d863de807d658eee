"""How figures are written for people: three significant digits, "·" where there is nothing."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

from aeroskein.evaluation.figures import Gap, Interval, Spread, Worst

__all__ = ["NOTHING", "clock", "gap", "interval", "number", "percent", "spread", "with_mean", "worst"]

NOTHING: Final = "·"


def number(value: float | None) -> str:
    """Three significant digits, but no more than three decimals."""
    if value is None:
        return NOTHING
    size = abs(value)
    digits = 0 if size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 0.095 else 3
    text = f"{value:.{digits}f}"
    return text if float(text) else "0"


def percent(share: float | None, digits: int = 1) -> str:
    """A share as a percentage; never rounded up to 100 nor down to 0."""
    if share is None:
        return NOTHING
    if share in (0.0, 1.0):
        return f"{100.0 * share:.0f} %"
    text = f"{100.0 * share:.{digits}f}"
    while digits < 4 and float(text) in (0.0, 100.0):
        digits += 1
        text = f"{100.0 * share:.{digits}f}"
    return f"{text} %"


def with_mean(rms: float | None, mean: float | None) -> str:
    """An RMS with the mean error beside it."""
    return NOTHING if rms is None or mean is None else f"{number(rms)} ({mean:+.2f})"


def interval(value: Interval | None) -> str:
    """A confidence interval."""
    return NOTHING if value is None else f"{number(value.low)}–{number(value.high)}"


def spread(value: Spread | None) -> str:
    """RMS and 95 %."""
    return NOTHING if value is None or not value.count else f"{number(value.rms)} / {number(value.p95)}"


def worst(value: Worst | None) -> str:
    """A flight and its figure; the time of day (UTC) on a second line."""
    if value is None:
        return NOTHING
    when = "" if value.time_s is None else f"\nat {clock(value.time_s)[11:]}"
    return f"{value.flight}: {number(value.value)}{when}"


def gap(value: Gap | None) -> str:
    """A gap: its flight and length; the time of day (UTC) it began on a second line."""
    return NOTHING if value is None else f"{value.flight}: {number(value.length_s)}\nfrom {clock(value.start_s)[11:]}"


def clock(time_s: float) -> str:
    """Day and time of day, UTC."""
    return datetime.fromtimestamp(time_s, UTC).strftime("%Y-%m-%d %H:%M:%S")
