"""The element log: what the last twenty elements of every track looked like, for engineers and the map.

Kept as rows of fixed size per closing pass, in single precision where that is enough (positions are metres in a plane
of 50 km: 4 mm), turned into plain numbers only for the one track that somebody asks for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein import geodesy
from aeroskein.closed import Closed
from aeroskein.frames import FrameTable
from aeroskein.plots import Array, Ints
from aeroskein.points import Flag, FusedPoints, Status
from aeroskein.reasons import Reason

__all__ = ["ElementLog"]

# Elements kept per track.
KEEP: Final = 20
# The axis is drawn in pieces of about a second.
AXIS_PIECES: Final = 4

# What is kept of the fused points: full precision for place and time, single for what is small or read by people.
_PLACES: Final = ("time_s", "lat_deg", "lon_deg")
_NUMBERS: Final = ("altitude_m", "height_m", "ground_speed_mps", "track_angle_deg", "vertical_rate_mps")
_SINGLE: Final = (*_PLACES, *_NUMBERS)
_COVARIANCES: Final = ("position_cov_m2", "velocity_cov_m2ps2")
# A report of an element: time since the element's start, place in its plane. 14 bytes.
_REPORT: Final = np.dtype(
    [("sensor", "i1"), ("reason", "u1"), ("after_s", "f4"), ("east_m", "f4"), ("north_m", "f4")]
)  # fmt: skip


@cache
def _element_dtype(sensors: int) -> np.dtype[Any]:
    """An element with its fused point; its reports are ``reports`` rows from ``first`` on."""
    return np.dtype(
        [
            ("number", "u4"), ("slot", "i4"), ("frame", "i4"), ("index", "i4"), ("seq", "i4"), ("span_s", "f8", 2),
            ("x", "f4", 6), ("half_width_m", "f4"), ("first", "i4"), ("reports", "u2"), *[(n, "f8") for n in _PLACES],
            *[(n, "f4") for n in _NUMBERS], *[(n, "f4", 3) for n in _COVARIANCES], ("status", "u1"), ("master", "i1"),
            ("flags", "u2"), ("rejected", "u2"), ("sources", "u2", sensors),
        ]
    )  # fmt: skip


@dataclass(slots=True, eq=False)
class _Pass:
    """Closed elements of one pass and their reports, rows of the two kinds above; ``end_s`` is the last end."""

    elements: NDArray[Any]
    reports: NDArray[Any]
    end_s: float

    def take(self, rows: Ints) -> _Pass:
        """Some of the elements, with their reports."""
        elements = self.elements[rows]
        count = elements["reports"].astype(np.int64)
        first = np.cumsum(count) - count
        place = np.repeat(elements["first"] - first, count) + np.arange(int(count.sum()))
        elements["first"] = first
        return _Pass(elements, self.reports[place], self.end_s)


class ElementLog:
    """Elements of all tracks, oldest pass first.

    Parameters
    ----------
    element_s, longest_s : float
        Usual and longest length of an element. [s]
    """

    def __init__(self, element_s: float, longest_s: float) -> None:
        self._thin_s, self._keep_s = (KEEP + 1) * element_s, (KEEP + 1) * longest_s
        self._passes: deque[_Pass] = deque()
        # Passes that have been looked through once, from the left.
        self._thinned = 0
        # By slot: the track that closed its last element there, and the index of that element.
        self._number, self._index = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)

    def add(
        self,
        closed: Closed,
        number: Ints,
        frame: Ints,
        points: FusedPoints,
        half_width_m: Array,
        reason: NDArray[np.uint8],
    ) -> None:
        """Keep a pass of closed elements.

        Parameters
        ----------
        closed : Closed
            The elements.
        number, frame : (n,) int64
            Track number and frame.
        points : FusedPoints
            The fused points, rows in the order of ``closed``.
        half_width_m : (n,) array
            Half distance of the boundary lines. [m]
        reason : (K, n) uint8
            What became of the reports in the span.
        """
        w = closed.window
        lane, event = np.nonzero(closed.inside.T)
        reports = np.empty(len(lane), dtype=_REPORT)
        at = event * len(closed.slots) + lane
        reports["sensor"], reports["reason"] = w.sensor_index.take(at), reason.take(at)
        reports["after_s"] = w.time_s.take(at) - closed.span_s[lane, 0]
        reports["east_m"], reports["north_m"] = w.east_m.take(at), w.north_m.take(at)
        count = np.bincount(lane, minlength=len(closed.slots))
        rows = np.empty(len(closed.slots), dtype=_element_dtype(points.sources.shape[1]))
        columns = {
            "number": number, "slot": closed.slots, "frame": frame, "index": closed.index, "span_s": closed.span_s,
            "x": closed.estimate.x.T, "half_width_m": half_width_m, "first": np.cumsum(count) - count, "reports": count,
        }  # fmt: skip
        of_point = ("seq", *_PLACES, *_NUMBERS, *_COVARIANCES, "status", "master", "flags", "rejected", "sources")
        for name, column in (columns | {name: getattr(points, name) for name in of_point}).items():
            rows[name] = column
        self._passes.append(_Pass(rows, reports, float(closed.span_s[:, 1].max(initial=-np.inf))))
        self._note(closed.slots, number, closed.index)
        self._forget(self._passes[-1].end_s)

    def _note(self, slots: Ints, number: Ints, index: Ints) -> None:
        more = int(slots.max(initial=-1)) + 1 - len(self._number)
        if more > 0:
            fresh = np.full(more, -1, dtype=np.int64)
            self._number, self._index = np.append(self._number, fresh), np.append(self._index, fresh)
        self._number[slots], self._index[slots] = number, index

    def _forget(self, newest_s: float) -> None:
        """Take out what is older than its track's last twenty, once that can be; later everything."""
        while self._passes and self._passes[0].end_s < newest_s - self._keep_s:
            self._passes.popleft()
            self._thinned = max(self._thinned - 1, 0)
        while self._thinned < len(self._passes) and self._passes[self._thinned].end_s < newest_s - self._thin_s:
            rows = self._passes[self._thinned].elements
            slot = rows["slot"]
            old = (self._number[slot] == rows["number"]) & (self._index[slot] - rows["index"] >= KEEP)
            self._passes[self._thinned] = self._passes[self._thinned].take(np.flatnonzero(~old))
            self._thinned += 1

    def keep_all(self) -> None:
        """Forget nothing from now on: for a file that is replayed."""
        self._keep_s = self._thin_s = np.inf

    def of_track(
        self, number: int, frames: FrameTable, sensor_ids: list[str], until_s: float = np.inf
    ) -> list[dict[str, Any]]:
        """The last elements of one track as plain numbers, oldest first; see ``docs/messages.md``.

        Elements that end after ``until_s`` are left out.
        """
        places: deque[tuple[_Pass, int]] = deque(maxlen=KEEP)
        for p in self._passes:
            mine = (p.elements["number"] == number) & (p.elements["span_s"][:, 1] <= until_s)
            places.extend((p, int(i)) for i in np.flatnonzero(mine))
        return [_record(p, i, frames, sensor_ids) for p, i in places]


