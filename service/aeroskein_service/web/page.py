"""The page as a process: what it needs to start, whichever way it was started, and its orderly end."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

from aeroskein_service.config import Config
from aeroskein_service.web.app import make_app
from aeroskein_service.web.live_source import LiveSource
from aeroskein_service.web.server import serve
from aeroskein_service.web.source import Source

__all__ = ["show_page"]


def show_page(
    config: Config,
    listener: socket.socket,
    stop: threading.Event,
    *,
    source: Source | None = None,
    service_url: str | None = None,
) -> None:
    """Serve the page until ``stop`` is set.

    Parameters
    ----------
    config : Config
        Its sections ``http``, ``zenoh`` and ``area``, and the sensors where there are some.
    listener : socket
        Where the browsers come.
    stop : threading.Event
        Ends it.
    source : Source, optional
        What is shown; the running service where absent.
    service_url : str, optional
        Where the service behind the page answers its health checks.
    """
    app = make_app(
        source or LiveSource(config),
        host=listener.getsockname()[0],
        origins=config.http.origins,
        viewers=config.http.viewers,
        layers=[Path(path) for path in config.http.layers],
        service_url=service_url,
    )
    serve(app, listener, stop)
