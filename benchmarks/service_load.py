"""The live service under load: latency, processor time, memory and losses with a given number of aircraft, printed.

    .venv/bin/python benchmarks/service_load.py --aircraft 4000 --seconds 30

Five processes, as in an installation: a router, a generator (ADS-B at 1 Hz, radars at 4 s and 8 s, batches of 50
reports), the service, and one or two consumers - one of the feed, which recovers losses, and with ``--keys`` one of the
keys per track, which does not. Latency is from the arrival of the newest report used to the receipt of its live point.
Processor time is read from /proc after a warm-up; all processes share the machine, so on few cores latency is
pessimistic.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, TextIO

import msgspec
import numpy as np

from aeroskein.geodesy import frame_rows
from aeroskein.plots import Plots
from aeroskein.radar_geometry import geodetic_to_radar
from aeroskein_service.codec import encode_batch
from aeroskein_service.commands import router, run
from aeroskein_service.config import load_config
from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.transport import SensorPublisher, open_session

PREFIX = "load/v1"
SITES = {"radar1": (48.35, 11.78, 460.0), "radar2": (48.9, 12.9, 600.0)}
PERIODS_S = {"adsb": 1.0, "radar1": 4.0, "radar2": 8.0}
BATCH = 50
TICK_S = 0.02
APPEAR_S = 8.0
WARM_UP_S = 14.0
SPREAD_M = 300_000.0
M_PER_DEG = 111_320.0
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


def write_config(folder: Path, endpoint: str, more: str) -> Path:
    """Three sensors, defaults elsewhere."""
    text = '[[sensors]]\nid = "adsb"\nkind = "adsb"\n'
    for sensor, (lat, lon, height) in SITES.items():
        text += f'[[sensors]]\nid = "{sensor}"\nkind = "ssr"\nperiod_s = {PERIODS_S[sensor]}\n'
        text += f"lat_deg = {lat}\nlon_deg = {lon}\nheight_m = {height}\n"
    text += f'[zenoh]\nprefix = "{PREFIX}"\nconnect = ["{endpoint}"]\n[http]\nlisten = ""\n{more}\n'
    path = folder / "load.toml"
    path.write_text(text)
    return path


# -- the generator -----------------------------------------------------------------------------------------------------
class Fleet:
    """Straight flights in a square; every column is per aircraft."""

    def __init__(self, n: int) -> None:
        rng = np.random.default_rng(1)
        self.address = (0x100000 + np.arange(n)).astype(np.int32)
        self.lat0 = 48.35 + rng.uniform(-SPREAD_M, SPREAD_M, n) / M_PER_DEG
        self.lon0 = 11.78 + rng.uniform(-SPREAD_M, SPREAD_M, n) / (M_PER_DEG * np.cos(np.radians(48.35)))
        self.height = rng.uniform(8_000.0, 12_000.0, n)
        self.angle = rng.uniform(0.0, 360.0, n)
        self.speed = rng.uniform(180.0, 250.0, n)
        # Flights do not begin all in one second: neither do their elements.
        self.appears_s = rng.uniform(0.0, APPEAR_S, n)
        self.phase = {sensor: rng.uniform(0.0, 1.0, n) for sensor in PERIODS_S}
        self.rng = rng

    def at(self, rows: np.ndarray, elapsed_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions of some aircraft. [deg]"""
        along, angle = self.speed[rows] * elapsed_s, np.radians(self.angle[rows])
        lat = self.lat0[rows] + along * np.cos(angle) / M_PER_DEG
        return lat, self.lon0[rows] + along * np.sin(angle) / (M_PER_DEG * np.cos(np.radians(self.lat0[rows])))

    def due(self, sensor: str, start_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Who is measured between two times since the beginning, and when, ordered by time."""
        period, phase = PERIODS_S[sensor], self.phase[sensor]
        turn = np.ceil(start_s / period - phase)
        when = (turn + phase) * period
        rows = np.flatnonzero((when >= start_s) & (when < end_s) & (when >= self.appears_s))
        rows = rows[np.argsort(when[rows])]
        return rows, when[rows]

    def measure(self, sensor: str, rows: np.ndarray, when: np.ndarray, began_s: float) -> Plots:
        """Reports of one sensor."""
        lat, lon = self.at(rows, when)
        n, noise = len(rows), self.rng.standard_normal((2, len(rows)))
        common = {"time_s": began_s + when, "address": self.address[rows], "altitude_m": self.height[rows]}
        if sensor == "adsb":
            return Plots.of(
                n, **common, lat_deg=lat + noise[0] * 5.0 / M_PER_DEG, lon_deg=lon + noise[1] * 5.0 / M_PER_DEG,
                height_m=self.height[rows], ground_speed_mps=self.speed[rows], track_angle_deg=self.angle[rows],
                nac_p=9, nac_v=2, nic=8, sil=3,
            )  # fmt: skip
        lat_s, lon_s, height_s = (np.array([value]) for value in SITES[sensor])
        slant, azimuth, _ = geodetic_to_radar(frame_rows(lat_s, lon_s, height_s), lat, lon, self.height[rows])
        return Plots.of(n, **common, range_m=slant + noise[0] * 50.0, azimuth_deg=(azimuth + noise[1] * 0.07) % 360.0)


def generate(link: Link, aircraft: int, seconds: float) -> dict[str, Any]:
    """Play all sensors in real time; says how many reports went out, and how late the worst tick was."""
    fleet, keys, epoch = Fleet(aircraft), Keys(PREFIX), int(time.time() * 1000)
    sent, worst_s = 0, 0.0
    with open_session(link) as session:
        publishers = {sensor: SensorPublisher(session, keys.reports(sensor)) for sensor in PERIODS_S}
        seqs = dict.fromkeys(PERIODS_S, 0)
        time.sleep(1.0)
        began_s, done_s = time.time(), 0.0
        while done_s < seconds:
            time.sleep(max(began_s + done_s + TICK_S - time.time(), 0.0))
            until_s = time.time() - began_s
            worst_s = max(worst_s, until_s - done_s)
            for sensor, publisher in publishers.items():
                rows, when = fleet.due(sensor, done_s, until_s)
                plots = fleet.measure(sensor, rows, when, began_s)
                for start in range(0, len(rows), BATCH):
                    part = plots.take(np.arange(start, min(start + BATCH, len(rows))))
                    publisher.put(
                        encode_batch(part, sensor_id=sensor, epoch=epoch, seq=seqs[sensor], sent_s=time.time())
                    )
                    seqs[sensor] += 1
                sent += len(rows)
            done_s = until_s
        time.sleep(1.0)
    return {"reports": sent, "worst_tick_ms": worst_s * 1e3}


# -- the consumers -----------------------------------------------------------------------------------------------------
class Seen(msgspec.Struct):
    """What a consumer needs of a point to judge the service."""

    track_number: int
    seq: int
    time_s: float
    published_s: float
    flags: list[str]
    input_received_s: float | None = None


class SeenFeed(msgspec.Struct):
    """The same of a feed message."""

    points: list[Seen]
    seq: int


class Tally:
    """Latencies and holes of one product."""

    def __init__(self) -> None:
        self.latency_s: list[float] = []
        self.publishing_s: list[float] = []
        self.next: dict[int, int] = {}
        self.points = self.holes = self.backwards = 0

    def note(self, point: Seen, received_s: float) -> None:
        self.points += 1
        expected = self.next.get(point.track_number, 0)
        self.holes += max(point.seq - expected, 0)
        self.backwards += point.seq < expected
        self.next[point.track_number] = point.seq + 1
        if point.input_received_s is not None and "coasted" not in point.flags:
            self.latency_s.append(received_s - point.input_received_s)
            self.publishing_s.append(point.published_s - point.input_received_s)

    def summary(self) -> dict[str, Any]:
        made = {"points": self.points, "tracks": len(self.next), "holes": self.holes, "backwards": self.backwards}
        for name, values in (("latency_ms", self.latency_s), ("until_published_ms", self.publishing_s)):
            # The first seconds, when every track begins at once, are not the steady state.
            steady = np.array(values[len(values) // 5 :])
            if len(steady):
                made[name] = [round(float(v) * 1e3, 2) for v in np.percentile(steady, (50, 95, 99))]
        return made


def consume(link: Link, per_key: bool) -> dict[str, Any]:
    """Follow the feed, or the keys per track, until SIGTERM."""
    keys, tallies = Keys(PREFIX), {"live": Tally(), "element": Tally()}
    decode_feed, decode_point = msgspec.msgpack.Decoder(SeenFeed).decode, msgspec.msgpack.Decoder(Seen).decode
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(1))
    with open_session(link) as session:
        for product, tally in tallies.items():

            def on_feed(_key: str, payload: bytes, _encoding: str, tally: Tally = tally) -> None:
                received_s = time.time()
                for point in decode_feed(payload).points:
                    tally.note(point, received_s)

            def on_point(_key: str, payload: bytes, _encoding: str, tally: Tally = tally) -> None:
                tally.note(decode_point(payload), time.time())

            if per_key:
                session.subscribe(keys.fused(product, "*"), on_point)
            else:
                session.subscribe_recovering(keys.feed(product), on_feed)
        while not stopped:
            time.sleep(0.1)
    return {product: tally.summary() for product, tally in tallies.items()}


def follow_status(link: Link) -> dict[str, Any]:
    """The last status, after SIGTERM."""
    last: list[bytes] = []
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(1))
    with open_session(link) as session:
        session.subscribe(Keys(PREFIX).status(), lambda _key, payload, _encoding: last.append(payload))
        while not stopped:
            time.sleep(0.1)
    return msgspec.json.decode(last[-1], type=dict[str, Any]) if last else {}


# -- the whole ---------------------------------------------------------------------------------------------------------
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


class Processes:
    """This script in other roles."""

    def __init__(self, folder: Path, link: str, args: argparse.Namespace) -> None:
        self.folder, self.link, self.args = folder, link, args
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self.files: list[TextIO] = []

    def start(self, role: str, name: str | None = None, **more: str) -> None:
        out = (self.folder / f"{name or role}.json").open("w")
        self.files.append(out)
        command = [sys.executable, __file__, "--role", role, "--link", self.link, "--folder", str(self.folder)]
        command += ["--aircraft", str(self.args.aircraft), "--seconds", str(self.args.seconds)]
        environ = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.running[name or role] = subprocess.Popen(command, stdout=out, env=environ | more)

    def stop(self, name: str) -> Any:
        """End one and read what it said."""
        process = self.running.pop(name)
        process.terminate()
        process.wait(20.0)
        text = (self.folder / f"{name}.json").read_text().strip()
        return json.loads(text.splitlines()[-1]) if text.startswith("{") else process.returncode

    def close(self) -> None:
        for process in self.running.values():
            process.kill()
            process.wait()
        for file in self.files:
            file.close()


def measure_all(args: argparse.Namespace) -> dict[str, Any]:
    """Run everything and collect."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        link = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_config(folder, link, args.more)
        processes = Processes(folder, link, args)
        try:
            return run_all(processes, args)
        finally:
            processes.close()


def run_all(processes: Processes, args: argparse.Namespace) -> dict[str, Any]:
    """Start in order, measure between warm-up and end, stop in order."""
    processes.start("router")
    consumers = ["feed", "keys"] if args.keys else ["feed"]
    for name in ["service", *consumers, "status"]:
        processes.start("consumer" if name in consumers else name, name, LOAD_KEYS="1" if name == "keys" else "")
    time.sleep(3.0)
    processes.start("generator")
    time.sleep(WARM_UP_S)
    pids = {name: process.pid for name, process in processes.running.items()}
    before, before_s = {name: used_s(pid) for name, pid in pids.items()}, time.monotonic()
    time.sleep(max(args.seconds - WARM_UP_S - 1.0, 1.0))
    elapsed_s = time.monotonic() - before_s
    core = {name: round((used_s(pid) - before[name]) / elapsed_s * 100.0, 1) for name, pid in pids.items()}
    memory = {name: round(rss_mb(pid), 1) for name, pid in pids.items()}
    generator = processes.running.pop("generator")
    generator.wait(args.seconds + 30.0)
    time.sleep(1.0)
    result: dict[str, Any] = {
        "aircraft": args.aircraft,
        "seconds": args.seconds,
        "core_percent": core,
        "rss_mb": memory,
    }
    result["sent"] = json.loads((processes.folder / "generator.json").read_text())
    result["service_exit"] = processes.stop("service")
    time.sleep(1.0)
    for name in (*consumers, "status"):
        result[name] = processes.stop(name)
    processes.stop("router")
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=30.0, help="length of the traffic, above %(default)s")
    parser.add_argument("--keys", action="store_true", help="also follow the keys per track")
    parser.add_argument("--more", default="", help="TOML to append to the service's configuration")
    parser.add_argument("--json", action="store_true")
    for hidden in ("--role", "--link", "--folder"):
        parser.add_argument(hidden, default="", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.role:
        play(args)
        return
    result = measure_all(args)
    if args.json:
        print(json.dumps(result, indent=1))
        return
    status = result.pop("status")
    for name, value in result.items():
        print(f"{name:<14}{value}")
    for sensor, state in status.get("sensors", {}).items():
        print(f"{sensor:<14}{state}")
    for name in ("tracks", "points", "stages_us", "alarms"):
        print(f"{name:<14}{status.get(name)}")


def play(args: argparse.Namespace) -> None:
    """One of the processes."""
    link = Link(connect=(args.link,))
    if args.role == "router":
        sys.exit(router.run(listen=[args.link]))
    if args.role == "service":
        sys.exit(run.run(load_config(Path(args.folder) / "load.toml")))
    if args.role == "generator":
        print(json.dumps(generate(link, args.aircraft, args.seconds)))
    elif args.role == "status":
        print(json.dumps(follow_status(link)))
    else:
        print(json.dumps(consume(link, bool(os.environ["LOAD_KEYS"]))))


if __name__ == "__main__":
    main()
