"""Everything else that is sent: registration states, replies to queries, and any message made of plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from math import isfinite
from typing import Any

import msgspec

from aeroskein.events import RegistrationState
from aeroskein_service.messages import JSON, VERSION, RegistrationMessage, Report

__all__ = [
    "encode_message",
    "encode_registration",
    "encode_reports_reply",
    "encode_tracks_reply",
    "registration_message",
]


def encode_message(message: Any, content_type: str) -> bytes:
    """Plain values or structs as one payload; floats that are no numbers become null."""
    sendable = _sendable(message)
    return msgspec.json.encode(sendable) if content_type == JSON else msgspec.msgpack.encode(sendable)


def registration_message(state: RegistrationState) -> RegistrationMessage:
    """A registration state as it is sent; a number that is not known is null."""
    values = {field.name: _sendable(getattr(state, field.name)) for field in fields(state)}
    return RegistrationMessage(version=VERSION, **values)


def encode_registration(state: RegistrationState, content_type: str) -> bytes:
    """One registration state as one payload."""
    return encode_message(registration_message(state), content_type)


def encode_tracks_reply(payloads: Sequence[bytes], content_type: str, *, time_s: float, truncated: bool) -> bytes:
    """Encoded points as the reply to ``query/tracks``."""
    points = [msgspec.Raw(payload) for payload in payloads]
    return encode_message(_reply(time_s, truncated, "tracks", points), content_type)


def encode_reports_reply(
    reports: Mapping[str, Sequence[Report]], content_type: str, *, time_s: float, truncated: bool
) -> bytes:
    """Reports by sensor as the reply to ``query/reports``."""
    return encode_message(_reply(time_s, truncated, "reports", reports), content_type)


def _reply(time_s: float, truncated: bool, name: str, content: Any) -> dict[str, Any]:
    reply = {"version": VERSION, "time_s": time_s, name: content}
    return reply | {"truncated": True} if truncated else reply


def _sendable(value: Any) -> Any:
    """NaN and infinities are never sent."""
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, dict):
        return {key: _sendable(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_sendable(inner) for inner in value]
    return value
