"""Who may come in: only pages that this server gave out, under a name that is its own, and not too many of them.

A page of another site that a viewer has open could otherwise open a WebSocket to 127.0.0.1 and read the picture
(browsers do not forbid that), or reach it under a name that points to 127.0.0.1 for the occasion (DNS rebinding).
"""

from __future__ import annotations

import ipaddress
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import Final
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["Doors", "Headers"]

Handler = Callable[[Request], Awaitable[Response]]

# What the page may load and whom it may talk to: this server and nobody else. Browser tools evaluate expressions in
# the page, which is why eval is not forbidden; the page itself has none, nor text that becomes HTML: a test looks.
POLICY: Final = (
    "default-src 'none'; script-src 'self' 'unsafe-eval'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: Final = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
)


class Doors:
    """Checks the names under which a request comes.

    Parameters
    ----------
    host : str
        Where the server listens.
    origins : iterable of str
        Further origins that may connect, as ``https://tower.example``: the page behind a proxy.
    """

    def __init__(self, host: str, origins: Iterable[str] = ()) -> None:
        self._origins = {origin.rstrip("/").lower() for origin in origins}
        self._names = {urlsplit(origin).hostname for origin in self._origins}
        self._local = _is_loopback(host)

    def knows_host(self, headers: Mapping[str, str]) -> bool:
        """Whether the name in the request can be this server's. Who listens for others takes any name."""
        if not self._local:
            return True
        name = urlsplit(f"//{headers.get('host', '')}").hostname or ""
        return _is_loopback(name) or name in self._names

    def knows_origin(self, headers: Mapping[str, str]) -> bool:
        """Whether the page that asks came from here; programs that are no browsers send no origin."""
        origin = headers.get("origin")
        if origin is None:
            return True
        if origin.lower() in self._origins:
            return True
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.netloc.lower() == headers.get("host", "").lower()

    def guard(self, handler: Handler) -> Handler:
        """A handler that answers only pages of our own."""

        async def respond(request: Request) -> Response:
            headers = {name.lower(): value for name, value in request.headers.items()}
            if not (self.knows_host(headers) and self.knows_origin(headers)):
                return PlainTextResponse("this page was not given out by this server", status_code=403)
            return await handler(request)

        return respond


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class Headers:
    """Adds the headers that keep a page to its own server; middleware for every answer."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, with headers."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *HEADERS]
            await send(message)

        await self._app(scope, receive, with_headers)
