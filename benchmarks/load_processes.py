"""A service under load in processes of its own, as in an installation, and what they left, joined and summed up.

The service has one processor for itself, everything else - router, generator, consumers - shares the others, so that
what is measured is the service.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from benchmarks.load_traffic import sensors_toml

__all__ = ["NO_PAGE", "Fleets", "Latencies", "Load", "Processes", "Seen", "processes", "rss_mb", "run_load", "used_s"]

TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK")
START_S: Final = 3.0
# The page is a process of its own that takes no part.
NO_PAGE: Final = '[http]\nlisten = ""\n'
STOP_S: Final = 30.0

Fleets = Sequence[tuple[int, float, float]]
"""Aircraft, begin and end of each fleet. [s since the beginning]"""


@dataclass(frozen=True, slots=True)
class Load:
    """What is measured: traffic, when the steady state begins and ends, and more configuration as TOML."""

    fleets: Fleets
    warm_up_s: float = 14.0
    ends_s: float | None = None
    keys: bool = False
    more: str = NO_PAGE

    @property
    def seconds(self) -> float:
        """Length of the traffic."""
        return max(end_s for _, _, end_s in self.fleets)

    @property
    def steady_end_s(self) -> float:
        """When the steady state ends; at the end of the traffic where nothing is said."""
        return self.seconds - 0.5 if self.ends_s is None else self.ends_s


@dataclass(slots=True)
class Latencies:
    """Live points by the put of the report they are from. [s]"""

    put_s: np.ndarray
    """Put of the report, since the beginning."""
    latency_s: np.ndarray
    """From that put to the consumer's receipt."""
    inside_s: np.ndarray
    """Of it, from the report's arrival in the service to the publication."""

    def percentiles_ms(self, from_s: float, to_s: float, *levels: float) -> list[float]:
        """Percentiles of the points whose reports were put in a time. [ms]"""
        chosen = self.latency_s[(self.put_s >= from_s) & (self.put_s < to_s)]
        if not len(chosen):
            return [float("nan")] * len(levels)
        return [float(v) * 1e3 for v in np.percentile(chosen, levels)]


@dataclass(slots=True)
class Seen:
    """What came out of one run."""

    live: Latencies
    points: dict[str, dict[str, Any]]
    """By consumer and product: points, tracks, holes, points that went back, coasted ones."""
    core: dict[str, float]
    """Share of a processor of each process between warm-up and end."""
    rss_mb: dict[str, float]
    sent: int
    rate: float
    """Reports a second between warm-up and end."""
    worst_tick_ms: float
    began_s: float
    exit: int
    statuses: list[dict[str, Any]] = field(default_factory=list)


def used_s(pid: int) -> float:
    """Processor time of a process so far. [s]"""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def rss_mb(pid: int) -> float:
    """Memory of a process. [MB]"""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024.0
    return 0.0


def free_endpoint() -> str:
    """A Zenoh endpoint that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def processors() -> tuple[set[int], set[int]]:
    """The service's processor, and those of everything else."""
    allowed = sorted(os.sched_getaffinity(0))
    return {allowed[0]}, set(allowed[1:]) or {allowed[0]}


class Processes:
    """The roles of ``load_roles``, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.link = free_endpoint()
        self.running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, role: str, *arguments: str) -> None:
        """Start one; the service on its processor, others beside it."""
        mine, others = processors()
        command = [sys.executable, "-m", "benchmarks.load_roles", role, self.link, str(self.folder), *arguments]
        log = (self.folder / f"{role}.log").open("wb")
        process = subprocess.Popen(command, stdout=log, stderr=log)
        log.close()
        os.sched_setaffinity(process.pid, mine if role == "service" else others)
        self.running[role] = process

    def stop(self, role: str) -> int:
        """End one, which then leaves what it saw."""
        process = self.running.pop(role)
        process.send_signal(signal.SIGTERM)
        return process.wait(STOP_S)

    def kill(self) -> None:
        """End what is left."""
        for process in self.running.values():
            process.kill()
            process.wait()


@contextmanager
def processes(more: str) -> Iterator[Processes]:
    """A folder with the service's configuration, and processes that end with the block."""
    with tempfile.TemporaryDirectory() as name:
        made = Processes(Path(name))
        zenoh = f'[zenoh]\nprefix = "load/v1"\nconnect = ["{made.link}"]\n[log]\nlevel = "warning"\n'
        (made.folder / "load.toml").write_text(f"{sensors_toml()}{zenoh}{more}\n")
        try:
            yield made
        finally:
            made.kill()


