"""Recordings over real Zenoh: what was sent and published is in the file, is sent again, and survives a cut."""

from __future__ import annotations

import gzip
import json
import time
from itertools import pairwise
from pathlib import Path

import pytest
from tests.integration.harness import (
    ADDRESSES,
    Listener,
    Process,
    Sensor,
    flight,
    make_config,
    running,
    wait_until,
    write_config,
)

from aeroskein_service.commands import export, recover


def lines_of(path: Path) -> list[dict]:
    content = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    return [json.loads(line) for line in content.splitlines()]


@pytest.mark.parametrize("name", ["tape.jsonl", "tape.jsonl.gz"])
def test_a_recording_has_what_was_sent_and_what_was_published(tmp_path, endpoint, session, keys, name):
    # Given a service and a recorder
    tape, sent = tmp_path / name, flight(ADDRESSES[0], time.time())
    live = Listener(session, keys.feed("live"), recovering=True)
    with (
        running(make_config(tmp_path, endpoint, keys.prefix)),
        Process(tmp_path, "record", "--config", tmp_path / "config.toml", "--output", tape) as recorder,
    ):
        recorder.wait_for_err("recording")
        # When a flight is reported
        sensor = Sensor(session, keys)
        sensor.send(sent)
        sensor.put(b"no batch")
        live.wait_for(lambda messages: sum(len(m["points"]) for m in messages) > 0, "live points")
        wait_until(lambda: tape.stat().st_size > 0, "the recording")
        assert recorder.stop() == 0
    # Then all of it is in the file
    lines = lines_of(tape)
    reports = [line for line in lines if "product" not in line]
    assert [{k: v for k, v in r.items() if k not in ("sensor", "received_s")} for r in reports] == sent
    assert {r["sensor"] for r in reports} == {"adsb"}
    seen = [point for message in live.messages for point in message["points"]]
    recorded = [line for line in lines if line.get("product") == "live"]
    assert [point["seq"] for point in recorded][: len(seen)] == [point["seq"] for point in seen][: len(recorded)]
    assert "12 reports" in recorder.err
    assert "1 messages that could not be read" in recorder.err


def test_a_recording_ends_after_its_duration(tmp_path, endpoint, keys):
    config = write_config(tmp_path, endpoint, keys.prefix)
    with Process(tmp_path, "record", "--config", config, "--output", tmp_path / "t", "--duration", "0.3") as recorder:
        assert recorder.wait() == 0
        assert "0 reports and 0 fused points" in recorder.err


def test_reports_are_sent_again_as_old_as_they_were_and_fused_points_are_not(tmp_path, endpoint, session, keys):
    # Given a recording of last year in which reports arrived 0.4 s after their stamps
    began_s = time.time() - 3.0e7
    sent = flight(ADDRESSES[1], began_s + 12.0)
    rows = [
        {"sensor": "adsb" if i % 2 else "radar1", "received_s": r["time_s"] + 0.4} | r for i, r in enumerate(sent[:5])
    ]
    rows.insert(2, {"version": 1, "product": "live", "track": ADDRESSES[1], "time_s": began_s})
    tape = tmp_path / "tape.jsonl"
    tape.write_text("".join(json.dumps(row) + "\n" for row in rows))
    heard = Listener(session, f"{keys.prefix}/reports/**")
    # When it is replayed
    before_s = time.time()
    with Process(tmp_path, "replay", "--config", write_config(tmp_path, endpoint, keys.prefix), tape) as replay:
        assert replay.wait() == 0
        assert "put 5 reports in 5 batches" in replay.err
    heard.wait_for(lambda messages: len(messages) == 5, "all batches")
    # Then every sensor sends its own, with stamps as old as they were and as far apart
    reports = [report for message in heard.messages for report in message["reports"]]
    assert [message["sensor"] for message in heard.messages] == ["radar1", "adsb", "radar1", "adsb", "radar1"]
    assert [r["lat_deg"] for r in reports] == [r["lat_deg"] for r in sent[:5]]
    steps = [b["time_s"] - a["time_s"] for a, b in pairwise(reports)]
    assert steps == pytest.approx([b["time_s"] - a["time_s"] for a, b in pairwise(sent[:5])], abs=1e-5)
    ages = [at - report["time_s"] for at, report in zip(heard.received_s, reports, strict=True)]
    assert all(age >= 0.4 for age in ages)
    assert reports[0]["time_s"] > before_s - 0.4


def test_a_replay_of_nothing_says_so(tmp_path, endpoint, keys):
    tape = tmp_path / "tape.jsonl"
    tape.write_text('{"product": "live"}\n')
    with Process(tmp_path, "replay", "--config", write_config(tmp_path, endpoint, keys.prefix), tape) as replay:
        assert replay.wait() == 1
        assert "put 0 reports" in replay.err


# -- files -----------------------------------------------------------------------------------------------------------
ROWS = [
    b'{"sensor":"adsb","time_s":1.0}',
    b'{"product":"live","seq":0}',
    b'{"sensor":"radar1","time_s":2.0,"note":"kept as it is"}',
    b'{"product":"element","seq":0}',
]


@pytest.mark.parametrize(("what", "rows"), [("reports", (0, 2)), ("fused", (1, 3))])
def test_an_export_has_the_lines_of_its_kind_byte_by_byte(tmp_path, what, rows):
    tape, out = tmp_path / "tape.jsonl.gz", tmp_path / "out.jsonl"
    tape.write_bytes(gzip.compress(b"\n".join(ROWS) + b"\n"))

    assert export.run(file=tape, output=out, what=what) == 0

    assert out.read_bytes().splitlines() == [ROWS[row] for row in rows]


def test_an_export_of_nothing_fails(tmp_path):
    tape = tmp_path / "tape.jsonl"
    tape.write_bytes(ROWS[0] + b"\n")

    assert export.run(file=tape, output=tmp_path / "out", what="fused") == 1


@pytest.mark.parametrize("packed", [False, True])
def test_every_whole_line_of_a_recording_that_was_cut_off_is_saved(tmp_path, capsys, packed):
    many = [b'{"sensor":"adsb","time_s":%d.5,"address":"%06X"}' % (n, n * 7919) for n in range(20_000)]
    content = b"\n".join(many) + b"\n"
    tape, out = tmp_path / ("tape.jsonl.gz" if packed else "tape.jsonl"), tmp_path / "out.jsonl"
    whole = gzip.compress(content, mtime=0) if packed else content
    tape.write_bytes(whole[: len(whole) * 2 // 3])

    assert recover.run(file=tape, output=out) == 0

    saved = out.read_bytes().splitlines()
    assert saved == many[: len(saved)]
    assert len(saved) > 10_000
    assert "ends early" in capsys.readouterr().err
    assert export.run(file=tape, output=tmp_path / "again.jsonl") == 1


def test_damaged_lines_are_left_out_and_counted(tmp_path, capsys):
    tape, out = tmp_path / "tape.jsonl", tmp_path / "out.jsonl"
    tape.write_bytes(b"\n".join([ROWS[0], b"\x00garbage", b'{"neither": 1}', b"", ROWS[1]]) + b"\n")

    assert recover.run(file=tape, output=out) == 0

    assert out.read_bytes().splitlines() == [ROWS[0], ROWS[1]]
    assert "2 lines, 2 left out" in capsys.readouterr().err


def test_nothing_to_recover_fails(tmp_path):
    tape = tmp_path / "tape.jsonl.gz"
    tape.write_bytes(b"")

    assert recover.run(file=tape, output=tmp_path / "out") == 1
