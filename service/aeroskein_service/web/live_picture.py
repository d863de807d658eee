"""The picture now: the newest live state of every track, kept as the records that go out to the browsers.

Messages of the feed are only queued by Zenoh's threads; ``drain`` reads them on the page's own. Python sees each point
once, to find its slot; everything else is columns.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aeroskein_service.codec import MessageError
from aeroskein_service.messages import MSGPACK, FusedPoint
from aeroskein_service.web.known_parts import UNKNOWN
from aeroskein_service.web.live_points import (
    STATUS_INDEX,
    LivePoint,
    flag_bits,
    read_messages,
    read_point,
    source_names,
    whole_point,
)
from aeroskein_service.web.quick_points import QuickReader
from aeroskein_service.web.records import (
    NAMED_BY_ADDRESS,
    UNKNOWN_ADDRESS,
    UNKNOWN_MODE_A,
    Records,
    blank,
    largest_sigma,
    pack_motion,
    pack_position,
)
from aeroskein_service.web.sensor_table import MOST_SENSORS, SensorTable

__all__ = ["LivePicture"]

MESSAGES: Final = 20_000  # messages that may wait, half a minute at 20,000 points/s; the oldest go first
FIRST_TRACKS: Final = 1024  # slots at the start; doubled when they are used up
MESSAGES_AT_ONCE: Final = 200  # messages that become columns together: 10,000 points, 10 ms
# What a picture needs of a point, in order; a covariance has three numbers.
NUMBERS: Final = (
    "time_s", "lat_deg", "lon_deg", "altitude_m", "ground_speed_mps", "track_angle_deg", "vertical_rate_mps",
    "input_received_s", "position_cov_m2",
)  # fmt: skip
UNKNOWN_COVARIANCE: Final = (np.nan,) * 3
TERMINATED: Final = STATUS_INDEX["terminated"]
ENDED_S: Final = 5.0  # how long an ended track stays in the picture
# A track that the service has not mentioned for so long, while it did mention others, was dropped by it. [s]
FORGOTTEN_S: Final = 60.0
# Tracks of a service that started earlier go when they have had no news for so long. [s]
REPLACED_S: Final = 3.0


class _Message(NamedTuple):
    """A message of the feed; tracks keep the newest one they came in."""

    payload: bytes
    encoding: str
    epoch: int


class _Point(NamedTuple):
    """A point read field by field: its slot, status, master, sensors and flags, and its numbers."""

    slot: int
    tail: tuple[int, int, int, int]
    numbers: tuple[Any, ...]


class LivePicture:
    """All tracks of the feed.

    Parameters
    ----------
    sensors : SensorTable
        Learns the sensors that contribute.
    clock : callable
        Gives the time. [s since the epoch]
    """

    def __init__(self, sensors: SensorTable, clock: Callable[[], float] = time.time) -> None:
        self._sensors = sensors
        self._clock = clock
        self._waiting: deque[tuple[bytes, str]] = deque(maxlen=MESSAGES)
        self._slot_of: dict[int, int] = {}
        self._slot_of_label: dict[str, int] = {}
        self._free: list[int] = []
        self._used: NDArray[np.int64] | None = None
        self._records = blank(0)
        self._time_s = self._arrived_s = self._heard_s = np.zeros(0)
        self._epoch = np.zeros(0, dtype=np.int64)
        self._contributed_s = np.zeros((MOST_SENSORS, 0))
        self._identity: list[tuple[Any, ...] | None] = []
        self._number: list[int] = []
        self._message: NDArray[np.object_] = np.empty(0, dtype=object)
        self._reader = QuickReader(NUMBERS, tail=4)
        self._newest_epoch = 0
        self.news_s = 0.0  # when the feed last said anything
        self.points = 0
        self.in_full = 0  # of them, read field by field
        self.broken = 0
        self._grow(FIRST_TRACKS)

    def __len__(self) -> int:
        return len(self._slot_of)

    # -- in ----------------------------------------------------------------------------------------------------------
    def note(self, _key: str, payload: bytes, encoding: str) -> None:
        """Queue one message of the feed; called by Zenoh."""
        self._waiting.append((payload, encoding))
        self.news_s = self._clock()

    def drain(self) -> None:
        """Read what has arrived."""
        while self._waiting:
            quick: list[_Message] = []
            slow: list[_Message] = []
            while self._waiting and len(quick) + len(slow) < MESSAGES_AT_ONCE:
                payload, encoding = self._waiting.popleft()
                (quick if encoding == MSGPACK else slow).append(_Message(payload, encoding, 0))
            if quick:
                slow += self._read_quickly(quick)
            if slow:
                self._read_whole(slow)

    def _read_quickly(self, waiting: list[_Message]) -> list[_Message]:
        """Read points as columns, and field by field those that are new; gives what could not be cut into points."""
        read = self._reader.read([message.payload for message in waiting])
        messages = np.empty(len(waiting), dtype=object)
        for index, epoch in read.epochs.items():
            messages[index] = waiting[index]._replace(epoch=epoch)
        unknown = read.unknown()
        for row in unknown:
            point = self._read_point(read.point(row), messages[read.message[row]])
            if point is not None:
                read.fill(row, *point)
        self._reader.learn(read, unknown)
        there = read.places != UNKNOWN
        self._message[read.places[there]] = messages[read.message[there]]
        self._take(read.places[there], read.tails[there], read.numbers[:, there])
        return [waiting[index] for index in read.left]

    def _read_whole(self, messages: list[_Message]) -> None:
        """Read messages point by point."""
        found: list[_Point] = []
        for message in messages:
            try:
                epoch, points = read_messages(message.payload, message.encoding)
            except MessageError:
                self.broken += 1
                continue
            message = message._replace(epoch=epoch)
            read = [self._read_point(bytes(point), message) for point in points]
            found += [point for point in read if point is not None]
        if found:
            slots, tails, numbers = zip(*found, strict=True)
            self._take(np.array(slots), np.array(tails), np.array(numbers, dtype=np.float64).T)

    def _read_point(self, point: bytes, message: _Message) -> _Point | None:
        """Read a point field by field; None where it is none."""
        encoding = message.encoding
        self.in_full += 1
        self._newest_epoch = max(self._newest_epoch, message.epoch)
        try:
            p = read_point(point, encoding)
        except MessageError:
            self.broken += 1
            return None
        bits = 0
        for name in source_names(p.sources, encoding):
            bits |= 1 << self._sensors.index(name)
        master = -1 if p.master is None else self._sensors.index(p.master)
        return _Point(
            self._slot(p, message),
            (STATUS_INDEX.get(p.status, 0), master, bits, flag_bits(p.flags, encoding)),
            (p.time_s, p.lat_deg, p.lon_deg, p.altitude_m, p.ground_speed_mps, p.track_angle_deg, p.vertical_rate_mps,
             p.input_received_s, *(p.position_cov_m2 or UNKNOWN_COVARIANCE)),
        )  # fmt: skip

    @np.errstate(over="ignore", invalid="ignore")  # numbers of a sick service look odd on the map, no more
    def _take(self, slots: NDArray[np.int64], tails: NDArray[np.int64], numbers: NDArray[np.float64]) -> None:
        """Write points into the columns; of two of one track the later one stays."""
        status, master, masks, flags = tails.T
        self.points += len(slots)
        records = self._records
        pack_position(records, slots, *numbers[1:4])
        pack_motion(records, slots, *numbers[4:7])
        records["sigma_m"][slots] = largest_sigma(*numbers[8:11])
        records["status"][slots] = status
        records["flags"][slots] = flags
        records["master"][slots] = master
        self._time_s[slots] = numbers[0]
        self._arrived_s[slots] = self._clock()
        self._heard_s[slots] = numbers[7]
        for sensor in range(len(self._sensors)):
            rows = np.flatnonzero(masks >> sensor & 1)
            self._contributed_s[sensor, slots[rows]] = numbers[0, rows]

    def _slot(self, point: LivePoint, message: _Message) -> int:
        slot = self._slot_of.get(point.track_number)
        if slot is None or self._epoch[slot] != message.epoch:
            if slot is not None:
                self._drop(slot)
            slot = self._open(point.track_number, message.epoch)
        identity = (point.track, point.address, point.callsign, point.mode_a)
        if identity != self._identity[slot]:
            self._identify(slot, *identity)
        self._message[slot] = message
        return slot

    def _open(self, number: int, epoch: int) -> int:
        if not self._free:
            self._grow(2 * len(self._records))
        slot = self._free.pop()
        self._slot_of[number] = slot
        self._used = None
        self._records[slot] = blank(1)[0]
        self._records["number"][slot] = number & 0xFFFFFFFF
        self._number[slot] = number
        self._epoch[slot] = epoch
        self._contributed_s[:, slot] = -np.inf
        self._identity[slot] = None
        return slot

    def _identify(self, slot: int, track: str, address: str | None, callsign: str | None, mode_a: str | None) -> None:
        before = self._identity[slot]
        if before is not None and self._slot_of_label.get(before[0]) == slot:
            del self._slot_of_label[before[0]]
        self._identity[slot] = (track, address, callsign, mode_a)
        self._slot_of_label[track] = slot
        record = self._records
        record["named"][slot] = NAMED_BY_ADDRESS if track == address else 0
        record["address"][slot] = _number(address, 16, UNKNOWN_ADDRESS)
        record["mode_a"][slot] = _number(mode_a, 8, UNKNOWN_MODE_A) & 0xFFFF
        record["callsign"][slot] = (callsign or "").encode("ascii", "replace")[:8]

    # -- slots -------------------------------------------------------------------------------------------------------
    def _grow(self, capacity: int) -> None:
        before = len(self._records)
        more = capacity - before
        self._records = np.concatenate([self._records, blank(more)])
        for name in ("_time_s", "_arrived_s", "_heard_s"):
            setattr(self, name, np.concatenate([getattr(self, name), np.zeros(more)]))
        self._epoch = np.concatenate([self._epoch, np.zeros(more, dtype=np.int64)])
        self._contributed_s = np.concatenate([self._contributed_s, np.full((MOST_SENSORS, more), -np.inf)], axis=1)
        self._identity += [None] * more
        self._number += [-1] * more
        self._message = np.concatenate([self._message, np.empty(more, dtype=object)])
        self._free += range(capacity - 1, before - 1, -1)

    def _drop(self, slot: int) -> None:
        self._slot_of.pop(self._number[slot], None)
        self._used = None
        identity = self._identity[slot]
        if identity is not None and self._slot_of_label.get(identity[0]) == slot:
            del self._slot_of_label[identity[0]]
        self._reader.forget(slot)
        self._identity[slot] = self._message[slot] = None
        self._free.append(slot)

    def prune(self) -> None:
        """Drop tracks that have ended, were forgotten, or belong to a service that another has replaced."""
        slots = self._rows()
        quiet_s = self._clock() - self._arrived_s[slots]
        gone = (self._records["status"][slots] == TERMINATED) & (quiet_s > ENDED_S)
        if self.silent_s < REPLACED_S:
            gone |= quiet_s > FORGOTTEN_S
            gone |= (self._epoch[slots] < self._newest_epoch) & (quiet_s > REPLACED_S)
        for slot in slots[gone].tolist():
            self._drop(slot)

    def _rows(self) -> NDArray[np.int64]:
        """The slots in use, in the order in which they were taken."""
        if self._used is None:
            self._used = np.fromiter(self._slot_of.values(), dtype=np.int64, count=len(self._slot_of))
        return self._used

    def numbers(self) -> set[int]:
        """The track numbers there are."""
        return set(self._slot_of)

    # -- out ---------------------------------------------------------------------------------------------------------
    @property
    def silent_s(self) -> float:
        """How long the feed has said nothing; 0 where it never has. [s]"""
        return max(self._clock() - self.news_s, 0.0) if self.news_s else 0.0

    def records(self, now_s: float) -> Records:
        """A copy of all records, with what depends on the time. The rows keep their order while tracks stay."""
        slots = self._rows()
        made = self._records[slots]
        made["age"] = np.clip(np.rint((now_s - self._time_s[slots]) * 100.0), -0x7FFF, 0x7FFF)
        heard = np.nan_to_num(now_s - self._heard_s[slots], nan=255.0)
        made["heard"] = np.clip(heard, 0.0, 255.0)
        sensors = np.zeros(len(slots), dtype=np.uint32)
        for bit, limit_s in enumerate(self._sensors.contributes_s().tolist()):
            sensors |= (now_s - self._contributed_s[bit, slots] <= limit_s).astype(np.uint32) << np.uint32(bit)
        made["sensors"] = sensors
        return made

    def point(self, label: str) -> FusedPoint | None:
        """The newest live point of a track with every field, None where there is no such track."""
        slot = self._slot_of_label.get(label)
        message: _Message | None = None if slot is None else self._message[slot]
        return (
            None
            if slot is None or message is None
            else whole_point(message.payload, message.encoding, self._number[slot])
        )

    def find(self, text: str, most: int) -> list[dict[str, Any]]:
        """Tracks whose label, address, callsign or code begins with (then: contains) the text, best first."""
        text = text.upper()
        found = []
        for label, slot in self._slot_of_label.items():
            identity = self._identity[slot]
            names = [name.upper() for name in identity or () if name]
            rank = min((_rank(name, text) for name in names), default=3)
            if rank < 3:
                record = self._records[slot]
                lat, lon = float(record["lat"]) * 1e-7, float(record["lon"]) * 1e-7
                callsign = identity[2] if identity else None
                found.append((rank, label, {"track": label, "callsign": callsign, "lat_deg": lat, "lon_deg": lon}))
        return [entry for _, _, entry in sorted(found, key=lambda item: item[:2])[:most]]


def _rank(name: str, text: str) -> int:
    """How well a name matches: 0 equal, 1 begins with it, 2 contains it, 3 not at all."""
    if name == text:
        return 0
    return 1 if name.startswith(text) else 2 if text in name else 3


def _number(text: str | None, base: int, unknown: int) -> int:
    """Digits as a number; what is no number is unknown."""
    try:
        return unknown if text is None else int(text, base) & 0xFFFFFFFF
    except ValueError:
        return unknown
