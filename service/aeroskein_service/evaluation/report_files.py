"""Report files to the raw reports that the fused points are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec

from aeroskein.evaluation.sensors import SensorReports, Site
from aeroskein.plots import Plots
from aeroskein_service.evaluation.files import Latitude, Longitude, address_number
from aeroskein_service.evaluation.lines import FileNotes, LineReader

__all__ = ["read_reports"]


class _ReportLine(msgspec.Struct, gc=False):
    """A target report, as far as it is judged."""

    sensor: Annotated[str, msgspec.Meta(min_length=1)]
    time_s: float
    address: str | None = None
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    range_m: float | None = None
    azimuth_deg: float | None = None


_FLOATS: Final = ("time_s", "lat_deg", "lon_deg", "range_m", "azimuth_deg")


def read_reports(path: Path, sites: Mapping[str, Site] | None = None) -> tuple[SensorReports, FileNotes]:
    """Read a report file.

    Parameters
    ----------
    path : Path
        JSON Lines, one report a line with its ``sensor``, plain or gzip.
    sites : mapping, optional
        Where the radars stand, by sensor id.

    Returns
    -------
    SensorReports, FileNotes
        The reports in file order, sensors in the order of their first report. Raises ``OSError``.
    """
    reader = LineReader(path, _ReportLine)
    sensors: dict[str, int] = {}
    parts = []
    for rows in reader.chunks():
        columns: dict[str, Any] = {name: [getattr(row, name) for row in rows] for name in _FLOATS}
        columns["sensor"] = [sensors.setdefault(row.sensor, len(sensors)) for row in rows]
        columns["address"] = [address_number(row.address) for row in rows]
        parts.append(Plots.of(len(rows), **columns))
    return SensorReports(Plots.concatenate(parts), tuple(sensors), sites or {}), reader.notes
