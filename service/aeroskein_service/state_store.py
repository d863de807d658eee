"""What must survive a restart, in one folder: which track numbers are taken, registration, and what was published.

Numbers are reserved in blocks before they are used, so that a crash costs at most a block and never uses one twice.
Every file is replaced whole: written beside, synced, renamed.
"""

from __future__ import annotations

import json
import os
import queue
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from aeroskein.errors import AeroskeinError
from aeroskein.points import FusedPoints
from aeroskein_service.journal import ElementJournal

__all__ = ["StateError", "StateStore"]

NUMBERS: Final = "numbers.json"
SNAPSHOT: Final = "engine.snapshot"
# Numbers reserved at once, and how many must be left before the next block: seconds of work at 20,000 new tracks.
BLOCK: Final = 20_000
SLACK: Final = 10_000


class StateError(AeroskeinError):
    """The folder cannot be used; the message is one sentence for the operator."""


class StateStore:
    """The folder ``service.state_dir``; without one nothing is kept and numbers start at 1.

    Raises ``StateError`` where the folder cannot be made, written or read.
    """

    def __init__(self, folder: str, *, complain: Callable[[str], None] = lambda _sentence: None) -> None:
        self._folder = Path(folder) if folder else None
        self._complain = complain
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._busy = threading.Event()
        self._writer: threading.Thread | None = None
        self._journal: ElementJournal | None = None
        self.first_number = 1
        self._reserved = 1
        if self._folder is None:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self.first_number = self._reserved = self._read_numbers()
            self._write_numbers(self.first_number + BLOCK)
            self._journal = ElementJournal(self._folder)
        except OSError as error:
            raise StateError(f"service.state_dir: {folder} cannot be used: {error.strerror}") from error
        self._writer = threading.Thread(target=self._write_on, name="state-store", daemon=True)
        self._writer.start()

    def _read_numbers(self) -> int:
        assert self._folder is not None
        path = self._folder / NUMBERS
        if not path.exists():
            return 1
        try:
            next_number = json.loads(path.read_bytes())["next_track_number"]
        except (ValueError, KeyError, TypeError):
            next_number = None
        if not isinstance(next_number, int) or next_number < 1:
            raise StateError(f"service.state_dir: {path} is damaged; restore it, or remove it to start at number 1")
        return next_number

    def _write_numbers(self, reserved: int) -> None:
        self._replace(NUMBERS, json.dumps({"version": 1, "next_track_number": reserved}).encode())
        self._reserved = reserved

    def _write_snapshot(self, snapshot: bytes, covered: Sequence[Path]) -> None:
        self._replace(SNAPSHOT, snapshot)
        for path in covered:
            path.unlink(missing_ok=True)

    def _cannot_write(self, error: OSError) -> None:
        self._complain(f"service.state_dir: {self._folder} cannot be written: {error.strerror}")

    def _replace(self, name: str, content: bytes) -> None:
        assert self._folder is not None
        beside = self._folder / f".{name}.new"
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self._folder / name)
        folder = os.open(self._folder, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def snapshot(self, fresh: bytes) -> bytes | None:
        """What an engine has to restore: the last snapshot, or ``fresh``, and what was published after it.

        None without a folder. Raises ``SnapshotError``, or ``StateError`` where the folder cannot be read.
        """
        if self._folder is None or self._journal is None:
            return None
        try:
            path = self._folder / SNAPSHOT
            return self._journal.added_to(path.read_bytes() if path.exists() else fresh)
        except OSError as error:
            raise StateError(f"service.state_dir: {self._folder} cannot be read: {error.strerror}") from error

    def note_published(self, points: FusedPoints) -> None:
        """Write down element points before they are published."""
        if self._journal is not None:
            try:
                self._journal.append(points)
            except OSError as error:
                self._cannot_write(error)

    def wants_snapshot(self) -> bool:
        """Whether there is a folder, and the last snapshot has been written."""
        return self._writer is not None and not self._busy.is_set()

    def keep(self, next_number: int, snapshot: bytes | None) -> None:
        """Reserve numbers ahead of ``next_number`` and keep the snapshot; returns at once."""
        if self._writer is None:
            return
        if next_number + SLACK > self._reserved:
            # Counted as reserved only when it is on the disk: see ``covers``.
            self._jobs.put(lambda: self._write_numbers(next_number + BLOCK))
        if snapshot is not None:
            self._busy.set()
            covered = [] if self._journal is None else self._journal.begin_file()
            self._jobs.put(lambda: self._write_snapshot(snapshot, covered))

    def covers(self, next_number: int) -> bool:
        """Whether every number below ``next_number`` is reserved on the disk."""
        return self._folder is None or next_number <= self._reserved

    def reserve_now(self, next_number: int) -> None:
        """Reserve at once: for the burst that outran the block."""
        if self._folder is not None:
            self._write_numbers(next_number + BLOCK)

    def close(self, next_number: int, snapshot: bytes | None) -> None:
        """Write the final state and stop; gives back the numbers that were reserved and not used."""
        if self._writer is None:
            return
        self.abandon()
        try:
            self._write_numbers(next_number)
            if snapshot is not None and self._journal is not None:
                self._write_snapshot(snapshot, self._journal.files())
        except OSError as error:
            self._cannot_write(error)

    def abandon(self) -> None:
        """Stop without a final state: what is on the disk already is what counts."""
        if self._writer is not None:
            self._jobs.put(None)
            self._writer.join()
            self._writer = None
        if self._journal is not None:
            self._journal.close()

    def _write_on(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except OSError as error:
                self._cannot_write(error)
            if self._jobs.empty():
                self._busy.clear()
