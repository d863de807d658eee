"""A recorded picture: every live state of a file in columns, and the picture of any instant out of them.

Rows are sorted by track and time, so the state of every track at an instant is one binary search over all tracks at
once. Jumping is as cheap as playing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein_service.web.live_points import STATUS_INDEX
from aeroskein_service.web.records import Records, record_label
from aeroskein_service.web.trails import POINT, Points

__all__ = ["LiveRows", "RecordedPicture"]

HOLD_S: Final = 10.0  # a state is shown no longer than this; a coasting track has one every second
ELEMENT_HOLD_S: Final = 20.0  # where a file holds elements only
ENDED_S: Final = 5.0
TERMINATED: Final = STATUS_INDEX["terminated"]

Array = NDArray[np.float64]


@dataclass(slots=True)
class LiveRows:
    """States in any order.

    Attributes
    ----------
    records : (n,) RECORD
        As for a frame; ``sensors`` says who contributed to this very state, ``age`` means nothing.
    time_s : (n,) float64
        [s since the epoch]
    epoch : (n,) int64
        Start of the service that published it.
    """

    records: Records
    time_s: Array
    epoch: NDArray[np.int64]


class RecordedPicture:
    """All tracks of a file.

    Parameters
    ----------
    rows : LiveRows
        At least one.
    contributes_s : (sensors,) float64
        How long each sensor counts as contributing after a report. [s]
    elements : (m,) POINT
        Points of elements, in any order.
    element_number, element_epoch : (m,) int64
        Whose they are.
    hold_s : float
        How long a state is shown. [s]
    """

    def __init__(
        self,
        rows: LiveRows,
        contributes_s: Array,
        elements: Points,
        element_number: NDArray[np.int64],
        element_epoch: NDArray[np.int64],
        hold_s: float = HOLD_S,
    ) -> None:
        self._hold_s = hold_s
        key = np.stack([rows.epoch, rows.records["number"].astype(np.int64)], axis=1)
        self._tracks, track = np.unique(key, axis=0, return_inverse=True)
        order = np.lexsort((rows.time_s, track))
        self._records, self._time_s, track = rows.records[order], rows.time_s[order], track[order]
        self._first = np.searchsorted(track, np.arange(len(self._tracks)))
        self.begin_s, self.end_s = float(self._time_s.min()), float(self._time_s.max())
        self._key = self._keyed(track, self._time_s)
        self._remember_sensors(track, contributes_s)
        self._elements, self._element_first, self._element_end = self._sorted_elements(
            elements, element_number, element_epoch
        )

    def _keyed(self, track: NDArray[np.int64], time_s: Any) -> Array:
        """Track and time as one number that grows with both."""
        apart = self.end_s - self.begin_s + 2.0
        return np.asarray(track * apart + np.clip(time_s - self.begin_s, -1.0, apart - 1.0))

    def _remember_sensors(self, track: NDArray[np.int64], contributes_s: Array) -> None:
        """Let ``sensors`` say who contributed lately, not only to this state."""
        now = self._records["sensors"].copy()
        lately = np.zeros(len(now), dtype=np.uint32)
        start, rows = self._first[track], np.arange(len(now))
        for bit, limit_s in enumerate(contributes_s.tolist()):
            last = np.maximum.accumulate(np.where(now >> bit & 1, rows, -1))
            there = (last >= start) & (self._time_s - self._time_s[np.maximum(last, 0)] <= limit_s)
            lately |= there.astype(np.uint32) << np.uint32(bit)
        self._records["sensors"] = lately

    def _sorted_elements(
        self, elements: Points, number: NDArray[np.int64], epoch: NDArray[np.int64]
    ) -> tuple[Points, NDArray[np.int64], NDArray[np.int64]]:
        index = {(int(e), int(n)): k for k, (e, n) in enumerate(self._tracks.tolist())}
        pairs = zip(epoch.tolist(), number.tolist(), strict=True)
        track = np.array([index.get(pair, -1) for pair in pairs], dtype=np.int64)
        elements, track = elements[track >= 0], track[track >= 0]
        order = np.lexsort((elements["time_s"], track))
        elements, track = elements[order], track[order]
        known = np.arange(len(self._tracks))
        return elements, np.searchsorted(track, known), np.searchsorted(track, known, side="right")

    # -- an instant --------------------------------------------------------------------------------------------------
    def _rows_at(self, at_s: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and track of every state that holds at an instant."""
        tracks = np.arange(len(self._tracks))
        row = np.searchsorted(self._key, self._keyed(tracks, at_s), side="right") - 1
        there = row >= self._first
        row, tracks = row[there], tracks[there]
        quiet_s = at_s - self._time_s[row]
        ended = self._records["status"][row] == TERMINATED
        there = quiet_s <= np.where(ended, ENDED_S, self._hold_s)
        return row[there], tracks[there]

    def at(self, at_s: float) -> Records:
        """The records of all tracks at an instant."""
        row, _ = self._rows_at(at_s)
        made = self._records[row]
        quiet_s = at_s - self._time_s[row]
        made["age"] = np.clip(np.rint(quiet_s * 100.0), 0, 0x7FFF)
        made["heard"] = np.clip(made["heard"] + quiet_s, 0, 255).astype(np.uint8)
        return made

    def track_at(self, label: str, at_s: float) -> int | None:
        """Index of the track of this name at an instant, or the last one that had it before."""
        row, tracks = self._rows_at(at_s)
        for records, index in ((self._records[row], tracks), (self._records[self._first], range(len(self._tracks)))):
            for record, track in zip(records, index, strict=True):
                if record_label(record) == label:
                    return int(track)
        return None

    def state(self, track: int, at_s: float) -> tuple[Any, float]:
        """The record of a track at an instant or the last before it, and its time."""
        row = int(np.searchsorted(self._key, self._keyed(np.array([track]), at_s), side="right")[0]) - 1
        row = max(row, int(self._first[track]))
        return self._records[row], float(self._time_s[row])

    def epoch_and_number(self, track: int) -> tuple[int, int]:
        """Which service published the track, and its number."""
        epoch, number = self._tracks[track].tolist()
        return int(epoch), int(number)

    def track_of(self, number: int, at_s: float) -> int | None:
        """Index of the track with a number at an instant."""
        row, tracks = self._rows_at(at_s)
        found = tracks[self._records["number"][row] == number]
        return int(found[0]) if len(found) else None

    # -- the way it came ---------------------------------------------------------------------------------------------
    def trail(self, track: int, at_s: float, seconds: float) -> Points:
        """The points of a track's elements in the time before an instant; its states where the file has none."""
        points = self._elements[self._element_first[track] : self._element_end[track]]
        if len(points):
            time_s = points["time_s"]
            return np.asarray(points[(time_s <= at_s) & (time_s >= at_s - seconds)])
        first = int(self._first[track])
        last = int(np.searchsorted(self._key, self._keyed(np.array([track]), at_s), side="right")[0])
        begin = first + int(np.searchsorted(self._time_s[first:last], at_s - seconds))
        return _points(self._records[begin:last], self._time_s[begin:last])


def _points(records: Records, time_s: Array) -> Points:
    """States as points of a trail."""
    made = np.zeros(len(records), dtype=POINT)
    made["time_s"] = time_s
    for name in ("lat", "lon", "altitude_m", "sigma_m", "master"):
        made[name] = records[name]
    speed, rate = records["speed"], records["rate"]
    made["speed_mps"] = np.where(speed == 0xFFFF, np.nan, speed * 0.1)
    made["rate_mps"] = np.where(rate == -0x8000, np.nan, rate * 0.01)
    made["element"] = -1
    return made
