"""What the integration tests share: a real router, a real service, sensors and listeners, all on private ports.

Nothing of Zenoh is replaced. Waiting is for a condition with a generous limit, never for a duration.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import msgspec

from aeroskein_service.config import Config, load_config
from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.service import Service
from aeroskein_service.transport import SensorPublisher, Session, open_session

LIMIT_S = 60.0  # a condition that has not come true by then never will

ADDRESSES = ("3C6444", "4CA2D6", "A0B1C2")

SENSORS = """
[[sensors]]
id = "adsb"
kind = "adsb"

[[sensors]]
id = "radar1"
kind = "ssr"
lat_deg = 48.35
lon_deg = 11.78
height_m = 460.0
"""

CONFIGURATION = """
[fusion]
element_s = 2.0
lookahead = 0
watermark_s = 0.5

[zenoh]
prefix = "{prefix}"
connect = ["{endpoint}"]

[http]
listen = ""
"""


def free_port() -> int:
    """A port on 127.0.0.1 that nobody listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def free_endpoint() -> str:
    """An endpoint for a router."""
    return f"tcp/127.0.0.1:{free_port()}"


def wait_until(condition: Callable[[], Any], what: str, limit_s: float = LIMIT_S) -> Any:
    """The condition's first true value; fails the test when the limit passes."""
    ends_s = time.monotonic() + limit_s
    while not (value := condition()):
        assert time.monotonic() < ends_s, f"waited {limit_s:g} s for {what}"
        time.sleep(0.02)
    return value


def write_config(folder: Path, endpoint: str, prefix: str, sensors: str = SENSORS) -> Path:
    """A configuration file for a service of two sensors, or of others."""
    path = folder / "config.toml"
    path.write_text(sensors + CONFIGURATION.format(endpoint=endpoint, prefix=prefix))
    return path


def make_config(
    folder: Path, endpoint: str, prefix: str, overrides: Mapping[str, Any] | None = None, sensors: str = SENSORS
) -> Config:
    """The same, read."""
    return load_config(write_config(folder, endpoint, prefix, sensors), overrides=overrides, environ={})


@contextmanager
def running(config: Config) -> Iterator[Service]:
    """A service in this process, started and stopped in order."""
    service = Service(config)
    try:
        service.start(threading.Event())
        yield service
    finally:
        service.stop()


def report(address: str, time_s: float, **fields: Any) -> dict[str, Any]:
    """An ADS-B report of an aircraft that flies north at 200 m/s; each address has its own meridian."""
    flown_m = 200.0 * (time_s % 1000.0)
    made = {
        "time_s": time_s,
        "address": address,
        "lat_deg": 47.0 + flown_m / 111_320.0,
        "lon_deg": 10.0 + int(address, 16) % 97 * 0.02,
        "altitude_m": 10_000.0,
        "ground_speed_mps": 200.0,
        "track_angle_deg": 0.0,
    }
    return made | fields


def flight(address: str, until_s: float, seconds: int = 12) -> list[dict[str, Any]]:
    """One report a second, the last at ``until_s``."""
    return [report(address, until_s - back) for back in range(seconds - 1, -1, -1)]


def seams(elements: Iterable[Mapping[str, Any]]) -> dict[str, list[tuple[float, float]]]:
    """Of every aircraft: where each of its elements ended, and where the next one began. [s since the epoch]"""
    spans: dict[str, list[list[float]]] = {}
    for point in elements:
        spans.setdefault(point["address"], []).append(point["span_s"])
    return {
        address: [(before[1], after[0]) for before, after in pairwise(sorted(of_one))]
        for address, of_one in spans.items()
    }


class Sensor:
    """Speaks as one sensor."""

    def __init__(self, session: Session, keys: Keys, sensor: str = "adsb", *, below: str = "", epoch: int = 1) -> None:
        self.sensor = sensor
        self.epoch = epoch
        self.seq = 0
        self._publisher = SensorPublisher(session, keys.reports(sensor) + below)

    def batch(self, reports: Sequence[Mapping[str, Any]], **envelope: Any) -> bytes:
        """A batch with the next number."""
        made = {
            "version": 1,
            "sensor": self.sensor,
            "epoch": self.epoch,
            "seq": self.seq,
            "sent_s": time.time(),
            "reports": reports,
        } | envelope
        self.seq += 1
        return msgspec.msgpack.encode(made)

    def send(self, reports: Sequence[Mapping[str, Any]], **envelope: Any) -> None:
        """Put a good batch."""
        self.put(self.batch(reports, **envelope))

    def put(self, payload: bytes) -> None:
        """Put any bytes."""
        self._publisher.put(payload)

    @contextmanager
    def flying(self, addresses: Sequence[str], period_s: float) -> Iterator[None]:
        """Report these aircraft as time passes, from a thread, until the block ends."""
        over = threading.Event()

        def fly() -> None:
            while not over.wait(period_s):
                self.send([report(address, time.time()) for address in addresses])

        thread = threading.Thread(target=fly, name=f"sensor-{self.sensor}")
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


class Listener:
    """Collects what arrives under a key expression."""

    def __init__(self, session: Session, key: str, *, recovering: bool = False) -> None:
        self.received: list[tuple[str, Any]] = []
        self.received_s: list[float] = []
        follow = session.subscribe_recovering if recovering else session.subscribe
        follow(key, self._note)

    def _note(self, key: str, payload: bytes, encoding: str) -> None:
        module = msgspec.json if "json" in encoding else msgspec.msgpack
        self.received.append((key, module.decode(payload)))
        self.received_s.append(time.time())

    @property
    def messages(self) -> list[Any]:
        """The payloads in order."""
        return [message for _, message in self.received]

    def wait_for(self, condition: Callable[[list[Any]], Any], what: str) -> Any:
        """Wait until the messages satisfy a condition."""
        return wait_until(lambda: condition(self.messages), what)


def connect(endpoint: str) -> Session:
    """A session of a test's own."""
    return open_session(Link(connect=(endpoint,)))


ROOT = Path(__file__).parents[2]


class Process:
    """A command of ours in a process of its own, with what it writes."""

    def __init__(self, folder: Path, *arguments: str | Path) -> None:
        self._out = folder / f"{arguments[0]}-{time.monotonic_ns()}.out"
        self._err = self._out.with_suffix(".err")
        environ = {name: value for name, value in os.environ.items() if not name.startswith("AEROSKEIN_")}
        environ["PYTHONPATH"] = os.pathsep.join([str(ROOT / "core"), str(ROOT / "service")])
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.popen = subprocess.Popen(
                [sys.executable, "-c", "from aeroskein_service.cli import main; main()", *map(str, arguments)],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env=environ,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.popen.poll() is None:
            self.popen.kill()
        self.popen.wait()

    @property
    def out(self) -> str:
        """Standard output so far."""
        return self._out.read_text()

    @property
    def err(self) -> str:
        """Standard error so far."""
        return self._err.read_text()

    def wait_for_err(self, text: str) -> None:
        """Wait until standard error has a text."""
        wait_until(lambda: text in self.err or self.popen.poll() is not None, f"{text!r} on standard error")
        assert text in self.err, self.err

    def signal(self, number: int) -> None:
        """Send a signal."""
        self.popen.send_signal(number)

    def wait(self) -> int:
        """Wait for the end; the exit status."""
        return self.popen.wait(LIMIT_S)

    def stop(self) -> int:
        """End it as a supervisor does; the exit status."""
        self.signal(signal.SIGTERM)
        return self.wait()


def is_running(pid: int) -> bool:
    """Whether there is such a process that is no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"