def run_load(load: Load, during: Callable[[float, int], None] | None = None) -> Seen:
    """Run everything and collect; ``during`` is called now and then with the elapsed time and the service's pid."""
    consumers = ["feed", "keys"] if load.keys else ["feed"]
    with processes(load.more) as running:
        for role in ("router", "service", *consumers, "status"):
            running.start(role)
        time.sleep(START_S)
        running.start("generator", json.dumps([list(fleet) for fleet in load.fleets]))
        # The generator says so when it begins.
        began = running.folder / "began"
        while not began.exists():
            time.sleep(0.05)
        began_s = float(began.read_text())
        pids = {role: process.pid for role, process in running.running.items()}
        _wait_until(began_s + load.warm_up_s, during, began_s, pids["service"])
        before, before_s = {role: used_s(pid) for role, pid in pids.items()}, time.monotonic()
        _wait_until(began_s + load.steady_end_s, during, began_s, pids["service"])
        elapsed_s = time.monotonic() - before_s
        core = {role: (used_s(pid) - before[role]) / elapsed_s for role, pid in pids.items()}
        memory = {role: rss_mb(pid) for role, pid in pids.items()}
        generator = running.running.pop("generator")
        generator.wait(load.seconds + STOP_S)
        status = running.stop("service")
        time.sleep(1.0)
        for role in (*consumers, "status"):
            running.stop(role)
        return _collect(running.folder, load, consumers, core, memory, status)


def _wait_until(end_s: float, during: Callable[[float, int], None] | None, began_s: float, pid: int) -> None:
    while (left_s := end_s - time.time()) > 0.0:
        time.sleep(min(left_s, 0.5))
        if during is not None:
            during(time.time() - began_s, pid)


def _collect(
    folder: Path, load: Load, consumers: list[str], core: dict[str, float], memory: dict[str, float], status: int
) -> Seen:
    sent = np.load(folder / "sent.npz")
    began_s = float(sent["began_s"])
    put_s = sent["put_s"] - began_s
    points = {}
    for consumer in consumers:
        for product in ("live", "element"):
            seen = np.load(folder / f"{consumer}-{product}.npz")
            totals = {name: int(seen[name]) for name in ("tracks", "holes", "backwards", "coasted")}
            points[f"{consumer} {product}"] = totals | {"points": len(seen["time_s"]) + totals["coasted"]}
    steady = (put_s >= load.warm_up_s) & (put_s < load.steady_end_s)
    lines = (folder / "status.json").read_bytes().splitlines()
    return Seen(
        live=_joined(sent, np.load(folder / "feed-live.npz"), began_s),
        points=points,
        core=core,
        rss_mb=memory,
        sent=len(put_s),
        rate=float(steady.sum()) / (load.steady_end_s - load.warm_up_s),
        worst_tick_ms=float(sent["worst_tick_s"]) * 1e3,
        began_s=began_s,
        exit=status,
        statuses=[json.loads(line) for line in lines],
    )


def _joined(sent: Any, seen: Any, began_s: float) -> Latencies:
    """Live points and the reports they are from: those with the same address and stamp."""
    pair = np.dtype([("address", "<i8"), ("time_s", "<f8")])

    def pairs(columns: Any) -> np.ndarray:
        made = np.empty(len(columns["address"]), dtype=pair)
        made["address"], made["time_s"] = columns["address"], columns["time_s"]
        return made

    reports, points = pairs(sent), pairs(seen)
    order = np.argsort(reports)
    place = np.minimum(np.searchsorted(reports[order], points), len(order) - 1)
    found = order[place]
    same = reports[found] == points
    put_s = sent["put_s"][found[same]]
    return Latencies(put_s - began_s, seen["received_s"][same] - put_s, seen["inside_s"][same])
