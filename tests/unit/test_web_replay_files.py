"""Files that the page replays: fused files as they are, report files through the engine."""

from __future__ import annotations

import asyncio
import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from tests.web_samples import NOW_S, tracks
from tests.wire_samples import SENSORS

from aeroskein.points import Product
from aeroskein_service.codec import PointEncoder
from aeroskein_service.config import load_config
from aeroskein_service.web.replay_files import ReplayError, open_replay
from aeroskein_service.web.requests import Play, Seek
from aeroskein_service.web.source import UnknownTrackError

TOML = '[[sensors]]\nid = "adsb"\nkind = "adsb"\n[fusion]\nelement_s = 2.0\nlookahead = 0\nwatermark_s = 0.5\n'


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "config.toml"
    path.write_text(TOML)
    return load_config(path, environ={})


def fused_file(path: Path, seconds: int = 20, *more: bytes) -> Path:
    """Two tracks that fly north by a thousandth of a degree a second; live points every second, elements every four."""
    encoder, lines = PointEncoder(SENSORS, 1000, "json"), list[bytes]()
    for second in range(seconds):
        lat = np.array([48.0, 49.0]) + 0.001 * second
        time_s = np.full(2, NOW_S + second)
        lines += encoder.encode(tracks(2, time_s=time_s, lat_deg=lat, seq=[second] * 2), NOW_S + second + 0.5)
        if second % 4 == 3:
            span_s = np.tile([NOW_S + second - 3.0, NOW_S + second + 1.0], (2, 1))
            points = tracks(2, Product.ELEMENT, time_s=time_s, lat_deg=lat, span_s=span_s, element=[second // 4] * 2)
            lines += encoder.encode(points, NOW_S + second + 2.0)
    content = b"\n".join([*lines, *more]) + b"\n"
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def report_file(path: Path, seconds: int = 40) -> Path:
    """ADS-B reports of one aircraft that flies north at 200 m/s, once a second."""
    lines = [
        {"sensor": "adsb", "received_s": NOW_S + t + 0.3, "time_s": NOW_S + t, "address": "3C6444",
         "callsign": "DLH4AB", "lat_deg": 48.0 + 200.0 * t / 111_200.0, "lon_deg": 11.0,
         "altitude_m": 10_000.0, "height_m": 10_050.0,
         "ground_speed_mps": 200.0, "track_angle_deg": 0.0, "nac_p": 9, "nac_v": 2}
        for t in range(seconds)
    ]  # fmt: skip
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


@pytest.mark.parametrize("name", ["fused.jsonl", "fused.jsonl.gz"])
def test_fused_file_shows_where_everybody_was_at_any_instant(tmp_path, config, name):
    source = open_replay(fused_file(tmp_path / name), config)
    assert (source.describe()["begin_s"], source.describe()["end_s"]) == (NOW_S, NOW_S + 19.0)
    for second in (0.0, 7.4, 19.0):
        shown = source.picture.at(NOW_S + second)
        assert shown["lat"] * 1e-7 == pytest.approx([48.0 + 0.001 * int(second), 49.0 + 0.001 * int(second)], abs=1e-6)


def test_elements_of_a_fused_file_are_those_published_until_then(tmp_path, config):
    source = open_replay(fused_file(tmp_path / "fused.jsonl"), config)
    answer = asyncio.run(source.elements("400000", NOW_S + 9.5))
    assert [element["element"] for element in answer["elements"]] == [0, 1]
    assert answer["elements"][1]["span_s"] == [NOW_S + 4.0, NOW_S + 8.0]
    assert answer["elements"][1]["point"]["lat_deg"] == pytest.approx(48.007)


def test_broken_lines_of_a_fused_file_are_left_out(tmp_path, config, capsys):
    path = fused_file(tmp_path / "fused.jsonl", 20, b"{", b'{"track_number": 1}')
    source = open_replay(path, config)
    assert len(source.picture.at(NOW_S + 3.0)) == 2
    assert "2 broken lines" in capsys.readouterr().err


def test_report_file_is_fused_and_keeps_every_element_with_its_reports(tmp_path, config):
    source = open_replay(report_file(tmp_path / "reports.jsonl"), config)
    point = source.track("3C6444", NOW_S + 20.0)["point"]
    assert point["callsign"] == "DLH4AB"
    assert point["ground_speed_mps"] == pytest.approx(200.0, abs=3.0)
    for at, newest in ((10.0, 8.0), (35.0, 33.0)):
        elements = asyncio.run(source.elements("3C6444", NOW_S + at))["elements"]
        assert elements[-1]["span_s"][1] - NOW_S == pytest.approx(newest, abs=2.0)
        assert [report["accepted"] for report in elements[-1]["reports"]] == [True, True]
        assert len(elements[-1]["boundary_lines"]) == 2
        assert elements[-1]["point"]["sources"] == {"adsb": 2}


def test_search_in_a_replay_is_about_the_instant(tmp_path, config):
    source = open_replay(report_file(tmp_path / "reports.jsonl"), config)
    assert [track["track"] for track in source.search("dlh", 5, NOW_S + 5.0)] == ["3C6444"]
    assert source.search("nobody", 5, NOW_S + 5.0) == []


def test_unknown_track_is_a_sentence(tmp_path, config):
    source = open_replay(fused_file(tmp_path / "fused.jsonl"), config)
    with pytest.raises(UnknownTrackError, match="there is no track 123456 in the file"):
        source.track("123456", NOW_S)


@pytest.mark.parametrize("content", ["", "\n\n", '{"a": 1}\n', "not json\n", "[1]\n"])
def test_file_of_another_kind_is_one_sentence(tmp_path, config, content):
    path = tmp_path / "other.jsonl"
    path.write_text(content)
    with pytest.raises(ReplayError, match="is neither a fused file nor a report file"):
        open_replay(path, config)


def test_report_file_without_sensors_is_one_sentence(tmp_path):
    with pytest.raises(ReplayError, match="its sensors are needed"):
        open_replay(report_file(tmp_path / "reports.jsonl"), load_config(None, environ={}, sensors_required=False))


def test_report_file_with_nothing_in_it_is_one_sentence(tmp_path, config):
    path = tmp_path / "reports.jsonl"
    path.write_text('{"sensor": "adsb", "time_s": 1.0}\n')
    with pytest.raises(ReplayError, match="nothing in it can be shown"):
        open_replay(path, config)


def test_each_viewer_has_a_clock_of_their_own(tmp_path, config):
    source = open_replay(fused_file(tmp_path / "fused.jsonl"), config)

    async def look() -> tuple[float, float, bool, float]:
        first, second, wanted = source.stream(), source.stream(), asyncio.Event()
        first.control(Play(on=False))
        first.control(Seek(time_s=NOW_S + 12.0))
        second.control(Seek(time_s=NOW_S + 1e6))
        one, two = await first.next(wanted), await second.next(wanted)
        # Playing on from the end begins again
        second.control(Play(on=True, speed=1.0))
        again = await second.next(asyncio.Event())
        return one.head.time_s - NOW_S, two.head.time_s - NOW_S, two.head.playing, again.head.time_s - NOW_S

    one, two, playing, again = asyncio.run(look())
    assert (one, two, playing) == (12.0, 19.0, False)
    assert again < 5.0
