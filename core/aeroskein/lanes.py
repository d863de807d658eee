"""Lanes: walking the reports of many flights through time at once, without sorting them anew.

Offline filters go through time once for all flights: the k-th report of every flight is one step. Rows stay where they
are (flight after flight, in order of time); ``Lanes`` says which rows make step k. Flights are taken longest first, so
the flights that still have a k-th report are always the first ones, and states need neither masks nor padding.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = [
    "Lanes",
    "by_flight_and_time",
    "continues",
    "even_parts",
    "flight_quantile",
    "held_rows",
    "lengths_of_runs",
    "newest_of_each",
    "ranks",
    "step_s",
]

# From this many rows on, ``lexsort`` is not the fastest way to sort by two columns.
MANY: Final = 1000


class Lanes:
    """Which rows make the k-th step of all flights.

    Parameters
    ----------
    flight : (n,) int64
        Flight of each row, ascending.

    Attributes
    ----------
    steps : int
        Reports of the longest flight.
    """

    def __init__(self, flight: Ints) -> None:
        first = np.flatnonzero(~continues(flight))
        lengths = lengths_of_runs(first, len(flight))
        self._starts = first[np.argsort(-lengths, kind="stable")]
        self.steps = int(lengths.max(initial=0))
        # How many flights are longer than k, for each k.
        self._active = len(lengths) - np.searchsorted(np.sort(lengths), np.arange(self.steps), side="right")

    def rows(self, k: int) -> Ints:
        """Rows of the k-th reports, longest flight first; the row after each is the same flight's next report."""
        return np.asarray(self._starts[: self._active[k]] + k)


def continues(flight: Ints) -> Bools:
    """Rows whose flight also owns the row before, shape ``(n,)``."""
    same = np.zeros(len(flight), dtype=np.bool_)
    same[1:] = flight[1:] == flight[:-1]
    return same


def ranks(flight: Ints) -> Ints:
    """0, 1, 2 … within each run of equal values, shape ``(n,)``."""
    row = np.arange(len(flight))
    return row - np.maximum.accumulate(np.where(continues(flight), 0, row))


def lengths_of_runs(first: Ints, n: int) -> Ints:
    """How many rows of ``n`` belong to each run, given their first rows ``(runs,)``."""
    lengths = np.empty(len(first), dtype=np.int64)
    np.subtract(first[1:], first[:-1], out=lengths[:-1])
    lengths[-1:] = n - first[-1:]
    return lengths


def even_parts(n: int, most: int) -> list[slice]:
    """``n`` rows in as few parts of at most ``most`` as there must be, of equal size or one more."""
    parts = -(-n // most)
    return [slice(n * k // parts, n * (k + 1) // parts) for k in range(parts)]


def by_flight_and_time(flight: Ints, time_s: Array) -> Ints:
    """Rows in order of flight, then time, equal ones as they are, ``(n,)``."""
    n = len(flight)
    if n < MANY:
        return np.lexsort((time_s, flight))
    # Sorts that need not keep the order of equal rows are five times faster; places make the second one keep it.
    order = np.argsort(time_s)
    order = order[np.argsort(flight[order] * n + np.arange(n))]
    flight, time_s = flight[order], time_s[order]
    equal = np.zeros(n + 1, dtype=np.bool_)
    equal[1:-1] = (flight[1:] == flight[:-1]) & (time_s[1:] == time_s[:-1])
    if equal.any():
        tied = equal[1:] | equal[:-1]
        rows, run = order[tied], np.cumsum(~equal[:-1])[tied]
        order[tied] = rows[np.lexsort((rows, run))]
    return order


def newest_of_each(flight: Ints, time_s: Array) -> Ints:
    """Row of the newest of each flight, of equally new ones the last, in order of flights."""
    order = by_flight_and_time(flight, time_s)
    flight = flight[order]
    newest = np.ones(len(flight), dtype=np.bool_)
    newest[:-1] = flight[1:] != flight[:-1]
    return order[newest]


def step_s(flight: Ints, time_s: Array) -> Array:
    """Time since the row before of the same flight, 0 for a flight's first row, shape ``(n,)``. [s]"""
    return np.asarray(np.where(continues(flight), np.diff(time_s, prepend=time_s[:1]), 0.0))


def held_rows(flight: Ints, marked: Bools) -> tuple[Ints, Ints]:
    """For each row the nearest marked row at or before it, and at or after it, in the same flight; -1 where none.

    Parameters
    ----------
    flight : (n,) int64
        Flight of each row, ascending.
    marked : (n,) bool
        Rows to find.
    """
    rows = np.arange(len(flight))
    before = np.maximum.accumulate(np.where(marked, rows, -1))
    after = np.minimum.accumulate(np.where(marked, rows, len(flight))[::-1])[::-1]
    before = np.where((before >= 0) & (flight[before] == flight), before, -1)
    clipped = np.minimum(after, len(flight) - 1)
    after = np.where((after < len(flight)) & (flight[clipped] == flight), after, -1)
    return before, after


def flight_quantile(flight: Ints, values: Array, quantile: float) -> Array:
    """Quantile of a column within each flight, with linear interpolation, shape ``(flights,)``."""
    order = np.lexsort((values, flight))
    first = np.flatnonzero(~continues(flight))
    last = np.append(first[1:], len(flight)) - 1
    place = first + quantile * (last - first)
    low = np.floor(place).astype(np.int64)
    high = np.minimum(low + 1, last)
    ranked = values[order]
    return np.asarray(ranked[low] + (place - low) * (ranked[high] - ranked[low]))
