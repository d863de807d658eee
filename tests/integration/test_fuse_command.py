"""``aeroskein fuse`` over a simulated report file: the rules of the contract for files, through the command line."""

from __future__ import annotations

import gzip
import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aeroskein.plots import Plots
from aeroskein.simulation import SimulationSettings, simulate
from aeroskein_service import cli, log
from aeroskein_service.config import load_config
from aeroskein_service.file_fusion import TICK_S, fuse_chunks
from aeroskein_service.files import ReportFile
from aeroskein_service.line_writers import ReportWriter
from aeroskein_service.messages import FUSED_FIELDS
from aeroskein_service.report_choice import ReportChoice
from aeroskein_service.selecting import parse_selection

CONFIG = Path(__file__).parents[2] / "deploy" / "fusion.toml"
SECONDS = 40.0
AIRCRAFT = 3


@pytest.fixture(autouse=True)
def _no_logging(monkeypatch):
    monkeypatch.setattr(log, "configure", lambda settings: None)


@pytest.fixture(scope="module")
def reports(tmp_path_factory) -> Path:
    """Forty seconds of three aircraft, in order of arrival."""
    path = tmp_path_factory.mktemp("fuse") / "reports.jsonl"
    config = load_config(CONFIG, environ={})
    settings = SimulationSettings(aircraft=AIRCRAFT, duration_s=SECONDS, errors=config.simulation.errors)
    with ReportWriter(path, config.sensor_ids) as writer:
        for chunk in simulate(settings, config.sensors):
            writer.plots(chunk.plots)
    return path


@pytest.fixture(scope="module")
def lines(reports) -> list[dict[str, Any]]:
    return read(reports)


@pytest.fixture(scope="module")
def points(reports, tmp_path_factory) -> list[dict[str, Any]]:
    """What comes out with the default options."""
    output = tmp_path_factory.mktemp("fused") / "fused.jsonl"
    assert fuse(reports, output) == 0
    return read(output)


def fuse(reports: Path, output: Path, *options: str) -> int:
    with pytest.raises(SystemExit) as left:
        cli.main(["fuse", "--config", str(CONFIG), str(reports), "--output", str(output), *options])
    return left.value.code or 0


def read(path: Path) -> list[dict[str, Any]]:
    content = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    return [json.loads(line) for line in content.splitlines()]


def write(path: Path, lines: list[Any]) -> Path:
    path.write_text("".join((line if isinstance(line, str) else json.dumps(line)) + "\n" for line in lines))
    return path


# -- what comes out ------------------------------------------------------------------------------------------------
def test_every_aircraft_has_points_of_both_products(points):
    for product in ("live", "element"):
        assert len({point["track"] for point in points if point["product"] == product}) == AIRCRAFT


def test_points_have_the_fields_of_the_contract(points):
    assert {tuple(point) for point in points} == {tuple(name for name in FUSED_FIELDS if name != "renamed_to")}


def test_epoch_is_the_first_arrival_in_milliseconds(points, lines):
    assert {point["epoch"] for point in points} == {round(lines[0]["received_s"] * 1000)}


def test_points_are_published_on_the_clock_of_the_file(points, lines):
    published = [point["published_s"] for point in points]

    assert published == sorted(published)
    assert published[0] >= lines[0]["received_s"]
    assert published[-1] == max(line["received_s"] for line in lines)


def test_live_point_is_published_within_a_tick_of_the_arrival_it_rests_on(points):
    waited = [
        point["published_s"] - point["input_received_s"]
        for point in points
        if point["product"] == "live" and "coasted" not in point["flags"] and point["status"] != "terminated"
    ]

    assert min(waited) >= 0.0
    assert max(waited) < TICK_S


def test_numbers_of_points_have_no_holes(points):
    counted: dict[Any, list[int]] = defaultdict(list)
    for point in points:
        counted[point["product"], point["track_number"]].append(point["seq"])

    assert all(seq == list(range(len(seq))) for seq in counted.values())


