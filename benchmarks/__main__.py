"""All benchmarks one after the other, as ``make bench`` runs them: every claim about accuracy and speed, measured anew.

    python -m benchmarks [--quick] [NAME ...]

Each runs in a process of its own and prints its tables. Exit status 1 when one of them misses a goal.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]

# What each is called with, in full and for a quick look.
BENCHMARKS: Final[dict[str, tuple[list[str], list[str]]]] = {
    "accuracy": ([], ["--quick"]),
    "adsb_filter": (["--seed", "11"], ["--seed", "11", "--aircraft", "4", "--duration", "200"]),
    "registration": ([], ["--runs", "4"]),
    "association": ([], ["--repeats", "5"]),
    "integrity": ([], ["--runs", "4", "--hours", "10"]),
    "registration_engine": ([], ["--runs", "2", "--case", "many"]),
    "association_engine": ([], ["--seeds", "1", "--case", "plots"]),
    "integrity_engine": ([], ["--runs", "1", "--case", "ghosts"]),
    "bench_codec": ([], []),
    "engine_peers": ([], ["--few", "4"]),
    "engine_kernel": ([], ["--aircraft", "1000"]),
    "engine_scaling": ([], ["--quick"]),
    "service_load": ([], ["--quick"]),
    "service_overload": ([], ["--overload", "30000", "--seconds", "15"]),
    "service_start": ([], ["--starts", "3"]),
    "service_soak": ([], ["--aircraft", "100"]),
    "web_load": ([], ["--aircraft", "2000", "--seconds", "6"]),
    "web_viewers": ([], ["--aircraft", "400", "--seconds", "40"]),
    "fuse_file": ([], ["--minutes", "1"]),
}


def main(arguments: list[str] | None = None) -> int:
    """Run the chosen benchmarks; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__.partition("\n")[0])
    parser.add_argument("name", nargs="*", choices=[*BENCHMARKS, []], help="which; all without a name")
    parser.add_argument("--quick", action="store_true", help="small samples: goals may be missed by chance")
    options = parser.parse_args(arguments)
    failed = []
    for name in options.name or BENCHMARKS:
        full, quick = BENCHMARKS[name]
        print(f"== {name} " + "=" * (70 - len(name)), flush=True)
        began_s = time.monotonic()
        command = [sys.executable, "-m", f"benchmarks.{name}", *(quick if options.quick else full)]
        if subprocess.run(command, cwd=ROOT, check=False).returncode != 0:
            failed.append(name)
        print(f"== {time.monotonic() - began_s:.0f} s\n", flush=True)
    print(f"missed: {', '.join(failed)}" if failed else "all goals met")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
