"""Sensor feeds: simulated or recorded reports put on Zenoh when they arrive, each sensor in a session of its own.

To the service such a feed is a sensor like any other: batches of at most 50 reports gathered over at most 100 ms,
numbered from 0 in an epoch, kept in a cache from which a subscriber recovers what an outage lost, with a liveliness
token while the feed runs.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.plots import Plots
from aeroskein.simulation import Chunk
from aeroskein_service.codec import encode_batch
from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.transport import SensorPublisher, open_session

__all__ = ["BATCH_S", "FeedCounts", "feed_sensors"]

# Reports are gathered for this long into one batch. [s]
BATCH_S: Final = 0.1
# Beyond 50 reports a batch gains nothing, it only waits longer.
BATCH_REPORTS: Final = 50
# Chunks made ahead of time, so that a block of 20,000 aircraft being flown does not delay what is due now.
AHEAD_CHUNKS: Final = 20
# When flying the traffic up to now takes longer than this, what has passed meanwhile is not sent after the event. [s]
LATE_S: Final = 5.0


@dataclass(slots=True)
class FeedCounts:
    """What a feed has put."""

    batches: int = 0
    reports: int = 0


class _Sensor:
    """One sensor's publisher and its place in the sequence."""

    def __init__(self, sensor_id: str, publisher: SensorPublisher, epoch_ms: int) -> None:
        self._id, self._publisher, self._epoch_ms, self._seq = sensor_id, publisher, epoch_ms, 0

    def put(self, plots: Plots, counts: FeedCounts) -> None:
        for first in range(0, len(plots), BATCH_REPORTS):
            part = plots.take(np.arange(first, min(first + BATCH_REPORTS, len(plots))))
            payload = encode_batch(part, sensor_id=self._id, epoch=self._epoch_ms, seq=self._seq, sent_s=time.time())
            self._publisher.put(payload)
            self._seq += 1
            counts.batches += 1
            counts.reports += len(part)


class _Ahead:
    """Makes chunks on a thread of its own, a few ahead of the one that is needed."""

    def __init__(self, chunks: Iterator[Chunk]) -> None:
        self._chunks = chunks
        self._made: queue.Queue[Chunk | BaseException | None] = queue.Queue(AHEAD_CHUNKS)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._make, name="simulator", daemon=True)
        self._thread.start()

    def _make(self) -> None:
        last: BaseException | None = None
        try:
            for chunk in self._chunks:
                if not self._hand_over(chunk):
                    return
        except Exception as error:
            last = error
        self._hand_over(last)

    def _hand_over(self, item: Chunk | BaseException | None) -> bool:
        while not self._over.is_set():
            try:
                self._made.put(item, timeout=BATCH_S)
            except queue.Full:
                continue
            return True
        return False

    def __iter__(self) -> Iterator[Chunk]:
        while True:
            item = self._made.get()
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            yield item

    def close(self) -> None:
        """Stop making chunks."""
        self._over.set()
        self._thread.join(2.0)


def feed_sensors(
    make_chunks: Callable[[float], Iterator[Chunk]],
    *,
    sensors: dict[int, str],
    link: Link,
    keys: Keys,
    instance: str,
    stop: threading.Event,
    announce: Callable[[str], None],
) -> FeedCounts:
    """Play sensors until the chunks end or ``stop`` is set.

    Parameters
    ----------
    make_chunks : callable
        Gets the time at which the feed begins and gives its chunks, of ``BATCH_S`` each. [s since the epoch]
    sensors : dict
        Ids of the sensors to be played, by their index in the columns.
    link, keys : Link, Keys
        Where the router is, and the keys.
    instance : str
        Name of this process in the liveliness tokens.
    stop : threading.Event
        Ends the feed.
    announce : callable
        Gets sentences about the connection.

    Returns
    -------
    FeedCounts
        What was put.

    Raises
    ------
    TransportError, OpenCancelledError
        From ``open_session``.
    """
    counts = FeedCounts()
    with ExitStack() as held:
        players: dict[int, _Sensor] = {}
        for index, sensor_id in sensors.items():
            session = held.enter_context(open_session(link, announce=announce, stop=stop))
            publisher = SensorPublisher(session, keys.reports(sensor_id))
            session.declare_alive(keys.alive(f"sensor-{sensor_id}", instance))
            players[index] = _Sensor(sensor_id, publisher, int(time.time() * 1000))
        ahead = _Ahead(make_chunks(time.time()))
        held.callback(ahead.close)
        late = True
        for chunk in ahead:
            if stop.wait(max(0.0, chunk.until_s - time.time())):
                break
            late = late and chunk.until_s < time.time() - LATE_S
            if late:
                continue
            for index, player in players.items():
                player.put(chunk.plots.take(chunk.plots.sensor == index), counts)
    return counts
