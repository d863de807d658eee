"""``aeroskein recover``: every whole line of a recording that was cut off or damaged."""

from __future__ import annotations

import sys
from pathlib import Path

import msgspec

from aeroskein_service.line_writers import LineWriter
from aeroskein_service.progress import progress_bar
from aeroskein_service.recorder import RecordingFile

__all__ = ["run"]


def run(*, file: Path, output: Path) -> int:
    """Write what can be read; 1 where that is nothing."""
    recording, saved = RecordingFile(file), 0
    with LineWriter(output) as written, progress_bar("recovering", file.stat().st_size) as progress:
        for _, line in recording.lines(progress):
            written.write([msgspec.Raw(line)])
            saved += 1
    print(f"{output}: {saved} lines, {recording.broken} left out", file=sys.stderr)
    if recording.cut_off is not None:
        print(f"{file} ends early: {recording.cut_off}", file=sys.stderr)
    return 0 if saved else 1
