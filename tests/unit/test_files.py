"""Report files: read in order, broken lines named, chunks without influence, bytes that repeat."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.wire_samples import NOW_S, SENSORS, adsb_report, decode, fused_points, good_reports, radar_report

from aeroskein.events import RegistrationState
from aeroskein.plots import Plots
from aeroskein.reasons import Reason
from aeroskein_service.codec import PointEncoder
from aeroskein_service.files import NAMED_LINES, ReportFile
from aeroskein_service.line_writers import FusedWriter, RegistrationWriter, ReportWriter

LINE = {"sensor": "adsb", "received_s": NOW_S + 0.4} | adsb_report()
RADAR_LINE = {"sensor": "radar1", "received_s": NOW_S + 1.5} | radar_report()


def write(path: Path, lines: list[Any]) -> Path:
    text = [line if isinstance(line, bytes) else json.dumps(line).encode() for line in lines]
    content = b"".join(line + b"\n" for line in text)
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def read(path: Path, **arguments: Any) -> tuple[Plots, np.ndarray, ReportFile]:
    file = ReportFile(path, SENSORS, **arguments)
    chunks = list(file.chunks())
    reasons = np.concatenate([chunk.reasons for chunk in chunks]) if chunks else np.zeros(0, dtype=np.uint8)
    return Plots.concatenate([chunk.plots for chunk in chunks]), reasons, file


# -- reading -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["reports.jsonl", "reports.jsonl.gz"])
def test_lines_become_reports_in_their_order(tmp_path, name):
    plots, reasons, file = read(write(tmp_path / name, [LINE, RADAR_LINE, LINE | {"address": "4CA2D6"}]))

    assert plots.sensor.tolist() == [0, 1, 0]
    assert plots.address.tolist() == [0x3C6444, -1, 0x4CA2D6]
    assert plots.received_s.tolist() == [NOW_S + 0.4, NOW_S + 1.5, NOW_S + 0.4]
    assert plots.range_m[1] == 80_000.0
    assert not reasons.any()
    assert (file.notes.lines, file.notes.broken) == (3, 0)


def test_arrival_that_is_absent_is_the_time_of_the_report(tmp_path):
    line = {name: value for name, value in LINE.items() if name != "received_s"}

    plots, _, _ = read(write(tmp_path / "r.jsonl", [line, LINE | {"received_s": None}]))

    assert plots.received_s.tolist() == [NOW_S, NOW_S]


def test_blank_lines_carriage_returns_and_a_byte_order_mark_do_no_harm(tmp_path):
    path = tmp_path / "r.jsonl"
    line = json.dumps(LINE).encode()
    path.write_bytes(b"\xef\xbb\xbf" + line + b"\r\n\r\n\n  \n" + line)

    plots, _, file = read(path)

    assert len(plots) == 2
    assert (file.notes.lines, file.notes.broken) == (2, 0)


def test_empty_file_has_no_reports(tmp_path):
    plots, _, file = read(write(tmp_path / "r.jsonl", []))

    assert len(plots) == 0
    assert file.notes.share_broken == 0.0


BROKEN = {
    b"not json": "is not JSON",
    b'{"sensor": "adsb", ': "is not JSON",
    b"\xff\xfe": "is not JSON",
    b"[" * 100_000: "is not JSON",
    b"17": "is no JSON object",
    b"[]": "is no JSON object",
    json.dumps({k: v for k, v in LINE.items() if k != "sensor"}).encode(): "names no sensor",
    json.dumps(LINE | {"sensor": 17}).encode(): "names no sensor",
    json.dumps(LINE | {"sensor": "radar9"}).encode(): "names sensor 'radar9', not configured",
    json.dumps(LINE | {"sensor": "radar9", "altitude_m": "x"}).encode(): "names sensor 'radar9', not configured",
}


@pytest.mark.parametrize("line", list(BROKEN), ids=lambda line: line[:20])
@pytest.mark.parametrize("beside", [LINE, LINE | {"altitude_m": "x"}], ids=["good", "wrong type"])
def test_broken_line_is_skipped_and_named_with_its_number(tmp_path, line, beside):
    plots, _, file = read(write(tmp_path / "r.jsonl", [LINE, b"", line, beside, LINE]))

    assert file.notes.named == [(3, BROKEN[line])]
    assert (file.notes.lines, file.notes.broken) == (4, 1)
    assert file.notes.share_broken == 0.25
    assert len(plots) == 3 - (beside is not LINE)


def test_line_numbers_go_on_over_chunks(tmp_path):
    lines: list[Any] = [LINE] * 30
    lines[17] = b"{"

    _, _, file = read(write(tmp_path / "r.jsonl", lines), chunk_bytes=1000)

    assert file.notes.named == [(18, "is not JSON")]


def test_only_the_first_broken_lines_are_named(tmp_path):
    _, _, file = read(write(tmp_path / "r.jsonl", [b"{"] * 25))

    assert file.notes.broken == 25
    assert [number for number, _ in file.notes.named] == list(range(1, NAMED_LINES + 1))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"altitude_m": "high"}, Reason.BAD_VALUE),
        ({"lat_deg": 91.0}, Reason.BAD_VALUE),
        ({"altitude_m": math.nan}, Reason.BAD_VALUE),
        ({"altitude_m": math.inf}, Reason.BAD_VALUE),
        ({"time_s": None}, Reason.BAD_VALUE),
        ({"received_s": "now"}, Reason.BAD_VALUE),
        ({"received_s": True}, Reason.BAD_VALUE),
        ({"received_s": math.nan}, Reason.BAD_VALUE),
        ({"received_s": -1.0}, Reason.BAD_VALUE),
        ({"received_s": 1.79e12}, Reason.BAD_VALUE),
        ({"address": "XYZ"}, Reason.BAD_ADDRESS),
        ({"address": 17}, Reason.BAD_ADDRESS),
        ({"lat_deg": None, "lon_deg": None}, Reason.NO_POSITION),
    ],
)
def test_wrong_report_is_rejected_and_its_line_is_not_broken(tmp_path, change, reason):
    plots, reasons, file = read(write(tmp_path / "r.jsonl", [LINE, LINE | change, RADAR_LINE]))

    assert file.notes.broken == 0
    assert file.notes.rejected[0, reason] == 1
    assert file.notes.rejected.sum() == 1
    assert (plots.take(reasons == 0)).sensor.tolist() == [0, 1]


@pytest.mark.parametrize("change", [{"received_s": 1.79e12}, {"received_s": -1.0}, {"received_s": math.nan}])
def test_impossible_arrival_does_not_move_the_clock(tmp_path, change):
    file = ReportFile(write(tmp_path / "r.jsonl", [LINE, LINE | change]), SENSORS)

    (chunk,) = file.chunks()

    assert np.isnan(chunk.arrival_s[1])


@pytest.mark.parametrize(("name", "value"), [("callsign", "TOOLONG99"), ("callsign", 7), ("mode_a", "9999")])
def test_bad_identity_is_dropped_and_counted_for_its_sensor(tmp_path, name, value):
    reason = Reason.BAD_CALLSIGN if name == "callsign" else Reason.BAD_MODE_A

    plots, reasons, file = read(write(tmp_path / "r.jsonl", [LINE, RADAR_LINE | {name: value}]))

    assert not reasons.any()
    assert file.notes.rejected[1, reason] == 1
    assert (plots.callsign[1], plots.mode_a[1]) == (b"", 0o1000 if name == "callsign" else -1)


@pytest.mark.parametrize("kept", [0.3, 0.7, 0.99])
def test_packed_file_that_was_cut_off_gives_what_is_there(tmp_path, kept):
    rng = np.random.default_rng(1)
    lines = [LINE | {"lat_deg": float(lat)} for lat in rng.uniform(-90, 90, 3000)]
    path = write(tmp_path / "r.jsonl.gz", lines)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * kept)])

    plots, _, file = read(path)

    assert file.notes.cut_off is not None
    assert 0.5 * kept * 3000 < len(plots) < 3000
    assert plots.lat_deg.tolist() == [line["lat_deg"] for line in lines[: len(plots)]]


def test_packed_file_that_is_damaged_gives_what_stands_before(tmp_path):
    rng = np.random.default_rng(1)
    path = write(tmp_path / "r.jsonl.gz", [LINE | {"lat_deg": float(lat)} for lat in rng.uniform(-90, 90, 30_000)])
    damaged = bytearray(path.read_bytes())
    damaged[-1000:-900] = bytes(100)
    path.write_bytes(damaged)

    plots, _, file = read(path)

    assert file.notes.cut_off is not None
    assert len(plots) > 10_000


def test_packed_files_may_be_joined(tmp_path):
    path = write(tmp_path / "r.jsonl.gz", [LINE, LINE])
    path.write_bytes(path.read_bytes() * 3)

    plots, _, file = read(path)

    assert len(plots) == 6
    assert file.notes.cut_off is None


def test_file_that_is_not_packed_though_it_says_so_is_cut_off_at_once(tmp_path):
    path = tmp_path / "r.jsonl.gz"
    path.write_bytes(json.dumps(LINE).encode())

    plots, _, file = read(path)

    assert len(plots) == 0
    assert file.notes.cut_off is not None


def test_missing_file_is_an_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        list(ReportFile(tmp_path / "nowhere", SENSORS).chunks())


def test_progress_ends_at_the_size_of_the_file(tmp_path):
    path = write(tmp_path / "r.jsonl", [LINE] * 100)
    seen: list[int] = []

    list(ReportFile(path, SENSORS, chunk_bytes=1000).chunks(seen.append))

    assert seen == sorted(seen)
    assert seen[-1] == path.stat().st_size


@given(
    kinds=st.lists(st.sampled_from(["good", "radar", "wrong", "broken", "blank"]), max_size=30),
    chunk_bytes=st.integers(1, 2000),
)
def test_size_of_the_chunks_changes_nothing(tmp_path_factory, kinds, chunk_bytes):
    lines = {"good": LINE, "radar": RADAR_LINE, "wrong": LINE | {"nac_p": "x"}, "broken": b"{", "blank": b""}
    path = write(tmp_path_factory.mktemp("files") / "r.jsonl", [lines[kind] for kind in kinds])

    small, small_reasons, small_file = read(path, chunk_bytes=chunk_bytes)
    large, large_reasons, large_file = read(path)

    np.testing.assert_array_equal(small.sensor, large.sensor)
    np.testing.assert_array_equal(small_reasons, large_reasons)
    assert small_file.notes.named == large_file.notes.named
    np.testing.assert_array_equal(small_file.notes.rejected, large_file.notes.rejected)
    assert len(large) == kinds.count("good") + kinds.count("radar")


# -- writing -------------------------------------------------------------------------------------------------------
@given(reports=st.lists(good_reports, min_size=1, max_size=5))
def test_reports_that_are_written_are_read_again(tmp_path_factory, reports):
    plots = decode({"version": 1, "epoch": 1, "seq": 1, "reports": reports}).plots
    plots.sensor[:] = np.arange(len(plots)) % len(SENSORS)
    plots.received_s[:] = NOW_S + np.arange(len(plots))
    path = tmp_path_factory.mktemp("files") / "r.jsonl"

    with ReportWriter(path, SENSORS) as writer:
        writer.plots(plots)
    again, reasons, _ = read(path)

    assert not reasons.any()
    for name in Plots.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(plots, name), err_msg=name)


def test_packed_file_has_the_same_bytes_under_any_name_at_any_time(tmp_path):
    for name in ("a.jsonl.gz", "b.jsonl.gz"):
        with FusedWriter(tmp_path / name, PointEncoder(SENSORS, 1, "json")) as writer:
            writer.points(fused_points(3), NOW_S)

    first, second = (tmp_path / "a.jsonl.gz").read_bytes(), (tmp_path / "b.jsonl.gz").read_bytes()
    assert first == second
    assert first[4:8] == b"\0\0\0\0"
    assert len(gzip.decompress(first).splitlines()) == 3


def test_fused_file_has_one_point_a_line(tmp_path):
    path = tmp_path / "f.jsonl"

    with FusedWriter(path, PointEncoder(SENSORS, 1, "json")) as writer:
        writer.points(fused_points(2), NOW_S)
        writer.points(fused_points(0), NOW_S)
        writer.points(fused_points(1), NOW_S + 1.0)

    points = [json.loads(line) for line in path.read_text().splitlines()]
    assert [point["published_s"] for point in points] == [NOW_S, NOW_S, NOW_S + 1.0]
    assert path.read_bytes().endswith(b"\n")


def test_registration_file_has_one_state_a_line_and_null_for_what_is_unknown(tmp_path):
    path = tmp_path / "g.jsonl"
    state = RegistrationState(
        "radar1", NOW_S, "converging", 80.0, 0.15, 0.3, math.nan, 3.0, 0.01, 0.02, math.inf, 120, 17
    )

    with RegistrationWriter(path) as writer:
        writer.states([state, state])

    first, second = (json.loads(line) for line in path.read_text().splitlines())
    assert first == second
    assert first == {
        "version": 1, "sensor": "radar1", "time_s": NOW_S, "state": "converging", "range_bias_m": 80.0,
        "azimuth_bias_deg": 0.15, "time_bias_s": 0.3, "range_gain": None, "range_bias_sigma_m": 3.0,
        "azimuth_bias_sigma_deg": 0.01, "time_bias_sigma_s": 0.02, "range_gain_sigma": None, "samples": 120,
        "aircraft": 17,
    }  # fmt: skip
