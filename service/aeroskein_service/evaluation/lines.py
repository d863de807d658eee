"""JSON Lines, streamed: typed rows in chunks, broken lines counted and named, gzip recognised by its first bytes.

A file is never held as a whole: a chunk of decoded lines becomes columns before the next one is read.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Generic, TypeVar

import msgspec

__all__ = ["BrokenLine", "FileNotes", "LineReader"]

# Lines decoded before they become columns: about 30 MB of Python objects.
CHUNK_LINES: Final = 65_536
# Broken lines that are named; the others are only counted.
NAMED_LINES: Final = 5
_GZIP_MAGIC: Final = b"\x1f\x8b"

_Row = TypeVar("_Row", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class BrokenLine:
    """A line that could not be used: its number from 1, and why."""

    number: int
    reason: str


@dataclass(slots=True)
class FileNotes:
    """What reading a file came to."""

    path: str
    lines: int = 0
    bad: int = 0
    named: list[BrokenLine] = field(default_factory=list)

    def note(self, reason: str) -> None:
        """Count the current line as broken."""
        self.bad += 1
        if len(self.named) < NAMED_LINES:
            self.named.append(BrokenLine(self.lines, reason))

    @property
    def bad_share(self) -> float:
        """Broken lines over all lines; 0 for an empty file."""
        return self.bad / self.lines if self.lines else 0.0


class LineReader(Generic[_Row]):
    """Rows of one type out of a file, chunk by chunk.

    Parameters
    ----------
    path : Path
        A JSON Lines file, plain or gzip.
    row_type : type
        The msgspec type that a line must fit; what it does not name is skipped.
    """

    def __init__(self, path: Path, row_type: type[_Row]) -> None:
        self.notes = FileNotes(str(path))
        self._path = path
        self._decode = msgspec.json.Decoder(row_type).decode

    def chunks(self) -> Iterator[list[_Row]]:
        """Decoded lines, up to ``CHUNK_LINES`` at a time, in the order of the file. Raises ``OSError``."""
        notes, decode = self.notes, self._decode
        rows: list[_Row] = []
        for line in _lines(self._path, notes):
            notes.lines += 1
            try:
                rows.append(decode(line))
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                if line.strip():
                    notes.note(str(error))
                else:
                    notes.lines -= 1
            if len(rows) >= CHUNK_LINES:
                yield rows
                rows = []
        if rows:
            yield rows


def _lines(path: Path, notes: FileNotes) -> Iterator[bytes]:
    """Raw lines; a compressed file that breaks off counts as one broken line."""
    with path.open("rb") as file:
        packed = file.peek(2)[:2] == _GZIP_MAGIC
        try:
            if packed:
                with gzip.open(file) as unpacked:
                    yield from unpacked
            else:
                yield from file
        except (EOFError, gzip.BadGzipFile, zlib.error) as error:
            notes.lines += 1
            notes.note(f"the compressed file breaks off: {error}")
