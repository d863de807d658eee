"""``aeroskein record``: what the sensors send and what the service publishes, into one file, until it is stopped."""

from __future__ import annotations

import sys
from pathlib import Path
from time import monotonic
from typing import Final

from aeroskein_service.config import Config
from aeroskein_service.keys import Keys
from aeroskein_service.line_writers import LineWriter
from aeroskein_service.recorder import Recorder
from aeroskein_service.signals import end_within, stop_on_signals
from aeroskein_service.transport import OpenCancelledError, open_session

__all__ = ["run"]

WRITE_S: Final = 0.5  # what a process that dies at once may lose
STOP_S: Final = 4.8


def run(*, config: Config, output: Path, duration: float | None = None) -> int:
    """Record until SIGINT, SIGTERM or the end of the duration.

    Parameters
    ----------
    config : Config
        Its sensors and its section ``zenoh``.
    output : Path
        The recording, packed where the name ends in ``.gz``.
    duration : float, optional
        [s]

    Returns
    -------
    int
        0, or 1 where messages came faster than they could be written.
    """
    stop, keys = stop_on_signals(), Keys(config.zenoh.prefix)
    with LineWriter(output) as file:
        try:
            session = open_session(config.zenoh.link, announce=_tell, stop=stop)
        except OpenCancelledError:
            return 0
        try:
            session.declare_alive(keys.alive("recorder", config.service.effective_instance))
            recorder = Recorder(session, keys, config.sensor_ids)
            _tell(f"recording {', '.join(config.sensor_ids)} and fused points at {config.zenoh.link.where}")
            ends_s = None if duration is None else monotonic() + duration
            while not stop.wait(WRITE_S if ends_s is None else min(WRITE_S, max(ends_s - monotonic(), 0.0))):
                recorder.write(file)
                if ends_s is not None and monotonic() >= ends_s:
                    break
        finally:
            timer = end_within(STOP_S)
            session.close()
            timer.cancel()
        recorder.write(file)
    _tell(f"{output}: {recorder.reports} reports and {recorder.points} fused points")
    if recorder.broken:
        _tell(f"{recorder.broken} messages that could not be read were left out")
    if recorder.lost:
        _tell(f"{recorder.lost} messages came faster than they could be written")
    return 1 if recorder.lost else 0


def _tell(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)
