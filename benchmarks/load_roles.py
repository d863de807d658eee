"""The processes around a service under load: router, generator, consumers, each of which leaves what it saw in a file.

python -m benchmarks.load_roles ROLE ENDPOINT FOLDER [FLEETS]
"""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from benchmarks.load_traffic import PERIODS_S, Fleet, SensorTraffic

from aeroskein_service.commands import router, run
from aeroskein_service.config import load_config
from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.transport import SensorPublisher, Session, open_session

__all__ = ["PREFIX"]

PREFIX: Final = "load/v1"
TICK_S: Final = 0.01
SETTLE_S: Final = 1.0


# -- the generator -----------------------------------------------------------------------------------------------------
def generate(link: Link, fleets: Sequence[tuple[int, float, float]], folder: Path) -> None:
    """Play all sensors in real time and leave what was put, and when, in ``sent.npz``.

    ``fleets`` are aircraft, begin and end: more than one makes the load change. [s since the beginning]
    """
    sent: list[tuple[np.ndarray, np.ndarray, float]] = []
    worst_s = 0.0
    with open_session(link) as session:
        publishers = {sensor: SensorPublisher(session, Keys(PREFIX).reports(sensor)) for sensor in PERIODS_S}
        time.sleep(SETTLE_S)
        began_s = time.time()
        (folder / "began.part").write_text(repr(began_s))
        (folder / "began.part").rename(folder / "began")
        # Each fleet is a publisher of its own with its own epoch, below the key of its sensor.
        traffic = []
        for index, (aircraft, start_s, end_s) in enumerate(fleets):
            fleet = Fleet(aircraft, seed=1 + index, first_address=0x100000 + 0x100000 * index)
            for sensor in PERIODS_S:
                own = SensorTraffic(fleet, sensor, began_s + start_s)
                put = publishers[sensor].put
                if index:
                    put = SensorPublisher(session, f"{Keys(PREFIX).reports(sensor)}/{index}").put
                traffic.append((own, put, start_s, end_s, fleet))
        done_s, last_s = 0.0, max(end_s for _, _, end_s in fleets)
        while done_s < last_s:
            time.sleep(max(began_s + done_s + TICK_S - time.time(), 0.0))
            until_s = time.time() - began_s
            worst_s = max(worst_s, until_s - done_s)
            for own, put, start_s, end_s, fleet in traffic:
                if start_s < until_s <= end_s:
                    for batch in own.batches(until_s - start_s):
                        put_s = time.time()
                        put(batch.payload)
                        sent.append((fleet.address[batch.rows], batch.time_s, put_s))
            done_s = until_s
        time.sleep(SETTLE_S)
    lengths = [len(rows) for rows, _, _ in sent]
    np.savez(
        folder / "sent.npz",
        address=np.concatenate([rows for rows, _, _ in sent]),
        time_s=np.concatenate([stamps for _, stamps, _ in sent]),
        put_s=np.repeat([put_s for _, _, put_s in sent], lengths),
        worst_tick_s=worst_s,
        began_s=began_s,
    )


# -- the consumers -----------------------------------------------------------------------------------------------------
class Seen(msgspec.Struct, gc=False):
    """What a consumer needs of a point to judge the service."""

    track_number: int
    seq: int
    time_s: float
    status: str
    published_s: float
    address: str | None = None
    input_received_s: float | None = None


class SeenFeed(msgspec.Struct, gc=False):
    """The same of a feed message."""

    points: list[Seen]


class Tally:
    """Points of one product, with their holes."""

    def __init__(self) -> None:
        self.next: dict[int, int] = {}
        self.holes = self.backwards = self.coasted = 0
        self.rows: list[tuple[str | None, float, float, float]] = []

    def note(self, point: Seen, received_s: float) -> None:
        expected = self.next.get(point.track_number, 0)
        self.holes += max(point.seq - expected, 0)
        self.backwards += point.seq < expected
        self.next[point.track_number] = point.seq + 1
        if point.status in ("coasting", "terminated"):
            # From no report: no latency.
            self.coasted += 1
        else:
            inside_s = point.published_s - (point.input_received_s or point.published_s)
            self.rows.append((point.address, point.time_s, received_s, inside_s))

    def save(self, path: Path) -> None:
        """All points in columns."""
        addresses = [int(address, 16) if address else -1 for address, *_ in self.rows]
        np.savez(
            path,
            address=np.array(addresses, dtype=np.int64),
            time_s=np.array([time_s for _, time_s, _, _ in self.rows]),
            received_s=np.array([received_s for _, _, received_s, _ in self.rows]),
            inside_s=np.array([inside_s for _, _, _, inside_s in self.rows]),
            tracks=len(self.next),
            holes=self.holes,
            backwards=self.backwards,
            coasted=self.coasted,
        )


def consume(link: Link, per_key: bool, folder: Path) -> None:
    """Follow the feed, or the keys per track, until SIGTERM; leaves ``feed-live.npz`` and so on."""
    keys, name = Keys(PREFIX), "keys" if per_key else "feed"
    tallies = {"live": Tally(), "element": Tally()}
    decode_feed, decode_point = msgspec.msgpack.Decoder(SeenFeed).decode, msgspec.msgpack.Decoder(Seen).decode

    def follow(session: Session, product: str, tally: Tally) -> None:
        def on_feed(_key: str, payload: bytes, _encoding: str) -> None:
            received_s = time.time()
            for point in decode_feed(payload).points:
                tally.note(point, received_s)

        def on_point(_key: str, payload: bytes, _encoding: str) -> None:
            tally.note(decode_point(payload), time.time())

        if per_key:
            session.subscribe(keys.fused(product, "*"), on_point)
        else:
            session.subscribe_recovering(keys.feed(product), on_feed)

    with open_session(link) as session:
        for product, tally in tallies.items():
            follow(session, product, tally)
        _until_terminated()
    for product, tally in tallies.items():
        tally.save(folder / f"{name}-{product}.npz")


def follow_status(link: Link, folder: Path) -> None:
    """Leave every status in ``status.json``, one a line, after SIGTERM."""
    seen: list[bytes] = []
    with open_session(link) as session:
        session.subscribe(Keys(PREFIX).status(), lambda _key, payload, _encoding: seen.append(payload))
        _until_terminated()
    (folder / "status.json").write_bytes(b"\n".join(seen))


def _until_terminated() -> None:
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(1))
    while not stopped:
        time.sleep(0.1)


def main() -> int:
    """Play one role."""
    role, endpoint, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    link = Link(connect=(endpoint,))
    if role == "router":
        return router.run(listen=[endpoint])
    if role == "service":
        return run.run(load_config(folder / "load.toml"))
    if role == "generator":
        generate(link, [(int(n), start_s, end_s) for n, start_s, end_s in json.loads(sys.argv[4])], folder)
    elif role == "status":
        follow_status(link, folder)
    else:
        consume(link, role == "keys", folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
