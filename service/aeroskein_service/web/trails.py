"""Where every aircraft has been: the fused points of its last elements, in a ring per track.

The trail is the accurate product, one point per element, so 75 points are five minutes. Rings are columns of one array;
a trail of 20,000 aircraft takes 45 MB.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Collection, Iterable
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein_service.codec import media_type
from aeroskein_service.messages import JSON, MSGPACK
from aeroskein_service.web.known_parts import UNKNOWN
from aeroskein_service.web.quick_points import QuickReader, Read
from aeroskein_service.web.records import Records, in_box, largest_sigma
from aeroskein_service.web.sensor_table import SensorTable
from aeroskein_service.web.source import Box

__all__ = ["POINT", "TrailStore", "chosen_numbers", "pack_trails", "trail_columns"]

MESSAGES: Final = 20_000
POINTS: Final = 75  # of each track
FIRST_TRACKS: Final = 256
MESSAGES_AT_ONCE: Final = 200

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
# What a trail needs of a point, in order; a covariance has three numbers.
_NUMBERS: Final = (
    "time_s", "lat_deg", "lon_deg", "altitude_m", "ground_speed_mps", "vertical_rate_mps", "element", "rejected",
    "position_cov_m2",
)  # fmt: skip


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
_POINT: Final = msgspec.msgpack.Decoder(_ElementPoint)
_ERRORS: Final = (msgspec.MsgspecError, ValueError, RecursionError)


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
        self._reader = QuickReader(_NUMBERS, tail=1)
        self.points = 0
        self.broken = 0

    # -- in ----------------------------------------------------------------------------------------------------------
    def note(self, _key: str, payload: bytes, encoding: str) -> None:
        """Queue one message of ``feed/element``; called by Zenoh."""
        self._waiting.append((payload, encoding))

    def drain(self) -> None:
        """Read what has arrived."""
        while self._waiting:
            quick: list[bytes] = []
            slow: list[tuple[bytes, str]] = []
            while self._waiting and len(quick) + len(slow) < MESSAGES_AT_ONCE:
                payload, encoding = self._waiting.popleft()
                if encoding == MSGPACK:
                    quick.append(payload)
                else:
                    slow.append((payload, encoding))
            if quick:
                read = self._reader.read(quick)
                self._follow(max(read.epochs.values(), default=0))
                self._read_quickly(read)
                slow += [(quick[index], MSGPACK) for index in read.left]
            if slow:
                self._read_whole(slow)

    def _read_quickly(self, read: Read) -> None:
        """Points as columns, and field by field those that are new."""
        unknown = read.unknown()
        for row in unknown:
            try:
                read.fill(row, *self._columns(_POINT.decode(read.point(row))))
            except _ERRORS:
                self.broken += 1
        self._reader.learn(read, unknown)
        there = read.places != UNKNOWN
        self._take(read.places[there], read.tails[there], read.numbers[:, there])

    def _read_whole(self, messages: list[tuple[bytes, str]]) -> None:
        """Messages that are built in another way."""
        points: list[_ElementPoint] = []
        for payload, encoding in messages:
            decoder = _DECODERS.get(media_type(encoding))
            try:
                feed = None if decoder is None else decoder.decode(payload)
            except _ERRORS:
                feed = None
            if feed is None:
                self.broken += 1
                continue
            self._follow(feed.epoch)
            points += feed.points
        if points:
            slots, tails, numbers = zip(*map(self._columns, points), strict=True)
            self._take(np.array(slots), np.array(tails), np.array(numbers, dtype=np.float64).T)

    def _follow(self, epoch: int) -> None:
        """After another start of the service numbers may begin anew."""
        if epoch > self._epoch:
            self._epoch = epoch
            self.keep_only(())

    def _columns(self, point: _ElementPoint) -> tuple[int, tuple[int], tuple[Any, ...]]:
        """Slot, master and numbers of one point."""
        p = point
        master = -1 if p.master is None else self._sensors.index(p.master)
        numbers = (p.time_s, p.lat_deg, p.lon_deg, p.altitude_m, p.ground_speed_mps, p.vertical_rate_mps, p.element,
                   p.rejected, *(p.position_cov_m2 or _NO_COVARIANCE))  # fmt: skip
        return self._slot(p.track_number), (master,), numbers

    @np.errstate(over="ignore", invalid="ignore")  # numbers of a sick service look odd on the map, no more
    def _take(self, slots: NDArray[np.int64], tails: NDArray[np.int64], numbers: NDArray[np.float64]) -> None:
        """Write points that have a place into the rings; of two of one track the later one comes behind."""
        placed = (np.abs(numbers[1]) <= 90.0) & (np.abs(numbers[2]) <= 180.0)
        left, numbers = slots[placed], numbers[:, placed]
        self.points += len(left)
        rows = np.zeros(len(left), dtype=POINT)
        for name, column in zip(("altitude_m", "speed_mps", "rate_mps"), numbers[3:6], strict=True):
            rows[name] = column
        rows["time_s"] = numbers[0]
        rows["lat"], rows["lon"] = np.rint(numbers[1:3] * 1e7).astype(np.int64)
        rows["element"] = np.nan_to_num(numbers[6], nan=-1.0)
        rows["rejected"] = np.clip(numbers[7], 0, 0xFFFF)
        rows["sigma_m"] = largest_sigma(*numbers[8:11])
        rows["master"] = tails[placed, 0]
        while len(left):
            # A track that has several points in a batch gets one of them in each turn, the earliest left.
            last = np.empty(len(self._count), dtype=np.int64)
            places = np.arange(len(left))
            last[left[::-1]] = places[::-1]
            first = last[left] == places
            slots = left[first]
            self._ring[slots, self._count[slots] % POINTS] = rows[first]
            self._count[slots] += 1
            left, rows = left[~first], rows[~first]

    def _slot(self, number: int) -> int:
        slot = self._slot_of.get(number)
        if slot is None:
            if not self._free:
                before = len(self._ring)
                more = max(before, FIRST_TRACKS)
                # Memory that nobody has written to yet costs nothing.
                ring = np.zeros((before + more, POINTS), dtype=POINT)
                ring[:before] = self._ring
                self._ring = ring
                self._count = np.concatenate([self._count, np.zeros(more, dtype=np.int64)])
                self._free += range(before + more - 1, before - 1, -1)
            slot = self._slot_of[number] = self._free.pop()
            self._count[slot] = 0
        return slot

    def keep_only(self, numbers: Collection[int]) -> None:
        """Forget the trails of all other tracks."""
        for number in [n for n in self._slot_of if n not in numbers]:
            slot = self._slot_of.pop(number)
            self._reader.forget(slot)
            self._free.append(slot)

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

    def packed(self, numbers: Iterable[int], seconds: float, most: int) -> bytes:
        """The trails of some tracks, see ``pack_trails``."""
        trails = []
        for number in numbers:
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


def chosen_numbers(records: Records, of: Box | frozenset[int] | None) -> list[int]:
    """The numbers of the tracks in a box, of those of some numbers that are there, or of all."""
    numbers: list[int] = (records[in_box(records, of)] if isinstance(of, tuple) else records)["number"].tolist()
    return [number for number in numbers if number in of] if isinstance(of, frozenset) else numbers


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
