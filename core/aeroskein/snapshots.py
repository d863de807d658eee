"""Snapshots: what must survive a restart, as bytes: registration, and how far each track had been published."""

from __future__ import annotations

import json
import math
from typing import Any, Final

from aeroskein.errors import SnapshotError

__all__ = ["pack", "unpack"]

VERSION: Final = 1


def pack(registration: dict[str, Any], published_until_s: dict[int, float]) -> bytes:
    """Content to bytes (JSON, so that an operator can read it)."""
    content = {
        "version": VERSION,
        "registration": registration,
        "published_until_s": {f"{address:06X}": end_s for address, end_s in sorted(published_until_s.items())},
    }
    return json.dumps(content, separators=(",", ":")).encode()


def unpack(data: bytes) -> tuple[dict[str, Any], dict[int, float]]:
    """Bytes to content. Raises ``SnapshotError`` where they are not a snapshot that this version can read."""
    try:
        content = json.loads(data)
        version, registration = content["version"], content["registration"]
        until = {int(address, 16): float(end_s) for address, end_s in content["published_until_s"].items()}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SnapshotError(f"the snapshot cannot be read: {error!r}") from error
    if version != VERSION or not isinstance(registration, dict):
        raise SnapshotError(f"snapshot of version {version!r}, expected {VERSION}")
    if not all(math.isfinite(end_s) for end_s in until.values()):
        raise SnapshotError("the snapshot holds a time that is no number")
    return registration, until
