"""``aeroskein export``: the report file or the fused file that is in a recording."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import msgspec

from aeroskein_service.line_writers import LineWriter
from aeroskein_service.progress import progress_bar
from aeroskein_service.recorder import RecordingFile

__all__ = ["run"]


def run(*, file: Path, output: Path, what: Literal["reports", "fused"] = "reports") -> int:
    """Write one kind of lines; 1 where there are none, or the recording breaks off."""
    recording, many = RecordingFile(file), 0
    with LineWriter(output) as written, progress_bar("exporting", file.stat().st_size) as progress:
        for kind, line in recording.lines(progress):
            if kind == what:
                written.write([msgspec.Raw(line)])
                many += 1
    print(f"{output}: {many} {'reports' if what == 'reports' else 'fused points'}", file=sys.stderr)
    if recording.cut_off is not None:
        print(f"{file} was not read to its end: {recording.cut_off}; see aeroskein recover", file=sys.stderr)
    return 0 if many and recording.cut_off is None else 1
