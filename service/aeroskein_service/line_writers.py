"""Writing JSON Lines: report files, fused files, registration files; packed where the name ends in ``.gz``.

The same content gives the same bytes: a packed file carries neither its name nor the time of day.
"""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Final, Self, cast

import msgspec

from aeroskein.events import RegistrationState
from aeroskein.plots import Plots
from aeroskein.points import FusedPoints
from aeroskein_service.batch_encoder import reports_of
from aeroskein_service.point_encoder import PointEncoder
from aeroskein_service.replies import registration_message

__all__ = ["FusedWriter", "LineWriter", "RegistrationWriter", "ReportWriter"]

# The usual trade: half as large as level 1, twice as fast as level 9.
PACKING: Final = 6

_encode_lines: Final = msgspec.json.Encoder().encode_lines


class LineWriter:
    """Writes messages, one a line. Raises ``OSError`` where the file cannot be made or written.

    Parameters
    ----------
    path : Path
        Overwritten where it exists.
    """

    def __init__(self, path: Path) -> None:
        self._raw = path.open("wb")
        self._stream: IO[bytes] = self._raw
        if path.suffix == ".gz":
            packed = gzip.GzipFile(filename="", mode="wb", compresslevel=PACKING, fileobj=self._raw, mtime=0)
            self._stream = cast(IO[bytes], packed)

    def write(self, messages: Sequence[Any]) -> None:
        """Append some lines."""
        if messages:
            self._stream.write(_encode_lines(messages))

    def flush(self) -> None:
        """Hand everything over to the system, so that it outlives the process."""
        self._stream.flush()
        self._raw.flush()

    def close(self) -> None:
        """Finish the file; may be called again."""
        self._stream.close()
        self._raw.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class ReportWriter(LineWriter):
    """Writes a report file.

    Parameters
    ----------
    path : Path
        Overwritten where it exists.
    sensor_ids : sequence of str
        By index.
    """

    def __init__(self, path: Path, sensor_ids: Sequence[str]) -> None:
        super().__init__(path)
        self._sensors = tuple(sensor_ids)

    def plots(self, plots: Plots) -> None:
        """Append reports in their order, which has to be that of their arrival."""
        rows = zip(reports_of(plots), plots.sensor.tolist(), plots.received_s.tolist(), strict=True)
        self.write(
            [
                {"sensor": self._sensors[sensor], "received_s": received_s} | msgspec.to_builtins(report)
                for report, sensor, received_s in rows
            ]
        )


class FusedWriter(LineWriter):
    """Writes a fused file: fused points of both products.

    Parameters
    ----------
    path : Path
        Overwritten where it exists.
    encoder : PointEncoder
        Knows the sensors and the epoch.
    """

    def __init__(self, path: Path, encoder: PointEncoder) -> None:
        super().__init__(path)
        self._encoder = encoder

    def points(self, points: FusedPoints, published_s: float) -> None:
        """Append points in their order."""
        self.write(self._encoder.messages(points, published_s))


class RegistrationWriter(LineWriter):
    """Writes a registration file."""

    def states(self, states: Sequence[RegistrationState]) -> None:
        """Append states in their order."""
        self.write([registration_message(state) for state in states])
