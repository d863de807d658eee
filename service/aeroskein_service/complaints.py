"""Warnings about input, at most one of a kind in ten seconds: a broken sensor must not fill the disk.

What was held back is counted and said with the next line.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

__all__ = ["Complaints"]

QUIET_S: Final = 10.0


class Complaints:
    """Rate-limited warnings.

    Parameters
    ----------
    log : logger
        Where they go.
    clock : callable
        Gives a time that never goes back. [s]
    """

    def __init__(self, log: Any, clock: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._clock = clock
        self._said_s: dict[tuple[str, str], float] = {}
        self._held: dict[tuple[str, str], int] = {}

    def warn(self, event: str, *, sensor: str, **details: Any) -> None:
        """Warn, unless the same event of the same sensor was warned about in the last ten seconds."""
        kind, now_s = (event, sensor), self._clock()
        if now_s - self._said_s.get(kind, -QUIET_S) < QUIET_S:
            self._held[kind] = self._held.get(kind, 0) + 1
            return
        self._said_s[kind] = now_s
        self._log.warning(event, sensor=sensor, **details, not_shown=self._held.pop(kind, 0))
