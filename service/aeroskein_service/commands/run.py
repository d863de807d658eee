"""``aeroskein run``: the fusion service, from the first wait for the router to the last status."""

from __future__ import annotations

import threading
from typing import Final

from aeroskein.errors import AeroskeinError
from aeroskein_service.config import Config
from aeroskein_service.service import Service
from aeroskein_service.signals import end_within, stop_on_signals
from aeroskein_service.supervisor import notify, watchdog_period_s
from aeroskein_service.transport import OpenCancelledError

__all__ = ["run"]

STOP_S: Final = 4.8  # an orderly end that takes longer is ended by force
LOOK_S: Final = 0.5  # how often a failed worker is looked for


class WorkerError(AeroskeinError):
    """The worker ended by itself; the log says where."""


def run(config: Config) -> int:
    """Run the service until SIGINT or SIGTERM.

    Returns
    -------
    int
        0 after an orderly end.

    Raises
    ------
    AeroskeinError
        Where it cannot start, or the worker failed; the message is one sentence.
    """
    stop = stop_on_signals()
    service = Service(config)
    try:
        service.start(stop)
        return _watch(service, stop)
    except OpenCancelledError:
        return 0
    finally:
        timer = end_within(STOP_S)
        service.stop()
        timer.cancel()


def _watch(service: Service, stop: threading.Event) -> int:
    """Wait for the end, and let the supervisor know how it goes."""
    notify("READY=1")
    period_s = watchdog_period_s()
    while not stop.wait(LOOK_S if period_s is None else min(LOOK_S, period_s)):
        if service.failure is not None:
            raise WorkerError(f"the worker failed: {service.failure!r}")
        if period_s is not None and not service.not_live():
            notify("WATCHDOG=1")
    notify("STOPPING=1")
    return 0
