"""Fused, truth and report files: what is good is read, what is broken is counted and named."""

import gzip
import json

import numpy as np
import pytest

from aeroskein.evaluation.sensors import Site
from aeroskein.points import Flag, Product, Status
from aeroskein_service.evaluation import lines
from aeroskein_service.evaluation.files import read_points, read_truth
from aeroskein_service.evaluation.report_files import read_reports

POINT = {
    "version": 1,
    "product": "live",
    "track": "3C6444",
    "track_number": 17,
    "address": "3c6444",
    "callsign": "DLH123",
    "mode_a": "7700",
    "epoch": 1_790_000_000_000,
    "seq": 4,
    "time_s": 1_790_000_001.5,
    "published_s": 1_790_000_001.75,
    "lat_deg": 48.0,
    "lon_deg": -11.0,
    "altitude_m": 3000.0,
    "height_m": None,
    "ground_speed_mps": 200.0,
    "track_angle_deg": 359.5,
    "position_cov_m2": [4.0, 1.0, 9.0],
    "velocity_cov_m2ps2": None,
    "status": "coasting",
    "element": None,
    "span_s": None,
    "master": "adsb",
    "sources": {"adsb": 4},
    "rejected": 0,
    "input_received_s": 1_790_000_001.6,
    "flags": ["coasted", "adsb_suspect", "something_new"],
}
TRUTH = {"track": "3C6444", "time_s": 1.0, "lat_deg": 48.0, "lon_deg": 11.0, "height_m": 100.0, "phase": "turn"}


def written(path, rows, opener=open):
    with opener(path, "wt", encoding="utf-8") as file:
        file.writelines((row if isinstance(row, str) else json.dumps(row)) + "\n" for row in rows)
    return path


def test_every_column_of_a_point_is_read(tmp_path):
    points, notes = read_points(written(tmp_path / "fused.jsonl", [POINT]))

    assert (notes.lines, notes.bad) == (1, 0)
    assert points.product[0] == Product.LIVE
    assert points.status[0] == Status.COASTING
    assert (points.track_number[0], points.address[0], points.mode_a[0]) == (17, 0x3C6444, 0o7700)
    assert points.callsign[0] == b"DLH123"
    assert (points.epoch[0], points.seq[0], points.element[0]) == (1_790_000_000_000, 4, -1)
    assert points.published_s[0] - points.time_s[0] == 0.25
    assert points.input_received_s[0] == 1_790_000_001.6
    assert (points.lat_deg[0], points.lon_deg[0], points.altitude_m[0]) == (48.0, -11.0, 3000.0)
    assert np.isnan([points.height_m[0], points.vertical_rate_mps[0]]).all()
    assert points.position_cov_m2[0].tolist() == [4.0, 1.0, 9.0]
    assert np.isnan(points.velocity_cov_m2ps2[0]).all()
    assert np.isnan(points.span_s[0]).all()
    assert points.flags[0] == Flag.COASTED | Flag.ADSB_SUSPECT


@pytest.mark.parametrize(
    "broken",
    [
        "{not json",
        "[1, 2]",
        {**POINT, "lat_deg": None},
        {**POINT, "lat_deg": 91.0},
        {**POINT, "time_s": "noon"},
        {**POINT, "status": "asleep"},
        {**POINT, "position_cov_m2": [1.0, 2.0]},
        '{"time_s": NaN, "lat_deg": 1, "lon_deg": 2}',
    ],
)
def test_a_broken_line_is_counted_named_and_skipped(tmp_path, broken):
    points, notes = read_points(written(tmp_path / "fused.jsonl", [POINT, broken, POINT]))

    assert len(points) == 2
    assert (notes.lines, notes.bad, notes.named[0].number) == (3, 1, 2)
    assert notes.named[0].reason


def test_bytes_that_are_no_text_cost_one_line(tmp_path):
    path = tmp_path / "fused.jsonl"
    good = json.dumps(POINT).encode()
    path.write_bytes(good + b"\n\xff\xfe\x00\n" + good + b"\n")

    points, notes = read_points(path)

    assert (len(points), notes.bad) == (2, 1)


def test_empty_lines_and_a_missing_end_of_line_are_no_errors(tmp_path):
    path = tmp_path / "fused.jsonl"
    path.write_text(f"\n{json.dumps(POINT)}\n   \n{json.dumps(POINT)}")

    points, notes = read_points(path)

    assert (len(points), notes.lines, notes.bad) == (2, 2, 0)


