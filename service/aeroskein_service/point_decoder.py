"""Fused points from bytes, for consumers: the page, ``watch``, recordings, evaluation."""

from __future__ import annotations

from typing import Any, Final, TypeVar

import msgspec

from aeroskein.errors import AeroskeinError
from aeroskein_service.batch_decoder import media_type
from aeroskein_service.messages import JSON, MSGPACK, Feed, FusedPoint

__all__ = ["MessageError", "decode_feed", "decode_point"]

_T = TypeVar("_T")

_POINTS: Final[dict[str, Any]] = {
    MSGPACK: msgspec.msgpack.Decoder(FusedPoint),
    JSON: msgspec.json.Decoder(FusedPoint),
}
_FEEDS: Final[dict[str, Any]] = {MSGPACK: msgspec.msgpack.Decoder(Feed), JSON: msgspec.json.Decoder(Feed)}


class MessageError(AeroskeinError, ValueError):
    """A payload that is not what its key promises."""


def decode_point(payload: bytes, encoding: str) -> FusedPoint:
    """One fused point. Raises ``MessageError``."""
    return _decoded(_POINTS, payload, encoding, FusedPoint)


def decode_feed(payload: bytes, encoding: str) -> Feed:
    """One feed message. Raises ``MessageError``."""
    return _decoded(_FEEDS, payload, encoding, Feed)


def _decoded(decoders: dict[str, Any], payload: bytes, encoding: str, kind: type[_T]) -> _T:
    decoder = decoders.get(media_type(encoding))
    if decoder is None:
        raise MessageError(f"encoding {encoding[:60]!r} is neither {MSGPACK!r} nor {JSON!r}")
    try:
        made = decoder.decode(payload)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise MessageError(f"the payload is no {kind.__name__}: {error}") from None
    assert isinstance(made, kind)
    return made
