"""The engine over a report file: the same stages as the live service, with the file's own clock.

The clock is the running maximum of the arrivals. Reports are given to the engine in micro-batches of one tick, and time
passes on every full second between them, so what comes out depends on the file and the configuration only, never on how
the file was cut into chunks or how fast the machine is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import numpy as np

from aeroskein.engine import FusionEngine
from aeroskein.events import Event
from aeroskein.plots import Array, Bools, Plots
from aeroskein.settings import EngineSettings
from aeroskein_service.files import ReportChunk

__all__ = ["fuse_chunks"]

# Reports are given to the engine together on this grid, about as a busy service takes them. [s]
TICK_S: Final = 0.25
# Elements close and tracks coast on this one: four times as many at a time as in the service cost half as much. [s]
PASS_S: Final = 1.0

Happened = tuple[float, list[Event]]


class _Ticker:
    """Gives an engine its reports tick by tick."""

    def __init__(self, engine: FusionEngine, first_s: float) -> None:
        self.engine = engine
        self._done = math.floor(first_s / PASS_S)
        self._fresh = False
        self.now_s = first_s

    def run(self, plots: Plots, clock_s: Array) -> Iterator[Happened]:
        """Whole ticks of reports; ``clock_s`` never goes back."""
        ticks = np.floor(clock_s / TICK_S).astype(np.int64)
        starts = np.flatnonzero(np.diff(ticks, prepend=ticks[0] - 1))
        for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(ticks)], strict=True):
            yield from self.pass_time(math.floor(int(ticks[start]) * TICK_S / PASS_S))
            self.now_s = float(clock_s[end - 1])
            batch = plots.take(np.arange(start, end))
            self._fresh = True
            yield self.now_s, self.engine.receive(batch, now_s=self.now_s)

    def pass_time(self, until: int) -> Iterator[Happened]:
        """Let the engine work on every pass up to ``until``.

        The first pass after reports is always worked on; of those after it only the ones for which the engine has
        something to do, so that hours without reports cost nothing.
        """
        while self._done < until:
            following = self._done + 1
            if not self._fresh:
                deadline_s = self.engine.next_deadline_s()
                if deadline_s is None or deadline_s > until * PASS_S:
                    break
                following = max(following, math.ceil(deadline_s / PASS_S))
            self._done, self._fresh = following, False
            now_s = following * PASS_S
            yield now_s, self.engine.advance(now_s=now_s)
        self._done = max(self._done, until)


def fuse_chunks(
    chunks: Iterable[ReportChunk], settings: EngineSettings, select: Callable[[Plots], Bools] | None = None
) -> Iterator[tuple[FusionEngine, float, list[Event]]]:
    """Fuse a whole file.

    Parameters
    ----------
    chunks : iterable of ReportChunk
        In order of arrival.
    settings : EngineSettings
        As for the service.
    select : callable, optional
        Says which reports take part; all others are as if they had not come. The clock is that of all reports.

    Yields
    ------
    engine : FusionEngine
        The same each time.
    now_s : float
        The file's clock: when these events are published. [s since the epoch]
    events : list of Event
        What happened then.
    """
    ticker: _Ticker | None = None
    waiting: list[tuple[Plots, Array]] = []
    latest_s = -math.inf
    for chunk in chunks:
        clock_s = np.fmax.accumulate(np.concatenate(([latest_s], chunk.arrival_s)))[1:]
        if not len(clock_s) or not math.isfinite(clock_s[-1]):
            continue
        latest_s = float(clock_s[-1])
        if ticker is None:
            first_s = float(clock_s[np.isfinite(clock_s)][0])
            ticker = _Ticker(FusionEngine(settings, epoch_ms=round(first_s * 1000.0)), first_s)
        waiting.append(_usable(chunk, clock_s, select))
        yield from _whole_ticks(ticker, waiting, math.floor(latest_s / TICK_S))
    if ticker is not None:
        yield from _whole_ticks(ticker, waiting, None)
        for now_s, events in ticker.pass_time(math.floor(latest_s / PASS_S)):
            yield ticker.engine, now_s, events
        ticker.now_s = max(ticker.now_s, latest_s)
        yield ticker.engine, ticker.now_s, ticker.engine.finish(now_s=ticker.now_s)


def _usable(chunk: ReportChunk, clock_s: Array, select: Callable[[Plots], Bools] | None) -> tuple[Plots, Array]:
    """The good reports of a chunk that are selected, with the clock at their arrival.

    A line that claims to have arrived before the one in front of it arrived when that one did, so that ages, latencies
    and what is too far ahead are measured on the same clock.
    """
    good = (chunk.reasons == 0) & np.isfinite(clock_s)
    plots, clock_s = chunk.plots.take(good), clock_s[good]
    plots.received_s = clock_s
    if select is not None:
        chosen = select(plots)
        plots, clock_s = plots.take(chosen), clock_s[chosen]
    return plots, clock_s


def _whole_ticks(
    ticker: _Ticker, waiting: list[tuple[Plots, Array]], unfinished: int | None
) -> Iterator[tuple[FusionEngine, float, list[Event]]]:
    """Run what waits, except for the tick that more reports may still fall into."""
    plots = Plots.concatenate([part for part, _ in waiting])
    clock_s = np.concatenate([part for _, part in waiting]) if waiting else np.zeros(0)
    whole = len(clock_s)
    if unfinished is not None:
        whole = int(np.searchsorted(clock_s, unfinished * TICK_S))
    rest = np.arange(whole, len(clock_s))
    waiting[:] = [(plots.take(rest), clock_s[rest])]
    if whole:
        rows = np.arange(whole)
        for now_s, events in ticker.run(plots.take(rows), clock_s[:whole]):
            yield ticker.engine, now_s, events
