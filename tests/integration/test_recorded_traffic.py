"""The whole job on recorded traffic: router, sensors, service and consumer, over real ADS-B where it is installed."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest
from tests.integration.harness import Process, wait_until

from aeroskein_service.recording import NoRecordingError, find_recording

LINE = re.compile(r"^(\d+) tracks, (\d+) live points, (\d+) element points, (\d+) missing; (.*)$", re.MULTILINE)


def shown(demo: Process) -> tuple[int, int, int, int, str]:
    """The last line of a demo in a pipe: tracks, live points, element points, missing ones, and the radars."""
    lines = LINE.findall(demo.out)
    if not lines:
        return 0, 0, 0, 0, ""
    tracks, live, element, missing, radars = lines[-1]
    return int(tracks), int(live), int(element), int(missing), radars


@pytest.mark.real_data
@pytest.mark.slow
def test_recorded_flights_are_fused_with_simulated_radars(tmp_path: Path) -> None:
    try:
        find_recording()
    except NoRecordingError as missing:
        pytest.skip(str(missing))

    with Process(tmp_path, "demo", "--real") as demo:
        wait_until(
            lambda: shown(demo)[2] >= 20 or demo.popen.poll() is not None, "elements of recorded flights", limit_s=90.0
        )
        demo.signal(signal.SIGINT)
        status = demo.wait()

    tracks, live, element, missing, radars = shown(demo)
    assert status == 0, demo.err
    assert "ADS-B is recorded, the radars are simulated from it" in demo.out
    assert tracks >= 5
    assert live > element >= 20
    assert missing == 0
    assert "radar1 conver" in radars
    assert "radar2 conver" in radars
