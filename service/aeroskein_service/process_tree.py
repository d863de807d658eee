"""Commands of ours as child processes: started together, watched, and ended together within a given time."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, Self

from aeroskein.errors import AeroskeinError

__all__ = ["ChildError", "ProcessTree"]

LOOK_S: Final = 0.2  # how often a child that died is looked for
ORDERLY_S: Final = 2.2  # time to end in order, for each of two groups; then it is ended by force


class ChildError(AeroskeinError):
    """A child ended by itself; the message says which one and what it said last."""


class ProcessTree:
    """Child processes that do not outlive this one.

    Parameters
    ----------
    folder : Path
        Gets a log file for each of them.
    stop : threading.Event
        Set when a child ends by itself.
    """

    def __init__(self, folder: Path, stop: threading.Event) -> None:
        self._folder = folder
        self._stop = stop
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._ending = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="children", daemon=True)
        self.died: str | None = None

    def __enter__(self) -> Self:
        self._watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def start(self, name: str, *arguments: str) -> None:
        """Start ``aeroskein <arguments>``."""
        with (self._folder / f"{name}.log").open("wb") as log:
            # A session of its own: Ctrl-C in the terminal reaches the parent, which ends its children in order.
            self._children[name] = subprocess.Popen(
                [sys.executable, "-m", "aeroskein_service.child", *arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def pids(self) -> dict[str, int]:
        """Process numbers by name."""
        return {name: child.pid for name, child in self._children.items()}

    def _watch(self) -> None:
        while not self._ending.wait(LOOK_S):
            for name, child in list(self._children.items()):
                status = child.poll()
                if status is not None and self.died is None:
                    self.died = f"{name} ended with status {status}: {self._last_words(name)}"
                    self._stop.set()
                    return

    def _last_words(self, name: str) -> str:
        lines = (self._folder / f"{name}.log").read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"

    def end(self, *, last: Sequence[str] = ()) -> None:
        """End all children, those in ``last`` after the others; returns when none is left."""
        self._ending.set()
        _end([child for name, child in self._children.items() if name not in last])
        _end([child for name, child in self._children.items() if name in last])
        for child in self._children.values():
            if child.stdin is not None:
                child.stdin.close()


def _end(children: Iterable[subprocess.Popen[bytes]]) -> None:
    running = [child for child in children if child.poll() is None]
    for child in running:
        child.terminate()
    ends_s = time.monotonic() + ORDERLY_S
    for child in running:
        try:
            child.wait(max(ends_s - time.monotonic(), 0.0))
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
