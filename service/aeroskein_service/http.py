"""Health and metrics over HTTP: ``/livez``, ``/readyz`` and ``/metrics`` from a small thread of their own.

It reads finished values only, so that a scrape never waits for the worker nor the worker for a scrape. Its own port is
a free one on 127.0.0.1; at ``http.listen`` is the page, which passes these three on.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Awaitable, Callable, Sequence
from typing import Final, Self

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from aeroskein.errors import AeroskeinError
from aeroskein_service.metrics import CONTENT_TYPE

__all__ = ["HealthServer", "ListenError", "bind", "url_of"]

STOP_S: Final = 2.0  # a client that keeps its connection open does not keep the service


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
        self._listener = listener
        self.url = url_of(listener)
        application = Starlette(
            routes=[
                Route("/livez", _reasons(live)),
                Route("/readyz", _reasons(ready)),
                Route("/metrics", _metrics(metrics)),
            ]
        )
        config = uvicorn.Config(
            application,
            log_config=None,
            log_level="warning",
            access_log=False,
            lifespan="off",
            ws="none",
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [listener]}, name="http", daemon=True
        )
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop serving and free the address."""
        self._server.should_exit = True
        self._thread.join(STOP_S)
        self._listener.close()


def _reasons(reasons: Callable[[], Sequence[str]]) -> Callable[[Request], Awaitable[Response]]:
    async def respond(_request: Request) -> Response:
        why = list(reasons())
        return JSONResponse({"ok": not why, "reasons": why}, status_code=503 if why else 200)

    return respond


def _metrics(metrics: Callable[[], bytes]) -> Callable[[Request], Awaitable[Response]]:
    async def respond(_request: Request) -> Response:
        return Response(metrics(), media_type=CONTENT_TYPE)

    return respond
