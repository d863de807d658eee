"""The page about the evaluation says what the program says."""

import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest

from aeroskein.evaluation import figures, results
from aeroskein.evaluation.continuity import LONG_GAP_RATIO, MIN_INTERVALS
from aeroskein.evaluation.results import EvaluationSettings
from aeroskein.evaluation.roughness import SPIKE_ANGLE_DEG, SPIKE_LEG_M, STEP_M
from aeroskein_service.evaluation.lines import BrokenLine, FileNotes

TEXT = (Path(__file__).parents[3] / "docs" / "evaluation.md").read_text("utf-8")
NAMES = (*figures.__all__, *results.__all__)
TYPES = [getattr(figures, name, None) or getattr(results, name) for name in NAMES]
DATA = [type_ for type_ in TYPES if is_dataclass(type_)]


@pytest.mark.parametrize("type_", [*DATA, FileNotes, BrokenLine], ids=lambda type_: type_.__name__)
def test_every_key_of_the_json_is_documented(type_):
    keys = {field.name for field in fields(type_) if field.metadata.get("json", True)}

    assert keys - set(re.findall(r"`([a-z0-9_]+)`", TEXT)) == set()


@pytest.mark.parametrize(
    "said",
    [
        f"beyond {LONG_GAP_RATIO:g} intervals",
        f"angle below {SPIKE_ANGLE_DEG:g}° between legs of more than {SPIKE_LEG_M:g} m",
        f"counted beyond {STEP_M:g} m",
        f"`--from-s` ({EvaluationSettings().from_s:g} s)",
        f"more than {EvaluationSettings().max_truth_gap_s:g} s are not bridged",
        f"within {EvaluationSettings().gate_m / 1000:g} km",
    ],
)
def test_every_number_in_the_text_is_the_programs(said):
    assert said in " ".join(TEXT.split())


def test_the_fewest_intervals_of_a_named_flight_are_ten():
    assert MIN_INTERVALS == 10
    assert "fewer than ten intervals" in TEXT
