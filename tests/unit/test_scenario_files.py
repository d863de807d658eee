"""Report and truth files of the simulator: every line says what the columns say, and a broken file is never left."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from tests.simulation_scenes import RADAR2, SENSORS, quiet, run

from aeroskein.errors import SettingsError
from aeroskein.plots import Plots
from aeroskein_service.commands import simulate as command
from aeroskein_service.config import Config
from aeroskein_service.evaluation.files import read_truth
from aeroskein_service.scenario_files import LineFile, report_lines, truth_lines, truth_path

IDS = [sensor.id for sensor in SENSORS]


def lines_of(path: Path) -> list[dict[str, object]]:
    content = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    return [json.loads(line) for line in content.splitlines()]


@pytest.fixture
def config() -> Config:
    return Config(sensors=SENSORS)


def test_report_lines_say_what_the_columns_say() -> None:
    plots, _ = run(*SENSORS, aircraft=10, duration_s=30.0)

    rows = [json.loads(line) for line in report_lines(plots, IDS).splitlines()]

    assert len(rows) == len(plots)
    assert [row["sensor"] for row in rows] == [IDS[index] for index in plots.sensor]
    for name, tolerance in (
        ("received_s", 1e-6), ("time_s", 1e-6), ("lat_deg", 1e-8), ("range_m", 1e-3), ("azimuth_deg", 1e-6),
        ("altitude_m", 1e-3), ("ground_speed_mps", 1e-4), ("vertical_rate_mps", 1e-4),
    ):  # fmt: skip
        column = np.array([row.get(name, np.nan) for row in rows])
        assert (np.isnan(column) == np.isnan(getattr(plots, name))).all()
        assert np.nanmax(np.abs(column - getattr(plots, name))) <= tolerance
    assert [row.get("address", "") for row in rows] == [f"{a:06X}" if a >= 0 else "" for a in plots.address]


def test_azimuths_never_round_up_to_360() -> None:
    plots = Plots.of(1, time_s=1.0, received_s=1.0, range_m=1000.0, azimuth_deg=359.9999999)

    (row,) = [json.loads(line) for line in report_lines(plots, ["radar"]).splitlines()]

    assert row["azimuth_deg"] == 0.0


def test_rounding_leaves_the_columns_alone() -> None:
    plots, _ = run(RADAR2, errors=(quiet("radar2"),), aircraft=4, duration_s=10.0)
    before = plots.range_m.tobytes()

    report_lines(plots, ["radar2"])

    assert plots.range_m.tobytes() == before


@pytest.mark.parametrize(
    ("reports", "truth"),
    [
        ("a.jsonl", "a.truth.jsonl"),
        ("a.jsonl.gz", "a.truth.jsonl.gz"),
        ("a.b.json", "a.b.truth.jsonl"),
        ("reports", "reports.truth.jsonl"),
    ],
)
def test_the_truth_of_a_report_file_stands_beside_it(reports: str, truth: str) -> None:
    assert truth_path(Path("x") / reports) == Path("x") / truth


def test_truth_files_are_read_back_by_the_evaluation(tmp_path: Path) -> None:
    _, truth = run(SENSORS[0], aircraft=5, duration_s=20.0)
    path = tmp_path / "a.truth.jsonl"
    path.write_bytes(truth_lines(truth))

    read, notes = read_truth(path)

    assert notes.bad == 0
    assert notes.lines == len(truth)
    assert {row["phase"] for row in lines_of(path)} <= {
        "hover", "turn", "acceleration", "deceleration", "climb", "descent", "straight",
    }  # fmt: skip
    assert read is not None


@pytest.mark.parametrize("name", ["a.jsonl", "a.jsonl.gz"])
def test_the_command_writes_reports_in_order_and_truth_by_track(tmp_path: Path, name: str, config: Config) -> None:
    status = command.run(config, aircraft=6, duration=20.0, scenario="terminal", output=tmp_path / name)

    reports, truth = lines_of(tmp_path / name), lines_of(truth_path(tmp_path / name))
    received = [row["received_s"] for row in reports]
    order = [(row["track"], row["time_s"]) for row in truth]
    assert status == 0
    assert received == sorted(received)
    assert {row["sensor"] for row in reports} == set(IDS)
    assert order == sorted(order)
    assert len(truth) == 6 * 100
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, truth_path(Path(name)).name])


def test_one_seed_writes_the_same_bytes(tmp_path: Path, config: Config) -> None:
    for name in ("a.jsonl.gz", "b.jsonl.gz"):
        command.run(config, aircraft=4, duration=10.0, seed=7, output=tmp_path / name)
    command.run(config, aircraft=4, duration=10.0, seed=8, output=tmp_path / "c.jsonl.gz")

    a, b, c = ((tmp_path / f"{name}.jsonl.gz").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_a_paced_file_holds_the_same_as_an_unpaced_one(tmp_path: Path, config: Config) -> None:
    command.run(config, aircraft=4, duration=10.0, output=tmp_path / "a.jsonl")
    command.run(config, aircraft=4, duration=10.0, output=tmp_path / "b.jsonl", speed=100.0)

    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "b.jsonl").read_bytes()


def test_a_file_can_hold_one_sensor_only(tmp_path: Path, config: Config) -> None:
    command.run(config, aircraft=4, duration=20.0, output=tmp_path / "a.jsonl", sensor=["radar2"])

    assert {row["sensor"] for row in lines_of(tmp_path / "a.jsonl")} == {"radar2"}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"speed": 2.0}, "--speed 2 needs --output"),
        ({"speed": 0.0, "output": Path("x")}, "--speed 0: expected a number above 0"),
        ({"sensor": ["radar9"]}, "--sensor radar9: no such sensor"),
    ],
)
def test_options_that_do_not_go_together_are_wrong_usage(
    options: dict[str, object], sentence: str, config: Config
) -> None:
    with pytest.raises(command.UsageError, match=sentence) as raised:
        command.run(config, **options)  # type: ignore[arg-type]

    assert raised.value.exit_status == 2


def test_an_unknown_scenario_is_wrong_configuration(config: Config) -> None:
    with pytest.raises(SettingsError, match=r"simulation.scenario: expected mixed"):
        command.run(config, scenario="loops", output=Path("x"))


def write_and_fail(path: Path, error: type[BaseException]) -> None:
    with LineFile(path) as file:
        file.write(b"one line\n")
        raise error


@pytest.mark.parametrize("name", ["a.jsonl", "a.jsonl.gz"])
def test_a_file_that_could_not_be_finished_is_not_there(tmp_path: Path, name: str) -> None:
    with pytest.raises(KeyboardInterrupt):
        write_and_fail(tmp_path / name, KeyboardInterrupt)

    assert list(tmp_path.iterdir()) == []


def test_a_failed_file_leaves_the_one_before_it(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    path.write_bytes(b"before\n")

    with pytest.raises(MemoryError):
        write_and_fail(path, MemoryError)

    assert path.read_bytes() == b"before\n"
