"""Health and metrics at the page's address: those of the service behind it, or the page's own where it runs alone."""

from __future__ import annotations

import asyncio
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from typing import Final

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from aeroskein_service.metrics import CONTENT_TYPE

__all__ = ["health_routes"]

TIMEOUT_S: Final = 3.0


def health_routes(
    service_url: str | None, *, ready: Callable[[], Sequence[str]], metrics: Callable[[], bytes]
) -> list[Route]:
    """``/livez``, ``/readyz`` and ``/metrics``.

    Parameters
    ----------
    service_url : str, optional
        Where the service answers itself; its answers are passed on.
    ready : callable
        Why the page alone has nothing to show, as sentences.
    metrics : callable
        The page's own metrics as text; they follow those of the service.
    """

    async def live(_request: Request) -> Response:
        if service_url is not None:
            return await _passed_on(f"{service_url}/livez")
        return JSONResponse({"ok": True, "reasons": []})

    async def is_ready(_request: Request) -> Response:
        if service_url is not None:
            return await _passed_on(f"{service_url}/readyz")
        why = list(ready())
        return JSONResponse({"ok": not why, "reasons": why}, status_code=503 if why else 200)

    async def measured(_request: Request) -> Response:
        if service_url is None:
            return Response(metrics(), media_type=CONTENT_TYPE)
        answer = await _passed_on(f"{service_url}/metrics")
        if answer.status_code == 200:
            answer = Response(bytes(answer.body) + metrics(), media_type=CONTENT_TYPE)
        return answer

    return [Route("/livez", live), Route("/readyz", is_ready), Route("/metrics", measured)]


async def _passed_on(url: str) -> Response:
    return await asyncio.to_thread(_fetch, url)


def _fetch(url: str) -> Response:
    try:
        with urllib.request.urlopen(url, timeout=TIMEOUT_S) as answer:
            return Response(answer.read(), status_code=answer.status, media_type=answer.headers.get("content-type"))
    except urllib.error.HTTPError as error:
        with error:
            return Response(error.read(), status_code=error.code, media_type=error.headers.get("content-type"))
    except OSError as error:
        why = [f"the service does not answer: {getattr(error, 'reason', error)}"]
        return JSONResponse({"ok": False, "reasons": why}, status_code=503)
