"""``aeroskein smooth``: whole tracks offline, of all sensors of an aircraft, smoothed forwards and backwards.

Twice through the file: the engine first, because it registers the radars while it fuses, and what it knows about their
biases at the end of the file holds for all of it; then the smoother over the corrected reports.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from aeroskein.events import RegistrationState
from aeroskein.points import FusedPoints
from aeroskein.smoothing import SmoothingSummary, smooth_reports
from aeroskein_service.config import Config
from aeroskein_service.file_fusion import fuse_chunks
from aeroskein_service.files import ReportFile
from aeroskein_service.offline import file_lines, first_arrival_ms, read_all, too_broken, write_points
from aeroskein_service.progress import progress_bar

__all__ = ["run"]


def run(*, config: Config, reports: Path, output: Path, max_bad: float = 0.01) -> int:
    """Smooth a report file.

    Parameters
    ----------
    config : Config
        The sensors; ``fusion.element_s`` is the length of an element.
    reports, output : Path
        Report file and fused file (element points), packed where the name ends in ``.gz``.
    max_bad : float
        Share of broken lines above which the exit status is 1.

    Returns
    -------
    int
        0, or 1 where too much of the file is broken.
    """
    plots, notes = read_all(reports, config.sensor_ids, output, "reading")
    states = _registered(config, reports)
    points, summary = smooth_reports(plots, config.engine, states)
    # Whole tracks are known when the file ends.
    published_s = np.full(0 if points is None else len(points), plots.received_s.max(initial=0.0))
    write_points(output, points, published_s, config.sensor_ids, first_arrival_ms(plots))
    for line in (*summary_lines(summary, points, states), *file_lines(notes, config.sensor_ids)):
        print(line, file=sys.stderr)
    return int(too_broken(notes, max_bad))


def _registered(config: Config, reports: Path) -> list[RegistrationState]:
    """What the engine knows about the radars' biases at the end of the file."""
    if not config.registration.enabled or not any(sensor.is_radar for sensor in config.sensors):
        return []
    states: list[RegistrationState] = []
    with progress_bar("registering", reports.stat().st_size) as progress:
        chunks = ReportFile(reports, config.sensor_ids).chunks(progress)
        for engine in deque((engine for engine, _, _ in fuse_chunks(chunks, config.engine)), maxlen=1):
            states = engine.registration()
    return states


def summary_lines(
    summary: SmoothingSummary, points: FusedPoints | None, states: Sequence[RegistrationState]
) -> Iterator[str]:
    """What was done, one sentence a line."""
    yield f"{summary.reports} reports in {summary.tracks} tracks, {0 if points is None else len(points)} element points"
    left_out = {
        "without address": summary.unidentified, "duplicate": summary.duplicates,
        "in tracks of too few reports": summary.unconfirmed,
    }  # fmt: skip
    named = [f"{many} {what}" for what, many in left_out.items() if many]
    if named:
        yield f"  left out: {', '.join(named)}"
    yield f"  not used: {summary.stale} stale, {summary.outliers} outliers"
    for state in states:
        yield (
            f"  {state.sensor} {state.state}: range {state.range_bias_m:+.1f} ± {state.range_bias_sigma_m:.1f} m, "
            f"azimuth {state.azimuth_bias_deg:+.4f} ± {state.azimuth_bias_sigma_deg:.4f} deg, "
            f"time {state.time_bias_s:+.3f} ± {state.time_bias_sigma_s:.3f} s"
        )
