"""What the page shows, whether it happens now or is replayed: the questions that the server puts to either.

``live_source`` follows a running service over Zenoh, ``replay_source`` plays a file. A browser gets a stream of its
own, so that each viewer of a replay has their own clock.
"""

from __future__ import annotations

import asyncio
from typing import Any, Literal, NamedTuple, Protocol

from aeroskein.errors import AeroskeinError
from aeroskein_service.web.frames import Head
from aeroskein_service.web.records import Records
from aeroskein_service.web.requests import Play, Seek

__all__ = ["Box", "NotNowError", "Picture", "Source", "Stream", "UnknownTrackError"]

Box = tuple[float, float, float, float]
"""``lat_min, lon_min, lat_max, lon_max`` [deg]."""


class UnknownTrackError(AeroskeinError):
    """There is no such track; the message is a sentence for the browser."""


class NotNowError(AeroskeinError):
    """The answer cannot be had at the moment; the message is a sentence for the browser."""


class Picture(NamedTuple):
    """All aircraft at one instant; ``tick`` counts the pictures, so that missed ones can be counted."""

    head: Head
    records: Records
    tick: int


class Stream(Protocol):
    """The pictures for one browser."""

    async def next(self, wanted: asyncio.Event) -> Picture:
        """Wait until there is another picture, or ``wanted`` is set."""
        ...

    def control(self, request: Seek | Play) -> bool:
        """Let the browser's clock run, stand or jump; false where there is none to control."""
        ...


class Source(Protocol):
    """Everything the page can be asked for."""

    kind: Literal["live", "replay"]

    def stream(self) -> Stream:
        """A stream for one more browser."""
        ...

    def describe(self) -> dict[str, Any]:
        """What a browser needs to know before the first picture."""
        ...

    def status(self) -> dict[str, Any]:
        """What goes to every browser once a second beside the picture."""
        ...

    def history(self) -> dict[str, Any]:
        """Rates and registration over the last minutes."""
        ...

    def search(self, text: str, most: int, at_s: float | None) -> list[dict[str, Any]]:
        """Tracks that match a text, best first."""
        ...

    def track(self, label: str, at_s: float | None) -> dict[str, Any]:
        """The newest point of a track and the way it came. Raises ``UnknownTrackError``."""
        ...

    def trails(self, of: Box | frozenset[int] | None, seconds: float, most: int, at_s: float | None) -> bytes:
        """Where the tracks in a box, or those of some numbers, or all have been."""
        ...

    async def elements(self, label: str, at_s: float | None) -> dict[str, Any]:
        """The last elements of a track. Raises ``UnknownTrackError`` and ``NotNowError``."""
        ...

    async def start(self) -> None:
        """Begin."""
        ...

    async def stop(self) -> None:
        """End."""
        ...
