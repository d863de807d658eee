"""What a browser may say on its WebSocket: four small messages, and nothing else.

Everything is checked by type and range before it is used; what does not fit is counted, and a client that keeps sending
such things is dismissed.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

import msgspec

from aeroskein_service.codec import MessageError

__all__ = ["MESSAGE_BYTES", "Play", "Request", "Seek", "Shown", "View", "read_request"]

MESSAGE_BYTES: Final = 4096  # the largest message a browser may send
MOST_PINNED: Final = 16  # tracks that are sent whether they are in view or not

_Latitude = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
_Longitude = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
_Number = Annotated[int, msgspec.Meta(ge=0, le=0xFFFFFFFF)]


class View(msgspec.Struct, tag="view", tag_field="type", forbid_unknown_fields=True):
    """What the map shows: ``lat_min, lon_min, lat_max, lon_max``, or everything; and tracks that are always wanted."""

    box: tuple[_Latitude, _Longitude, _Latitude, _Longitude] | None = None
    pinned: Annotated[list[_Number], msgspec.Meta(max_length=MOST_PINNED)] = msgspec.field(default_factory=list)


class Shown(msgspec.Struct, tag="shown", tag_field="type", forbid_unknown_fields=True):
    """This frame has been drawn; the next one may come."""

    frame: _Number


class Seek(msgspec.Struct, tag="seek", tag_field="type", forbid_unknown_fields=True):
    """Jump to this instant of a replay. [s since the epoch]"""

    time_s: Annotated[float, msgspec.Meta(ge=0.0, le=1e11)]


class Play(msgspec.Struct, tag="play", tag_field="type", forbid_unknown_fields=True):
    """Let time pass in a replay, this many times as fast as it did, or stop it."""

    on: bool
    speed: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] = 1.0


Request = View | Shown | Seek | Play

_DECODER: Final = msgspec.json.Decoder(Request)


def read_request(text: str | bytes) -> Request:
    """One message of a browser. Raises ``MessageError``."""
    try:
        request: Request = _DECODER.decode(text)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise MessageError(f"not understood: {error}") from None
    if isinstance(request, View) and request.box is not None:
        lat_min, _, lat_max, _ = request.box
        if not all(map(math.isfinite, request.box)) or lat_min > lat_max:
            raise MessageError("not understood: a box is lat_min, lon_min, lat_max, lon_max")
    return request
