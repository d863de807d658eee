"""Frames for the WebSocket: a head of 48 bytes and one record per aircraft in the client's view.

The first byte is the version; a page that was loaded before an update sees that and asks to be reloaded. The layout is
repeated in ``static/js/frame.js`` and in ``docs/web.md``.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from aeroskein_service.web.records import RECORD, Records

__all__ = ["HEAD", "PICTURE", "VERSION", "Head", "pack_frame", "unpack_frame"]

VERSION: Final = 1
PICTURE: Final = 1  # the only kind of frame so far

# version, kind, bytes of the head, frame number, time of the picture, time of sending, tracks in all, records here,
# frames this client has missed so far, seconds without news from the service, playing, connected, bytes of a record,
# speed of a replay
HEAD: Final = struct.Struct("<BBHIddIIIfBBHf")


class Head(NamedTuple):
    """What a frame says besides the aircraft.

    Attributes
    ----------
    frame : int
        Counts the pictures of the server; the numbers between two frames were skipped.
    time_s : float
        The instant that the picture shows. [s since the epoch]
    sent_s : float
        The server's clock when the frame was made. [s since the epoch]
    total : int
        Tracks in the whole picture, in view or not.
    skipped : int
        Pictures this client did not get because it was slow.
    silent_s : float
        How long the service has sent nothing; 0 in a replay. [s]
    playing, connected : bool
        Whether time passes, and whether the router is there.
    speed : float
        Of a replay, times real time.
    """

    frame: int
    time_s: float
    sent_s: float
    total: int
    skipped: int = 0
    silent_s: float = 0.0
    playing: bool = True
    connected: bool = True
    speed: float = 1.0


def pack_frame(head: Head, records: Records) -> bytes:
    """One frame as bytes."""
    packed = HEAD.pack(
        VERSION, PICTURE, HEAD.size, head.frame & 0xFFFFFFFF, head.time_s, head.sent_s, head.total, len(records),
        head.skipped, head.silent_s, head.playing, head.connected, RECORD.itemsize, head.speed,
    )  # fmt: skip
    return packed + records.tobytes()


def unpack_frame(payload: bytes) -> tuple[Head, Records]:
    """The other way round, for programs that read the page's frames. Raises ``ValueError``."""
    import numpy as np

    if len(payload) < HEAD.size or payload[0] != VERSION or payload[1] != PICTURE:
        raise ValueError("this is no frame of version 1")
    fields = HEAD.unpack_from(payload)
    _, _, size, frame, time_s, sent_s, total, count, skipped, silent_s, playing, connected, itemsize, speed = fields
    if itemsize != RECORD.itemsize or len(payload) != size + count * itemsize:
        raise ValueError("the frame has not the length that its head says")
    records = np.frombuffer(payload, dtype=RECORD, offset=size)
    return Head(frame, time_s, sent_s, total, skipped, silent_s, bool(playing), bool(connected), speed), records
