"""Report files and truth files, as the simulator writes them: JSON Lines in order of arrival, and by track.

Numbers are rounded to what a sensor could mean (a millimetre, a microsecond), which halves the files. A file appears
under its name only when it is complete, and its bytes depend on its content only, compressed or not.
"""

from __future__ import annotations

import gzip
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self, cast

import msgspec
import numpy as np

from aeroskein.plots import Plots
from aeroskein.simulation import Phase, TruthStates
from aeroskein_service.codec import reports_of

__all__ = ["LineFile", "report_lines", "truth_lines", "truth_path"]

# Digits after the point, by unit: 1e-8 degrees of latitude are 1 mm.
_DECIMALS: Final = {"_s": 6, "_m": 3, "_mps": 4, "_deg": 6}
_POSITION_DECIMALS: Final = 8

# Fast rather than small: level 5 costs a third of level 9 and saves all but 3 % of the same.
_GZIP_LEVEL: Final = 5

_PHASES: Final = tuple(phase.wire_name for phase in Phase)
_TRUTH_COLUMNS: Final = (
    "time_s", "lat_deg", "lon_deg", "height_m", "altitude_m", "ground_speed_mps", "track_angle_deg",
    "vertical_rate_mps",
)  # fmt: skip


class _TruthLine(msgspec.Struct, gc=False):
    """One sample of truth."""

    track: str
    time_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    altitude_m: float
    ground_speed_mps: float
    track_angle_deg: float
    vertical_rate_mps: float
    phase: str


def truth_path(reports: Path) -> Path:
    """Where the truth of a report file stands: ``a.jsonl.gz`` has ``a.truth.jsonl.gz`` beside it."""
    name = reports.name
    zipped = ".gz" if name.endswith(".gz") else ""
    stem = name.removesuffix(".gz").removesuffix(".jsonl").removesuffix(".json")
    return reports.with_name(f"{stem}.truth.jsonl{zipped}")


def report_lines(plots: Plots, sensor_ids: Sequence[str]) -> bytes:
    """The rows as lines of a report file, in their order."""
    rounded = plots.take(np.arange(len(plots)))
    for name in Plots.__dataclass_fields__:
        column = getattr(rounded, name)
        if column.dtype == np.float64 and len(column):
            setattr(rounded, name, _rounded(name, column))
    encode = msgspec.json.Encoder().encode
    heads = [f'{{"sensor":"{sensor_id}","received_s":' for sensor_id in sensor_ids]
    rows = zip(rounded.sensor.tolist(), rounded.received_s.tolist(), reports_of(rounded), strict=True)
    # The report's own object is continued: building a second one for the two more fields would cost as much again.
    return b"".join(
        [f"{heads[sensor]}{received_s!r},".encode() + encode(report)[1:] + b"\n" for sensor, received_s, report in rows]
    )


def truth_lines(truth: TruthStates) -> bytes:
    """The rows as lines of a truth file, in their order."""
    columns: list[list[Any]] = [[f"{address:06X}" for address in truth.address.tolist()]]
    columns += [_rounded(name, getattr(truth, name)).tolist() for name in _TRUTH_COLUMNS]
    columns.append([_PHASES[phase] for phase in truth.phase.tolist()])
    lines = [_TruthLine(*row) for row in zip(*columns, strict=True)]
    return msgspec.json.Encoder().encode_lines(lines)


def _rounded(name: str, column: np.ndarray) -> np.ndarray:
    decimals = _POSITION_DECIMALS if name in ("lat_deg", "lon_deg") else _DECIMALS["_" + name.rpartition("_")[2]]
    rounded = np.round(column, decimals)
    # 359.9999999 is not 360.
    return np.where(rounded >= 360.0, 0.0, rounded) if name in ("azimuth_deg", "track_angle_deg") else rounded


class LineFile:
    """A file of lines that is there when it is complete, and not at all when writing it failed.

    Parameters
    ----------
    path : Path
        Compressed where the name ends with ``.gz``.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._part = path.with_name(path.name + ".part")

    def __enter__(self) -> Self:
        self._raw = self._part.open("wb")
        self._file: IO[bytes] = self._raw
        if self._path.name.endswith(".gz"):
            # No name and no time in the header: the same lines are the same bytes.
            zipped = gzip.GzipFile("", "wb", _GZIP_LEVEL, self._raw, mtime=0)
            self._file = cast(IO[bytes], zipped)
        return self

    def write(self, lines: bytes) -> None:
        """Add lines."""
        self._file.write(lines)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        self._raw.close()
        if kind is None:
            os.replace(self._part, self._path)
        else:
            self._part.unlink()