def test_spans_of_a_track_join(points):
    spans: dict[str, list[Any]] = defaultdict(list)
    for point in points:
        if point["product"] == "element":
            spans[point["track"]].append(point["span_s"])

    for track in spans.values():
        assert [start for start, _ in track[1:]] == [end for _, end in track[:-1]]


# -- the same bytes ------------------------------------------------------------------------------------------------
def test_same_input_gives_the_same_bytes(reports, tmp_path):
    fuse(reports, tmp_path / "a.jsonl.gz")
    fuse(reports, tmp_path / "b.jsonl.gz")

    assert (tmp_path / "a.jsonl.gz").read_bytes() == (tmp_path / "b.jsonl.gz").read_bytes()


def test_packing_changes_nothing(reports, points, tmp_path):
    packed = tmp_path / "r.jsonl.gz"
    packed.write_bytes(gzip.compress(reports.read_bytes()))

    fuse(packed, tmp_path / "f.jsonl")

    assert read(tmp_path / "f.jsonl") == points


def test_size_of_the_chunks_changes_nothing(reports):
    config = load_config(CONFIG, environ={})

    def happened(chunk_bytes: int) -> list[Any]:
        file = ReportFile(reports, config.sensor_ids, chunk_bytes=chunk_bytes)
        return [
            (now_s, [repr(event) for event in events]) for _, now_s, events in fuse_chunks(file.chunks(), config.engine)
        ]

    assert happened(3_000) == happened(10_000_000)


# -- options -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("product", ["live", "element"])
def test_one_product_alone_is_the_same_as_among_both(reports, points, tmp_path, product):
    fuse(reports, tmp_path / "f.jsonl", "--product", product)

    assert read(tmp_path / "f.jsonl") == [point for point in points if point["product"] == product]


@pytest.mark.parametrize("product", ["lives", "", "live,dead"])
def test_unknown_product_is_wrong_usage(reports, tmp_path, product, capsys):
    assert fuse(reports, tmp_path / "f.jsonl", "--product", product) == 2
    assert "--product: " in capsys.readouterr().err


def test_mode_of_the_command_line_is_in_force(reports, tmp_path):
    fuse(reports, tmp_path / "f.jsonl", "--mode", "patent", "--product", "element")

    covariances = [point["position_cov_m2"] for point in read(tmp_path / "f.jsonl") if "coasted" not in point["flags"]]
    assert covariances
    assert set(covariances) == {None}


def test_longer_lookahead_publishes_elements_later(reports, points, tmp_path):
    fuse(reports, tmp_path / "f.jsonl", "--lookahead", "3", "--product", "element")

    def delay(some: list[dict[str, Any]]) -> float:
        # Not the last elements, which the end of the file closes.
        end = max(point["published_s"] for point in some)
        return float(np.median([p["published_s"] - p["span_s"][1] for p in some if p["published_s"] < end]))

    usual = delay([point for point in points if point["product"] == "element"])
    assert delay(read(tmp_path / "f.jsonl")) == pytest.approx(usual + 8.0, abs=1.0)


def test_registration_states_come_every_ten_seconds_for_every_radar(reports, tmp_path):
    fuse(reports, tmp_path / "f.jsonl", "--registration-output", str(tmp_path / "g.jsonl"))

    states = read(tmp_path / "g.jsonl")
    for radar in ("radar1", "radar2"):
        times = [state["time_s"] for state in states if state["sensor"] == radar]
        assert len(times) >= SECONDS / 10.0
        assert max(np.diff(times)) < 10.0 + 2 * TICK_S
    assert {state["sensor"] for state in states} == {"radar1", "radar2"}


# -- selections ----------------------------------------------------------------------------------------------------
def test_selected_address_is_fused_alone(reports, points, tmp_path):
    address = points[0]["address"]

    fuse(reports, tmp_path / "f.jsonl", "--select", f"address={address}")

    alone = read(tmp_path / "f.jsonl")
    assert {point["address"] for point in alone} == {address}
    assert len(alone) > 10