def test_an_empty_file_has_no_points(tmp_path):
    points, notes = read_points(written(tmp_path / "fused.jsonl", []))

    assert (len(points), notes.lines, notes.bad_share) == (0, 0, 0.0)


def test_a_packed_file_is_recognised_whatever_it_is_called(tmp_path):
    points, _ = read_points(written(tmp_path / "fused.data", [POINT] * 3, gzip.open))

    assert len(points) == 3


def test_a_packed_file_that_breaks_off_gives_what_came_before(tmp_path):
    rows = [{**POINT, "seq": k, "callsign": f"X{hash(str(k)) % 99999}"} for k in range(2000)]
    whole = written(tmp_path / "whole.gz", rows, gzip.open).read_bytes()
    (tmp_path / "cut.gz").write_bytes(whole[: len(whole) // 2])

    points, notes = read_points(tmp_path / "cut.gz")

    assert 0 < len(points) < 2000
    assert notes.bad >= 1
    assert "breaks off" in notes.named[-1].reason


def test_chunks_are_joined_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr(lines, "CHUNK_LINES", 7)

    points, _ = read_points(written(tmp_path / "fused.jsonl", [{**POINT, "seq": k} for k in range(23)]))

    assert points.seq.tolist() == list(range(23))


def test_only_the_first_broken_lines_are_named_and_all_are_counted(tmp_path):
    _, notes = read_points(written(tmp_path / "fused.jsonl", ["{"] * 20))

    assert (notes.bad, len(notes.named), notes.bad_share) == (20, lines.NAMED_LINES, 1.0)


def test_tracks_without_a_number_are_told_apart_by_their_name(tmp_path):
    rows = [{**POINT, "track_number": None, "track": name} for name in ("T000001", "T000002", "T000001")]

    points, _ = read_points(written(tmp_path / "fused.jsonl", rows))

    assert points.track_number[0] == points.track_number[2] != points.track_number[1]
    assert (points.track_number < 0).all()


def test_truth_knows_its_flights_phases_and_addresses(tmp_path):
    rows = [TRUTH, {**TRUTH, "time_s": 2.0, "phase": "climb"}, {**TRUTH, "track": "second", "phase": None}]

    truth, notes = read_truth(written(tmp_path / "truth.jsonl", rows))

    assert notes.lines == 3
    assert truth.names == ("3C6444", "second")
    assert truth.addresses.tolist() == [0x3C6444, -1]
    assert truth.flight.tolist() == [0, 0, 1]
    assert [truth.phases[i] if i >= 0 else None for i in truth.phase] == ["turn", "climb", None]


def test_truth_may_name_address_and_callsign_of_a_flight(tmp_path):
    row = {**TRUTH, "track": "flight one", "address": "4CA2D6", "callsign": "RYR1 "}

    truth, _ = read_truth(written(tmp_path / "truth.jsonl", [row]))

    assert truth.addresses.tolist() == [0x4CA2D6]
    assert truth.callsigns.tolist() == [b"RYR1"]


def test_an_empty_truth_has_no_flights(tmp_path):
    truth, _ = read_truth(written(tmp_path / "truth.jsonl", []))

    assert (truth.names, len(truth)) == ((), 0)


def test_reports_of_all_sensors_are_read(tmp_path):
    rows = [
        {"sensor": "adsb", "time_s": 1.0, "address": "3C6444", "lat_deg": 48.0, "lon_deg": 11.0, "nac_p": 9},
        {"sensor": "radar1", "received_s": 2.5, "time_s": 2.0, "range_m": 5e4, "azimuth_deg": 12.0},
    ]

    reports, notes = read_reports(written(tmp_path / "reports.jsonl", rows), {"radar1": Site(48.0, 11.0)})

    assert reports.sensors == ("adsb", "radar1")
    assert reports.plots.sensor.tolist() == [0, 1]
    assert reports.plots.address.tolist() == [0x3C6444, -1]
    assert reports.plots.range_m[1] == 5e4
    assert np.isnan(reports.plots.lat_deg[1])
    assert notes.bad == 0


def test_a_report_without_sensor_is_a_broken_line(tmp_path):
    reports, notes = read_reports(written(tmp_path / "reports.jsonl", [{"time_s": 1.0}]))

    assert (len(reports.plots), notes.bad) == (0, 1)
