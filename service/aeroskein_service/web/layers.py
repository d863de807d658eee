"""GeoJSON files that the operator adds to the map: airspace, routes. Read when the server starts, and checked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from aeroskein.errors import AeroskeinError

__all__ = ["LayerError", "LayerFiles"]

LARGEST: Final = 50_000_000  # bytes of one file
_KINDS: Final = {
    "FeatureCollection", "Feature", "GeometryCollection", "Point", "MultiPoint", "LineString", "MultiLineString",
    "Polygon", "MultiPolygon",
}  # fmt: skip


class LayerError(AeroskeinError):
    """A file that is no GeoJSON; the message is one sentence."""

    exit_status: Final = 2


class LayerFiles:
    """The layers, in the order in which they were given.

    Raises ``LayerError`` for a file that cannot be used.
    """

    def __init__(self, paths: Sequence[Path] = ()) -> None:
        self._contents = [(path.stem, _checked(path)) for path in paths]

    def names(self) -> list[str]:
        """What each is called: its file's name."""
        return [name for name, _ in self._contents]

    def content(self, number: int) -> bytes | None:
        """The file, None where there is none of that number."""
        return self._contents[number][1] if 0 <= number < len(self._contents) else None


def _checked(path: Path) -> bytes:
    try:
        if path.stat().st_size > LARGEST:
            raise LayerError(f"http.layers: {path} is larger than {LARGEST // 1_000_000} MB")
        content = path.read_bytes()
    except OSError as error:
        raise LayerError(f"http.layers: {path}: {(error.strerror or str(error)).lower()}") from None
    try:
        kind: Any = msgspec.json.decode(content, type=dict[str, msgspec.Raw]).get("type")
        known = kind is not None and msgspec.json.decode(kind) in _KINDS
    except (msgspec.MsgspecError, ValueError, TypeError):
        known = False
    if not known:
        raise LayerError(f"http.layers: {path} is no GeoJSON")
    return content