def test_selected_sensor_is_the_only_source(reports, tmp_path):
    fuse(reports, tmp_path / "f.jsonl", "--select", "sensor=radar1")

    assert {source for point in read(tmp_path / "f.jsonl") for source in point["sources"]} == {"radar1"}


def test_selected_time_span_holds_all_that_is_fused(reports, lines, tmp_path):
    start = lines[0]["time_s"] + 20.0

    fuse(reports, tmp_path / "f.jsonl", "--select", f"time={start},{start + 20.0}", "--product", "live")

    times = [p["time_s"] for p in read(tmp_path / "f.jsonl") if "coasted" not in p["flags"] and p["seq"] == 0]
    assert min(times) >= start - 1.0  # time registration moves radar plots
    assert max(times) <= start + 21.0


def test_selected_airspace_takes_radar_plots_by_their_converted_position():
    config = load_config(CONFIG, environ={})
    settings = SimulationSettings(aircraft=AIRCRAFT, duration_s=30.0, errors=())
    plots = Plots.concatenate([chunk.plots for chunk in simulate(settings, config.sensors)])
    adsb = plots.take(np.isfinite(plots.lat_deg))
    lat, lon = np.median(adsb.lat_deg), np.median(adsb.lon_deg)
    choice = ReportChoice(parse_selection(f"bbox=-90,-180,{lat},{lon}", config.sensor_ids), config.sensors)

    chosen = choice(plots)

    inside = {a for a in np.unique(adsb.address) if choice(adsb.take(adsb.address == a)).all()}
    outside = {a for a in np.unique(adsb.address) if not choice(adsb.take(adsb.address == a)).any()}
    radar = np.isfinite(plots.range_m) & (plots.address >= 0)
    assert inside
    assert outside
    assert chosen[radar & np.isin(plots.address, list(inside))].mean() > 0.95
    assert chosen[radar & np.isin(plots.address, list(outside))].mean() < 0.05


@pytest.mark.parametrize("select", ["speed=fast", "sensor=radar9", "colour=red", "bbox=1,2"])
def test_selection_that_is_not_understood_is_wrong_usage(reports, tmp_path, select, capsys):
    assert fuse(reports, tmp_path / "f.jsonl", "--select", select) == 2
    assert select.partition("=")[0] in capsys.readouterr().err
    assert not (tmp_path / "f.jsonl").exists()


# -- the clock -----------------------------------------------------------------------------------------------------
def report(time_s: float, received_s: float | None = None, **changes: Any) -> dict[str, Any]:
    line = {
        "sensor": "adsb",
        "time_s": time_s,
        "address": "3C6444",
        "lat_deg": 48.0 + (time_s - 1000.0) * 2e-3,
        "lon_deg": 11.0,
    }
    line |= {"ground_speed_mps": 222.4, "track_angle_deg": 0.0, "altitude_m": 9000.0}
    return line | ({} if received_s is None else {"received_s": received_s}) | changes


@pytest.mark.parametrize(("ahead_s", "refused"), [(4.9, False), (5.1, True), (-29.9, False), (-30.1, True)])
def test_limits_of_time_are_measured_on_the_clock_at_the_arrival(tmp_path, ahead_s, refused, capsys):
    # Another report in the same tick moves the clock on behind the one in question.
    flight = [report(1000.0 + i, address="4CA2D6") for i in range(40)]
    asked = report(1040.01 + ahead_s, 1040.01)
    later = report(1040.0, 1040.24, address="4CA2D6")

    fuse(write(tmp_path / "r.jsonl", [*flight, asked, later]), tmp_path / "f.jsonl")

    said = capsys.readouterr().err
    assert (("future" in said) or ("too_old" in said)) is refused


def test_arrival_that_goes_back_does_not_turn_the_clock_back(tmp_path, capsys):
    lines = [report(1000.0 + i, 1000.5 + i) for i in range(20)]
    lines.append(report(960.0, 960.5, address="4CA2D6"))

    fuse(write(tmp_path / "r.jsonl", lines), tmp_path / "f.jsonl")

    assert "1 too_old" in capsys.readouterr().err