def _point(row: Any, sensor_ids: list[str]) -> dict[str, Any]:
    """One point as plain numbers; what is unknown is None."""
    master = int(row["master"])
    covariances = {name: _known(row[name]) for name in _COVARIANCES}
    return {
        **dict(zip(_SINGLE, _known(row[name] for name in _SINGLE), strict=True)),
        **{name: None if None in part else part for name, part in covariances.items()},
        "status": Status(int(row["status"])).name.lower(),
        "master": sensor_ids[master] if master >= 0 else None,
        "sources": {sensor_ids[k]: int(many) for k, many in enumerate(row["sources"]) if many},
        "rejected": int(row["rejected"]),
        "flags": [str(flag.name).lower() for flag in Flag if int(row["flags"]) & flag],
    }


def _known(values: Iterable[float]) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _record(p: _Pass, i: int, frames: FrameTable, sensor_ids: list[str]) -> dict[str, Any]:
    row = p.elements[i]
    frame = frames.rows[[int(row["frame"])]]
    start, end = (float(t) for t in row["span_s"])
    centre = 0.5 * (start + end)
    h = np.linspace(start, end, AXIS_PIECES + 1) - centre
    x = row["x"].astype(np.float64)
    axis = x[0:2] + h[:, None] * x[2:4] + 0.5 * h[:, None] ** 2 * x[4:6]
    direction = x[2:4] + h[:, None] * x[4:6]
    direction = direction / np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-6)[:, None]
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) * float(row["half_width_m"])
    reports = p.reports[int(row["first"]) : int(row["first"]) + int(row["reports"])]
    seen_m = np.stack([reports["east_m"], reports["north_m"]], axis=1).astype(np.float64)
    # All at once: a conversion costs more by its call than by its points.
    plane_m = np.concatenate([axis, axis + normal, axis - normal, seen_m])
    globe = np.stack(geodesy.from_plane(frame, plane_m[:, 0], plane_m[:, 1]), axis=1).tolist()
    line, left, right = (globe[k * len(h) : (k + 1) * len(h)] for k in range(3))
    report = zip(
        reports["sensor"].tolist(), reports["after_s"].tolist(), reports["reason"].tolist(), globe[3 * len(h) :],
        strict=True,
    )  # fmt: skip
    return {
        "element": int(row["index"]),
        "seq": int(row["seq"]),
        "span_s": [start, end],
        "centre_s": centre,
        "axis": line,
        "axis_time_s": np.linspace(start, end, AXIS_PIECES + 1).tolist(),
        "division_points": [line[0], line[-1]],
        "boundary_lines": [left, right],
        "half_width_m": float(row["half_width_m"]),
        "point": _point(row, sensor_ids),
        "reports": [
            {
                "sensor": sensor_ids[sensor],
                "time_s": start + after_s,
                "lat_deg": lat_deg,
                "lon_deg": lon_deg,
                "accepted": reason == 0,
                "reason": None if reason == 0 else Reason(reason).wire_name,
            }
            for sensor, after_s, reason, (lat_deg, lon_deg) in report
        ],
    }
