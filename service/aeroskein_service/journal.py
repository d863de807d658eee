"""How far each track has been published, written down before it is published: what a crash must not make us forget.

The engine's snapshot is made every ten seconds; what happens in between is appended here, twelve bytes an element, and
added to the snapshot after a restart. A file is begun with every snapshot and removed when a later snapshot is on disk.
"""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path
from typing import Final

import numpy as np

from aeroskein import snapshots
from aeroskein.points import FusedPoints

__all__ = ["ElementJournal"]

_NAME: Final = re.compile(r"published\.(\d+)\.journal")
_ROW: Final = np.dtype([("label", "<i4"), ("end_s", "<f8")])


class ElementJournal:
    """Append-only files in one folder; raises ``OSError`` where they cannot be written.

    Parameters
    ----------
    folder : Path
        Must exist.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._number = max((number for number, _ in self._files()), default=0)
        self._published = self._read()
        self._open()

    def _files(self) -> list[tuple[int, Path]]:
        matches = ((_NAME.fullmatch(path.name), path) for path in self._folder.iterdir())
        return sorted((int(match[1]), path) for match, path in matches if match)

    def _read(self) -> dict[int, float]:
        """The end of the last published element by naming address; a row that was cut off does not count."""
        ends: dict[int, float] = {}
        for _, path in self._files():
            content = path.read_bytes()
            rows = np.frombuffer(content[: len(content) // _ROW.itemsize * _ROW.itemsize], dtype=_ROW)
            for label, end_s in zip(rows["label"].tolist(), rows["end_s"].tolist(), strict=True):
                ends[label] = max(end_s, ends.get(label, end_s))
        return ends

    def _open(self) -> None:
        self._number += 1
        self._file = os.open(self._folder / f"published.{self._number}.journal", os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def added_to(self, snapshot: bytes) -> bytes:
        """A snapshot with what had been published after it. Raises ``SnapshotError``."""
        registration, until_s = snapshots.unpack(snapshot)
        for label, end_s in self._published.items():
            until_s[label] = max(end_s, until_s.get(label, end_s))
        return snapshots.pack(registration, until_s)

    def append(self, points: FusedPoints) -> None:
        """Note element points that are about to be published; a ``T`` number is never used again, so it needs none."""
        named = points.label >= 0
        rows = np.empty(int(named.sum()), dtype=_ROW)
        rows["label"], rows["end_s"] = points.label[named], points.span_s[named, 1]
        if len(rows):
            os.write(self._file, rows.tobytes())

    def begin_file(self) -> list[Path]:
        """Go on in a new file; returns those before it, to be removed once a snapshot made now is on disk."""
        before = self.files()
        os.close(self._file)
        self._open()
        return before

    def files(self) -> list[Path]:
        """All files there are."""
        return [path for _, path in self._files()]

    def close(self) -> None:
        """Stop writing."""
        with contextlib.suppress(OSError):
            os.close(self._file)
