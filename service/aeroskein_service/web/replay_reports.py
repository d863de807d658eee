"""A report file as a recorded picture: fused by the same engine as everywhere, with every element kept."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from aeroskein.engine import FusionEngine
from aeroskein.points import FusedPoints, Product
from aeroskein_service.config import Config
from aeroskein_service.file_fusion import fuse_chunks
from aeroskein_service.files import ReportFile
from aeroskein_service.progress import progress_bar
from aeroskein_service.replies import registration_message
from aeroskein_service.web.recorded import LiveRows, RecordedPicture
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

__all__ = ["fuse_reports"]

REGISTRATION_S: Final = 10.0  # between two states of the registration that are kept


def records_of(points: FusedPoints, now_s: float) -> Records:
    """Fused points as records."""
    n = len(points)
    made, rows = blank(n), np.arange(n)
    pack_position(made, rows, points.lat_deg, points.lon_deg, points.altitude_m)
    pack_motion(made, rows, points.ground_speed_mps, points.track_angle_deg, points.vertical_rate_mps)
    made["sigma_m"] = largest_sigma(*points.position_cov_m2.T)
    made["number"] = points.track_number & 0xFFFFFFFF
    made["status"], made["flags"], made["master"] = points.status, points.flags, points.master
    bits = np.uint32(1) << np.arange(points.sources.shape[1], dtype=np.uint32)
    made["sensors"] = ((points.sources > 0) * bits).sum(axis=1, dtype=np.uint32)
    made["address"] = np.where(points.address >= 0, points.address, UNKNOWN_ADDRESS)
    made["named"] = np.where(points.label >= 0, NAMED_BY_ADDRESS, 0)
    made["mode_a"] = np.where(points.mode_a >= 0, points.mode_a, UNKNOWN_MODE_A)
    made["callsign"] = points.callsign
    made["heard"] = np.clip(np.nan_to_num(now_s - points.input_received_s, nan=0.0), 0.0, 255.0)
    return made


def trail_points(points: FusedPoints) -> Points:
    """Element points for trails."""
    made = np.zeros(len(points), dtype=POINT)
    made["time_s"] = points.time_s
    made["lat"] = np.rint(points.lat_deg * 1e7).astype(np.int64)
    made["lon"] = np.rint(points.lon_deg * 1e7).astype(np.int64)
    made["altitude_m"], made["speed_mps"] = points.altitude_m, points.ground_speed_mps
    made["rate_mps"], made["element"], made["master"] = points.vertical_rate_mps, points.element, points.master
    made["sigma_m"] = largest_sigma(*points.position_cov_m2.T)
    made["rejected"] = np.minimum(points.rejected, 0xFFFF)
    return made


class _Fusion:
    """What has come out of the engine so far."""

    def __init__(self) -> None:
        self.engine: FusionEngine | None = None
        self.live: list[Records] = []
        self.live_s: list[np.ndarray] = []
        self.trails: list[Points] = []
        self.numbers: list[np.ndarray] = []
        self.registration: dict[str, list[dict[str, Any]]] = {}
        self._next_s = -np.inf

    def take(self, engine: FusionEngine, now_s: float, events: list[Any]) -> None:
        """Take the events of one moment."""
        if self.engine is None:
            self.engine = engine
            engine.keep_elements()
        for event in events:
            if isinstance(event, FusedPoints) and event.product is Product.LIVE:
                self.live.append(records_of(event, now_s))
                self.live_s.append(event.time_s)
            elif isinstance(event, FusedPoints):
                self.trails.append(trail_points(event))
                self.numbers.append(event.track_number)
        if now_s >= self._next_s:
            self._next_s = now_s + REGISTRATION_S
            for state in engine.registration():
                message = msgspec.to_builtins(registration_message(state))
                self.registration.setdefault(state.sensor, []).append(message)


def fuse_reports(path: Path, config: Config) -> ReplaySource | None:
    """Fuse a report file; None where nothing comes out of it."""
    file, fusion, sensors = ReportFile(path, config.sensor_ids), _Fusion(), SensorTable(config.sensors)
    with progress_bar(f"fusing {path.name}", path.stat().st_size) as progress:
        for engine, now_s, events in fuse_chunks(file.chunks(progress), config.engine):
            fusion.take(engine, now_s, events)
    if file.notes.broken:
        print(f"{path}: {file.notes.broken} broken lines, skipped", file=sys.stderr)
    engine_made = fusion.engine
    if engine_made is None or not fusion.live:
        return None
    epoch = np.full(sum(map(len, fusion.live)), engine_made.epoch_ms, dtype=np.int64)
    number = np.concatenate(fusion.numbers) if fusion.numbers else np.zeros(0, dtype=np.int64)
    picture = RecordedPicture(
        LiveRows(np.concatenate(fusion.live), np.concatenate(fusion.live_s), epoch),
        sensors.contributes_s(),
        np.concatenate(fusion.trails) if fusion.trails else np.zeros(0, dtype=POINT),
        number,
        np.full(len(number), engine_made.epoch_ms, dtype=np.int64),
    )
    fusing = config.fusion
    # An element was published when those it looks ahead to had ended and the watermark had passed.
    behind_s = fusing.element_s * fusing.lookahead + fusing.watermark_s

    def elements(_epoch: int, track_number: int, at_s: float) -> list[dict[str, Any]]:
        return [record.content for record in engine_made.elements_until(track_number, at_s - behind_s)]

    return ReplaySource(
        picture, sensors, elements, title=path.name, history={"rates": [], "registration": fusion.registration}
    )
