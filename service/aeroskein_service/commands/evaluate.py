"""``aeroskein evaluate``: how far published points are from the truth, for one or more fused files."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from aeroskein.evaluation import Evaluation, EvaluationSettings, TruthCurve, as_dict, evaluate
from aeroskein.evaluation.sensors import SensorReports, Site
from aeroskein_service.config import Config
from aeroskein_service.evaluation.files import read_points, read_truth
from aeroskein_service.evaluation.lines import FileNotes
from aeroskein_service.evaluation.page import write_page
from aeroskein_service.evaluation.report_files import read_reports
from aeroskein_service.evaluation.text import print_evaluations

__all__ = ["run"]

# Grows when a key changes its meaning; a new key alone does not.
JSON_VERSION: Final = 1


@dataclass(slots=True)
class _Judged:
    """Everything that was read and found."""

    evaluations: list[Evaluation]
    curve: TruthCurve
    notes: list[FileNotes]


def run(
    fused: Sequence[Path],
    *,
    truth: Path,
    reports: Path | None = None,
    config: Config | None = None,
    as_json: bool = False,
    html: Path | None = None,
    from_s: float = 30.0,
    seed: int = 1,
    max_bad: float = 0.01,
) -> int:
    """Judge fused files against truth and print what was found.

    Parameters
    ----------
    fused : sequence of Path
        Fused files; each becomes a column per product.
    truth : Path
        Truth file.
    reports : Path, optional
        The report file behind the fused files: raw reports are judged too.
    config : Config, optional
        With the sites of the radars, without which radar reports cannot be placed.
    as_json : bool
        Print JSON instead of tables.
    html : Path, optional
        Write a page with plots there.
    from_s : float
        Judge from this long after the first report of a flight. [s]
    seed : int
        Seed of the bootstrap intervals.
    max_bad : float
        Share of broken lines above which the exit status is 1. [1]

    Returns
    -------
    int
        Exit status: 0, or 1 where a file has too many broken lines, or cannot be read or written.
    """
    settings = EvaluationSettings(from_s=from_s, seed=seed)
    try:
        judged = _judge(fused, truth, reports, _sites(config), settings)
        if html is not None:
            write_page(html, judged.evaluations, judged.curve, [note.path for note in judged.notes])
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    if as_json:
        json.dump(_document(judged), sys.stdout, indent=1, allow_nan=False)
        print()
    else:
        print_evaluations(judged.evaluations, _console(judged.evaluations))
    return _report_broken(judged.notes, max_bad)


def _judge(
    fused: Sequence[Path], truth: Path, reports: Path | None, sites: dict[str, Site], settings: EvaluationSettings
) -> _Judged:
    """Read everything and judge each fused file. Raises ``OSError``."""
    true, truth_notes = read_truth(truth)
    judged = _Judged([], TruthCurve(true, settings.max_truth_gap_s), [truth_notes])
    raw: SensorReports | None = None
    if reports is not None:
        raw, notes = read_reports(reports, sites)
        judged.notes.append(notes)
    for path, name in zip(fused, _names(fused), strict=True):
        points, notes = read_points(path)
        judged.notes.append(notes)
        judged.evaluations.append(evaluate(points, judged.curve, reports=raw, name=name, settings=settings))
    return judged


def _sites(config: Config | None) -> dict[str, Site]:
    """Sites of the radars of a configuration, by sensor id."""
    if config is None:
        return {}
    return {
        sensor.id: Site(sensor.lat_deg, sensor.lon_deg, sensor.height_m or 0.0)
        for sensor in config.sensors
        if sensor.lat_deg is not None and sensor.lon_deg is not None
    }


def _console(evaluations: Sequence[Evaluation]) -> Console:
    """As wide as the terminal; in a pipe as wide as the tables need."""
    console = Console(markup=False, highlight=False)
    if not console.is_terminal:
        console.width = 90 + 20 * sum(len(evaluation.products) for evaluation in evaluations)
    return console


def _names(paths: Sequence[Path]) -> list[str]:
    """A short name for each file, the whole path where two would be the same."""
    names = [path.name.split(".")[0] for path in paths]
    return [name if names.count(name) == 1 else str(path) for name, path in zip(names, paths, strict=True)]


def _document(judged: _Judged) -> dict[str, Any]:
    """What ``--json`` prints."""
    return {
        "version": JSON_VERSION,
        "inputs": [as_dict(note) for note in judged.notes],
        "evaluations": [as_dict(evaluation) for evaluation in judged.evaluations],
    }


def _report_broken(notes: Sequence[FileNotes], max_bad: float) -> int:
    """Name broken lines on standard error; 1 where a file has too many of them."""
    status = 0
    for note in notes:
        if note.bad:
            first = note.named[0]
            more = "" if note.bad == 1 else f" (and {note.bad - 1} more)"
            print(f"{note.path}: line {first.number} skipped: {first.reason}{more}", file=sys.stderr)
        status |= note.bad_share > max_bad
    return int(status)
