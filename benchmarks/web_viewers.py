"""Whether those who look hold up the fusion: its latency in one run, with ten viewers of the page and with none.

    python -m benchmarks.web_viewers [--aircraft N] [--seconds S]

The load of ``service_load`` with the page that ``run`` starts. Viewers come and go every few seconds, so that both
figures are of the same minutes; they take every picture, and one asks for an aircraft's elements once a second, as the
page does. The service has a processor of its own; page and viewers share the other with router, sensors and consumer.
What is judged is the fusion's own latency, from the arrival of a report in the service to the publication of its point;
the way there and on to the consumer is told beside it, for that waits for a processor that ten viewers keep busy.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import sys
import threading
import time
import urllib.request
from pathlib import Path

import numpy as np
from benchmarks.goals import Row, judged
from benchmarks.load_processes import Load, processors, run_load
from benchmarks.web_load import free_port, view

VIEWERS = 10
PHASE_S = 6.0  # viewers are there for so long, then away for so long
SETTLE_S = 1.0  # of a phase that counts for neither
WARM_UP_S = 14.0
# The page must not be felt: what is beyond this is more than two equal runs differ by on a shared machine.
RATIO_MUST, RATIO_AIM = 1.2, 1.05


class Crowd:
    """Viewers that come in every second phase."""

    def __init__(self, url: str) -> None:
        self._url = url
        self.there: list[tuple[float, float]] = []  # when they were there, since the beginning
        self.frames = 0
        self._thread: threading.Thread | None = None

    def during(self, elapsed_s: float, service: int) -> None:
        """Let them in when it is time."""
        for thread in threads_of_children(service):
            with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
                os.sched_setaffinity(thread, processors()[1])
        phase = int((elapsed_s - WARM_UP_S) // PHASE_S)
        if elapsed_s > WARM_UP_S and phase % 2 and not (self._thread and self._thread.is_alive()):
            left_s = (phase + 1) * PHASE_S + WARM_UP_S - elapsed_s
            if left_s > 2.0 * SETTLE_S:
                self.there.append((elapsed_s, elapsed_s + left_s))
                self._thread = threading.Thread(target=self._look, args=(left_s,), daemon=True)
                self._thread.start()

    def _look(self, seconds: float) -> None:
        asker = threading.Thread(target=self._ask, args=(time.monotonic() + seconds,), daemon=True)
        asker.start()
        self.frames += sum(asyncio.run(view(self._url, VIEWERS, seconds))["frames"])
        asker.join()

    def _ask(self, ends_s: float) -> None:
        while time.monotonic() < ends_s:
            with urllib.request.urlopen(f"{self._url}/api/search?q=10000", timeout=5.0) as answer:
                found = json.load(answer)
            for track in found["tracks"][:1]:
                with urllib.request.urlopen(f"{self._url}/api/elements/{track['track']}", timeout=5.0) as answer:
                    answer.read()
            time.sleep(1.0)


def threads_of_children(parent: int) -> list[int]:
    """All threads of the processes that a process has started: each has an affinity of its own."""
    lists = Path(f"/proc/{parent}/task").glob("*/children")
    children = [pid for children in lists for pid in children.read_text().split()]
    return [int(task.name) for pid in children for task in Path(f"/proc/{pid}/task").glob("*")]


def main() -> int:
    """Run and judge; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", type=int, default=4_000)
    parser.add_argument("--seconds", type=float, default=74.0, help="length of the traffic")
    args = parser.parse_args()
    http = f"127.0.0.1:{free_port()}"
    load = Load([(args.aircraft, 0.0, args.seconds)], warm_up_s=WARM_UP_S, more=f'[http]\nlisten = "{http}"\n')
    crowd = Crowd(f"http://{http}")
    seen = run_load(load, crowd.during)
    put_s = seen.live.put_s
    looked = np.zeros(len(put_s), dtype=bool)
    counts = (put_s > WARM_UP_S) & (put_s < args.seconds - 0.5)
    for begin_s, end_s in crowd.there:
        looked |= (put_s >= begin_s) & (put_s < end_s)
        for edge_s in (begin_s, end_s):
            counts &= (put_s < edge_s) | (put_s >= edge_s + SETTLE_S)
    rows = [Row("pictures taken by viewers", crowd.frames, must=10.0, better="higher")]
    for what, latency_s in (("fusion", seen.live.inside_s), ("put to receipt", seen.live.latency_s)):
        alone, beside = (np.percentile(latency_s[counts & who] * 1e3, (50, 99)) for who in (~looked, looked))
        for share, without, with_them in zip((50, 99), alone, beside, strict=True):
            rows.append(Row(f"{what}, {share} %, nobody looks", without, "ms"))
            rows.append(Row(f"{what}, {share} %, {VIEWERS} viewers", with_them, "ms"))
        limits = (RATIO_MUST, RATIO_AIM) if what == "fusion" else (None, None)
        rows.append(Row(f"{what}, 99 %, ratio", beside[1] / alone[1], "", *limits))
    rows.append(Row("service, share of a processor", seen.core["service"]))
    return judged(f"viewers beside the fusion of {args.aircraft} aircraft", rows)


if __name__ == "__main__":
    sys.exit(main())
