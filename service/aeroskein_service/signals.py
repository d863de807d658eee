"""Stopping on SIGINT and SIGTERM: the first one asks for an orderly end, the second one ends at once."""

from __future__ import annotations

import _thread
import os
import signal
import threading
from types import FrameType
from typing import Final

__all__ = ["end_within", "stop_on_signals"]

ENDED_AT_ONCE: Final = 1


def stop_on_signals() -> threading.Event:
    """An event that the first SIGINT or SIGTERM sets; main thread only."""
    stop, asked = threading.Event(), False

    def handle(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            os._exit(ENDED_AT_ONCE)
        asked = True
        # Not in this thread: it may be inside the event's own wait, with the lock that setting the event needs.
        _thread.start_new_thread(stop.set, ())

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    return stop


def end_within(seconds: float) -> threading.Timer:
    """End the process by force after this long, unless the timer is cancelled: nothing may hang a shutdown."""
    timer = threading.Timer(seconds, os._exit, args=(ENDED_AT_ONCE,))
    timer.daemon = True
    timer.start()
    return timer
