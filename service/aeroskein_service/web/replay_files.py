"""Files that the page replays: a fused file as it is, a report file after the engine has fused it."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any, Final, Literal

from aeroskein.errors import AeroskeinError
from aeroskein_service.config import Config
from aeroskein_service.files import pieces, unpacked
from aeroskein_service.web.replay_fused import read_fused
from aeroskein_service.web.replay_reports import fuse_reports
from aeroskein_service.web.source import Source

__all__ = ["ReplayError", "open_replay"]

FIRST_LINES: Final = 50  # looked at to find out what a file is


class ReplayError(AeroskeinError):
    """A file that cannot be replayed; the message is one sentence."""


def open_replay(path: Path, config: Config) -> Source:
    """Read a whole file, with progress on a terminal.

    Parameters
    ----------
    path : Path
        JSON Lines, ``.gz`` by suffix: fused points or reports.
    config : Config
        A report file needs its sensors; a fused file shows their sites where it has them.

    Raises
    ------
    ReplayError
        Where there is nothing to be shown.
    OSError
        Where the file cannot be read.
    """
    kind = _kind(path)
    if kind == "fused":
        source = read_fused(path, config)
    else:
        if not config.sensors:
            raise ReplayError(f"{path} is a report file: its sensors are needed to fuse it, give them with --config")
        source = fuse_reports(path, config)
    if source is None:
        raise ReplayError(f"{path}: nothing in it can be shown")
    return source


def _kind(path: Path) -> Literal["fused", "reports"]:
    """What the first lines say."""
    with path.open("rb") as raw:
        try:
            content = next(unpacked(raw) if path.suffix == ".gz" else pieces(raw), b"")
        except (EOFError, zlib.error) as error:
            raise ReplayError(f"{path}: {error}") from None
    for line in content.removeprefix(b"\xef\xbb\xbf").splitlines()[:FIRST_LINES]:
        row = _object(line)
        if "product" in row or "track_number" in row:
            return "fused"
        if "sensor" in row:
            return "reports"
    raise ReplayError(f"{path} is neither a fused file nor a report file")


def _object(line: bytes) -> dict[str, Any]:
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return row if isinstance(row, dict) else {}
