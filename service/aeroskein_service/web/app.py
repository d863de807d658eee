"""The page's routes: its files, the WebSocket, and JSON for details on demand."""

from __future__ import annotations

import contextlib
import math
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute

from aeroskein_service.codec import encode_message
from aeroskein_service.messages import JSON
from aeroskein_service.web.behind import health_routes
from aeroskein_service.web.doors import Doors, Headers
from aeroskein_service.web.layers import LayerFiles
from aeroskein_service.web.page_metrics import PageMetrics
from aeroskein_service.web.source import Box, NotNowError, Source, UnknownTrackError
from aeroskein_service.web.static_files import StaticFiles
from aeroskein_service.web.visits import Visits

__all__ = ["make_app"]

MOST_FOUND: Final = 20  # results of a search
MOST_PICKED: Final = 100  # tracks whose trails are asked for by number
MOST_TRAILS: Final = 2000  # tracks whose trails go out at a time: 1.2 MB
LONGEST_TRAIL_S: Final = 3600.0
LONGEST_TEXT: Final = 40


def make_app(
    source: Source,
    *,
    host: str,
    origins: Sequence[str] = (),
    viewers: int = 50,
    layers: Sequence[Path] = (),
    service_url: str | None = None,
) -> Starlette:
    """The application.

    Parameters
    ----------
    source : Source
        What is shown; started and stopped with the application.
    host : str
        Where the server listens.
    origins : sequence of str
        Further origins that may connect.
    viewers : int
        Browsers at a time.
    layers : sequence of Path
        GeoJSON files for the map.
    service_url : str, optional
        Where the service behind the page answers ``/livez``, ``/readyz`` and ``/metrics``.
    """
    doors = Doors(host, origins)
    visits = Visits(source, doors, viewers)
    details = _Details(source, LayerFiles(layers))
    files = StaticFiles()

    @contextlib.asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        await source.start()
        yield
        await source.stop()

    return Starlette(
        lifespan=lifespan,
        middleware=[Middleware(Headers)],
        exception_handlers={HTTPException: _error},
        routes=[
            Route("/", doors.guard(files.index)),
            Route("/api/status", doors.guard(details.status)),
            Route("/api/history", doors.guard(details.history)),
            Route("/api/search", doors.guard(details.search)),
            Route("/api/track/{label}", doors.guard(details.track)),
            Route("/api/elements/{label}", doors.guard(details.elements)),
            Route("/api/trails", doors.guard(details.trails)),
            Route("/api/layers", doors.guard(details.layers)),
            Route("/api/layers/{number:int}", doors.guard(details.layer)),
            *health_routes(service_url, ready=details.not_ready, metrics=PageMetrics(visits).text),
            WebSocketRoute("/ws", visits.receive),
            Route("/static/{path:path}", files.file),
        ],
    )


async def _error(_request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return Response(
        msgspec.json.encode({"error": error.detail}), status_code=error.status_code, media_type="application/json"
    )


class _Details:
    """JSON on demand."""

    def __init__(self, source: Source, layers: LayerFiles) -> None:
        self._source = source
        self._layers = layers

    async def status(self, _request: Request) -> Response:
        return _json(self._source.describe() | self._source.status())

    def not_ready(self) -> list[str]:
        """Why the page has nothing to show, as sentences."""
        waiting = str(self._source.status().get("waiting") or "")
        return [waiting] if waiting else []

    async def history(self, _request: Request) -> Response:
        return _json(self._source.history())

    async def search(self, request: Request) -> Response:
        text = request.query_params.get("q", "").strip()
        if not 0 < len(text) <= LONGEST_TEXT:
            raise HTTPException(400, f"q: expected 1 to {LONGEST_TEXT} characters")
        return _json({"tracks": self._source.search(text, MOST_FOUND, _time(request))})

    async def track(self, request: Request) -> Response:
        try:
            return _json(self._source.track(_label(request), _time(request)))
        except UnknownTrackError as error:
            raise HTTPException(404, str(error)) from None

    async def elements(self, request: Request) -> Response:
        try:
            return _json(await self._source.elements(_label(request), _time(request)))
        except UnknownTrackError as error:
            raise HTTPException(404, str(error)) from None
        except NotNowError as error:
            raise HTTPException(503, str(error)) from None

    async def trails(self, request: Request) -> Response:
        seconds = _number(request, "seconds", 300.0, 1.0, LONGEST_TRAIL_S)
        of = _numbers(request) if "tracks" in request.query_params else _box(request)
        packed = self._source.trails(of, seconds, MOST_TRAILS, _time(request))
        return Response(packed, media_type="application/octet-stream")

    async def layers(self, _request: Request) -> Response:
        return _json({"layers": self._layers.names()})

    async def layer(self, request: Request) -> Response:
        content = self._layers.content(request.path_params["number"])
        if content is None:
            raise HTTPException(404, "there is no such layer")
        return Response(content, media_type="application/geo+json")


def _json(content: Any) -> Response:
    return Response(encode_message(msgspec.to_builtins(content), JSON), media_type="application/json")


def _label(request: Request) -> str:
    label = str(request.path_params["label"]).upper()
    if not (label.isascii() and label.isalnum() and len(label) <= LONGEST_TEXT):
        raise HTTPException(404, "expected an address or a key such as T000123")
    return label


def _time(request: Request) -> float | None:
    return _number(request, "at", 0.0, 0.0, 1e11) if "at" in request.query_params else None


def _number(request: Request, name: str, otherwise: float, low: float, high: float) -> float:
    text = request.query_params.get(name)
    if text is None:
        return otherwise
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise HTTPException(400, f"{name}: expected a number from {low:g} to {high:g}")
    return value


def _numbers(request: Request) -> frozenset[int]:
    parts = request.query_params["tracks"].split(",")
    if len(parts) > MOST_PICKED or not all(part.isascii() and part.isdigit() and len(part) < 11 for part in parts):
        raise HTTPException(400, f"tracks: expected up to {MOST_PICKED} track numbers")
    return frozenset(map(int, parts))


def _box(request: Request) -> Box | None:
    text = request.query_params.get("box")
    if text is None:
        return None
    try:
        lat_min, lon_min, lat_max, lon_max = (float(part) for part in text.split(","))
    except ValueError:
        raise HTTPException(400, "box: expected lat_min,lon_min,lat_max,lon_max") from None
    if not (-90.0 <= lat_min <= lat_max <= 90.0 and abs(lon_min) <= 180.0 and abs(lon_max) <= 180.0):
        raise HTTPException(400, "box: expected lat_min,lon_min,lat_max,lon_max in degrees")
    return lat_min, lon_min, lat_max, lon_max
