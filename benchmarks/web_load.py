"""The page under load: 20,000 aircraft at 1 Hz, one viewer, ten, and a real browser that draws them all.

    python -m benchmarks.web_load [--aircraft N] [--seconds S] [--picture FILE]

A router, a generator that publishes the feed as the service does (live points once a second and aircraft, elements
every four seconds, a status), the page, viewers that take every frame, and Chromium without a GPU where there is one.
Processor time is read from /proc over each part; the share is of one core. Everything shares the machine.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.goals import Row, judged

from aeroskein.points import FusedPoints, Product
from aeroskein_service.codec import PointEncoder, encode_feed, encode_message
from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.messages import FEED_POINTS, JSON, MSGPACK
from aeroskein_service.transport import FeedPublisher, open_session
from aeroskein_service.web.frames import unpack_frame

PREFIX = "webload/v1"
SENSORS = ("adsb", "radar1", "radar2")
SLICES = 20  # of a second: every aircraft is published once a second, in its slice
ELEMENT_S = 4
WARM_UP_S = 4.0
LIMIT_S = 30.0  # until the page must have everybody
VIEWERS = {1: 0.1, 10: 0.2}  # and the share of a core that the page may take with them
PAGES = 5  # opened one after the other, besides the one that is looked at
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


# -- the generator -----------------------------------------------------------------------------------------------------
class Fleet:
    """Aircraft all over the world, flying straight; every column is per aircraft."""

    def __init__(self, n: int) -> None:
        rng = np.random.default_rng(1)
        self.n = n
        self.lat, self.lon = rng.uniform(-55.0, 65.0, n), rng.uniform(-180.0, 180.0, n)
        self.angle, self.speed = rng.uniform(0.0, 360.0, n), rng.uniform(80.0, 260.0, n)
        self.altitude = rng.uniform(500.0, 12_500.0, n)
        self.seq = np.zeros((2, n), dtype=np.int64)
        self.began_s = time.time()

    def points(self, product: Product, rows: np.ndarray, time_s: float) -> FusedPoints:
        """Fused points of some aircraft at one time."""
        n, flown = len(rows), self.speed[rows] * (time_s - self.began_s) / 111_320.0
        angle = np.radians(self.angle[rows])
        lat = np.clip(self.lat[rows] + flown * np.cos(angle), -85.0, 85.0)
        lon = (self.lon[rows] + flown * np.sin(angle) / np.cos(np.radians(lat)) + 180.0) % 360.0 - 180.0
        live = product is Product.LIVE
        nan = np.full(n, np.nan)
        seq = self.seq[product, rows]
        self.seq[product, rows] += 1
        sources = np.zeros((n, 3), dtype=np.int32)
        sources[:, 0], sources[:, 1] = 1, rows % 4 == 0
        return FusedPoints(
            product=product, slot=rows, track_number=rows + 1, label=(0x400000 + rows).astype(np.int32),
            address=(0x400000 + rows).astype(np.int32), mode_a=(rows % 4096).astype(np.int16),
            callsign=np.array([f"SKN{row:05d}" for row in rows.tolist()], dtype="S8"), seq=seq,
            time_s=np.full(n, time_s), lat_deg=lat, lon_deg=lon, altitude_m=self.altitude[rows],
            height_m=self.altitude[rows] + 40.0, ground_speed_mps=self.speed[rows], track_angle_deg=self.angle[rows],
            vertical_rate_mps=np.zeros(n), position_cov_m2=np.tile([25.0, 1.0, 30.0], (n, 1)),
            velocity_cov_m2ps2=np.tile([0.5, 0.0, 0.5], (n, 1)), status=np.ones(n, dtype=np.uint8),
            element=np.full(n, -1) if live else seq, span_s=np.stack([nan, nan], axis=1) if live
            else np.tile([time_s - ELEMENT_S, time_s], (n, 1)), master=np.zeros(n, dtype=np.int16), sources=sources,
            rejected=np.zeros(n, dtype=np.int32), input_received_s=np.full(n, time_s + 0.02) if live else nan,
            flags=np.zeros(n, dtype=np.uint16), renamed_to=np.full(n, -1, dtype=np.int32),
        )  # fmt: skip


def generate(link: Link, aircraft: int, seconds: float) -> None:
    """Publish as a service does."""
    fleet, keys, epoch = Fleet(aircraft), Keys(PREFIX), int(time.time() * 1000)
    encoder = PointEncoder(SENSORS, epoch)
    with open_session(link) as session:
        feeds = {p: FeedPublisher(session, keys.feed(p.name.lower(), "load"), MSGPACK) for p in Product}
        seqs, began_s, turn = dict.fromkeys(Product, 0), time.time(), 0
        while time.time() - began_s < seconds:
            slot = turn % SLICES
            rows = np.arange(slot, aircraft, SLICES)
            lots = [(Product.LIVE, rows)]
            if (turn // SLICES) % ELEMENT_S == slot % ELEMENT_S:
                lots.append((Product.ELEMENT, rows))
            now_s = time.time()
            for product, of in lots:
                payloads = encoder.encode(fleet.points(product, of, now_s), now_s)
                for start in range(0, len(payloads), FEED_POINTS):
                    part = payloads[start : start + FEED_POINTS]
                    feeds[product].put(encode_feed(part, MSGPACK, epoch=epoch, seq=seqs[product]))
                    seqs[product] += 1
            if slot == 0:
                session.put(keys.status("load"), status(began_s, now_s, aircraft, seqs), JSON)
            turn += 1
            time.sleep(max(began_s + turn / SLICES - time.time(), 0.0))


def status(began_s: float, now_s: float, aircraft: int, seqs: dict[Product, int]) -> bytes:
    """A status as the service sends it."""
    state = {"accepted": 0, "rejected": {}, "batches": 0, "lost_batches": 0, "last_report_s": now_s, "latency_s": 0.02,
             "inbox": 0, "dropped": 0}  # fmt: skip
    message = {
        "version": 1, "instance": "load", "time_s": now_s, "started_s": began_s,
        "sensors": dict.fromkeys(SENSORS, state), "tracks": {"tentative": 0, "confirmed": aircraft, "coasting": 0},
        "points": {p.name.lower(): n * FEED_POINTS for p, n in seqs.items()}, "stages_us": {}, "alarms": [],
    }  # fmt: skip
    return encode_message(message, JSON)


# -- the viewers -------------------------------------------------------------------------------------------------------
async def view(url: str, viewers: int, seconds: float) -> dict[str, Any]:
    """Take every frame, as a browser does, and say what came."""
    from websockets.asyncio.client import connect

    async def one() -> tuple[int, int, int, list[float]]:
        frames = size = skipped = 0
        ages: list[float] = []
        async with connect(f"{url}/ws".replace("http", "ws"), max_size=None, compression=None) as socket_:
            try:
                async with asyncio.timeout(seconds):
                    while True:
                        message = await socket_.recv()
                        if isinstance(message, bytes):
                            head, _ = unpack_frame(message)
                            ages.append(time.time() - head.time_s)
                            frames, size, skipped = frames + 1, len(message), head.skipped
                            await socket_.send(json.dumps({"type": "shown", "frame": head.frame}))
            except TimeoutError:
                pass
        return frames, size, skipped, ages

    results = await asyncio.gather(*(one() for _ in range(viewers)))
    ages = [age for *_, of in results for age in of]
    return {
        "frames": [r[0] for r in results],
        "frame_bytes": max((r[1] for r in results), default=0),
        "skipped": sum(r[2] for r in results),
        "frame_age_ms": round(1e3 * float(np.median(ages)), 1) if ages else None,
    }


def browse(url: str, seconds: float, picture: str | None) -> dict[str, Any]:
    """Let Chromium draw, and read its numbers."""
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=flags)
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        # The browser has started and this page of it is new: what follows is what one who looks waits for.
        ready_s = first_picture_s(page, url)
        page.wait_for_timeout(3000)
        before = page.evaluate("[__view.frames, __view.drawn, __view.skipped, __view.draws]")
        page.wait_for_timeout(seconds * 1000)
        numbers = page.evaluate(
            "({frames: __view.frames, drawn: __view.drawn, skipped: __view.skipped, count: __view.count, ages: "
            "__view.ages, parts: __view.parts, draws: __view.draws, times: __view.drawTimes, labels: __view.labels, "
            "faults: __view.faults})"
        )
        if picture:
            page.screenshot(path=picture)
        page.close()
        later_s = []
        for _ in range(PAGES):
            # Each is new too: nothing is in a cache.
            page = browser.new_page(viewport={"width": 1400, "height": 900})
            later_s.append(first_picture_s(page, url))
            page.close()
        browser.close()
    numbers["draws"] -= before[3]
    ages, times = np.array(numbers.pop("ages")) * 1e3, np.array(numbers.pop("times")[-numbers["draws"] :])
    numbers["frames"], numbers["drawn"] = numbers["frames"] - before[0], numbers["drawn"] - before[1]
    numbers["skipped"] -= before[2]
    numbers["age_ms"] = {"median": round(float(np.median(ages)), 1), "max": round(float(ages.max()), 1)}
    numbers["draw_ms"] = {"median": round(float(np.median(times)), 2), "p95": round(float(np.percentile(times, 95)), 2)}
    return numbers | {"ready_s": ready_s, "later_s": later_s}


def first_picture_s(page: Any, url: str) -> float:
    """From the address to the first picture drawn. [s]"""
    began_s = time.monotonic()
    page.goto(f"{url}/?lat=20&lon=10&zoom=2.5")
    page.wait_for_function("window.__view && window.__view.ready")
    return time.monotonic() - began_s


# -- the whole ---------------------------------------------------------------------------------------------------------
def used_s(pid: int) -> float:
    """Processor time of a process so far. [s]"""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def rss_mb(pid: int) -> float:
    """Memory of a process. [MB]"""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS"))


def free_port() -> int:
    """A port that nobody listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def main() -> int:
    """Run and print; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", type=int, default=20_000)
    parser.add_argument("--seconds", type=float, default=15.0, help="of each part")
    parser.add_argument("--picture", help="where to write a picture of the browser")
    parser.add_argument("--generate", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.generate:
        generate(Link(connect=(args.generate,)), args.aircraft, args.seconds)
        return 0
    endpoint, http = f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    whole_s = LIMIT_S + WARM_UP_S + 3 * args.seconds + 30.0
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "web.toml")
        config.write_text(f'[zenoh]\nprefix = "{PREFIX}"\nconnect = ["{endpoint}"]\n[http]\nlisten = "{http}"\n')
        ours = [sys.executable, "-m", "aeroskein_service.child"]
        traffic = [sys.executable, "-m", "benchmarks.web_load", "--generate", endpoint]
        traffic += ["--aircraft", str(args.aircraft), "--seconds", str(whole_s)]
        environ = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        started = [
            subprocess.Popen([*ours, "router", "--listen", endpoint], stdin=subprocess.PIPE, env=environ),
            subprocess.Popen([*ours, "web", "--config", str(config)], stdin=subprocess.PIPE, env=environ),
            subprocess.Popen(traffic, env=environ),
        ]
        try:
            return measure(f"http://{http}", started[1].pid, args)
        finally:
            for process in reversed(started):
                process.terminate()
                process.wait(10.0)


def warmed_up(url: str, aircraft: int) -> int:
    """Wait until the page has everybody and some seconds more; the tracks it knows."""
    ends_s, tracks = time.monotonic() + LIMIT_S, 0
    while tracks < aircraft and time.monotonic() < ends_s:
        time.sleep(0.5)
        with contextlib.suppress(OSError), urllib.request.urlopen(f"{url}/api/status") as answer:
            tracks = json.load(answer)["feed"]["tracks"]
    time.sleep(WARM_UP_S)
    return tracks


def measure(url: str, page: int, args: argparse.Namespace) -> int:
    """Warm up, measure, and judge the numbers."""
    tracks = warmed_up(url, args.aircraft)
    rows = [Row("aircraft in the picture", tracks, must=args.aircraft, better="higher")]
    for viewers, goal in VIEWERS.items():
        before_s, began_s = used_s(page), time.monotonic()
        seen = asyncio.run(view(url, viewers, args.seconds))
        share = (used_s(page) - before_s) / (time.monotonic() - began_s)
        rows += [
            Row(f"page with {viewers} viewer{'s'[: viewers - 1]}: share of a core", share, "", goal),
            Row("  frames to each, fewest", min(seen["frames"]), "", args.seconds - 1.0, better="higher"),
            Row("  frames left out", seen["skipped"], "", 0.0),
        ]
        print(f"{viewers} viewers: {share:.3f} of a core, {seen}", flush=True)
    rows += [Row("bytes of a frame", seen["frame_bytes"]), Row("memory of the page", rss_mb(page), "MB")]
    if shutil.which("chromium") is None:
        print("no Chromium on this machine: the browser's part is left out")
    else:
        rows += browser_rows(browse(url, args.seconds, args.picture), args.aircraft)
    return judged(f"the page with {args.aircraft} aircraft", rows)


def browser_rows(seen: dict[str, Any], aircraft: int) -> list[Row]:
    """What Chromium did."""
    print("browser: " + json.dumps(seen))
    return [
        Row("browser: first picture, just started", seen["ready_s"], "s", 2.0),
        Row(f"  first picture, the slowest of {PAGES} more pages", max(seen["later_s"]), "s", 2.0),
        Row("  aircraft drawn", seen["count"], "", aircraft, better="higher"),
        Row("  frames that came and were not drawn", seen["frames"] - seen["drawn"], "", 1.0),
        Row("  frames left out for it", seen["skipped"], "", 0.0),
        Row("  drawing, median", seen["draw_ms"]["median"], "ms", 16.0),
        Row("  drawing, 95 %", seen["draw_ms"]["p95"], "ms"),
        Row("  age of a frame when drawn, median", seen["age_ms"]["median"], "ms", 500.0),
        Row("  age of a frame when drawn, most", seen["age_ms"]["max"], "ms"),
        Row("  labels", seen["labels"]),
    ]


if __name__ == "__main__":
    sys.exit(main())
