"""``filter`` and ``smooth`` from the command line: report file in, fused file out that ``evaluate`` reads."""

import gzip
import json
from pathlib import Path

import pytest

from aeroskein_service.cli import main
from aeroskein_service.evaluation.files import read_points

CONFIG = """
[[sensors]]
id = "adsb"
kind = "adsb"

[[sensors]]
id = "radar1"
kind = "ssr"
lat_deg = 48.35
lon_deg = 11.78
height_m = 460.0
period_s = 4.0

[simulation]
scenario = "terminal"
aircraft = 2
duration_s = 120.0
"""


def aeroskein(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A configuration, a report file and its truth."""
    made = tmp_path_factory.mktemp("offline")
    (made / "demo.toml").write_text(CONFIG)
    assert aeroskein("simulate", "-c", made / "demo.toml", "--output", made / "reports.jsonl") == 0
    return made


def lines(path: Path) -> list[dict[str, object]]:
    data = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    return [json.loads(line) for line in data.splitlines()]


def run_filter(folder: Path, output: Path, *options: str, reports: str = "reports.jsonl") -> int:
    arguments = ("filter", "-c", folder / "demo.toml", folder / reports, "--output", output)
    return aeroskein(*arguments, *(options if "--sensor" in options else ("--sensor", "adsb", *options)))


@pytest.mark.parametrize("model", ["linear", "ukf", "imm"])
@pytest.mark.parametrize("smooth", [(), ("--smooth",)])
def test_filtered_files_can_be_evaluated(
    folder: Path, tmp_path: Path, model: str, smooth: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_filter(folder, tmp_path / "out.jsonl", "--model", model, *smooth) == 0
    capsys.readouterr()

    status = aeroskein("evaluate", tmp_path / "out.jsonl", "--truth", folder / "reports.truth.jsonl", "--json")

    assert status == 0
    (product,) = json.loads(capsys.readouterr().out)["evaluations"][0]["products"]
    assert product["product"] == ("element" if smooth else "live")
    assert product["accuracy"]["horizontal_m"]["rms"] < (7.0 if smooth else 10.0)


def test_points_follow_the_contract(folder: Path, tmp_path: Path) -> None:
    assert run_filter(folder, tmp_path / "out.jsonl.gz") == 0

    rows = lines(tmp_path / "out.jsonl.gz")
    points, notes = read_points(tmp_path / "out.jsonl.gz")

    assert notes.bad == 0
    assert len(points) == len(rows)
    assert {row["product"] for row in rows} == {"live"}
    assert all(row["element"] is None and row["span_s"] is None for row in rows)
    assert all(row["published_s"] == row["input_received_s"] for row in rows)
    published = [float(str(row["published_s"])) for row in rows]
    assert published == sorted(published)


def test_same_input_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    for name in ("a.jsonl.gz", "b.jsonl.gz"):
        assert run_filter(folder, tmp_path / name, "--smooth") == 0

    assert (tmp_path / "a.jsonl.gz").read_bytes() == (tmp_path / "b.jsonl.gz").read_bytes()


def test_settings_of_the_filter_come_from_its_section(folder: Path, tmp_path: Path) -> None:
    (folder / "published.toml").write_text(CONFIG + '\n[filter]\nindicators = "published"\nuse_velocity = false\n')

    run_filter(folder, tmp_path / "usual.jsonl")
    aeroskein(
        "filter", "-c", folder / "published.toml", folder / "reports.jsonl", "--sensor", "adsb",
        "--output", tmp_path / "published.jsonl",
    )  # fmt: skip

    assert (tmp_path / "usual.jsonl").read_bytes() != (tmp_path / "published.jsonl").read_bytes()


def test_a_setting_that_cannot_work_stops_the_program(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "wrong.toml").write_text(CONFIG + "\n[filter]\ngap_inflation = 0.5\n")

    status = aeroskein(
        "filter", "-c", folder / "wrong.toml", folder / "reports.jsonl", "--sensor", "adsb", "--output", tmp_path / "x"
    )

    assert status == 2
    assert "filter.gap_inflation" in capsys.readouterr().err


def test_an_unknown_sensor_is_wrong_usage(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_filter(folder, tmp_path / "out.jsonl", "--sensor", "radar7") == 2
    assert "radar7" in capsys.readouterr().err


def test_the_report_file_is_never_overwritten(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "reports.jsonl").read_bytes()

    assert run_filter(folder, folder / "reports.jsonl") == 2
    assert "report file itself" in capsys.readouterr().err
    assert (folder / "reports.jsonl").read_bytes() == before


def test_too_many_broken_lines_fail_after_everything_good_was_written(folder: Path, tmp_path: Path) -> None:
    good = (folder / "reports.jsonl").read_text().splitlines()
    (folder / "broken.jsonl").write_text("\n".join([*good, *["{not json"] * (len(good) // 20)]) + "\n")

    run_filter(folder, tmp_path / "good.jsonl")
    assert run_filter(folder, tmp_path / "out.jsonl", reports="broken.jsonl") == 1

    assert (tmp_path / "out.jsonl").read_bytes() == (tmp_path / "good.jsonl").read_bytes()


def test_estimated_errors_are_said(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_filter(folder, tmp_path / "out.jsonl", "--estimate-errors") == 0

    assert "adsb: one sigma" in capsys.readouterr().err


def test_a_radar_can_be_filtered_too(folder: Path, tmp_path: Path) -> None:
    assert run_filter(folder, tmp_path / "out.jsonl", "--sensor", "radar1", "--smooth") == 0

    assert {next(iter(row["sources"])) for row in lines(tmp_path / "out.jsonl")} == {"radar1"}  # type: ignore[call-overload]


def test_smoothed_tracks_beat_filtered_ones(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    smoothed = aeroskein("smooth", "-c", folder / "demo.toml", folder / "reports.jsonl", "-o", tmp_path / "s.jsonl")
    assert smoothed == 0
    assert run_filter(folder, tmp_path / "f.jsonl") == 0
    said = capsys.readouterr().err
    assert "radar1 converg" in said

    aeroskein(
        "evaluate", tmp_path / "s.jsonl", tmp_path / "f.jsonl", "--truth", folder / "reports.truth.jsonl", "--json"
    )

    found = json.loads(capsys.readouterr().out)["evaluations"]
    error = [evaluation["products"][0]["accuracy"]["horizontal_m"]["rms"] for evaluation in found]
    assert error[0] < 0.85 * error[1]


def test_an_empty_report_file_gives_an_empty_fused_file(folder: Path, tmp_path: Path) -> None:
    (folder / "empty.jsonl").write_text("")

    assert run_filter(folder, tmp_path / "f.jsonl", reports="empty.jsonl") == 0
    assert aeroskein("smooth", "-c", folder / "demo.toml", folder / "empty.jsonl", "-o", tmp_path / "s.jsonl") == 0

    assert (tmp_path / "f.jsonl").read_bytes() == (tmp_path / "s.jsonl").read_bytes() == b""
