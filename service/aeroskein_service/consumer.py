"""A consumer of fused points: follows the feed, or one track, into a bounded queue for whoever shows them."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final, Literal

from aeroskein_service.codec import MessageError, decode_feed, decode_point
from aeroskein_service.keys import Keys
from aeroskein_service.messages import FusedPoint
from aeroskein_service.transport import Session

__all__ = ["Consumer"]

MESSAGES: Final = 20_000  # messages that may wait; the oldest go first, which shows as holes in ``seq``


class Consumer:
    """Subscribes at once; ``take`` gives what has come since the last call.

    Parameters
    ----------
    session : Session
    keys : Keys
    product : {"live", "element"}
    track : str, optional
        Only this track, from its own key; without it all tracks, from the feed, without loss.
    """

    def __init__(
        self, session: Session, keys: Keys, product: Literal["live", "element"], track: str | None = None
    ) -> None:
        self._waiting: deque[tuple[bytes, str]] = deque(maxlen=MESSAGES)
        self._news = threading.Event()
        self._single = track is not None
        self.broken = 0
        if track is not None:
            session.subscribe(keys.fused(product, track), self._note)
        else:
            session.subscribe_recovering(keys.feed(product), self._note)

    def _note(self, _key: str, payload: bytes, encoding: str) -> None:
        self._waiting.append((payload, encoding))
        self._news.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait for news; whether there are some."""
        return self._news.wait(timeout_s)

    def take(self) -> list[FusedPoint]:
        """All points that wait, in order of arrival; what cannot be read is counted in ``broken``."""
        self._news.clear()
        points: list[FusedPoint] = []
        while self._waiting:
            payload, encoding = self._waiting.popleft()
            try:
                if self._single:
                    points.append(decode_point(payload, encoding))
                else:
                    points += decode_feed(payload, encoding).points
            except MessageError:
                self.broken += 1
        return points
