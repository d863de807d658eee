"""The page over a file: the same questions as to a running service, answered for the instant each viewer looks at."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any, Final, Literal

import numpy as np

from aeroskein_service.messages import FLAG_NAMES, STATUS_NAMES
from aeroskein_service.web.frames import Head
from aeroskein_service.web.recorded import RecordedPicture
from aeroskein_service.web.records import (
    UNKNOWN_ADDRESS,
    UNKNOWN_ANGLE,
    UNKNOWN_MODE_A,
    UNKNOWN_RATE,
    record_label,
)
from aeroskein_service.web.requests import Play, Seek
from aeroskein_service.web.sensor_table import SensorTable
from aeroskein_service.web.source import Box, Picture, UnknownTrackError
from aeroskein_service.web.trails import chosen_numbers, pack_trails, trail_columns

__all__ = ["ElementsAt", "ReplaySource"]

PLAYING_S: Final = 0.25  # between two pictures while time passes
STANDING_S: Final = 1.0  # and while it stands
SOONEST_S: Final = 0.05
TRAIL_S: Final = 1800.0  # of the details

ElementsAt = Callable[[int, int, float], list[dict[str, Any]]]
"""The last elements of a track by its epoch and number that had been closed at an instant."""


class ReplaySource:
    """A recorded picture with a clock for every viewer.

    Parameters
    ----------
    picture : RecordedPicture
    sensors : SensorTable
    elements : callable
        See ``ElementsAt``.
    title : str
        What is shown, for people: the file's name.
    history : dict
        Registration over the time of the file, as ``ServiceWatch.history`` gives it.
    """

    kind: Literal["live", "replay"] = "replay"

    def __init__(
        self,
        picture: RecordedPicture,
        sensors: SensorTable,
        elements: ElementsAt,
        *,
        title: str,
        history: dict[str, Any],
    ) -> None:
        self.picture = picture
        self._sensors = sensors
        self._elements = elements
        self._title = title
        self._history = history

    async def start(self) -> None:
        """Nothing runs but the viewers' clocks."""

    async def stop(self) -> None:
        """Nothing runs."""

    def stream(self) -> _ReplayStream:
        """A stream for one more browser."""
        return _ReplayStream(self.picture)

    def describe(self) -> dict[str, Any]:
        """What a browser needs to know before the first picture."""
        picture = self.picture
        return {"kind": self.kind, "file": self._title, "begin_s": picture.begin_s, "end_s": picture.end_s}

    def status(self) -> dict[str, Any]:
        """What goes to every browser once a second beside the picture."""
        states = self._history.get("registration", {})
        return {
            "type": "status",
            "time_s": time.time(),
            "heard": True,
            "silent_s": 0.0,
            "service": None,
            "rates": None,
            "registration": {sensor: of[-1] for sensor, of in states.items() if of},
            "sensors": self._sensors.describe(),
            "waiting": "",
        }

    def history(self) -> dict[str, Any]:
        """Registration over the time of the file."""
        return self._history

    def _at(self, at_s: float | None) -> float:
        return self.picture.begin_s if at_s is None else at_s

    def _find(self, label: str, at_s: float) -> int:
        track = self.picture.track_at(label, at_s)
        if track is None:
            raise UnknownTrackError(f"there is no track {label} in the file")
        return track

    def search(self, text: str, most: int, at_s: float | None) -> list[dict[str, Any]]:
        """Tracks in the picture at that instant that match a text, best first."""
        text, found = text.upper(), []
        for record in self.picture.at(self._at(at_s)):
            label, callsign = record_label(record), record["callsign"].decode("ascii", "replace")
            code = "" if record["mode_a"] == UNKNOWN_MODE_A else f"{int(record['mode_a']):04o}"
            places = [name.find(text) for name in (label, callsign, code) if text in name]
            if places:
                lat, lon = float(record["lat"]) * 1e-7, float(record["lon"]) * 1e-7
                entry = {"track": label, "callsign": callsign or None, "lat_deg": lat, "lon_deg": lon}
                found.append((min(places), label, entry))
        return [entry for _, _, entry in sorted(found, key=lambda item: item[:2])[:most]]

    def track(self, label: str, at_s: float | None) -> dict[str, Any]:
        """The state of a track at that instant, and the way it came."""
        when_s = self._at(at_s)
        track = self._find(label, when_s)
        point = self._point(track, when_s)
        return {"point": point, "trail": trail_columns(self.picture.trail(track, when_s, TRAIL_S))}

    def _point(self, track: int, at_s: float) -> dict[str, Any]:
        """A state in the words of a live point; what a record does not hold is null."""
        record, time_s = self.picture.state(track, at_s)
        epoch, number = self.picture.epoch_and_number(track)
        named = [self._sensors.ids[bit] for bit in range(len(self._sensors)) if int(record["sensors"]) >> bit & 1]
        sigma_m = float(record["sigma_m"])
        speed, rate = int(record["speed"]), int(record["rate"])
        return {
            "track": record_label(record),
            "track_number": number,
            "address": None if record["address"] == UNKNOWN_ADDRESS else f"{int(record['address']):06X}",
            "callsign": record["callsign"].decode("ascii", "replace") or None,
            "epoch": epoch,
            "seq": None,
            "time_s": time_s,
            "lat_deg": float(record["lat"]) * 1e-7,
            "lon_deg": float(record["lon"]) * 1e-7,
            "altitude_m": float(record["altitude_m"]),
            "height_m": None,
            "ground_speed_mps": None if speed == UNKNOWN_ANGLE else speed * 0.1,
            "track_angle_deg": None if speed == UNKNOWN_ANGLE else int(record["angle"]) * (360.0 / 65536.0),
            "vertical_rate_mps": None if rate == UNKNOWN_RATE else rate * 0.01,
            "position_cov_m2": None if np.isnan(sigma_m) else (sigma_m**2, 0.0, sigma_m**2),
            "status": STATUS_NAMES[int(record["status"])],
            "sources": dict.fromkeys(named, 1),
            "rejected": 0,
            "flags": [name for bit, name in enumerate(FLAG_NAMES) if int(record["flags"]) >> bit & 1],
        }

    def trails(self, of: Box | frozenset[int] | None, seconds: float, most: int, at_s: float | None) -> bytes:
        """Where the tracks in a box, or those of some numbers, or all have been before that instant."""
        when_s = self._at(at_s)
        trails = []
        for number in chosen_numbers(self.picture.at(when_s), of)[:most]:
            track = self.picture.track_of(number, when_s)
            points = None if track is None else self.picture.trail(track, when_s, seconds)
            if points is not None and len(points):
                trails.append((number, points))
        return pack_trails(trails)

    async def elements(self, label: str, at_s: float | None) -> dict[str, Any]:
        """The last elements of a track that had been closed at that instant."""
        when_s = self._at(at_s)
        track = self._find(label, when_s)
        elements = await asyncio.to_thread(self._elements, *self.picture.epoch_and_number(track), when_s)
        return {
            "time_s": when_s,
            "track": label,
            "elements": elements,
            "live": self._point(track, when_s),
            "waiting": [],
        }


