"""What the README shows works: its sensor and its consumer over Zenoh, and its commands on files."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tests.integration.harness import running, wait_until, write_config

from aeroskein_service.config import load_config

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAM = Path(sys.executable).with_name("aeroskein")
ENDPOINT = "tcp/127.0.0.1:7447"


def block(language: str, holds: str) -> str:
    """The one block of the README in this language that holds these words."""
    blocks = [b for b in re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL) if holds in b]
    assert len(blocks) == 1
    return blocks[0]


@contextmanager
def program(code: str, endpoint: str, output: Path) -> Iterator[None]:
    """A Python program of the README as a process, at another router."""
    assert ENDPOINT in code
    with output.open("w") as out:
        process = subprocess.Popen([sys.executable, "-c", code.replace(ENDPOINT, endpoint)], stdout=out, stderr=out)
    try:
        yield
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()


def test_the_readmes_consumer_sees_what_the_readmes_sensor_flies(endpoint: str, tmp_path: Path) -> None:
    config = load_config(write_config(tmp_path, endpoint, "atc/v1"), environ={})
    seen, said = tmp_path / "consumer", tmp_path / "sensor"

    with (
        running(config),
        program(block("python", "declare_subscriber"), endpoint, seen),
        program(block("python", "session.put"), endpoint, said),
    ):
        line = wait_until(
            lambda: next((line for line in seen.read_text().splitlines() if "confirmed" in line), None),
            f"a confirmed point; the sensor said {said.read_text()!r}",
        )

    track, status, lat_deg, lon_deg, *sources = line.split()
    assert (track, status) == ("3C6444", "confirmed")
    assert float(lat_deg) == pytest.approx(48.005, abs=0.05)
    assert float(lon_deg) == pytest.approx(11.5, abs=0.001)
    assert "'adsb':" in sources[0]


@pytest.mark.timeout(300)
def test_the_readmes_commands_on_files_work_one_after_the_other(tmp_path: Path) -> None:
    commands = block("sh", "aeroskein simulate").splitlines()
    environ = {name: value for name, value in os.environ.items() if not name.startswith("AEROSKEIN_")}

    for command in commands:
        words = shlex.split(command.replace("deploy/", f"{ROOT}/deploy/"))
        done = subprocess.run(
            [PROGRAM, *words[1:]], cwd=tmp_path, env=environ, capture_output=True, text=True, check=False, timeout=200
        )
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        assert done.stderr.count("\n") <= 12, done.stderr

    made = {path.name for path in tmp_path.iterdir()}
    assert made == {
        "reports.jsonl", "reports.truth.jsonl", "fused.jsonl", "circle.jsonl", "page.html", "filtered.jsonl",
    }  # fmt: skip
    products = [json.loads(line)["product"] for line in (tmp_path / "circle.jsonl").read_text().splitlines()]
    assert products
    assert set(products) == {"element"}
