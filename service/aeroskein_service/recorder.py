"""Recordings: what sensors send and what the service publishes, on Zenoh, becomes one file of JSON Lines, and back.

A recording has the lines of a report file and of a fused file in order of arrival; a line with ``product`` is a fused
point, every other one a report. So it needs no format of its own: ``replay`` sends its reports again, ``export`` takes
it apart, and one that was cut off is whole up to its last whole line.
"""

from __future__ import annotations

import time
import zlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from aeroskein_service.codec import MessageError, decode_feed, open_batch
from aeroskein_service.files import pieces, unpacked
from aeroskein_service.keys import Keys
from aeroskein_service.line_writers import LineWriter
from aeroskein_service.transport import OnMessage, Session

__all__ = ["Recorder", "RecordingFile"]

# Messages that may wait to be written, seconds of the largest traffic; more than that are counted as lost.
WAITING: Final = 50_000


class Recorder:
    """Follows everything of an installation from construction on; ``write`` puts down what has come.

    Parameters
    ----------
    session : Session
        Closing it ends the recording.
    keys : Keys
        The installation's.
    sensors : sequence of str
        Whose reports are recorded.
    """

    def __init__(self, session: Session, keys: Keys, sensors: Sequence[str]) -> None:
        self._waiting: deque[tuple[str | None, float, bytes, str]] = deque()
        self.reports = self.points = self.lost = self.broken = 0
        for sensor in sensors:
            session.subscribe_recovering(keys.reports_below(sensor), self._noting(sensor))
        for product in ("live", "element"):
            session.subscribe_recovering(keys.feed(product), self._noting(None))

    def _noting(self, sensor: str | None) -> OnMessage:
        def note(_key: str, payload: bytes, encoding: str) -> None:
            if len(self._waiting) < WAITING:
                self._waiting.append((sensor, time.time(), payload, encoding))
            else:
                self.lost += 1

        return note

    def write(self, file: LineWriter) -> None:
        """Write what has come since the last call, and see to it that it is on the disk if the process dies."""
        for _ in range(len(self._waiting)):
            sensor, received_s, payload, encoding = self._waiting.popleft()
            file.write(
                self._points(payload, encoding)
                if sensor is None
                else self._reports(sensor, received_s, payload, encoding)
            )
        file.flush()

    def _reports(self, sensor: str, received_s: float, payload: bytes, encoding: str) -> list[Any]:
        batch = open_batch(payload, encoding, sensor_id=sensor)
        self.broken += batch.error is not None
        self.reports += len(batch.reports)
        stamp = {"sensor": sensor, "received_s": received_s}
        return [stamp | msgspec.to_builtins(report) for report in batch.reports]

    def _points(self, payload: bytes, encoding: str) -> Sequence[Any]:
        try:
            points = decode_feed(payload, encoding).points
        except MessageError:
            self.broken += 1
            return []
        self.points += len(points)
        return points


class _Line(msgspec.Struct):
    """What tells the two kinds of lines apart."""

    product: Any = None
    sensor: Any = None


class RecordingFile:
    """The lines of a recording, of a report file or of a fused file.

    Attributes
    ----------
    broken : int
        Lines that are no JSON object, or neither a report nor a fused point.
    cut_off : str or None
        Why the file could not be read to its end.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.broken = 0
        self.cut_off: str | None = None

    def lines(
        self, progress: Callable[[int], None] | None = None
    ) -> Iterator[tuple[Literal["reports", "fused"], bytes]]:
        """Every good line with its kind, as far as the file can be read. Raises ``OSError`` where it cannot be opened.

        ``progress`` gets the number of bytes of the file that have been read so far.
        """
        with self.path.open("rb") as raw:
            rest = b""
            content = unpacked(raw) if self.path.suffix == ".gz" else pieces(raw)
            while (data := self._next(content)) is not None:
                *whole, rest = (rest + data).split(b"\n")
                yield from self._good(whole)
                if progress is not None:
                    progress(raw.tell())
            if rest.strip():
                before = self.broken
                yield from self._good([rest])
                if self.broken > before and self.cut_off is None:
                    self.cut_off = "its last line is not whole"

    def _next(self, content: Iterator[bytes]) -> bytes | None:
        try:
            return next(content, None)
        except (EOFError, zlib.error) as error:
            self.cut_off = f"the packed data breaks off ({error})"
            return None

    def _good(self, lines: Sequence[bytes]) -> Iterator[tuple[Literal["reports", "fused"], bytes]]:
        for line in lines:
            if not line.strip():
                continue
            try:
                kind = msgspec.json.decode(line, type=_Line)
            except (msgspec.MsgspecError, ValueError, RecursionError):
                self.broken += 1
                continue
            if kind.product is not None:
                yield "fused", line
            elif kind.sensor is not None:
                yield "reports", line
            else:
                self.broken += 1
