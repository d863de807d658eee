"""``aeroskein fuse``: the engine over a report file, as fast as it goes; the same bytes for the same input."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np

from aeroskein.engine import FusionEngine
from aeroskein.events import Rejections, TrackChanges
from aeroskein.plots import Ints
from aeroskein.points import FusedPoints, Product, Status
from aeroskein.reasons import Reason
from aeroskein_service.config import Config
from aeroskein_service.file_fusion import fuse_chunks
from aeroskein_service.files import FileNotes, ReportFile
from aeroskein_service.line_writers import FusedWriter, RegistrationWriter
from aeroskein_service.point_encoder import PointEncoder
from aeroskein_service.progress import progress_bar
from aeroskein_service.report_choice import ReportChoice
from aeroskein_service.selecting import SelectionError, parse_selection

__all__ = ["run"]

PRODUCTS: Final = {"live": Product.LIVE, "element": Product.ELEMENT}
# A registration state is written this often per radar, as the service publishes it. [s]
REGISTRATION_PERIOD_S: Final = 10.0


class Totals:
    """What came out of a file."""

    def __init__(self, sensors: int) -> None:
        self.reports: Ints = np.zeros((sensors, len(Reason)), dtype=np.int64)
        self.points = dict.fromkeys(Product, 0)
        self.confirmed: set[int] = set()

    def count(self, event: object) -> None:
        """Add one event of the engine."""
        if isinstance(event, Rejections):
            self.reports += event.counts
        elif isinstance(event, FusedPoints):
            self.points[event.product] += len(event)
        elif isinstance(event, TrackChanges):
            self.confirmed |= set(event.track_number[event.status == Status.CONFIRMED].tolist())


def run(
    *,
    config: Config,
    reports: Path,
    output: Path,
    product: str = "element,live",
    registration_output: Path | None = None,
    select: str | None = None,
    max_bad: float = 0.01,
) -> int:
    """Fuse a report file.

    Parameters
    ----------
    config : Config
        With what the command line changed in it.
    reports, output : Path
        Report file and fused file, packed where the name ends in ``.gz``.
    product : str
        ``element``, ``live`` or both with a comma between.
    registration_output : Path, optional
        Where registration states go, one a line.
    select : str, optional
        Dimension identifiers: only the reports in them take part.
    max_bad : float
        Share of broken lines above which the exit status is 1.

    Returns
    -------
    int
        0, or 1 where too much of the file is broken.
    """
    wanted = _products(product)
    selection = None if select is None else parse_selection(select, config.sensor_ids)
    for written in (output, registration_output):
        if written is not None and written.exists() and written.samefile(reports):
            raise SelectionError("--output", f"{written} is the report file itself")
    file = ReportFile(reports, config.sensor_ids)
    choice = None if selection is None else ReportChoice(selection, config.sensors)
    totals = Totals(len(config.sensors))
    with ExitStack() as stack:
        progress = stack.enter_context(progress_bar("fusing", reports.stat().st_size))
        sink = _Sink(stack, config, output, wanted, registration_output)
        for engine, now_s, events in fuse_chunks(file.chunks(progress), config.engine, choice):
            for event in events:
                totals.count(event)
                sink.take(engine, now_s, event)
            sink.registration(engine, now_s)
        sink.finish()
    totals.reports += file.notes.rejected
    _summary(file.notes, totals, config.sensor_ids)
    return 1 if file.notes.share_broken > max_bad or file.notes.cut_off is not None else 0


class _Sink:
    """Where a fusion goes: a fused file, and a registration file where one is wanted."""

    def __init__(
        self, stack: ExitStack, config: Config, output: Path, wanted: set[Product], registration: Path | None
    ) -> None:
        self._stack = stack
        self._config = config
        self._output = output
        self._wanted = wanted
        self._fused: FusedWriter | None = None
        self._states = None if registration is None else stack.enter_context(RegistrationWriter(registration))
        self._next_s = -np.inf
        self._last: tuple[FusionEngine, float] | None = None

    def take(self, engine: FusionEngine, now_s: float, event: object) -> None:
        """Write points of the wanted products."""
        if isinstance(event, FusedPoints) and event.product in self._wanted:
            self._writer(engine.epoch_ms).points(event, now_s)

    def registration(self, engine: FusionEngine, now_s: float) -> None:
        """Write registration states when their time has come."""
        self._last = engine, now_s
        if self._states is not None and now_s >= self._next_s:
            self._states.states(engine.registration())
            self._next_s = now_s + REGISTRATION_PERIOD_S

    def finish(self) -> None:
        """Write the final registration states; an input without reports gives an empty fused file."""
        if self._states is not None and self._last is not None:
            self._states.states(self._last[0].registration())
        self._writer(0)

    def _writer(self, epoch_ms: int) -> FusedWriter:
        if self._fused is None:
            encoder = PointEncoder(self._config.sensor_ids, epoch_ms, "json")
            self._fused = self._stack.enter_context(FusedWriter(self._output, encoder))
        return self._fused


def _products(text: str) -> set[Product]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in PRODUCTS:
            raise SelectionError("--product", f"unknown product {name!r}, expected element, live or both")
    if not names:
        raise SelectionError("--product", "expected element, live or element,live")
    return {PRODUCTS[name] for name in names}


def _summary(notes: FileNotes, totals: Totals, sensor_ids: Sequence[str]) -> None:
    """Say on standard error what was read, what was not used and why, and what came out."""
    for line in summary_lines(notes, totals, sensor_ids):
        print(line, file=sys.stderr)


def summary_lines(notes: FileNotes, totals: Totals, sensor_ids: Sequence[str]) -> Iterator[str]:
    """The lines of the summary."""
    yield f"{notes.lines} lines, {int(totals.reports[:, Reason.ACCEPTED].sum())} reports accepted"
    for sensor, counts in zip(sensor_ids, totals.reports.tolist(), strict=True):
        refused = [f"{many} {Reason(i).wire_name}" for i, many in enumerate(counts) if i and many]
        detail = f", not used: {', '.join(refused)}" if refused else ""
        yield f"  {sensor}: {counts[Reason.ACCEPTED]} accepted{detail}"
    live, element = totals.points[Product.LIVE], totals.points[Product.ELEMENT]
    yield f"{element} element points and {live} live points of {len(totals.confirmed)} confirmed tracks"
    if notes.broken:
        yield f"{notes.broken} broken lines ({100.0 * notes.share_broken:.2g} %), skipped:"
        for number, fault in notes.named:
            yield f"  line {number} {fault}"
        if notes.broken > len(notes.named):
            yield f"  and {notes.broken - len(notes.named)} more"
    if notes.cut_off is not None:
        yield f"the file was not read to its end: {notes.cut_off}"