class _ReplayStream:
    """One viewer's clock."""

    def __init__(self, picture: RecordedPicture) -> None:
        self._picture = picture
        self._playing = True
        self._speed = 1.0
        self._at_s = picture.begin_s
        self._since_s = time.monotonic()
        self._tick = 0

    def _now_s(self) -> float:
        """Where the clock stands; at the end it stops."""
        if self._playing:
            passed_s = (time.monotonic() - self._since_s) * self._speed
            if self._at_s + passed_s >= self._picture.end_s:
                self._at_s, self._playing = self._picture.end_s, False
                return self._at_s
            return self._at_s + passed_s
        return self._at_s

    async def next(self, wanted: asyncio.Event) -> Picture:
        """Wait for the next picture, or for the viewer to jump."""
        if self._tick:
            wait_s = PLAYING_S if self._playing else STANDING_S
            try:
                await asyncio.wait_for(wanted.wait(), wait_s)
                wanted.clear()
                await asyncio.sleep(SOONEST_S)
            except TimeoutError:
                pass
        self._tick += 1
        at_s = self._now_s()
        records = self._picture.at(at_s)
        head = Head(self._tick, at_s, time.time(), len(records), playing=self._playing, speed=self._speed)
        return Picture(head, records, self._tick)

    def control(self, request: Seek | Play) -> bool:
        """Jump, let time pass, or stop it."""
        self._at_s = self._now_s()
        self._since_s = time.monotonic()
        if isinstance(request, Seek):
            self._at_s = min(max(request.time_s, self._picture.begin_s), self._picture.end_s)
        else:
            self._playing, self._speed = request.on, request.speed
            if request.on and self._at_s >= self._picture.end_s:
                self._at_s = self._picture.begin_s
        return True
