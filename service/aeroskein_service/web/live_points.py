"""Live points from the feed, read no further than a picture needs: half the cost of reading every field.

What a picture does not need is still at hand: ``whole_point`` decodes one point of a kept message in full.
"""

from __future__ import annotations

from typing import Any, Final

import msgspec

from aeroskein_service.codec import MessageError, decode_feed, media_type
from aeroskein_service.messages import FLAG_NAMES, JSON, MSGPACK, STATUS_NAMES, FusedPoint

__all__ = ["LivePoint", "flag_bits", "read_messages", "read_point", "source_names", "whole_point"]


class LivePoint(msgspec.Struct, gc=False):
    """What a picture needs of a live point; see ``messages.FusedPoint``."""

    track: str
    track_number: int
    time_s: float
    status: str
    sources: msgspec.Raw
    flags: msgspec.Raw
    address: str | None = None
    callsign: str | None = None
    mode_a: str | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    altitude_m: float | None = None
    ground_speed_mps: float | None = None
    track_angle_deg: float | None = None
    vertical_rate_mps: float | None = None
    position_cov_m2: tuple[float, float, float] | None = None
    master: str | None = None
    input_received_s: float | None = None


class _Feed(msgspec.Struct, gc=False):
    """One message of ``feed/live``, its points not read yet."""

    epoch: int
    points: list[msgspec.Raw]


_FEEDS: Final[dict[str, Any]] = {MSGPACK: msgspec.msgpack.Decoder(_Feed), JSON: msgspec.json.Decoder(_Feed)}
_POINTS: Final[dict[str, Any]] = {MSGPACK: msgspec.msgpack.Decoder(LivePoint), JSON: msgspec.json.Decoder(LivePoint)}
_RAW: Final[dict[str, Any]] = {MSGPACK: msgspec.msgpack.decode, JSON: msgspec.json.decode}
STATUS_INDEX: Final = {name: index for index, name in enumerate(STATUS_NAMES)}
_FLAG_BIT: Final = {name: 1 << bit for bit, name in enumerate(FLAG_NAMES)}


def read_messages(payload: bytes, encoding: str) -> tuple[int, list[msgspec.Raw]]:
    """Epoch and points of one message. Raises ``MessageError``."""
    feed = _decoded(_FEEDS, payload, encoding, "feed message")
    return feed.epoch, feed.points


def read_point(payload: bytes, encoding: str) -> LivePoint:
    """One point. Raises ``MessageError``."""
    point: LivePoint = _decoded(_POINTS, payload, encoding, "point")
    return point


def _decoded(decoders: dict[str, Any], payload: bytes, encoding: str, what: str) -> Any:
    decoder = decoders.get(media_type(encoding))
    if decoder is None:
        raise MessageError(f"encoding {encoding[:60]!r} is not one of the contract")
    try:
        return decoder.decode(payload)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise MessageError(f"the payload is no {what}: {error}") from None


def whole_point(payload: bytes, encoding: str, track_number: int) -> FusedPoint:
    """The newest point of a track in a message, with every field."""
    return next(p for p in reversed(decode_feed(payload, encoding).points) if p.track_number == track_number)


def source_names(raw: bytes, encoding: str) -> tuple[str, ...]:
    """The sensors in a point's ``sources``."""
    value = _RAW[media_type(encoding)](raw)
    return tuple(name for name, many in value.items() if many) if isinstance(value, dict) else ()


def flag_bits(raw: bytes, encoding: str) -> int:
    """A point's ``flags`` as bits."""
    value = _RAW[media_type(encoding)](raw)
    return sum(_FLAG_BIT.get(name, 0) for name in set(value)) if isinstance(value, list) else 0
