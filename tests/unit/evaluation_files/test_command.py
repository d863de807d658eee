"""The command: tables, JSON, page, exit status."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from tests.evaluation_scenes import START_S, points_on, truth_of

from aeroskein.evaluation import EvaluationSettings, TruthCurve, evaluate
from aeroskein.points import Product
from aeroskein_service.commands.evaluate import run
from aeroskein_service.config import Config
from aeroskein_service.evaluation.page import page

NUMBERS = (
    *("time_s", "published_s", "lat_deg", "lon_deg", "height_m"),
    *("ground_speed_mps", "track_angle_deg"),
)
SENSORS = (
    {"id": "adsb", "kind": "adsb"},
    {"id": "radar1", "kind": "ssr", "lat_deg": 48.35, "lon_deg": 11.78, "height_m": 460.0},
)


def write_truth(path, truth):
    with path.open("w") as file:
        for k in range(len(truth)):
            row = {"track": truth.names[truth.flight[k]], "time_s": truth.time_s[k], "phase": "straight"}
            for name in ("lat_deg", "lon_deg", "height_m", "ground_speed_mps", "track_angle_deg", "vertical_rate_mps"):
                row[name] = float(getattr(truth, name)[k])
            file.write(json.dumps(row) + "\n")
    return path


def write_points(path, truth, error_m):
    with path.open("w") as file:
        for product in Product:
            points = points_on(truth, east_m=error_m, product=product, position_cov_m2=[25.0, 0.0, 25.0])
            for k in range(len(points)):
                row = {name: float(getattr(points, name)[k]) for name in NUMBERS}
                row |= {name: int(getattr(points, name)[k]) for name in ("track_number", "seq")}
                row |= {"product": product.name.lower(), "status": "confirmed", "address": f"{points.address[k]:06X}"}
                row["position_cov_m2"] = points.position_cov_m2[k].tolist()
                file.write(json.dumps(row) + "\n")
    return path


@pytest.fixture
def scene(tmp_path):
    truth = truth_of(["3C6444", "4CA2D6"], seconds=120, height_m=9000.0)
    rng = np.random.default_rng(4)
    write_truth(tmp_path / "truth.jsonl", truth)
    write_points(tmp_path / "good.jsonl", truth, rng.normal(0.0, 5.0, len(truth)))
    write_points(tmp_path / "bad.jsonl", truth, rng.normal(0.0, 20.0, len(truth)))
    raw = points_on(truth, east_m=rng.normal(0.0, 50.0, len(truth)))
    with (tmp_path / "reports.jsonl").open("w") as file:
        for k in range(len(truth)):
            address = truth.names[truth.flight[k]]
            row = {"sensor": "adsb", "time_s": raw.time_s[k], "address": address}
            file.write(json.dumps({**row, "lat_deg": raw.lat_deg[k], "lon_deg": raw.lon_deg[k]}) + "\n")
    return tmp_path


def test_files_stand_side_by_side(scene, capsys):
    status = run([scene / "good.jsonl", scene / "bad.jsonl"], truth=scene / "truth.jsonl")

    out = capsys.readouterr().out
    rms = next(line for line in out.splitlines() if "horizontal error, RMS" in line)
    figures = [float(text) for text in rms.split("]")[1].split()]
    assert status == 0
    assert len(figures) == 4
    assert figures[:2] == pytest.approx([5.0, 5.0], rel=0.2)
    assert figures[2:] == pytest.approx([20.0, 20.0], rel=0.2)


def test_json_comes_back_as_the_evaluation(scene, capsys):
    status = run([scene / "good.jsonl"], truth=scene / "truth.jsonl", as_json=True)

    document = json.loads(capsys.readouterr().out)
    live = document["evaluations"][0]["products"][0]
    assert status == 0
    assert document["version"] == 1
    assert live["product"] == "live"
    assert live["accuracy"]["horizontal_m"]["rms"] == pytest.approx(5.0, rel=0.2)
    assert live["flights"][1]["flight"] == "4CA2D6"
    assert live["requirements"][0]["verdict"] == "met"
    assert "residuals" not in live


def test_json_has_no_number_that_is_none(scene, capsys):
    run([scene / "good.jsonl"], truth=scene / "truth.jsonl", as_json=True)

    assert not re.search(r"\bNaN\b|Infinity", capsys.readouterr().out)


def test_the_same_files_give_the_same_json(scene, capsys):
    outputs = []
    for _ in range(2):
        run([scene / "good.jsonl"], truth=scene / "truth.jsonl", as_json=True, seed=7)
        outputs.append(capsys.readouterr().out)

    assert outputs[0] == outputs[1]


def test_the_seed_moves_the_intervals_and_nothing_else(scene, capsys):
    products = []
    for seed in (1, 2):
        run([scene / "good.jsonl"], truth=scene / "truth.jsonl", as_json=True, seed=seed)
        products.append(json.loads(capsys.readouterr().out)["evaluations"][0]["products"][0])

    assert products[0]["accuracy"] == products[1]["accuracy"]


def test_from_s_leaves_out_the_beginning(scene, capsys):
    judged = []
    for from_s in (0.0, 60.0):
        run([scene / "good.jsonl"], truth=scene / "truth.jsonl", as_json=True, from_s=from_s)
        judged.append(json.loads(capsys.readouterr().out)["evaluations"][0]["products"][0]["judged"])

    assert judged == [242, 122]


def test_raw_reports_are_compared_with(scene, capsys):
    config = Config.model_validate({"sensors": SENSORS}, strict=False)

    run(
        [scene / "good.jsonl"],
        truth=scene / "truth.jsonl",
        reports=scene / "reports.jsonl",
        config=config,
        as_json=True,
    )

    evaluation = json.loads(capsys.readouterr().out)["evaluations"][0]
    assert evaluation["sensors"][0]["horizontal_m"]["rms"] == pytest.approx(50.0, rel=0.2)
    assert evaluation["products"][0]["ratio_to_sensor"]["adsb"] == pytest.approx(0.1, rel=0.3)


def test_a_broken_line_is_said_and_forgiven(scene, capsys):
    with (scene / "good.jsonl").open("a") as file:
        file.write("{broken\n")

    status = run([scene / "good.jsonl"], truth=scene / "truth.jsonl")

    assert status == 0
    assert "line 485 skipped" in capsys.readouterr().err


def test_too_many_broken_lines_are_a_failure_after_all_is_printed(scene, capsys):
    with (scene / "good.jsonl").open("a") as file:
        file.write("{broken\n" * 10)

    status = run([scene / "good.jsonl"], truth=scene / "truth.jsonl", max_bad=0.01)

    captured = capsys.readouterr()
    assert status == 1
    assert "(and 9 more)" in captured.err
    assert "horizontal error" in captured.out


def test_a_file_that_is_not_there_is_one_sentence(scene, capsys):
    status = run([scene / "nothing.jsonl"], truth=scene / "truth.jsonl")

    assert status == 1
    assert capsys.readouterr().err.strip().endswith("nothing.jsonl: No such file or directory")


def test_empty_files_say_so(tmp_path, capsys):
    for name in ("fused.jsonl", "truth.jsonl"):
        (tmp_path / name).touch()

    status = run([tmp_path / "fused.jsonl"], truth=tmp_path / "truth.jsonl", html=tmp_path / "page.html")

    assert status == 0
    assert "no fused points" in capsys.readouterr().out
    assert "no fused points" in (tmp_path / "page.html").read_text()


def test_nothing_printed_claims_conformity(scene, capsys):
    run([scene / "good.jsonl"], truth=scene / "truth.jsonl", html=scene / "page.html")

    text = capsys.readouterr().out + (scene / "page.html").read_text()
    assert "No statement of conformity" in text
    assert not re.search(r"complian|certified", text, re.IGNORECASE)


class Page(HTMLParser):
    """What a browser would make of the page: open tags, references, pictures."""

    VOID = frozenset({"meta", "br", "line", "rect", "circle", "path"})

    def __init__(self, text):
        super().__init__()
        self.open, self.references, self.pictures = [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in ("src", "href", "xlink:href", "data", "action")]
        self.pictures += tag == "svg"
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag


@pytest.fixture
def report(scene, capsys):
    run(
        [scene / "good.jsonl", scene / "bad.jsonl"], truth=scene / "truth.jsonl", reports=scene / "reports.jsonl",
        html=scene / "page.html",
    )  # fmt: skip
    return (scene / "page.html").read_text()


def test_the_page_refers_to_nothing_outside(report):
    parsed = Page(report)

    assert parsed.references == []
    assert not re.search(r"https?:|url\((?!#)|@import|<script|<link|<img", report)


def test_every_tag_of_the_page_is_closed(report):
    assert Page(report).open == []


def test_the_page_has_every_kind_of_picture(report):
    titles = re.findall(r'aria-label="([^"]*)"', report)

    assert Page(report).pictures == len(titles)
    for kind in (
        "Cumulative distribution of the horizontal error", "Tail of the horizontal error", "Horizontal error by phase",
        "Error over time, straight", "Errors along and across the track", "against chi-square", "Map of flight",
        "close up", "Horizontal error of the worst flights", "RMS of all flights", "Age when published",
    ):  # fmt: skip
        assert any(kind in title for title in titles), kind


def test_no_picture_has_a_coordinate_that_is_none(report):
    assert not re.search(r'[dxyr]\d?="[^"]*(nan|inf)', report)


def test_the_page_knows_light_and_dark(report):
    assert "prefers-color-scheme: dark" in report


def test_names_in_the_page_are_escaped():
    truth = truth_of(["<b>&x"], seconds=60)
    evaluation = evaluate(points_on(truth, address=-1), truth, name="<i>", settings=EvaluationSettings(from_s=0.0))

    text = page([evaluation], TruthCurve(truth), ["<file>"])

    assert "<b>&x" not in text
    assert "<i>" not in re.sub(r'<i class="room"><i style="[^"]*"></i></i>', "", text)
    assert Page(text).open == []


def test_the_page_of_one_point_is_a_page():
    truth = truth_of(seconds=60)
    points = points_on(truth).take(np.array([40]))

    text = page([evaluate(points, truth, settings=EvaluationSettings(from_s=0.0))], TruthCurve(truth), [])

    assert Page(text).pictures > 5
    assert not re.search(r'[dxyr]\d?="[^"]*(nan|inf)', text)


def test_the_page_of_points_that_nobody_can_judge_is_a_page():
    truth = truth_of(["3C6444"], seconds=60)
    elsewhere = truth_of(["4CA2D6"], seconds=60, lat_deg=10.0)

    text = page([evaluate(points_on(elsewhere), truth)], TruthCurve(truth), [])

    assert "3C6444" in text
    assert Page(text).open == []


def test_time_of_day_is_named_for_the_worst_point(scene, capsys):
    run([scene / "good.jsonl"], truth=scene / "truth.jsonl")

    assert re.search(r"at 14:\d\d:\d\d", capsys.readouterr().out)
    assert START_S == 1_790_000_000.0
