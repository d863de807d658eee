"""The page as a child of the service: ``python -m aeroskein_service.web.child``, started by ``page_process``.

Standard input holds one line of JSON, the configuration and what was handed over, and then stays open: however the
service dies, the pipe closes and the page ends too. The password of the router is thus in no list of processes.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading

import msgspec

from aeroskein_service.config import Config
from aeroskein_service.log import configure
from aeroskein_service.signals import end_within, stop_on_signals
from aeroskein_service.web.page import show_page

STOP_S = 3.0


class Handover(msgspec.Struct):
    """What the service gives its page: the listening socket's number, and where the service answers."""

    listener: int
    service_url: str
    config: msgspec.Raw


def _end_with_parent() -> None:
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


def main() -> None:
    """Serve until the service ends."""
    stop = stop_on_signals()
    given = msgspec.json.decode(sys.stdin.buffer.readline(), type=Handover)
    config = Config.model_validate_json(bytes(given.config), strict=True)
    configure(config.log)
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    with socket.socket(fileno=given.listener) as listener:
        show_page(config, listener, stop, service_url=given.service_url)
    end_within(STOP_S)


if __name__ == "__main__":
    main()
