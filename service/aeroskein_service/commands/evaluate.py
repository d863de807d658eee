"""``aeroskein evaluate``: how far published points are from the truth, for one or more fused files."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from aeroskein.evaluation import Evaluation, EvaluationSettings, as_dict, evaluate
from aeroskein_service.evaluation.files import read_points, read_truth
from aeroskein_service.evaluation.lines import FileNotes
from aeroskein_service.evaluation.text import print_evaluations

__all__ = ["run"]

# Grows when a key changes its meaning; a new key alone does not.
JSON_VERSION: Final = 1


def run(
    fused: Sequence[Path],
    *,
    truth: Path,
    as_json: bool = False,
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
    as_json : bool
        Print JSON instead of tables.
    from_s : float
        Judge from this long after the first report of a flight. [s]
    seed : int
        Seed of the bootstrap intervals.
    max_bad : float
        Share of broken lines above which the exit status is 1. [1]

    Returns
    -------
    int
        Exit status: 0, or 1 where a file is mostly broken or cannot be read.
    """
    settings = EvaluationSettings(from_s=from_s, seed=seed)
    try:
        true, truth_notes = read_truth(truth)
        notes = [truth_notes]
        evaluations = []
        for path, name in zip(fused, _names(fused), strict=True):
            points, file_notes = read_points(path)
            notes.append(file_notes)
            evaluations.append(evaluate(points, true, name=name, settings=settings))
    except OSError as error:
        print(f"cannot read {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    if as_json:
        json.dump(_document(evaluations, notes), sys.stdout, indent=1, allow_nan=False)
        print()
    else:
        print_evaluations(evaluations, Console(markup=False, highlight=False))
    return _report_broken(notes, max_bad)


def _names(paths: Sequence[Path]) -> list[str]:
    """A short name for each file, longer where two would be the same."""
    names = [path.name.split(".")[0] for path in paths]
    return [name if names.count(name) == 1 else str(path) for name, path in zip(names, paths, strict=True)]


def _document(evaluations: Sequence[Evaluation], notes: Sequence[FileNotes]) -> dict[str, Any]:
    return {
        "version": JSON_VERSION,
        "inputs": [as_dict(note) for note in notes],
        "evaluations": [as_dict(evaluation) for evaluation in evaluations],
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
