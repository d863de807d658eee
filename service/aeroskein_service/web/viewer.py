"""One browser: what it looks at, and the loop that sends it the newest picture whenever it is ready for one.

There is no queue. A picture is made when it is sent; a browser that is slow to draw, or a connection that is slow, gets
the newest one when it is ready again, and the number of those it missed. A browser says ``shown`` for each frame that
it has drawn; a program that never says so gets the next frame as soon as the connection has taken the last.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Final

import numpy as np

from aeroskein_service.web.frames import Head, pack_frame
from aeroskein_service.web.records import Records, in_box
from aeroskein_service.web.requests import Shown, View

__all__ = ["Viewer"]

# A browser that has drawn frames but not this one is asked no more than this long; then it gets another. [s]
PATIENCE_S: Final = 10.0
# Below this many tracks the whole picture is sent: a table of all of them is then at hand. 1,500 are 78 kB.
WHOLE_BELOW: Final = 1500

# Hijacked, no radio, in distress: these are sent to everybody wherever they look.
EMERGENCIES: Final = (0o7500, 0o7600, 0o7700)

Send = Callable[[bytes], Awaitable[None]]


class Viewer:
    """What one connection looks at and has got so far.

    Parameters
    ----------
    send : callable
        Sends one binary message and waits while the connection is full.
    """

    def __init__(self, send: Send) -> None:
        self._send = send
        self._view = View()
        self._drawn = asyncio.Event()
        self._drawn.set()
        self._answers = False
        self._last_tick: int | None = None
        self.frame = 0
        self.skipped = 0
        self.sent_bytes = 0
        self.wanted = asyncio.Event()  # set when the browser wants a picture before the next second
        self.broken = 0  # messages of it that were not understood

    def look(self, view: View) -> None:
        """Show something else from now on, beginning at once."""
        self._view = view
        self.wanted.set()

    def shown(self, shown: Shown) -> None:
        """The browser has drawn a frame."""
        self._answers = True
        if shown.frame >= self.frame:
            self._drawn.set()

    async def ready(self) -> None:
        """Wait until the browser has drawn what it was sent."""
        if self._answers:
            try:
                await asyncio.wait_for(self._drawn.wait(), PATIENCE_S)
            except TimeoutError:
                self._answers = False

    async def send(self, head: Head, records: Records, tick: int) -> None:
        """Send the part of a picture that is in view; ``tick`` counts the pictures there were."""
        if self._last_tick is not None:
            self.skipped += max(tick - self._last_tick - 1, 0)
        self._last_tick = tick
        self.frame = head.frame
        if self._answers:
            self._drawn.clear()
        payload = pack_frame(head._replace(skipped=self.skipped, sent_s=time.time()), self._in_view(records))
        self.sent_bytes += len(payload)
        await self._send(payload)

    def _in_view(self, records: Records) -> Records:
        box = self._view.box
        if box is None or len(records) <= WHOLE_BELOW:
            return records
        inside = in_box(records, box) | np.isin(records["mode_a"], EMERGENCIES)
        if self._view.pinned:
            inside |= np.isin(records["number"], self._view.pinned)
        return records[inside]
