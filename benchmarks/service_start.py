"""Cold start: from the command ``aeroskein run`` to the first fused point, with sensors that send already.

    python -m benchmarks.service_start [--starts N]

The service runs as installed, with its page; the process is new every time, its files are in the page cache.
"""

from __future__ import annotations

import argparse
import json
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.goals import Row, judged
from benchmarks.load_processes import Processes, processes
from benchmarks.load_roles import PREFIX

from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.transport import open_session

STARTS = 5
AIRCRAFT = 100
MUST_S, AIM_S = 3.0, 1.5
WAIT_S = 20.0


def start_once(folder: Path, arrived: threading.Event) -> float:
    """One start, to the first point. [s]"""
    arrived.clear()
    command = [str(Path(sys.executable).with_name("aeroskein")), "run", "--config", str(folder / "load.toml")]
    began_s = time.monotonic()
    service = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        there = arrived.wait(WAIT_S)
        return time.monotonic() - began_s if there else float("nan")
    finally:
        service.send_signal(signal.SIGTERM)
        service.wait()


def starts(running: Processes, many: int) -> Sequence[float]:
    """Several starts beside one router and one feed. [s]"""
    running.start("router")
    time.sleep(1.0)
    running.start("generator", json.dumps([[AIRCRAFT, 0.0, 10.0 + many * (WAIT_S if many == 1 else 6.0)]]))
    arrived = threading.Event()
    with open_session(Link(connect=(running.link,))) as session:
        session.subscribe(Keys(PREFIX).fused("live", "*"), lambda *_: arrived.set())
        time.sleep(3.0)
        return [start_once(running.folder, arrived) for _ in range(many)]


def main() -> int:
    """Print the median and the worst; 1 where the goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=STARTS)
    args = parser.parse_args()
    with processes('[http]\nlisten = "127.0.0.1:0"\n') as running:
        took_s = starts(running, args.starts)
    rows = [
        Row("aeroskein run to the first fused point, median", statistics.median(took_s), "s", MUST_S, AIM_S),
        Row("the slowest", max(took_s), "s"),
    ]
    return judged(f"cold start, {args.starts} times, {AIRCRAFT} aircraft", rows)


if __name__ == "__main__":
    sys.exit(main())
