"""Report files: JSON Lines in, columns out, as fast as msgspec decodes; what is broken is skipped, counted and named.

Lines are in order of arrival. A chunk of lines is decoded at once; only when one of them is broken is the chunk gone
through line by line. A line is broken when it is no JSON object or names no configured sensor; a report with a wrong
type or value is a rejected report, as it would be on Zenoh.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Final, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints, Plots
from aeroskein.reasons import Reason
from aeroskein_service.batch_decoder import lenient_json, read_report
from aeroskein_service.messages import JSON, Report
from aeroskein_service.report_columns import columns_of

__all__ = ["FileNotes", "ReportChunk", "ReportFile", "pieces", "unpacked"]

# A few thousand reports: long enough for columns to pay, short enough for the processor's cache. [bytes]
CHUNK_BYTES: Final = 1_000_000
READ_BYTES: Final = 1 << 18
# zlib's name for its own format with the header of gzip and the largest window.
GZIP: Final = zlib.MAX_WBITS | 16
BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
# Broken lines that are named in the summary; the others are only counted.
NAMED_LINES: Final = 10
# Arrival must be a plausible time like any other; see ``aeroskein.cleaning``. [s]
HIGHEST_TIME_S: Final = 1.0e11


class FileReport(Report, gc=False):
    """One line of a report file."""

    sensor: str | None = None
    received_s: float | None = None
    product: str | None = None


_DECODER: Final = msgspec.json.Decoder(FileReport)
# The same type, for arguments by position.
_MAKE: Final[Any] = FileReport


@dataclass(slots=True)
class FileNotes:
    """What was noticed while reading one file.

    Attributes
    ----------
    lines : int
        Lines that are not blank.
    broken : int
        Lines that could not be used.
    named : list of (int, str)
        Line number, counted from 1, and fault of the first of them.
    cut_off : str or None
        Why the file could not be read to its end.
    rejected : (sensors, reasons) int64
        Reports that were not used and fields that were dropped, by sensor index and ``Reason``.
    """

    rejected: Ints
    lines: int = 0
    broken: int = 0
    named: list[tuple[int, str]] = field(default_factory=list)
    cut_off: str | None = None

    @property
    def share_broken(self) -> float:
        """Broken lines among all."""
        return self.broken / self.lines if self.lines else 0.0

    def note(self, line: int, fault: str) -> None:
        """Count one broken line."""
        self.broken += 1
        if len(self.named) < NAMED_LINES:
            self.named.append((line, fault))


@dataclass(slots=True, eq=False)
class ReportChunk:
    """Some lines, in order.

    Attributes
    ----------
    plots : Plots
        Every report that could be decoded, the rejected ones too, because their arrival moves the clock.
    reasons : (n,) uint8
        ``Reason``, 0 where the report is good.
    arrival_s : (n,) float64
        ``received_s``, or ``time_s`` where it is absent; NaN where neither is a time. [s since the epoch]
    """

    plots: Plots
    reasons: NDArray[np.uint8]
    arrival_s: Array


class ReportFile:
    """Reads a report file in chunks.

    Parameters
    ----------
    path : Path
        ``.gz`` by suffix.
    sensor_ids : sequence of str
        The configured sensors, by index.
    chunk_bytes : int
        About how much is decoded at a time; the reports do not depend on it.
    among_points : bool
        The file may be a recording: lines with ``product`` are fused points and passed over.
    """

    def __init__(
        self, path: Path, sensor_ids: Sequence[str], *, chunk_bytes: int = CHUNK_BYTES, among_points: bool = False
    ) -> None:
        self.path = path
        self._among_points = among_points
        self._index = {sensor: index for index, sensor in enumerate(sensor_ids)}
        self._chunk_bytes = chunk_bytes
        self.notes = FileNotes(np.zeros((len(sensor_ids), len(Reason)), dtype=np.int64))

    def chunks(self, progress: Callable[[int], None] | None = None) -> Iterator[ReportChunk]:
        """Read the whole file, once. Raises ``OSError`` where it cannot be opened.

        Parameters
        ----------
        progress : callable, optional
            Gets the number of bytes of the file that have been read so far.
        """
        first = 1
        with self.path.open("rb") as raw:
            for block in self._blocks(unpacked(raw) if self.path.suffix == ".gz" else pieces(raw)):
                yield self._chunk(block.removeprefix(BYTE_ORDER_MARK) if first == 1 else block, first)
                first += block.count(b"\n")
                if progress is not None:
                    progress(raw.tell())

    def _blocks(self, content: Iterator[bytes]) -> Iterator[bytes]:
        """Whole lines, about ``chunk_bytes`` at a time; the last line may lack its end."""
        parts: list[bytes] = []
        size, ended = 0, False
        while not ended:
            try:
                data = next(content, b"")
            except (EOFError, zlib.error) as error:
                self.notes.cut_off = f"the packed data breaks off ({error})"
                data = b""
            ended = not data
            parts.append(data)
            size += len(data)
            if size >= self._chunk_bytes or ended:
                block = b"".join(parts)
                cut = len(block) if ended else block.rfind(b"\n") + 1
                if cut:
                    yield block[:cut]
                parts, size = [block[cut:]], len(block) - cut

    def _chunk(self, block: bytes, first: int) -> ReportChunk:
        numbers = None
        try:
            reports = _DECODER.decode_lines(block)
        except (msgspec.MsgspecError, ValueError, RecursionError):
            reports, numbers = self._one_by_one(block, first)
        sensors = [self._index.get(cast(str, report.sensor), -1) for report in reports]
        if -1 in sensors:
            numbers = numbers or [n for n, line in enumerate(block.split(b"\n"), first) if line.strip()]
            reports, sensors = self._known(reports, sensors, numbers)
        self.notes.lines += len(reports)
        return self._checked(reports, sensors)

    def _known(self, reports: list[FileReport], sensors: list[int], numbers: list[int]) -> tuple[Any, list[int]]:
        """Leave out the lines that name no configured sensor."""
        for number, report, sensor in zip(numbers, reports, sensors, strict=True):
            if sensor < 0 and not (self._among_points and report.product is not None):
                self.notes.lines += 1
                named = "no sensor" if report.sensor is None else f"sensor {report.sensor[:40]!r}, not configured"
                self.notes.note(number, f"names {named}")
        kept = [report for report, sensor in zip(reports, sensors, strict=True) if sensor >= 0]
        return kept, [sensor for sensor in sensors if sensor >= 0]

    def _one_by_one(self, block: bytes, first: int) -> tuple[list[FileReport], list[int]]:
        reports, numbers = [], []
        for number, line in enumerate(block.split(b"\n"), first):
            if not line.strip():
                continue
            try:
                report: FileReport | str = _DECODER.decode(line)
            except (msgspec.MsgspecError, ValueError, RecursionError):
                report = self._repaired(line)
            if isinstance(report, str):
                self.notes.lines += 1
                if report:
                    self.notes.note(number, report)
            else:
                reports.append(report)
                numbers.append(number)
        return reports, numbers

    def _repaired(self, line: bytes) -> FileReport | str:
        """A line that did not decode: the report without bad fields, or why it is broken, or "" where it is counted."""
        try:
            row = lenient_json(line)
        except (ValueError, RecursionError):
            return "is not JSON"
        if not isinstance(row, dict):
            return "is no JSON object"
        sensor, received_s = row.pop("sensor", None), row.pop("received_s", None)
        if not isinstance(sensor, str) or sensor not in self._index:
            return (
                f"names sensor {str(sensor)[:40]!r}, not configured" if isinstance(sensor, str) else "names no sensor"
            )
        counts = self.notes.rejected[self._index[sensor]]
        dropped: dict[Reason, int] = {}
        report = read_report(row, JSON, dropped)
        for reason, many in dropped.items():
            counts[reason] += many
        if isinstance(report, Reason):
            counts[report] += 1
            return ""
        if received_s is not None and (isinstance(received_s, bool) or not isinstance(received_s, int | float)):
            counts[Reason.BAD_VALUE] += 1
            return ""
        repaired: FileReport = _MAKE(*msgspec.structs.astuple(report), sensor, received_s)
        return repaired

    def _checked(self, reports: list[FileReport], sensors: list[int]) -> ReportChunk:
        """Columns of all reports, with reasons, and the count of those."""
        arrival_s = np.array([np.nan if r.received_s is None else r.received_s for r in reports], dtype=np.float64)
        sensor = np.array(sensors, dtype=np.int16)
        columns = columns_of(reports, received_s=arrival_s, sensor=sensor)
        plots, reasons = columns.plots, columns.reasons
        stated = np.array([r.received_s is not None for r in reports], dtype=np.bool_)
        wrong = stated & ~((arrival_s >= 0.0) & (arrival_s <= HIGHEST_TIME_S))
        reasons[wrong & (reasons == Reason.ACCEPTED)] = Reason.BAD_VALUE
        arrival_s = np.where(stated, arrival_s, plots.time_s)
        arrival_s[~((arrival_s >= 0.0) & (arrival_s <= HIGHEST_TIME_S))] = np.nan
        plots.received_s = arrival_s
        bad = reasons != Reason.ACCEPTED
        counts: Any = self.notes.rejected
        np.add.at(counts, (sensor[bad], reasons[bad]), 1)
        for reason, dropped in ((Reason.BAD_CALLSIGN, columns.bad_callsign), (Reason.BAD_MODE_A, columns.bad_mode_a)):
            if dropped is not None:
                np.add.at(counts, (sensor[dropped], np.full(int(dropped.sum()), reason)), 1)
        return ReportChunk(plots, reasons, arrival_s)


def pieces(raw: IO[bytes]) -> Iterator[bytes]:
    """The content of a file, piece by piece."""
    while data := raw.read(READ_BYTES):
        yield data


def unpacked(raw: IO[bytes]) -> Iterator[bytes]:
    """The unpacked content of a gzip file, piece by piece, as far as it goes.

    Python's ``gzip`` loses what it has unpacked when a file breaks off; this gives it out first. Raises ``EOFError``
    where the end is missing and ``zlib.error`` where the data are damaged.
    """
    unpacker = zlib.decompressobj(GZIP)
    for data in pieces(raw):
        while data:
            if unpacker.eof:  # files may be joined
                unpacker = zlib.decompressobj(GZIP)
            if content := unpacker.decompress(data):
                yield content
            data = unpacker.unused_data
    if not unpacker.eof and raw.tell():
        raise EOFError("its end is missing")
