"""The WebSocket of the page: one task reads what the browser says, one sends it pictures, until either ends."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Mapping
from typing import Any, Final

import msgspec
from starlette.responses import PlainTextResponse
from starlette.websockets import WebSocket, WebSocketDisconnect

from aeroskein_service.codec import MessageError
from aeroskein_service.web.doors import Doors
from aeroskein_service.web.frames import VERSION
from aeroskein_service.web.requests import Play, Seek, Shown, View, read_request
from aeroskein_service.web.source import Source
from aeroskein_service.web.viewer import Viewer

__all__ = ["Visits"]

MESSAGES_PER_S: Final = 40.0  # a browser that drags its map sends ten a second
BURST: Final = 120.0
BROKEN: Final = 10  # messages that are not understood before the connection ends
# Codes of RFC 6455 and of the IANA registry for "you break the rules".
BREAKS_RULES: Final = 1008


class Visits:
    """All connections.

    Parameters
    ----------
    source : Source
        What is shown.
    doors : Doors
        Who may come in.
    most : int
        Connections at a time.
    """

    def __init__(self, source: Source, doors: Doors, most: int) -> None:
        self._source = source
        self._doors = doors
        self._most = most
        self._viewers: set[Viewer] = set()
        self.frames = 0
        self.bytes = 0
        self.skipped = 0
        self.refused = 0
        self.broken = 0

    def __len__(self) -> int:
        return len(self._viewers)

    async def receive(self, socket: WebSocket) -> None:
        """Serve one connection to its end."""
        headers = {name.lower(): value for name, value in socket.headers.items()}
        if not (self._doors.knows_host(headers) and self._doors.knows_origin(headers)):
            await self._refuse(socket, 403, "this page was not given out by this server")
            return
        if len(self._viewers) >= self._most:
            await self._refuse(socket, 503, f"{self._most} viewers are here already")
            return
        viewer = Viewer(socket.send_bytes)
        self._viewers.add(viewer)
        try:
            await socket.accept()
            await self._serve(socket, viewer)
        except WebSocketDisconnect:
            pass
        finally:
            self._viewers.discard(viewer)
            self.broken += viewer.broken

    async def _refuse(self, socket: WebSocket, status: int, sentence: str) -> None:
        self.refused += 1
        await socket.send_denial_response(PlainTextResponse(sentence, status_code=status))

    async def _serve(self, socket: WebSocket, viewer: Viewer) -> None:
        stream = self._source.stream()
        hello = {"type": "hello", "version": VERSION} | self._source.describe()
        await socket.send_text(_text(hello))
        await socket.send_text(_text(self._source.status()))

        async def listen() -> None:
            allowed, at_s = BURST, time.monotonic()
            while True:
                message = await socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                now_s = time.monotonic()
                allowed, at_s = min(allowed + (now_s - at_s) * MESSAGES_PER_S, BURST) - 1.0, now_s
                if allowed < 0.0 or not _heed(message, viewer, stream):
                    await socket.close(BREAKS_RULES)
                    return

        async def show() -> None:
            said_s = time.monotonic()
            while True:
                picture = await stream.next(viewer.wanted)
                await viewer.ready()
                before = viewer.sent_bytes, viewer.skipped
                await viewer.send(*picture)
                self.frames += 1
                self.bytes += viewer.sent_bytes - before[0]
                self.skipped += viewer.skipped - before[1]
                if time.monotonic() - said_s >= 1.0:
                    said_s = time.monotonic()
                    await socket.send_text(_text(self._source.status() | {"viewers": len(self)}))

        await _until_first_ends(listen(), show())


def _heed(message: Mapping[str, Any], viewer: Viewer, stream: Any) -> bool:
    """Do what a browser asks; false where it has asked for nonsense too often."""
    try:
        text = message.get("text")
        if text is None:
            raise MessageError("not understood: binary")
        request = read_request(text)
    except MessageError:
        viewer.broken += 1
        return viewer.broken < BROKEN
    if isinstance(request, View):
        viewer.look(request)
    elif isinstance(request, Shown):
        viewer.shown(request)
    elif isinstance(request, Seek | Play) and stream.control(request):
        viewer.wanted.set()
    return True


async def _until_first_ends(*coroutines: Any) -> None:
    tasks = [asyncio.create_task(coroutine) for coroutine in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        error = task.exception()
        # A connection that breaks while something is sent has ended, no more.
        if error is not None and not isinstance(error, WebSocketDisconnect | RuntimeError):
            raise error


def _text(message: dict[str, Any]) -> str:
    return msgspec.json.encode(message).decode()
