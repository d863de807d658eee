"""`aeroskein fuse` over a long file: how long an hour of 1,000 aircraft takes, and how much memory, printed.

    python -m benchmarks.fuse_file [--aircraft N] [--minutes M] [--folder F]

ADS-B at 1 Hz, radars every 4 s and 8 s: 4.9 million reports an hour. The file is made first and does not count. The
memory is the largest the process had; that it does not grow with the file shows by comparing lengths. Processor time
is what counts on a machine with other work; both are given for an hour where fewer minutes were run.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec
from benchmarks.goals import Row, judged
from benchmarks.load_traffic import PERIODS_S, Fleet, SensorTraffic, sensors_toml

AIRCRAFT, MINUTES = 1_000, 10.0
START_S = 1_790_000_000.0
STEP_S = 0.25
DELAY_S = 0.3
MUST_MIN, AIM_MIN = 15.0, 8.0
MEMORY_MUST_MB = 500.0


def write_reports(path: Path, aircraft: int, seconds: float) -> int:
    """A report file in order of arrival; returns its lines."""
    fleet = Fleet(aircraft)
    traffic = {sensor: SensorTraffic(fleet, sensor, START_S) for sensor in PERIODS_S}
    decode, encode, lines = msgspec.msgpack.Decoder().decode, msgspec.json.Encoder(), 0
    with path.open("wb") as file:
        for step in range(1, int(seconds / STEP_S) + 1):
            for sensor, own in traffic.items():
                for batch in own.batches(step * STEP_S):
                    rows = decode(batch.payload)["reports"]
                    for row in rows:
                        row["sensor"], row["received_s"] = sensor, START_S + step * STEP_S + DELAY_S
                    file.write(encode.encode_lines(rows))
                    lines += len(rows)
    return lines


def fuse(folder: Path) -> tuple[float, float, float]:
    """Run the command; wall time, processor time [s] and most memory [MB]."""
    program = str(Path(sys.executable).with_name("aeroskein"))
    (folder / "load.toml").write_text(sensors_toml())
    command = [program, "fuse", "--config", str(folder / "load.toml"), str(folder / "reports.jsonl")]
    began_s = time.monotonic()
    process = subprocess.Popen([*command, "--output", str(folder / "fused.jsonl")], stderr=subprocess.PIPE)
    assert process.stderr is not None
    said = process.stderr.read().decode()
    _, status, used = os.wait4(process.pid, 0)
    took_s = time.monotonic() - began_s
    print("".join(f"  {line}\n" for line in said.splitlines()), end="")
    if status != 0 or "\r" in said:
        raise SystemExit("fuse failed, or showed progress in a pipe")
    return took_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0


def main() -> int:
    """Make the file, fuse it; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", type=int, default=AIRCRAFT)
    parser.add_argument("--minutes", type=float, default=MINUTES)
    parser.add_argument("--folder", type=Path, help="where the files go, which then stay")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = args.folder or Path(name)
        lines = write_reports(folder / "reports.jsonl", args.aircraft, args.minutes * 60.0)
        took_s, used_s, memory_mb = fuse(folder)
        written_mb = (folder / "fused.jsonl").stat().st_size / 1e6
    hour = 60.0 / args.minutes / 60.0
    rows = [
        Row("reports", lines),
        Row("fused file", written_mb, "MB"),
        Row("an hour takes, processor time", used_s * hour, "min", MUST_MIN, AIM_MIN),
        Row("an hour takes, on the clock", took_s * hour, "min"),
        Row("a report takes, processor time", used_s / lines * 1e6, "us"),
        Row("faster than real time", args.minutes * 60.0 / took_s, "times"),
        Row("most memory", memory_mb, "MB", MEMORY_MUST_MB),
    ]
    return judged(f"aeroskein fuse, {args.aircraft} aircraft, {args.minutes:g} minutes", rows)


if __name__ == "__main__":
    sys.exit(main())
