"""The page beside the service: a child process on the listening socket, started again when it fails.

The service listens and hands the socket over, so a taken address is found out at once, a page that is started again
loses no visitor, and nothing that browsers do takes processor time from the worker's interpreter.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from typing import Final, Self

import structlog

from aeroskein_service.config import Config

__all__ = ["PageProcess"]

AGAIN_S: Final = 1.0  # before a page that has ended is started again; doubled each time
AGAIN_MOST_S: Final = 30.0
STEADY_S: Final = 60.0  # a page that has run this long begins with the short wait again
STOP_S: Final = 2.0  # time to end in order


class PageProcess:
    """Runs from construction until ``close``.

    Parameters
    ----------
    listener : socket
        Where the browsers come; stays open here too, so that nobody is turned away between two starts.
    config : Config
        What the page is told.
    service_url : str
        Where the service answers ``/livez``, ``/readyz`` and ``/metrics``.
    """

    def __init__(self, listener: socket.socket, config: Config, service_url: str) -> None:
        self._listener = listener
        handover = {
            "listener": listener.fileno(),
            "service_url": service_url,
            "config": config.model_dump(mode="json"),
        }
        self._handover = json.dumps(handover).encode() + b"\n"
        self._log = structlog.get_logger("aeroskein.page")
        self._ending = threading.Event()
        self._child = self._start()
        self._watcher = threading.Thread(target=self._watch, name="page", daemon=True)
        self._watcher.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Process number of the page."""
        return self._child.pid

    def _start(self) -> subprocess.Popen[bytes]:
        child = subprocess.Popen(
            [sys.executable, "-m", "aeroskein_service.web.child"],
            stdin=subprocess.PIPE,
            pass_fds=(self._listener.fileno(),),
            start_new_session=True,  # Ctrl-C reaches the service, which ends its page in order
        )
        assert child.stdin is not None
        try:
            child.stdin.write(self._handover)
            child.stdin.flush()
        except BrokenPipeError:
            pass  # it has ended already; the watcher sees that
        return child

    def _watch(self) -> None:
        wait_s = AGAIN_S
        while not self._ending.is_set():
            try:
                self._child.wait(STEADY_S)
            except subprocess.TimeoutExpired:
                wait_s = AGAIN_S
                continue
            if self._ending.is_set():
                return
            self._log.error("page_ended", status=self._child.returncode, again_in_s=wait_s)
            if self._ending.wait(wait_s):
                return
            wait_s = min(2.0 * wait_s, AGAIN_MOST_S)
            self._child = self._start()

    def end(self) -> None:
        """Ask it to end, without waiting."""
        self._ending.set()
        self._child.terminate()

    def close(self) -> None:
        """End it and wait, by force after two seconds; then nobody listens any more."""
        self.end()
        try:
            self._child.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._watcher.join(STOP_S)
        if self._child.stdin is not None:
            self._child.stdin.close()
        self._listener.close()
