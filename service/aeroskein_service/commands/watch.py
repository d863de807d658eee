"""``aeroskein watch``: fused points as they come - a moving table on a terminal, lines in a pipe, or JSON."""

from __future__ import annotations

import os
import sys
import threading
from typing import Final, Literal

import msgspec
from rich.console import Console
from rich.live import Live

from aeroskein_service.board import Board, line
from aeroskein_service.config import Config
from aeroskein_service.consumer import Consumer
from aeroskein_service.keys import Keys
from aeroskein_service.signals import end_within, stop_on_signals
from aeroskein_service.transport import OpenCancelledError, open_session

__all__ = ["run"]

STOP_S: Final = 4.8
REDRAW_S: Final = 0.25
FRAME_ROWS: Final = 7  # title, heads, rules and caption of the table


def run(
    config: Config, product: Literal["live", "element"] = "live", track: str | None = None, as_json: bool = False
) -> int:
    """Show fused points until SIGINT or SIGTERM.

    Parameters
    ----------
    config : Config
        Only its section ``zenoh`` is used.
    product : {"live", "element"}
    track : str, optional
        One track's key chunk (address or ``T000123``); all tracks without it.
    as_json : bool
        One JSON object a line.

    Returns
    -------
    int
        0 after an orderly end.

    Raises
    ------
    TransportError
        Where the configuration of Zenoh cannot work.
    """
    stop = stop_on_signals()
    try:
        session = open_session(config.zenoh.link, announce=lambda what: print(what, file=sys.stderr), stop=stop)
    except OpenCancelledError:
        return 0
    keys = Keys(config.zenoh.prefix)
    try:
        session.declare_alive(keys.alive("watch", config.service.effective_instance))
        consumer = Consumer(session, keys, product, None if track is None else track.upper())
        console = Console()
        if console.is_terminal and not as_json:
            _draw(console, consumer, stop, f"fused points, {product}")
        else:
            _print(consumer, stop, as_json)
    except BrokenPipeError:
        # Whoever read us has gone; nothing is wrong. Python would complain again when it flushes at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        timer = end_within(STOP_S)
        session.close()
        timer.cancel()
    return 0


def _draw(console: Console, consumer: Consumer, stop: threading.Event, title: str) -> None:
    board = Board()
    with Live(console=console, auto_refresh=False, screen=False) as live:
        while not stop.wait(REDRAW_S):
            for point in consumer.take():
                board.note(point)
            state = f"{title}: {len(board)} tracks, {board.points} points, {board.missing} missing"
            live.update(board.table(max(console.height - FRAME_ROWS, 1), state), refresh=True)


def _print(consumer: Consumer, stop: threading.Event, as_json: bool) -> None:
    encode = msgspec.json.Encoder().encode
    while not stop.is_set():
        if not consumer.wait(REDRAW_S):
            continue
        points = consumer.take()
        lines = [encode(point).decode() if as_json else line(point) for point in points]
        if lines:
            print("\n".join(lines), flush=True)
