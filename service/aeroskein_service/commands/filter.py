"""``aeroskein filter``: the published ADS-B filter over the tracks of one sensor, or of several with own positions."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from aeroskein.adsb_filter import FilterSummary, Model, filter_reports
from aeroskein.points import FusedPoints
from aeroskein_service.config import Config
from aeroskein_service.offline import file_lines, first_arrival_ms, read_all, too_broken, write_points
from aeroskein_service.selecting import SelectionError

__all__ = ["run"]


def run(
    *,
    config: Config,
    reports: Path,
    sensor: str,
    output: Path,
    model: Model = "imm",
    smooth: bool = False,
    estimate_errors: bool = False,
    max_bad: float = 0.01,
) -> int:
    """Filter a report file.

    Parameters
    ----------
    config : Config
        The sensors, and section ``filter``.
    reports, output : Path
        Report file and fused file, packed where the name ends in ``.gz``.
    sensor : str
        Whose reports; several with commas between make one track per aircraft, each with its own errors.
    model : str
        ``linear``, ``ukf`` or ``imm``.
    smooth : bool
        Element points of whole tracks smoothed backwards, instead of live points.
    estimate_errors : bool
        Estimate position and time errors of each sensor that reports positions of its own from straight flight, and
        use those.
    max_bad : float
        Share of broken lines above which the exit status is 1.

    Returns
    -------
    int
        0, or 1 where too much of the file is broken.
    """
    chosen = _sensors(sensor, config.sensor_ids)
    plots, notes = read_all(reports, config.sensor_ids, output, "reading")
    epoch_ms, last_s = first_arrival_ms(plots), float(plots.received_s.max(initial=0.0))
    plots = plots.take(np.isin(plots.sensor, chosen))
    points, summary = filter_reports(
        plots, config.engine, config.filter, model=model, smooth=smooth, estimate_errors=estimate_errors
    )
    # A smoothed track is known when the file ends, an unsmoothed point with its report.
    n = 0 if points is None else len(points)
    published_s = np.full(n, last_s) if smooth or points is None else points.input_received_s
    write_points(output, points, published_s, config.sensor_ids, epoch_ms)
    for line in summary_lines(summary, points, config.sensor_ids):
        print(line, file=sys.stderr)
    for line in file_lines(notes, config.sensor_ids):
        print(line, file=sys.stderr)
    return int(too_broken(notes, max_bad))


def _sensors(text: str, sensor_ids: Sequence[str]) -> list[int]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in sensor_ids:
            raise SelectionError("--sensor", f"no sensor {name!r} in the configuration ({', '.join(sensor_ids)})")
    if not names:
        raise SelectionError("--sensor", "expected the id of a sensor")
    return [sensor_ids.index(name) for name in names]


def summary_lines(summary: FilterSummary, points: FusedPoints | None, sensor_ids: Sequence[str]) -> Iterator[str]:
    """What was done, one sentence a line."""
    yield f"{summary.reports} reports in {summary.flights} flights, {0 if points is None else len(points)} points"
    left_out = {
        "without identity": summary.unidentified, "duplicate": summary.duplicates, "on the ground": summary.on_ground,
        "before a believable start or in too short a flight": summary.unstarted,
    }  # fmt: skip
    named = [f"{many} {what}" for what, many in left_out.items() if many]
    if named:
        yield f"  left out: {', '.join(named)}"
    yield f"  not used: {summary.stale} stale, {summary.outliers} outliers"
    yield (
        f"  published limits: {summary.spikes} spikes, {summary.too_fast} too fast, "
        f"{summary.accelerations} accelerations; {summary.repaired} repaired"
    )
    for to, flights in summary.fallbacks.items():
        yield f"  {flights} flights diverged and fell back to the {to} track"
    for name, errors in zip(sensor_ids, summary.source_errors or [], strict=False):
        if errors.windows:
            found = "too little straight flight"
            if np.isfinite(errors.position_sigma_m):
                found = f"position {errors.position_sigma_m:.1f} m, time {errors.time_sigma_s:.3f} s"
            yield f"  {name}: one sigma {found} ({errors.windows} straight windows)"
