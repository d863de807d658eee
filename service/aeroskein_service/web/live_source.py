"""The page over a running service: follows the feed, the status and the registration, and puts the browsers' questions.

The router may come later, or go and come back: the page is served all the time, and says what is missing.
"""

from __future__ import annotations

import asyncio
import threading
import time
from typing import Any, Final, Literal

import structlog

from aeroskein_service.config import Config
from aeroskein_service.keys import Keys
from aeroskein_service.transport import OpenCancelledError, Session, TransportError, open_session
from aeroskein_service.web.frames import Head
from aeroskein_service.web.live_picture import LivePicture
from aeroskein_service.web.questions import Questions
from aeroskein_service.web.requests import Play, Seek
from aeroskein_service.web.sensor_table import SensorTable
from aeroskein_service.web.service_watch import ServiceWatch
from aeroskein_service.web.source import Box, NotNowError, Picture, UnknownTrackError
from aeroskein_service.web.trails import TrailStore, chosen_numbers
from aeroskein_service.web.waiting_reports import place_reports

__all__ = ["LiveSource"]

PICTURE_S: Final = 1.0  # between two pictures
DRAIN_S: Final = 0.2  # between two looks at what has arrived, so that no one of them takes long
SOONEST_S: Final = 0.1  # between two frames of a browser that moves its map
HISTORY: Final = 1000  # batches of the feed asked for at the start, no older than this: the picture is whole at once
HISTORY_S: Final = 3.0
TRAIL_S: Final = 300.0


