"""Where every aircraft has been: the fused points of its last elements, in a ring per track.

The trail is the accurate product, one point per element, so 75 points are five minutes. Rings are columns of one array;
a trail of 20,000 aircraft takes 45 MB.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Collection
from operator import attrgetter
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein_service.codec import media_type
from aeroskein_service.messages import JSON, MSGPACK
from aeroskein_service.web.records import Records, in_box, largest_sigma
from aeroskein_service.web.sensor_table import SensorTable
from aeroskein_service.web.source import Box

__all__ = ["POINT", "TrailStore", "pack_trails", "trail_columns"]

MESSAGES: Final = 20_000
POINTS: Final = 75  # of each track
FIRST_TRACKS: Final = 256
POINTS_AT_ONCE: Final = 5000

POINT: Final = np.dtype(
    [
        ("time_s", "<f8"),
        ("lat", "<i4"),  # 1e-7 degrees
        ("lon", "<i4"),
        ("altitude_m", "<f4"),
        ("speed_mps", "<f4"),
        ("rate_mps", "<f4"),
        ("sigma_m", "<f4"),
        ("element", "<i4"),
        ("master", "<i2"),
        ("rejected", "<u2"),
    ]
)
Points = NDArray[Any]
_NO_COVARIANCE: Final = (np.nan,) * 3
_NUMBERS: Final = {
    "lat": attrgetter("lat_deg"),
    "lon": attrgetter("lon_deg"),
    "time_s": attrgetter("time_s"),
    "altitude_m": attrgetter("altitude_m"),
    "speed_mps": attrgetter("ground_speed_mps"),
    "rate_mps": attrgetter("vertical_rate_mps"),
}


class _ElementPoint(msgspec.Struct, gc=False):
    track_number: int
    time_s: float
    element: int | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    altitude_m: float | None = None
    ground_speed_mps: float | None = None
    vertical_rate_mps: float | None = None
    position_cov_m2: tuple[float, float, float] | None = None
    master: str | None = None
    rejected: int = 0


class _ElementFeed(msgspec.Struct, gc=False):
    epoch: int
    points: list[_ElementPoint]


_DECODERS: Final[dict[str, Any]] = {
    MSGPACK: msgspec.msgpack.Decoder(_ElementFeed),
    JSON: msgspec.json.Decoder(_ElementFeed),
}


class TrailStore:
    """Rings of element points.

    Parameters
    ----------
    sensors : SensorTable
        Spells the masters.
    """

    def __init__(self, sensors: SensorTable) -> None:
        self._sensors = sensors
        self._waiting: deque[tuple[bytes, str]] = deque(maxlen=MESSAGES)
        self._slot_of: dict[int, int] = {}
        self._free: list[int] = []
        self._ring = np.zeros((0, POINTS), dtype=POINT)
        self._count = np.zeros(0, dtype=np.int64)
        self._epoch = 0
        self.points = 0
        self.broken = 0

    # -- in ----------------------------------------------------------------------------------------------------------
    def note(self, _key: str, payload: bytes, encoding: str) -> None:
        """Queue one message of ``feed/element``; called by Zenoh."""
        self._waiting.append((payload, encoding))

    def drain(self) -> None:
        """Read what has arrived."""
        while self._waiting:
            points: list[_ElementPoint] = []
            while self._waiting and len(points) < POINTS_AT_ONCE:
                payload, encoding = self._waiting.popleft()
                decoder = _DECODERS.get(media_type(encoding))
                try:
                    feed = None if decoder is None else decoder.decode(payload)
                except (msgspec.MsgspecError, ValueError, RecursionError):
                    feed = None
                if feed is None:
                    self.broken += 1
                    continue
                if feed.epoch > self._epoch:
                    # Another start of the service: numbers may begin anew.
                    self._epoch = feed.epoch
                    self.keep_only(())
                points += feed.points
            if points:
                self._take([p for p in points if p.lat_deg is not None and p.lon_deg is not None])

    def _take(self, points: list[_ElementPoint]) -> None:
        self.points += len(points)
        rows = np.zeros(len(points), dtype=POINT)
        for name, field in _NUMBERS.items():
            column = np.array([*map(field, points)], dtype=np.float64)  # None becomes NaN
            rows[name] = np.rint(column * 1e7).astype(np.int64) if name in ("lat", "lon") else column
        covariance = [p.position_cov_m2 or _NO_COVARIANCE for p in points]
        rows["sigma_m"] = largest_sigma(*np.array(covariance, dtype=np.float64).reshape(-1, 3).T)
        rows["element"] = [-1 if p.element is None else p.element for p in points]
        index = {name: -1 if name is None else self._sensors.index(name) for name in {p.master for p in points}}
        rows["master"] = [index[p.master] for p in points]
        rows["rejected"] = [min(p.rejected, 0xFFFF) for p in points]
        left = np.array([self._slot(p.track_number) for p in points], dtype=np.int64)
        # A track that has several points in a batch gets one of them in each turn.
        while len(left):
            slots, first = np.unique(left, return_index=True)
            self._ring[slots, self._count[slots] % POINTS] = rows[first]
            self._count[slots] += 1
            left, rows = np.delete(left, first), np.delete(rows, first)

    def _slot(self, number: int) -> int:
        slot = self._slot_of.get(number)
        if slot is None:
            if not self._free:
                before = len(self._ring)
                more = max(before, FIRST_TRACKS)
                self._ring = np.concatenate([self._ring, np.zeros((more, POINTS), dtype=POINT)])
                self._count = np.concatenate([self._count, np.zeros(more, dtype=np.int64)])
                self._free += range(before + more - 1, before - 1, -1)
            slot = self._slot_of[number] = self._free.pop()
            self._count[slot] = 0
        return slot

    def keep_only(self, numbers: Collection[int]) -> None:
        """Forget the trails of all other tracks."""
        for number in [n for n in self._slot_of if n not in numbers]:
            self._free.append(self._slot_of.pop(number))

    # -- out ---------------------------------------------------------------------------------------------------------
    def _points(self, slot: int) -> Points:
        """A track's points in order."""
        count = int(self._count[slot])
        points: Points = self._ring[slot, np.arange(max(count - POINTS, 0), count) % POINTS]
        return points

    def of_track(self, number: int) -> dict[str, list[Any]]:
        """A track's trail as columns for JSON."""
        slot = self._slot_of.get(number)
        return trail_columns(np.zeros(0, dtype=POINT) if slot is None else self._points(slot))

    def packed(self, records: Records, box: Box | None, seconds: float, most: int) -> bytes:
        """The trails of the tracks in a box, see ``pack_trails``."""
        inside = records if box is None else records[in_box(records, box)]
        trails = []
        for number in inside["number"].tolist():
            slot = self._slot_of.get(number)
            if slot is None:
                continue
            points = self._points(slot)
            points = points[points["time_s"] >= points["time_s"][-1:] - seconds]
            if len(points):
                trails.append((number, points))
            if len(trails) >= most:
                break
        return pack_trails(trails)


def trail_columns(points: Points) -> dict[str, list[Any]]:
    """Points as columns for JSON; what is unknown is null."""
    made: dict[str, list[Any]] = {
        "time_s": points["time_s"].tolist(),
        "lat_deg": (points["lat"] * 1e-7).tolist(),
        "lon_deg": (points["lon"] * 1e-7).tolist(),
    }
    for name in ("altitude_m", "speed_mps", "rate_mps", "sigma_m"):
        known = np.isfinite(points[name]).tolist()
        made[name] = [round(v, 3) if k else None for v, k in zip(points[name].tolist(), known, strict=True)]
    for name in ("element", "master", "rejected"):
        made[name] = points[name].tolist()
    return made


def pack_trails(trails: list[tuple[int, Points]]) -> bytes:
    """Trails for the map: version, count, then per trail its number and length, then all positions, little endian."""
    head = struct.pack("<II", 1, len(trails))
    index = np.array([(number & 0xFFFFFFFF, len(points)) for number, points in trails], dtype="<u4").tobytes()
    place = [np.stack([points["lat"], points["lon"]], axis=1).astype("<i4").tobytes() for _, points in trails]
    return head + index + b"".join(place)