def test_file_without_arrivals_runs_on_the_times_of_its_reports(tmp_path):
    fuse(write(tmp_path / "r.jsonl", [report(1000.0 + i) for i in range(30)]), tmp_path / "f.jsonl")

    points = read(tmp_path / "f.jsonl")
    assert points[0]["epoch"] == 1_000_000
    assert points[-1]["published_s"] == 1029.0


def test_hours_without_reports_end_a_track_and_begin_another(tmp_path):
    lines = [report(1000.0 + i) for i in range(20)] + [report(9000.0 + i) for i in range(20)]

    fuse(write(tmp_path / "r.jsonl", lines), tmp_path / "f.jsonl")

    points = [point for point in read(tmp_path / "f.jsonl") if point["product"] == "live"]
    assert len({point["track_number"] for point in points}) == 2
    (ended,) = [point for point in points if point["status"] == "terminated" and point["published_s"] < 8000.0]
    assert ended["published_s"] == pytest.approx(1019.0 + 30.0, abs=1.5)


# -- broken files --------------------------------------------------------------------------------------------------
def test_broken_lines_are_skipped_and_named(tmp_path, capsys):
    lines: list[Any] = [report(1000.0 + i) for i in range(200)]
    lines[99] = "{"

    status = fuse(write(tmp_path / "r.jsonl", lines), tmp_path / "f.jsonl")

    assert status == 0
    said = capsys.readouterr().err
    assert "1 broken line" in said
    assert "line 100 is not JSON" in said
    assert len(read(tmp_path / "f.jsonl")) > 190


def test_too_many_broken_lines_fail_after_everything_good_was_written(tmp_path):
    lines: list[Any] = [report(1000.0 + i) for i in range(50)] + ["{"]
    path = write(tmp_path / "r.jsonl", lines)

    assert fuse(path, tmp_path / "strict.jsonl") == 1
    assert fuse(path, tmp_path / "lenient.jsonl", "--max-bad", "2%") == 0
    assert (tmp_path / "strict.jsonl").read_bytes() == (tmp_path / "lenient.jsonl").read_bytes()
    assert len(read(tmp_path / "strict.jsonl")) > 45


def test_file_that_was_cut_off_fails_after_everything_good_was_written(reports, tmp_path, capsys):
    path = tmp_path / "r.jsonl.gz"
    path.write_bytes(gzip.compress(reports.read_bytes())[:-500])

    assert fuse(path, tmp_path / "f.jsonl", "--max-bad", "100%") == 1
    assert "not read to its end" in capsys.readouterr().err
    assert len(read(tmp_path / "f.jsonl")) > 50


def test_wrong_reports_are_counted_by_sensor_and_reason(tmp_path, capsys):
    lines = [report(1000.0 + i) for i in range(20)]
    lines += [report(1020.0, altitude_m="x"), report(1020.0, address="?"), report(1020.0, callsign="MUCH TOO LONG")]

    assert fuse(write(tmp_path / "r.jsonl", lines), tmp_path / "f.jsonl") == 0

    assert "adsb: 21 accepted, not used: 1 bad_value, 1 bad_address, 1 bad_callsign" in capsys.readouterr().err


@pytest.mark.parametrize("lines", [[], ["{"], [report(1000.0, altitude_m="x")]])
def test_file_without_a_good_report_gives_an_empty_fused_file(tmp_path, lines):
    fuse(write(tmp_path / "r.jsonl", lines), tmp_path / "f.jsonl")

    assert (tmp_path / "f.jsonl").read_bytes() == b""


def test_report_file_is_not_overwritten_by_its_own_fusion(reports, capsys):
    before = reports.read_bytes()

    assert fuse(reports, reports) == 2
    assert "is the report file itself" in capsys.readouterr().err
    assert reports.read_bytes() == before


def test_output_that_cannot_be_written_is_one_sentence(reports, tmp_path, capsys):
    assert fuse(reports, tmp_path / "nowhere" / "f.jsonl") == 1
    assert "no such file or directory" in capsys.readouterr().err
