"""Fused points for people: the latest state of every track as a table that moves, and one point as a line.

Used by ``watch`` and ``demo``; both only look at what any consumer gets.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Final

from rich.table import Table
from rich.text import Text

from aeroskein_service.messages import FusedPoint

__all__ = ["Board", "line"]

ENDED_S: Final = 10.0  # how long an ended track stays on the board
MPS_TO_KNOTS: Final = 3600.0 / 1852.0
METRES_TO_FEET: Final = 1.0 / 0.3048
_STYLES: Final = {"tentative": "dim", "confirmed": "", "coasting": "yellow", "terminated": "red"}


def line(point: FusedPoint) -> str:
    """One point as one line of text, columns aligned."""
    sources = ",".join(f"{sensor}:{many}" for sensor, many in point.sources.items()) or "-"
    parts = [
        datetime.fromtimestamp(point.time_s, UTC).strftime("%H:%M:%S.%f")[:-3],
        f"{point.track:<8}",
        f"{point.callsign or '-':<8}",
        f"{point.status:<10}",
        f"{_number(point.lat_deg, 10, 5)} {_number(point.lon_deg, 10, 5)}",
        f"{_number(point.altitude_m, 8, 1)} m",
        f"{_number(point.ground_speed_mps, 6, 1)} m/s",
        f"{_number(point.track_angle_deg, 5, 1)}°",
        f"seq {point.seq}",
        sources,
        ",".join(point.flags),
    ]
    return "  ".join(parts).rstrip()


def _number(value: float | None, width: int, decimals: int) -> str:
    return f"{'-':>{width}}" if value is None else f"{value:>{width}.{decimals}f}"


class Board:
    """The latest point of every track, and how many points and holes there were."""

    def __init__(self) -> None:
        self._latest: dict[tuple[int, int], tuple[FusedPoint, float]] = {}
        self._next_seq: dict[tuple[int, int], int] = {}
        self.points = 0
        self.missing = 0

    def note(self, point: FusedPoint) -> None:
        """Take one point."""
        name = (point.epoch, point.track_number)
        self.points += 1
        expected = self._next_seq.get(name, point.seq)
        self.missing += max(point.seq - expected, 0)
        self._next_seq[name] = point.seq + 1
        self._latest[name] = (point, time.monotonic())

    def __len__(self) -> int:
        return len(self._latest)

    def forget_ended(self) -> None:
        """Drop tracks that ended a while ago."""
        now_s = time.monotonic()
        for name, (point, seen_s) in list(self._latest.items()):
            if point.status == "terminated" and now_s - seen_s > ENDED_S:
                del self._latest[name]
                self._next_seq.pop(name, None)

    def table(self, rows: int, title: str = "") -> Table:
        """The first ``rows`` tracks by name, newest state each."""
        self.forget_ended()
        made = Table(title=title or None, title_justify="left", expand=False, pad_edge=False)
        for column in ("track", "callsign", "status"):
            made.add_column(column)
        for column in ("lat °", "lon °", "alt ft", "speed kt", "track °", "sigma m", "age s"):
            made.add_column(column, justify="right")
        made.add_column("sources")
        made.add_column("flags")
        latest = sorted((point for point, _ in self._latest.values()), key=lambda point: point.track)
        now_s = time.time()
        for point in latest[:rows]:
            made.add_row(*_cells(point, now_s), style=_STYLES.get(point.status, ""))
        if len(latest) > rows:
            made.caption = f"and {len(latest) - rows} more"
        return made


def _cells(point: FusedPoint, now_s: float) -> list[str | Text]:
    sigma_m = None
    if point.position_cov_m2 is not None:
        sigma_m = max(point.position_cov_m2[0] + point.position_cov_m2[2], 0.0) ** 0.5
    altitude_m = point.altitude_m if point.altitude_m is not None else point.height_m
    return [
        point.track,
        point.callsign or "",
        point.status,
        _number(point.lat_deg, 9, 5),
        _number(point.lon_deg, 10, 5),
        _number(None if altitude_m is None else altitude_m * METRES_TO_FEET, 6, 0),
        _number(None if point.ground_speed_mps is None else point.ground_speed_mps * MPS_TO_KNOTS, 5, 0),
        _number(point.track_angle_deg, 5, 1),
        _number(sigma_m, 6, 1),
        f"{now_s - point.time_s:.1f}",
        Text(" ".join(f"{sensor} {many}" for sensor, many in point.sources.items())),
        Text(" ".join(point.flags)),
    ]
