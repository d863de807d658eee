"""Health and metrics over HTTP: ``/livez``, ``/readyz`` and ``/metrics`` from a small thread of their own.

It reads finished values only, so that a scrape never waits for the worker nor the worker for a scrape. Its own port is
a free one on 127.0.0.1; at ``http.listen`` is the page, which passes these three on.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Mapping, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final, NamedTuple, Self

from aeroskein.errors import AeroskeinError
from aeroskein_service.metrics import CONTENT_TYPE

__all__ = ["HealthServer", "ListenError", "bind", "url_of"]

CLIENT_S: Final = 5.0  # a client that says nothing for so long is hung up on


class ListenError(AeroskeinError):
    """The address cannot be listened at; the message is one sentence for the operator."""


def bind(listen: str) -> socket.socket:
    """A listening socket for ``host:port`` (port 0: a free one). Raises ``ListenError``."""
    host, _, port = listen.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdigit() or int(port) > 65535:
        raise ListenError(f"http.listen: {listen!r} is no address, expected for example '127.0.0.1:8080'")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, int(port)))
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise ListenError(
            f"http.listen: cannot listen at {listen}: {(error.strerror or str(error)).lower()}"
        ) from error
    return listener


def url_of(listener: socket.socket) -> str:
    """The address of a listening socket for people and programs."""
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


class HealthServer:
    """Serves in the background from construction until ``close``.

    Parameters
    ----------
    listener : socket
        From ``bind``.
    live, ready : callable
        Reasons why the process is not live or not ready, as sentences; none where it is.
    metrics : callable
        The metrics as text.
    """

    def __init__(
        self,
        listener: socket.socket,
        *,
        live: Callable[[], Sequence[str]],
        ready: Callable[[], Sequence[str]],
        metrics: Callable[[], bytes],
    ) -> None:
        self.url = url_of(listener)
        answers = {"/livez": _reasons(live), "/readyz": _reasons(ready), "/metrics": _metrics(metrics)}
        self._server = _Server(listener, answers)
        self._thread = threading.Thread(target=self._server.serve_forever, name="http", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop serving and free the address."""
        self._server.shutdown()
        self._server.server_close()


class _Answer(NamedTuple):
    status: int
    media_type: str
    body: bytes


def _reasons(reasons: Callable[[], Sequence[str]]) -> Callable[[], _Answer]:
    def answer() -> _Answer:
        why = list(reasons())
        body = json.dumps({"ok": not why, "reasons": why}).encode()
        return _Answer(503 if why else 200, "application/json", body)

    return answer


def _metrics(metrics: Callable[[], bytes]) -> Callable[[], _Answer]:
    return lambda: _Answer(200, CONTENT_TYPE, metrics())


class _Server(ThreadingHTTPServer):
    """Serves on a socket that listens already."""

    daemon_threads = True

    def __init__(self, listener: socket.socket, answers: Mapping[str, Callable[[], _Answer]]) -> None:
        super().__init__(listener.getsockname()[:2], _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self.answers = answers


class _Handler(BaseHTTPRequestHandler):
    """Answers GET for the three paths."""

    timeout = CLIENT_S
    server: _Server

    def do_GET(self) -> None:
        made = self.server.answers.get(self.path.partition("?")[0])
        answer = _Answer(404, "text/plain", b"not found") if made is None else made()
        self.send_response(answer.status)
        self.send_header("content-type", answer.media_type)
        self.send_header("content-length", str(len(answer.body)))
        self.end_headers()
        self.wfile.write(answer.body)

    def log_message(self, *_: object) -> None:
        """Health checks come every few seconds; nobody wants to read of them."""
