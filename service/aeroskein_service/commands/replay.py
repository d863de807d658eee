"""``aeroskein replay``: the reports of a recording or a report file, sent again as their sensors, shifted to now."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from aeroskein.simulation import Chunk
from aeroskein_service.config import Config
from aeroskein_service.files import ReportFile
from aeroskein_service.keys import Keys
from aeroskein_service.sensor_feed import BATCH_S, feed_sensors
from aeroskein_service.signals import stop_on_signals
from aeroskein_service.transport import OpenCancelledError

__all__ = ["run"]


def run(*, config: Config, file: Path) -> int:
    """Send every report when it arrived, with its stamp as old as it was then, until the end or a signal.

    Parameters
    ----------
    config : Config
        Its sensors and its section ``zenoh``.
    file : Path
        A recording or a report file, ``.gz`` by suffix.

    Returns
    -------
    int
        0, or 1 where nothing could be read or the file breaks off.
    """
    stop = stop_on_signals()
    reports = ReportFile(file, config.sensor_ids, among_points=True)
    try:
        counts = feed_sensors(
            lambda start_s: _shifted(reports, start_s),
            sensors=dict(enumerate(config.sensor_ids)),
            link=config.zenoh.link,
            keys=Keys(config.zenoh.prefix),
            instance=config.service.effective_instance,
            stop=stop,
            announce=_tell,
        )
    except OpenCancelledError:
        return 0
    _tell(f"put {counts.reports} reports in {counts.batches} batches")
    for number, fault in reports.notes.named:
        _tell(f"line {number} {fault}, skipped")
    if reports.notes.cut_off is not None:
        _tell(f"{file} was not read to its end: {reports.notes.cut_off}")
    return 0 if counts.reports and reports.notes.cut_off is None else 1


def _shifted(file: ReportFile, start_s: float) -> Iterator[Chunk]:
    """The file's reports by the time of their arrival, which is shifted so that the first one arrives at the start."""
    first_s: float | None = None
    latest_s = -np.inf
    for chunk in file.chunks():
        good = (chunk.reasons == 0) & np.isfinite(chunk.arrival_s)
        plots = chunk.plots.take(good)
        if not len(plots):
            continue
        arrival_s = np.maximum.accumulate(np.concatenate([[latest_s], chunk.arrival_s[good]]))[1:]
        latest_s = float(arrival_s[-1])
        first_s = float(arrival_s[0]) if first_s is None else first_s
        plots.time_s = plots.time_s + (start_s - first_s)
        plots.received_s = arrival_s + (start_s - first_s)
        parts = np.floor((arrival_s - first_s) / BATCH_S).astype(np.int64)
        starts = np.flatnonzero(np.diff(parts, prepend=parts[0] - 1))
        for begin, end in zip(starts.tolist(), [*starts[1:].tolist(), len(parts)], strict=True):
            until_s = start_s + (int(parts[begin]) + 1) * BATCH_S
            yield Chunk(until_s, plots.take(np.arange(begin, end)), None)


def _tell(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)
