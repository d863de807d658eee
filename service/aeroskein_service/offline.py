"""Whole files for the offline commands: every good report of a report file at once, and points with their own times.

``fuse`` streams; filtering and smoothing of whole flights need all reports of an aircraft before the first estimate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from aeroskein.plots import Array, Plots
from aeroskein.points import FusedPoints
from aeroskein.reasons import Reason
from aeroskein_service.files import FileNotes, ReportFile
from aeroskein_service.line_writers import LineWriter
from aeroskein_service.point_encoder import PointEncoder
from aeroskein_service.progress import progress_bar
from aeroskein_service.selecting import SelectionError

__all__ = ["file_lines", "first_arrival_ms", "read_all", "too_broken", "write_points"]

# Lines encoded at a time. [points]
WRITE_POINTS = 20_000


def read_all(path: Path, sensor_ids: Sequence[str], output: Path, what: str) -> tuple[Plots, FileNotes]:
    """Read every good report of a file, in order of arrival.

    Parameters
    ----------
    path : Path
        The report file.
    sensor_ids : sequence of str
        The configured sensors, by index.
    output : Path
        Where the command will write: must not be the report file itself (``SelectionError``).
    what : str
        A word in front of the progress bar.
    """
    if output.exists() and output.samefile(path):
        raise SelectionError("--output", f"{output} is the report file itself")
    file = ReportFile(path, sensor_ids)
    parts = []
    with progress_bar(what, path.stat().st_size) as progress:
        for chunk in file.chunks(progress):
            parts.append(chunk.plots.take((chunk.reasons == Reason.ACCEPTED) & np.isfinite(chunk.arrival_s)))
    return Plots.concatenate(parts), file.notes


def first_arrival_ms(plots: Plots) -> int:
    """The epoch of a file: its first arrival, 0 without reports. [ms since the epoch]"""
    return round(float(plots.received_s.min()) * 1000.0) if len(plots) else 0


def write_points(
    path: Path, points: FusedPoints | None, published_s: Array, sensor_ids: Sequence[str], epoch_ms: int
) -> None:
    """Write a fused file, in order of publication.

    Parameters
    ----------
    path : Path
        Overwritten where it exists, packed where the name ends in ``.gz``.
    points : FusedPoints or None
        None gives an empty file.
    published_s : (n,) array
        When each point could have been sent. [s since the epoch]
    sensor_ids : sequence of str
        By index.
    epoch_ms : int
        The file's epoch.
    """
    encoder = PointEncoder(sensor_ids, epoch_ms, "json")
    with LineWriter(path) as writer:
        if points is None:
            return
        order = np.lexsort((points.time_s, published_s))
        for start in range(0, len(order), WRITE_POINTS):
            rows = order[start : start + WRITE_POINTS]
            messages = encoder.messages(points.take(rows), 0.0)
            for message, sent_s in zip(messages, published_s[rows].tolist(), strict=True):
                message.published_s = sent_s
            writer.write(messages)


def file_lines(notes: FileNotes, sensor_ids: Sequence[str]) -> Iterator[str]:
    """What was wrong with the file, one sentence a line."""
    for sensor, counts in zip(sensor_ids, notes.rejected.tolist(), strict=True):
        refused = [f"{many} {Reason(i).wire_name}" for i, many in enumerate(counts) if i and many]
        if refused:
            yield f"  {sensor}: not used: {', '.join(refused)}"
    if notes.broken:
        yield f"{notes.broken} broken lines ({100.0 * notes.share_broken:.2g} %), skipped:"
        for number, fault in notes.named:
            yield f"  line {number} {fault}"
        if notes.broken > len(notes.named):
            yield f"  and {notes.broken - len(notes.named)} more"
    if notes.cut_off is not None:
        yield f"the file was not read to its end: {notes.cut_off}"


def too_broken(notes: FileNotes, max_bad: float) -> bool:
    """Whether the exit status must be 1 although everything good was written."""
    return notes.share_broken > max_bad or notes.cut_off is not None
