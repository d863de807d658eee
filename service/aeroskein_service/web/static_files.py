"""The page's own files, read once when the server starts, and the page that names them.

A browser asks each time whether a file has changed, so that an update is never half seen. The page tells it of all
modules at once; by itself it would find them import after import, and the picture would come after half a dozen trips.
"""

from __future__ import annotations

import hashlib
import mimetypes
from pathlib import Path
from typing import Final, NamedTuple

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

__all__ = ["StaticFiles"]

STATIC: Final = Path(__file__).parent / "static"
TYPES: Final = {".js": "text/javascript", ".css": "text/css", ".bin": "application/octet-stream"}
MODULES: Final = "<!-- modules -->"  # in index.html, where the modules are named


class _File(NamedTuple):
    content: bytes
    media_type: str
    etag: str

    def answer(self, request: Request) -> Response:
        headers = {"cache-control": "no-cache", "etag": self.etag}
        if request.headers.get("if-none-match") == self.etag:
            return Response(status_code=304, headers=headers)
        return Response(self.content, media_type=self.media_type, headers=headers)


class StaticFiles:
    """Everything in ``static``, by its path there."""

    def __init__(self) -> None:
        paths = sorted(path for path in STATIC.rglob("*") if path.is_file())
        self._files = {path.relative_to(STATIC).as_posix(): _read(path) for path in paths}
        modules = [name for name in self._files if name.startswith("js/")]
        named = "\n  ".join(f'<link rel="modulepreload" href="/static/{name}">' for name in modules)
        html = self._files["index.html"].content.decode().replace(MODULES, named)
        self._index = _file(html.encode(), "text/html")

    async def index(self, request: Request) -> Response:
        """The page."""
        return self._index.answer(request)

    async def file(self, request: Request) -> Response:
        """A file of it."""
        found = self._files.get(request.path_params["path"])
        if found is None:
            raise HTTPException(404, "there is no such file")
        return found.answer(request)


def _read(path: Path) -> _File:
    media_type = TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "text/plain"
    return _file(path.read_bytes(), media_type)


def _file(content: bytes, media_type: str) -> _File:
    return _File(content, media_type, f'"{hashlib.sha256(content).hexdigest()[:32]}"')
