"""From a simulated scenario through ``fuse`` to ``evaluate``, on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from aeroskein_service import cli, log

CONFIG = str(Path(__file__).parents[2] / "deploy" / "fusion.toml")


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        cli.main([str(argument) for argument in arguments])
    return left.value.code


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two minutes of six aircraft: reports, truth, fused points and their evaluation."""
    folder = tmp_path_factory.mktemp("evaluate")
    reports, fused = folder / "reports.jsonl", folder / "fused.jsonl.gz"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(log, "configure", lambda settings: None)
        scene = ("--aircraft", 6, "--duration", 120, "--seed", 5, "--scenario", "enroute")
        assert call("simulate", "--config", CONFIG, *scene, "--output", reports) == 0
        assert call("fuse", "--config", CONFIG, reports, "--output", fused) == 0
    return folder


@pytest.fixture
def evaluation(folder, capsys, monkeypatch):
    monkeypatch.setattr(log, "configure", lambda settings: None)
    status = call(
        "evaluate", folder / "fused.jsonl.gz", "--truth", folder / "reports.truth.jsonl", "--reports",
        folder / "reports.jsonl", "--config", CONFIG, "--json", "--html", folder / "page.html",
    )  # fmt: skip
    assert status == 0
    return json.loads(capsys.readouterr().out)


def test_both_products_of_every_flight_are_judged(evaluation):
    (found,) = evaluation["evaluations"]

    assert [product["product"] for product in found["products"]] == ["live", "element"]
    assert found["flights_without_points"] == []
    assert all(product["judged"] > 100 for product in found["products"])


def test_fused_points_are_better_than_every_raw_sensor(evaluation):
    for product in evaluation["evaluations"][0]["products"]:
        assert product["ratio_to_sensor"]
        assert max(product["ratio_to_sensor"].values()) < 0.5


def test_what_the_engine_writes_has_no_holes(evaluation):
    live, element = evaluation["evaluations"][0]["products"]

    for product in (live, element):
        assert (product["timing"]["seq_missing"], product["timing"]["seq_repeated"]) == (0, 0)
        assert product["timing"]["times_backwards"] == 0
    assert element["span_cover"]["hole_s"] == 0.0
    assert element["span_cover"]["overlap_s"] == 0.0


def test_no_line_of_what_the_program_wrote_is_broken(evaluation):
    assert [file["bad"] for file in evaluation["inputs"]] == [0, 0, 0]
    assert all(file["lines"] > 0 for file in evaluation["inputs"])


def test_the_page_is_written_beside_it(folder, evaluation):
    assert "Requirement rows" in (folder / "page.html").read_text("utf-8")
