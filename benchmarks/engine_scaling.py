"""How the engine's cost grows: with the number of aircraft, and with the length of a run; and what a track takes.

    python -m benchmarks.engine_scaling [--quick] [--plots FOLDER]

Each size runs in a process of its own: the whole engine on seeded traffic, in batches as the service makes them.
Processor time is read after a warm-up. Memory of a track is what the process has more than before the first report,
without the 30 s log of reports, shared out over the tracks. Exit status 1 when a track takes more than it may, or when
the last minute of a run costs more than the first one.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
from benchmarks.bars import FOLDER, plot_bars
from benchmarks.engine_scene import REPORTS_PER_S, START_S, Traffic, settings

from aeroskein import report_log
from aeroskein.engine import FusionEngine

SIZES: Final = (100, 1_000, 5_000, 20_000, 40_000)
QUICK_SIZES: Final = (100, 1_000)
# Elements begin within twenty seconds.
WARM_S: Final = 22.0
MEASURED_S: Final = 6.0
# The log of elements is full after 84 s.
MEMORY_AIRCRAFT: Final = 5_000
MEMORY_S: Final = 100.0
MOST_BYTES: Final = 20_000.0
LONG_AIRCRAFT: Final = 100
MINUTES: Final = (1, 10, 60)
QUICK_MINUTES: Final = (1, 3)
# A later minute may cost this much more than the first: what a busy machine does.
MOST_GROWTH: Final = 1.3
# Reports that wait for a turn of a busy service, and the longest and shortest turn. [s]
BATCH: Final = 1_000.0
TURN_S: Final = (0.05, 1.0)


def turn_s(aircraft: int) -> float:
    """How much time a batch spans."""
    return float(np.clip(BATCH / (REPORTS_PER_S * aircraft), *TURN_S))


def resident_bytes() -> int:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def run(aircraft: int, seconds: float, marks_s: list[tuple[float, float]], log: bool) -> dict[str, Any]:
    """One engine; microseconds per report between each pair of marks, and bytes per track at the end."""
    if not log:
        report_log.KEEP_S = 0.0  # type: ignore[misc]
    traffic, engine = Traffic(aircraft), FusionEngine(settings(), epoch_ms=0)
    engine.receive(traffic.plots(0.0), now_s=START_S)
    gc.collect()
    empty, tick_s = resident_bytes(), turn_s(aircraft)
    spent_s, reports = np.zeros(len(marks_s)), np.zeros(len(marks_s))
    for now_s, plots in traffic.ticks(seconds, tick_s):
        started = time.process_time()
        engine.receive(plots, now_s=now_s)
        engine.advance(now_s=now_s)
        took_s = time.process_time() - started
        for k, (begin_s, end_s) in enumerate(marks_s):
            if begin_s <= now_s - START_S < end_s:
                spent_s[k] += took_s
                reports[k] += len(plots)
    del plots
    gc.collect()
    return {
        "us": (1e6 * spent_s / reports).tolist(),
        "bytes": (resident_bytes() - empty) / aircraft,
        "tracks": sum(engine.track_counts().values()),
    }


def in_a_process(*call: Any) -> dict[str, Any]:
    """The same in a process of its own, so that memory begins anew."""
    command = [sys.executable, "-m", "benchmarks.engine_scaling", "--call", json.dumps(call)]
    environ = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    out = subprocess.run(command, check=True, capture_output=True, text=True, env=environ).stdout
    found: dict[str, Any] = json.loads(out)
    return found


def main() -> int:
    """Print the tables; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.engine_scaling", description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--plots", type=Path, default=FOLDER)
    parser.add_argument("--call", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.call is not None:
        print(json.dumps(run(*json.loads(options.call))))
        return 0
    missed = []
    print(f"{'aircraft':>9s} {'reports/s':>10s} {'batch':>6s} {'us a report':>12s} {'share of a core':>16s}")
    costs = {}
    for n in QUICK_SIZES if options.quick else SIZES:
        found = in_a_process(n, WARM_S + MEASURED_S, [(WARM_S, WARM_S + MEASURED_S)], True)
        us, rate = found["us"][0], REPORTS_PER_S * n
        costs[f"{n:,}"] = us
        print(f"{n:9,d} {rate:10,.0f} {rate * turn_s(n):6.0f} {us:12.1f} {1e-4 * us * rate:15.1f}%", flush=True)
    minutes = QUICK_MINUTES if options.quick else MINUTES
    marks = [(60.0 * m - 30.0, 60.0 * m) for m in minutes]
    found = in_a_process(LONG_AIRCRAFT, 60.0 * minutes[-1], marks, True)
    print(f"{LONG_AIRCRAFT} aircraft, us a report: "
          + ", ".join(f"minute {m}: {us:.0f}" for m, us in zip(minutes, found["us"], strict=True)))  # fmt: skip
    if max(found["us"][1:]) > MOST_GROWTH * found["us"][0]:
        missed.append("cost grows with the length of a run")
    n, seconds = (1_000, 90.0) if options.quick else (MEMORY_AIRCRAFT, MEMORY_S)
    found = in_a_process(n, seconds, [(0.0, seconds)], False)
    print(f"memory, {found['tracks']:,} tracks with 20 elements each, without the report log: "
          f"{found['bytes'] / 1e3:.1f} kB a track")  # fmt: skip
    if found["bytes"] > MOST_BYTES:
        missed.append(f"a track takes {found['bytes']:.0f} bytes, at most {MOST_BYTES:.0f}")
    plot_bars(options.plots / "engine_scaling.png", "Processor time per report by number of aircraft", costs, "us")
    for what in missed:
        print(f"    MISSED: {what}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
