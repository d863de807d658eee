"""A fused file as a recorded picture. It holds no reports, so its elements are drawn from their fused points."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein_service.config import Config
from aeroskein_service.evaluation.lines import LineReader
from aeroskein_service.messages import FLAG_NAMES
from aeroskein_service.progress import progress_bar
from aeroskein_service.web.live_points import STATUS_INDEX
from aeroskein_service.web.recorded import ELEMENT_HOLD_S, HOLD_S, LiveRows, RecordedPicture
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
from aeroskein_service.web.replay_source import ReplaySource
from aeroskein_service.web.sensor_table import SensorTable
from aeroskein_service.web.trails import POINT, Points

__all__ = ["read_fused"]

LAST_ELEMENTS: Final = 20
_NONE3: Final = (np.nan, np.nan, np.nan)
_FLAG: Final = {name: 1 << bit for bit, name in enumerate(FLAG_NAMES)}


class _Line(msgspec.Struct, gc=False):
    """A fused point, as far as it is shown."""

    track_number: int
    time_s: float
    lat_deg: float
    lon_deg: float
    product: str = "live"
    track: str | None = None
    address: str | None = None
    callsign: str | None = None
    mode_a: str | None = None
    epoch: int = 0
    seq: int | None = None
    altitude_m: float | None = None
    height_m: float | None = None
    ground_speed_mps: float | None = None
    track_angle_deg: float | None = None
    vertical_rate_mps: float | None = None
    position_cov_m2: tuple[float, float, float] | None = None
    status: str = "confirmed"
    element: int | None = None
    span_s: tuple[float, float] | None = None
    master: str | None = None
    sources: dict[str, int] = {}
    rejected: int = 0
    input_received_s: float | None = None
    published_s: float | None = None
    flags: list[str] = []


class _FusedFile:
    """What has been read so far."""

    def __init__(self, sensors: SensorTable) -> None:
        self._sensors = sensors
        self.rows: dict[str, list[LiveRows]] = {"live": [], "element": []}
        self.points: list[Points] = []
        self.lines: dict[tuple[int, int], list[_Line]] = {}

    def take(self, lines: list[_Line]) -> None:
        """Take a chunk of lines."""
        for product, parts in self.rows.items():
            chosen = [line for line in lines if line.product == product]
            if chosen:
                parts.append(self._rows(chosen))
        for line in lines:
            if line.product == "element":
                self.lines.setdefault((line.epoch, line.track_number), []).append(line)

    def _rows(self, lines: list[_Line]) -> LiveRows:
        n = len(lines)
        records: Records = blank(n)
        numbers = np.array(
            [
                (p.lat_deg, p.lon_deg, p.altitude_m, p.ground_speed_mps, p.track_angle_deg, p.vertical_rate_mps,
                 p.time_s, p.published_s, p.input_received_s, *(p.position_cov_m2 or _NONE3))
                for p in lines
            ],
            dtype=np.float64,
        ).T  # fmt: skip
        rows = np.arange(n)
        pack_position(records, rows, *numbers[0:3])
        pack_motion(records, rows, *numbers[3:6])
        records["sigma_m"] = largest_sigma(*numbers[9:12])
        records["number"] = [p.track_number & 0xFFFFFFFF for p in lines]
        records["status"] = [STATUS_INDEX.get(p.status, 1) for p in lines]
        records["flags"] = [sum(_FLAG.get(name, 0) for name in set(p.flags)) for p in lines]
        records["master"] = [-1 if p.master is None else self._sensors.index(p.master) for p in lines]
        records["sensors"] = [self._bits(p.sources) for p in lines]
        records["address"] = [_digits(p.address, 16, UNKNOWN_ADDRESS) for p in lines]
        records["named"] = [NAMED_BY_ADDRESS if p.track == p.address and p.address else 0 for p in lines]
        records["mode_a"] = [_digits(p.mode_a, 8, UNKNOWN_MODE_A) & 0xFFFF for p in lines]
        records["callsign"] = [(p.callsign or "").encode("ascii", "replace")[:8] for p in lines]
        heard_s = np.nan_to_num(numbers[7] - numbers[8], nan=0.0)
        records["heard"] = np.clip(heard_s, 0.0, 255.0).astype(np.uint8)
        return LiveRows(records, numbers[6], np.array([p.epoch for p in lines], dtype=np.int64))

    def _bits(self, sources: dict[str, int]) -> int:
        bits = 0
        for name, many in sources.items():
            bits |= 1 << self._sensors.index(name) if many else 0
        return bits

    def elements(self, epoch: int, number: int, at_s: float) -> list[dict[str, Any]]:
        """The last elements that had been published at an instant; as the service tells them, without reports."""
        known = self.lines.get((epoch, number), [])
        until = [line for line in known if line.span_s is not None and (line.published_s or line.time_s) <= at_s]
        return [
            {
                "element": line.element,
                "seq": line.seq,
                "span_s": list(line.span_s or ()),
                "point": msgspec.to_builtins(line),
            }
            for line in until[-LAST_ELEMENTS:]
        ]

    def trail_points(self) -> tuple[Points, NDArray[np.int64], NDArray[np.int64]]:
        """All element points for trails, with their track numbers and epochs."""
        lines = [line for of_track in self.lines.values() for line in of_track]
        points = np.zeros(len(lines), dtype=POINT)
        if lines:
            rows = [self._rows(lines)]
            records = rows[0].records
            for name in ("lat", "lon", "altitude_m", "sigma_m", "master"):
                points[name] = records[name]
            points["time_s"] = rows[0].time_s
            points["speed_mps"] = [np.nan if p.ground_speed_mps is None else p.ground_speed_mps for p in lines]
            points["rate_mps"] = [np.nan if p.vertical_rate_mps is None else p.vertical_rate_mps for p in lines]
            points["element"] = [-1 if p.element is None else p.element for p in lines]
            points["rejected"] = [min(p.rejected, 0xFFFF) for p in lines]
        number = np.array([line.track_number for line in lines], dtype=np.int64)
        return points, number, np.array([line.epoch for line in lines], dtype=np.int64)


def _digits(text: str | None, base: int, unknown: int) -> int:
    try:
        return unknown if text is None else int(text, base) & 0xFFFFFFFF
    except ValueError:
        return unknown


def read_fused(path: Path, config: Config) -> ReplaySource | None:
    """Read a fused file; None where it holds no point."""
    sensors = SensorTable(config.sensors)
    file, reader, done = _FusedFile(sensors), LineReader(path, _Line), 0
    with progress_bar(f"reading {path.name}", path.stat().st_size) as progress:
        for lines in reader.chunks():
            file.take(lines)
            done += len(lines)
            progress(done * path.stat().st_size // max(reader.notes.lines, 1))
    if reader.notes.bad:
        print(f"{path}: {reader.notes.bad} broken lines, skipped", file=sys.stderr)
    parts = file.rows["live"] or file.rows["element"]
    if not parts:
        return None
    rows = LiveRows(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("records", "time_s", "epoch")))
    picture = RecordedPicture(
        rows, sensors.contributes_s(), *file.trail_points(),
        hold_s=HOLD_S if file.rows["live"] else ELEMENT_HOLD_S,
    )  # fmt: skip
    return ReplaySource(picture, sensors, file.elements, title=path.name, history={"rates": [], "registration": {}})
