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
from aeroskein_service.web.known_parts import UNKNOWN, KnownParts
from aeroskein_service.web.live_points import (
    STATUS_INDEX,
    LivePoint,
    flag_bits,
    read_messages,
    read_point,
    source_names,
    whole_point,
)
from aeroskein_service.web.quick_points import BODY, START, TAIL, QuickReader, cut
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
POINTS_AT_ONCE: Final = 5000  # points that become columns together: 10 ms
UNKNOWN_COVARIANCE: Final = (np.nan,) * 3
CACHED: Final = 20_000  # different tails of points remembered
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


class _Batch:
    """Points read field by field that become columns together."""

    def __init__(self) -> None:
        self.slots: list[int] = []
        self.tails: list[int] = []
        self.numbers: list[tuple[Any, ...]] = []


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
        self._records = blank(0)
        self._time_s = self._arrived_s = self._heard_s = np.zeros(0)
        self._epoch = np.zeros(0, dtype=np.int64)
        self._contributed_s = np.zeros((0, MOST_SENSORS))
        self._identity: list[tuple[Any, ...] | None] = []
        self._number: list[int] = []
        self._message: NDArray[np.object_] = np.empty(0, dtype=object)
        self._reader = QuickReader()
        self._head: list[bytes | None] = []
        self._tail_rows: dict[tuple[int, ...], int] = {}
        self._tail_table = np.zeros((0, 4), dtype=np.int64)
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
            slow = _Batch()
            points: list[bytes] = []
            messages: list[_Message] = []
            while self._waiting and len(points) + len(slow.slots) < POINTS_AT_ONCE:
                payload, encoding = self._waiting.popleft()
                parts = cut(payload) if encoding == MSGPACK else None
                if parts is not None:
                    points += parts[1]
                    messages += [_Message(payload, encoding, parts[0])] * len(parts[1])
                    continue
                try:
                    epoch, others = read_messages(payload, encoding)
                except MessageError:
                    self.broken += 1
                    continue
                for other in others:
                    self._read_slowly(slow, bytes(other), _Message(payload, encoding, epoch))
            if points:
                self._read_quickly(points, messages, slow)
            if slow.slots:
                self._take(np.array(slow.slots), np.array(slow.tails), np.array(slow.numbers, dtype=np.float64).T)

    def _read_quickly(self, points: list[bytes], messages: list[_Message], slow: _Batch) -> None:
        """Read points whose heads and tails are known at once, and learn those of the others."""
        read = self._reader.sort(points)
        known = read.heads != UNKNOWN
        slots = read.heads[known]
        kept = np.empty(len(points), dtype=object)
        kept[:] = messages
        self._message[slots] = kept[known]
        self._take(slots, read.tails[known], read.numbers[:, known])
        for place in np.flatnonzero(~known).tolist():
            point = points[place]
            begin = point.find(BODY)
            end = point.find(TAIL, begin)
            found = self._read_slowly(slow, START + point, messages[place])
            if found is not None and 0 < begin < end:
                self._remember(point[:begin], point[end:], *found)

    def _remember(self, head: bytes, tail: bytes, slot: int, row: int) -> None:
        before = self._head[slot]
        if before is not None and before != head:
            self._reader.heads.remove(before)
        self._head[slot] = head
        self._reader.heads.add(head, slot)
        if len(self._reader.tails) >= CACHED:
            self._reader.tails = KnownParts()
        self._reader.tails.add(tail, row)

    def _tail(self, *values: int) -> int:
        """The row of status, master, sensors and flags in the table of those there are."""
        row = self._tail_rows.setdefault(values, len(self._tail_rows))
        if row == len(self._tail_table):
            self._tail_table = np.concatenate([self._tail_table, np.array([values], dtype=np.int64)])
        return row

    def _read_slowly(self, slow: _Batch, point: bytes, message: _Message) -> tuple[int, int] | None:
        """Read a point field by field; None where it is none."""
        encoding = message.encoding
        self.in_full += 1
        self._newest_epoch = max(self._newest_epoch, message.epoch)
        try:
            p = read_point(point, encoding)
        except MessageError:
            self.broken += 1
            return None
        slot = self._slot(p, message)
        bits = 0
        for name in source_names(p.sources, encoding):
            bits |= 1 << self._sensors.index(name)
        master = -1 if p.master is None else self._sensors.index(p.master)
        tail = self._tail(STATUS_INDEX.get(p.status, 0), master, bits, flag_bits(p.flags, encoding))
        slow.slots.append(slot)
        slow.tails.append(tail)
        slow.numbers.append(
            (p.time_s, p.lat_deg, p.lon_deg, p.altitude_m, p.ground_speed_mps, p.track_angle_deg, p.vertical_rate_mps,
             p.input_received_s, *(p.position_cov_m2 or UNKNOWN_COVARIANCE))
        )  # fmt: skip
        return slot, tail

    def _take(self, slots: NDArray[np.int64], tails: NDArray[np.int64], numbers: NDArray[np.float64]) -> None:
        """Write points into the columns; of two of one track the later one stays."""
        status, master, masks, flags = self._tail_table[tails].T
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
            self._contributed_s[slots[rows], sensor] = numbers[0, rows]

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
        self._records[slot] = blank(1)[0]
        self._records["number"][slot] = number & 0xFFFFFFFF
        self._number[slot] = number
        self._epoch[slot] = epoch
        self._contributed_s[slot] = -np.inf
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
        self._contributed_s = np.concatenate([self._contributed_s, np.full((more, MOST_SENSORS), -np.inf)])
        self._identity += [None] * more
        self._number += [-1] * more
        self._head += [None] * more
        self._message = np.concatenate([self._message, np.empty(more, dtype=object)])
        self._free += range(capacity - 1, before - 1, -1)

    def _drop(self, slot: int) -> None:
        self._slot_of.pop(self._number[slot], None)
        identity = self._identity[slot]
        if identity is not None and self._slot_of_label.get(identity[0]) == slot:
            del self._slot_of_label[identity[0]]
        head = self._head[slot]
        if head is not None:
            self._reader.heads.remove(head)
        self._identity[slot] = self._message[slot] = self._head[slot] = None
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
        return np.fromiter(self._slot_of.values(), dtype=np.int64, count=len(self._slot_of))

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
        limits_s = self._sensors.contributes_s()
        n = len(limits_s)
        lately = now_s - self._contributed_s[slots, :n] <= limits_s
        made["sensors"] = (lately * (np.uint32(1) << np.arange(n, dtype=np.uint32))).sum(axis=1, dtype=np.uint32)
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
