"""The element log: what the last twenty elements of every track looked like, for engineers and the map.

Kept as columns per closing pass in single precision (positions are metres in a plane of 50 km: 4 mm), turned into
plain numbers only for the one track that somebody asks for.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein import geodesy
from aeroskein.closed import Closed
from aeroskein.frames import FrameTable
from aeroskein.plots import Array, Bools, Ints
from aeroskein.points import Flag, FusedPoints, Status
from aeroskein.reasons import Reason

__all__ = ["ElementLog"]

# Elements kept per track.
KEEP: Final = 20
# The axis is drawn in pieces of about a second.
AXIS_PIECES: Final = 4

Single = NDArray[np.float32]


@dataclass(slots=True, eq=False)
class _Pass:
    """Closed elements of one pass: columns ``(n,)`` by element, then columns ``(m,)`` by report."""

    number: Ints
    frame: NDArray[np.int32]
    index: NDArray[np.int32]
    span_s: Array
    centre_s: Array
    x: Single
    half_width_m: Single
    seq: Ints
    fused: _FusedColumns
    element_of: NDArray[np.int32]
    sensor: NDArray[np.int8]
    reason: NDArray[np.uint8]
    after_s: Single
    east_m: Single
    north_m: Single


# What is kept of the fused points: full precision for place and time, single for what is small or read by people.
_PLACES: Final = ("time_s", "lat_deg", "lon_deg")
_NUMBERS: Final = ("altitude_m", "height_m", "ground_speed_mps", "track_angle_deg", "vertical_rate_mps")
_COVARIANCES: Final = ("position_cov_m2", "velocity_cov_m2ps2")


@dataclass(slots=True, eq=False)
class _FusedColumns:
    """Fused points of one pass, rows by element."""

    places: Array
    numbers: Single
    covariances: Single
    status: NDArray[np.uint8]
    master: NDArray[np.int8]
    flags: NDArray[np.uint16]
    sources: NDArray[np.uint16]
    rejected: NDArray[np.uint16]

    @classmethod
    def of(cls, points: FusedPoints) -> Self:
        """Keep what the query shows."""
        return cls(
            np.stack([getattr(points, name) for name in _PLACES], axis=1),
            np.stack([getattr(points, name) for name in _NUMBERS], axis=1).astype(np.float32),
            np.concatenate([getattr(points, name) for name in _COVARIANCES], axis=1).astype(np.float32),
            points.status,
            points.master.astype(np.int8),
            points.flags,
            points.sources.astype(np.uint16),
            points.rejected.astype(np.uint16),
        )

    def row(self, i: int, sensor_ids: list[str]) -> dict[str, Any]:
        """One point as plain numbers; what is unknown is None."""
        numbers, covariances = _known(self.numbers[i]), _known(self.covariances[i])
        master = int(self.master[i])
        return {
            **dict(zip(_PLACES, _known(self.places[i]), strict=True)),
            **dict(zip(_NUMBERS, numbers, strict=True)),
            **{
                name: None if None in (part := covariances[3 * k : 3 * k + 3]) else part
                for k, name in enumerate(_COVARIANCES)
            },
            "status": Status(int(self.status[i])).name.lower(),
            "master": sensor_ids[master] if master >= 0 else None,
            "sources": {sensor_ids[k]: int(many) for k, many in enumerate(self.sources[i]) if many},
            "rejected": int(self.rejected[i]),
            "flags": [str(flag.name).lower() for flag in Flag if int(self.flags[i]) & flag],
        }


def _known(values: NDArray[Any]) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


class ElementLog:
    """Elements of all tracks, oldest pass first."""

    def __init__(self, longest_element_s: float) -> None:
        self._keep_s = (KEEP + 1) * longest_element_s
        self._passes: deque[_Pass] = deque()

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
        event, lane = np.nonzero(closed.in_span())
        self._passes.append(
            _Pass(
                number,
                frame.astype(np.int32),
                closed.index.astype(np.int32),
                closed.span_s,
                closed.centre_s,
                closed.estimate.x.T.astype(np.float32),
                half_width_m.astype(np.float32),
                points.seq,
                _FusedColumns.of(points),
                lane.astype(np.int32),
                w.sensor_index[event, lane].astype(np.int8),
                reason[event, lane],
                (w.time_s[event, lane] - closed.span_s[lane, 0]).astype(np.float32),
                w.east_m[event, lane].astype(np.float32),
                w.north_m[event, lane].astype(np.float32),
            )
        )
        newest = float(closed.span_s[:, 1].max(initial=-np.inf))
        while self._passes and float(self._passes[0].span_s[:, 1].max()) < newest - self._keep_s:
            self._passes.popleft()

    def keep_all(self) -> None:
        """Forget nothing from now on: for a file that is replayed."""
        self._keep_s = np.inf

    def of_track(
        self, number: int, frames: FrameTable, sensor_ids: list[str], until_s: float = np.inf
    ) -> list[dict[str, Any]]:
        """The last elements of one track as plain numbers, oldest first; see ``docs/messages.md``.

        Elements that end after ``until_s`` are left out.
        """
        places: deque[tuple[_Pass, int]] = deque(maxlen=KEEP)
        for p in self._passes:
            places.extend((p, int(i)) for i in np.flatnonzero((p.number == number) & (p.span_s[:, 1] <= until_s)))
        return [_record(p, i, frames, sensor_ids) for p, i in places]


def _record(p: _Pass, i: int, frames: FrameTable, sensor_ids: list[str]) -> dict[str, Any]:
    frame = frames.rows[[int(p.frame[i])]]
    start, end = (float(t) for t in p.span_s[i])
    h = np.linspace(start, end, AXIS_PIECES + 1) - float(p.centre_s[i])
    x = p.x[i].astype(np.float64)
    axis = x[0:2] + h[:, None] * x[2:4] + 0.5 * h[:, None] ** 2 * x[4:6]
    direction = x[2:4] + h[:, None] * x[4:6]
    direction = direction / np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-6)[:, None]
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) * float(p.half_width_m[i])
    of_element: Bools = p.element_of == i
    reports = np.flatnonzero(of_element)
    at = np.stack([p.east_m[reports], p.north_m[reports]], axis=1).astype(np.float64)
    lat, lon = geodesy.from_plane(frame, at[:, 0], at[:, 1])
    return {
        "element": int(p.index[i]),
        "seq": int(p.seq[i]),
        "span_s": [start, end],
        "centre_s": float(p.centre_s[i]),
        "axis": _globe(frame, axis),
        "axis_time_s": [float(t) for t in np.linspace(start, end, AXIS_PIECES + 1)],
        "division_points": _globe(frame, axis[[0, -1]]),
        "boundary_lines": [_globe(frame, axis + normal), _globe(frame, axis - normal)],
        "half_width_m": float(p.half_width_m[i]),
        "point": p.fused.row(i, sensor_ids),
        "reports": [
            {
                "sensor": sensor_ids[int(p.sensor[r])],
                "time_s": start + float(p.after_s[r]),
                "lat_deg": float(lat[k]),
                "lon_deg": float(lon[k]),
                "accepted": int(p.reason[r]) == 0,
                "reason": None if p.reason[r] == 0 else Reason(int(p.reason[r])).wire_name,
            }
            for k, r in enumerate(reports)
        ],
    }


def _globe(frame: Array, plane_m: Array) -> list[list[float]]:
    """Plane points ``(k, 2)`` as ``[[lat, lon], ...]``."""
    lat, lon = geodesy.from_plane(frame, plane_m[:, 0], plane_m[:, 1])
    return [[float(a), float(b)] for a, b in zip(lat, lon, strict=True)]
