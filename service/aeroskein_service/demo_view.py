"""What the demo shows: the fused tracks as they move, and what the service found out about its radars.

It sees what any consumer sees: the feed, the status and the registration states on Zenoh.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Final, TextIO

import msgspec
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from aeroskein_service.board import Board
from aeroskein_service.config import Config
from aeroskein_service.consumer import Consumer
from aeroskein_service.keys import Keys
from aeroskein_service.messages import JSON
from aeroskein_service.transport import Session

__all__ = ["DemoView"]

REDRAW_S: Final = 0.5
LINE_S: Final = 2.0
FRAME_ROWS: Final = 14  # everything on the screen that is no track


class DemoView:
    """A consumer of everything.

    Parameters
    ----------
    session : Session
    config : Config
    """

    def __init__(self, session: Session, config: Config) -> None:
        keys = Keys(config.zenoh.prefix)
        self._board = Board()
        self._elements = 0
        self._live = Consumer(session, keys, "live")
        self._element = Consumer(session, keys, "element")
        self._status: dict[str, Any] = {}
        self._registration: dict[str, dict[str, Any]] = {}
        session.subscribe(keys.status(), self._note_status)
        session.subscribe(keys.registration("*"), self._note_registration)

    def _note_status(self, _key: str, payload: bytes, _encoding: str) -> None:
        self._status = msgspec.json.decode(payload)

    def _note_registration(self, _key: str, payload: bytes, encoding: str) -> None:
        state = (msgspec.json if encoding == JSON else msgspec.msgpack).decode(payload)
        self._registration = self._registration | {state["sensor"]: state}

    def _take(self) -> None:
        for point in self._live.take():
            self._board.note(point)
        self._elements += len(self._element.take())

    # -- on a terminal -----------------------------------------------------------------------------------------------
    def draw(self, console: Console, stop: threading.Event, ends_s: float | None) -> None:
        """A table that moves, until ``stop`` is set or the time has come."""
        with Live(console=console, auto_refresh=False, transient=False) as live:
            while not _over(stop, ends_s, REDRAW_S):
                live.update(self.frame(max(console.height - FRAME_ROWS, 3)), refresh=True)

    def frame(self, rows: int) -> Group:
        """What there is to see now, with ``rows`` tracks at the most."""
        self._take()
        return Group(self._board.table(rows, self._headline()), self._radars(), self._remarks())

    def _headline(self) -> str:
        board = self._board
        return (
            f"{len(board)} tracks, {board.points} live points, {self._elements} element points, {board.missing} missing"
        )

    def _radars(self) -> Table:
        table = Table(title="registration: what each radar measures too much", title_justify="left", pad_edge=False)
        for column in ("radar", "state", "range m", "azimuth °", "time s", "aircraft"):
            table.add_column(column)
        for state in sorted(self._registration.values(), key=lambda state: state["sensor"]):
            table.add_row(
                state["sensor"],
                state["state"],
                _with_sigma(state, "range_bias_m", "range_bias_sigma_m", 1),
                _with_sigma(state, "azimuth_bias_deg", "azimuth_bias_sigma_deg", 3),
                _with_sigma(state, "time_bias_s", "time_bias_sigma_s", 3),
                str(state["aircraft"]),
            )
        return table

    def _remarks(self) -> Text:
        sensors = self._status.get("sensors", {})
        counts = [f"{name} {state['accepted']} reports" for name, state in sensors.items()]
        alarms = self._status.get("alarms", [])
        return Text("   ".join(counts) + "".join(f"\n{alarm}" for alarm in alarms), style="yellow" if alarms else "")

    # -- in a pipe ---------------------------------------------------------------------------------------------------
    def print_lines(self, out: TextIO, stop: threading.Event, ends_s: float | None) -> None:
        """A line now and then, until ``stop`` is set or the time has come."""
        while not _over(stop, ends_s, LINE_S):
            self._take()
            print(f"{self._headline()}{self._found()}", file=out, flush=True)

    def _found(self) -> str:
        states = sorted(self._registration.values(), key=lambda state: state["sensor"])
        return "".join(
            f"; {s['sensor']} {s['state']}, range {_with_sigma(s, 'range_bias_m', 'range_bias_sigma_m', 0)} m"
            for s in states
        )


def _over(stop: threading.Event, ends_s: float | None, wait_s: float) -> bool:
    """Wait a while; whether it is time to end."""
    if ends_s is not None:
        wait_s = min(wait_s, max(ends_s - time.monotonic(), 0.0))
    return stop.wait(wait_s) or (ends_s is not None and time.monotonic() >= ends_s)


def _with_sigma(state: dict[str, Any], value: str, sigma: str, decimals: int) -> str:
    if state[value] is None:
        return "-"
    spread = "" if state[sigma] is None else f" ± {state[sigma]:.{decimals}f}"
    return f"{state[value]:+.{decimals}f}{spread}"