class LiveSource:
    """A consumer of everything.

    Parameters
    ----------
    config : Config
        Its sections ``zenoh`` and ``area``, and the sensors where there are some.
    """

    kind: Literal["live", "replay"] = "live"

    def __init__(self, config: Config) -> None:
        self._config = config
        self._keys = Keys(config.zenoh.prefix)
        self._log = structlog.get_logger("aeroskein.web")
        self.sensors = SensorTable(config.sensors)
        self.picture = LivePicture(self.sensors)
        self.trail_store = TrailStore(self.sensors)
        self.watch = ServiceWatch(self.sensors)
        self._session: Session | None = None
        self._questions: Questions | None = None
        self._stop = threading.Event()
        self._opener = threading.Thread(target=self._open, name="zenoh-open", daemon=True)
        self._turner: asyncio.Task[None] | None = None
        self._turned = asyncio.Event()
        self._waiting = "connecting to the Zenoh router"
        self._shown = Picture(Head(0, time.time(), time.time(), 0), self.picture.records(time.time()), 0)

    # -- start and stop ----------------------------------------------------------------------------------------------
    async def start(self) -> None:
        """Connect in the background and begin to make pictures."""
        self._opener.start()
        self._turner = asyncio.create_task(self._turn())

    async def stop(self) -> None:
        """Disconnect."""
        self._stop.set()
        if self._turner is not None:
            self._turner.cancel()
        await asyncio.to_thread(self._opener.join, 2.0)
        if self._session is not None:
            await asyncio.to_thread(self._session.close)

    def _open(self) -> None:
        try:
            session = open_session(self._config.zenoh.link, announce=self._announce, stop=self._stop)
        except OpenCancelledError:
            return
        except TransportError as error:
            self._announce(str(error))
            return
        self._waiting = ""
        keys = self._keys
        session.declare_alive(keys.alive("web", self._config.service.effective_instance))
        session.subscribe(keys.status(), self.watch.note_status)
        session.subscribe(keys.registration("*"), self.watch.note_registration)
        session.subscribe_recovering(keys.feed("live"), self.picture.note, history=HISTORY, history_age_s=HISTORY_S)
        session.subscribe_recovering(
            keys.feed("element"), self.trail_store.note, history=HISTORY, history_age_s=TRAIL_S
        )
        self._questions = Questions(session, keys)
        self._session = session

    def _announce(self, sentence: str) -> None:
        self._waiting = sentence
        self._log.warning("router", what=sentence)

    @property
    def connected(self) -> bool:
        """Whether the router is there."""
        return self._session is not None and self._session.connected

    # -- pictures ----------------------------------------------------------------------------------------------------
    async def _turn(self) -> None:
        """Read what arrives, and make a picture every second."""
        next_s = time.monotonic()
        while True:
            try:
                self._drain()
                if time.monotonic() >= next_s:
                    next_s = max(next_s + PICTURE_S, time.monotonic())
                    self._make_picture()
            except Exception:
                self._log.exception("picture_failed")
            await asyncio.sleep(min(DRAIN_S, max(next_s - time.monotonic(), 0.0)))

    def _drain(self) -> None:
        self.picture.drain()
        self.trail_store.drain()

    def _make_picture(self) -> None:
        now_s = time.time()
        self.picture.prune()
        self.watch.turn(now_s)
        tick = self._shown.tick + 1
        if tick % 16 == 0:
            self.trail_store.keep_only(self.picture.numbers())
        head = Head(tick, now_s, now_s, len(self.picture), silent_s=self._silent_s(now_s), connected=self.connected)
        self._shown = Picture(head, self.picture.records(now_s), tick)
        self._turned.set()
        self._turned = asyncio.Event()

    def _silent_s(self, now_s: float) -> float:
        """How long the picture has stood still: no status, or no points while there are tracks."""
        quiet_s = self.watch.silent_s(now_s)
        return max(quiet_s, self.picture.silent_s) if len(self.picture) else quiet_s

    def stream(self) -> _LiveStream:
        """A stream for one more browser."""
        return _LiveStream(self)

    @property
    def shown(self) -> Picture:
        """The newest picture."""
        return self._shown

    async def turned(self) -> None:
        """Wait for the next picture."""
        await self._turned.wait()

    # -- words -------------------------------------------------------------------------------------------------------
    def describe(self) -> dict[str, Any]:
        """What a browser needs to know before the first picture."""
        return {
            "kind": self.kind,
            "area": self._config.area.name,
            "prefix": self._config.zenoh.prefix,
            "where": self._config.zenoh.link.where,
        }

    def status(self) -> dict[str, Any]:
        """What goes to every browser once a second beside the picture."""
        now_s = time.time()
        made = self.watch.report(now_s)
        made["sensors"] = self.sensors.describe()
        made["waiting"] = self._waiting
        made["feed"] = {"points": self.picture.points, "broken": self.picture.broken, "tracks": len(self.picture)}
        return made

    def history(self) -> dict[str, Any]:
        """Rates and registration over the last minutes."""
        return self.watch.history()

    # -- questions ---------------------------------------------------------------------------------------------------
    def search(self, text: str, most: int, at_s: float | None) -> list[dict[str, Any]]:
        """Tracks that match a text, best first."""
        return self.picture.find(text, most)

    def track(self, label: str, at_s: float | None) -> dict[str, Any]:
        """The newest point of a track and the way it came."""
        point = self.picture.point(label)
        if point is None:
            raise UnknownTrackError(f"there is no track {label} now")
        return {"point": point, "trail": self.trail_store.of_track(point.track_number)}

    def trails(self, of: Box | frozenset[int] | None, seconds: float, most: int, at_s: float | None) -> bytes:
        """Where the tracks in a box, or those of some numbers, or all have been."""
        return self.trail_store.packed(chosen_numbers(self._shown.records, of), seconds, most)

    async def elements(self, label: str, at_s: float | None) -> dict[str, Any]:
        """The last elements of a track, as the service tells them."""
        if self._questions is None:
            raise NotNowError(self._waiting or "there is no connection to the service")
        reply = await self._questions.elements(label)
        live = self.picture.point(label)
        made = reply | {"live": live, "waiting": []}
        if live is not None and live.address is not None and reply.get("elements"):
            height_m = live.altitude_m if live.height_m is None else live.height_m
            reports = await self._questions.reports(live.address)
            made["waiting"] = place_reports(
                reports.get("reports", {}),
                {sensor["id"]: sensor for sensor in self.sensors.describe()},
                self.watch.registration(),
                height_m=height_m,
                after_s=float(reply["elements"][-1]["span_s"][1]),
            )
        return made


class _LiveStream:
    """The newest picture for one browser, once a second or when it looks elsewhere."""

    def __init__(self, source: LiveSource) -> None:
        self._source = source
        self._tick = -1

    async def next(self, wanted: asyncio.Event) -> Picture:
        """Wait for the next second, or for the browser to want something."""
        if self._source.shown.tick == self._tick:
            turned = asyncio.create_task(self._source.turned())
            asked = asyncio.create_task(wanted.wait())
            try:
                await asyncio.wait((turned, asked), return_when=asyncio.FIRST_COMPLETED)
            finally:
                turned.cancel()
                asked.cancel()
        if wanted.is_set():
            await asyncio.sleep(SOONEST_S)
            wanted.clear()
        self._tick = self._source.shown.tick
        return self._source.shown

    def control(self, request: Seek | Play) -> bool:
        """What happens now can be neither stopped nor repeated."""
        return False
