"""The page served: one event loop with uvicorn, on a socket that is listening already."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import threading
from collections.abc import Iterator
from typing import Final

import uvicorn
from starlette.applications import Starlette

from aeroskein_service.web.requests import MESSAGE_BYTES

__all__ = ["serve"]

STOP_S: Final = 1  # connections that do not end by themselves are ended
LOOK_S: Final = 0.1
PING_S: Final = 20.0  # a browser that has gone without a word is noticed after twice this


def serve(app: Starlette, listener: socket.socket, stop: threading.Event) -> None:
    """Serve until ``stop`` is set."""
    # What uvicorn would say about every connection is said by the metrics.
    logging.getLogger("uvicorn.error").setLevel(logging.WARNING)
    config = uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        lifespan="on",
        ws="auto",
        ws_max_size=MESSAGE_BYTES,
        # Compression would cost 25 times what everything else of a frame costs, and frames hardly shrink.
        ws_per_message_deflate=False,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PING_S,
        timeout_graceful_shutdown=STOP_S,
        h11_max_incomplete_event_size=32_768,
        server_header=False,
    )
    server = _Server(config)

    async def run() -> None:
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not stop.is_set() and not serving.done():
            await asyncio.sleep(LOOK_S)
        server.should_exit = True
        await serving

    asyncio.run(run())


class _Server(uvicorn.Server):
    """Leaves the signals to the process."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Nothing."""
        yield
