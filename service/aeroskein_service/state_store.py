"""What must survive a restart, in one folder: which track numbers are taken, and the engine's own snapshot.

Numbers are reserved in blocks before they are used, so that a crash costs at most a block and never uses one twice.
Every file is replaced whole: written beside, synced, renamed.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

__all__ = ["StateError", "StateStore"]

NUMBERS: Final = "numbers.json"
SNAPSHOT: Final = "engine.snapshot"
# Numbers reserved at once, and how many must be left before the next block: seconds of work at 20,000 new tracks.
BLOCK: Final = 20_000
SLACK: Final = 10_000


class StateError(RuntimeError):
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
        self.first_number = 1
        self._reserved = 1
        if self._folder is None:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self.first_number = self._reserved = self._read_numbers()
            self._write_numbers(self.first_number + BLOCK)
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

    def snapshot(self) -> bytes | None:
        """What the engine wrote last, None on a clean start."""
        if self._folder is None:
            return None
        try:
            return (self._folder / SNAPSHOT).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StateError(f"service.state_dir: {self._folder} cannot be read: {error.strerror}") from error

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
            self._jobs.put(lambda: self._replace(SNAPSHOT, snapshot))

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
        with contextlib.suppress(OSError):
            self._write_numbers(next_number)
            if snapshot is not None:
                self._replace(SNAPSHOT, snapshot)

    def abandon(self) -> None:
        """Stop without a final state: what is on the disk already is what counts."""
        if self._writer is not None:
            self._jobs.put(None)
            self._writer.join()
            self._writer = None

    def _write_on(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except OSError as error:
                self._complain(f"service.state_dir: {self._folder} cannot be written: {error.strerror}")
            if self._jobs.empty():
                self._busy.clear()
