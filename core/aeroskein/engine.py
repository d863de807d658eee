"""FusionEngine: reports in, fused points out, without clock, I/O or logging.

Interface draft; the stages behind it are being built.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from aeroskein.events import Event, RegistrationState
from aeroskein.plots import Plots
from aeroskein.points import FusedPoints
from aeroskein.selection import Selection
from aeroskein.settings import EngineSettings

__all__ = ["ElementRecord", "FusionEngine"]


@dataclass(slots=True)
class ElementRecord:
    """One closed element as the engineer's query shows it: plain numbers, ready for JSON (see docs/messages.md)."""

    content: dict[str, Any]


class FusionEngine:
    """Reports in, fused points out. Time is an argument (seconds since the epoch, UTC)."""

    def __init__(self, settings: EngineSettings, *, epoch_ms: int, first_track_number: int = 1) -> None:
        self.settings = settings
        self.epoch_ms = epoch_ms

    def receive(self, plots: Plots, *, now_s: float) -> list[Event]:
        """Take any number of reports in any order; returns live points, rejections and track changes."""
        raise NotImplementedError

    def advance(self, *, now_s: float) -> list[Event]:
        """Let time pass: close elements behind the watermark, coast, terminate."""
        raise NotImplementedError

    def finish(self, *, now_s: float) -> list[Event]:
        """The input has ended: close open elements with what there is."""
        raise NotImplementedError

    def next_deadline_s(self) -> float | None:
        """When ``advance`` has something to do next; None while there is no track."""
        raise NotImplementedError

    # -- queries -------------------------------------------------------------------------------------------------
    def tracks(self, selection: Selection) -> FusedPoints:
        """Latest live state of every matching track, terminated ones for 60 s."""
        raise NotImplementedError

    def reports(self, selection: Selection) -> Plots:
        """Buffered reports (at least the last 30 s) that match."""
        raise NotImplementedError

    def elements(self, label: str) -> list[ElementRecord] | None:
        """The last 20 elements of the track with this key chunk (address or ``T000123``); None: no such track."""
        raise NotImplementedError

    def track_counts(self) -> dict[str, int]:
        """How many tracks are tentative, confirmed, coasting."""
        raise NotImplementedError

    def alarms(self) -> list[str]:
        """What an operator should know now, one sentence each."""
        raise NotImplementedError

    def stages_us(self) -> dict[str, float]:
        """Microseconds per report or element of every stage since the last call."""
        raise NotImplementedError

    # -- control -------------------------------------------------------------------------------------------------
    want_dispositions: bool = False

    def registration(self) -> list[RegistrationState]:
        """The registration state of every radar."""
        raise NotImplementedError

    def control_registration(
        self, sensor_id: str, action: Literal["freeze", "release", "reset", "set"], **values: float
    ) -> RegistrationState:
        """Freeze, release, reset or set a radar's biases; returns what is now in force."""
        raise NotImplementedError

    def control_sensor(self, sensor_id: str, on: bool) -> bool:
        """Switch a sensor's reports on or off; returns what is now in force."""
        raise NotImplementedError

    # -- state that survives a restart ---------------------------------------------------------------------------
    next_track_number: int
    """The first number that has not been used; reserve ahead of it on disk."""

    def snapshot(self) -> bytes:
        """Registration state and end of the last published element per track, as bytes."""
        raise NotImplementedError

    def restore(self, data: bytes) -> None:
        """Take a snapshot over. Raises ``SnapshotError``."""
        raise NotImplementedError
