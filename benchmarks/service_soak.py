"""Half an hour of coming and going traffic, accelerated: the memory of the process stays flat.

    python -m benchmarks.service_soak [--aircraft N] [--minutes M]

All that the service does between a payload and its payloads, with the clock simulated: decoding, engine, elements,
encoding, counters. Flights last five minutes and then end, and others with new addresses begin, so that
every table has to give back what it no longer needs. Memory is compared from the tenth simulated minute on, when the
first flights have come and gone twice: the most that was held in every half minute, for the allocator gives a few
megabytes back now and then, and takes them again within seconds.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import time
from collections.abc import Iterator

import numpy as np
from benchmarks.goals import Row, judged
from benchmarks.load_processes import rss_mb
from benchmarks.load_traffic import PERIODS_S, Fleet, SensorTraffic, sensor_settings

from aeroskein.engine import FusionEngine
from aeroskein.points import FusedPoints
from aeroskein.settings import EngineSettings
from aeroskein_service.codec import PointEncoder, encode_feed, gather, open_batch
from aeroskein_service.messages import FEED_POINTS, MSGPACK
from aeroskein_service.status import Counters

AIRCRAFT, MINUTES = 300, 30
START_S = 1_790_000_000.0
TICK_S = 1.0
FLIGHT_S, WAVES = 300.0, 5
FROM_MIN = 10
MUST, AIM = 5.0, 2.0


class Sky:
    """Waves of flights, each a fleet of its own; one begins whenever another ends."""

    def __init__(self, aircraft: int) -> None:
        self._each = aircraft // WAVES
        self._waves: list[tuple[float, dict[str, SensorTraffic]]] = []
        self._begun = 0

    def payloads(self, now_s: float) -> Iterator[tuple[str, bytes]]:
        """What the sensors send until now. [s since the beginning]"""
        while self._begun * FLIGHT_S / WAVES <= now_s:
            begins_s = self._begun * FLIGHT_S / WAVES
            fleet = Fleet(self._each, seed=self._begun, first_address=0x100000 + self._begun * self._each)
            own = {sensor: SensorTraffic(fleet, sensor, START_S + begins_s) for sensor in PERIODS_S}
            self._waves.append((begins_s, own))
            self._begun += 1
        self._waves = [wave for wave in self._waves if now_s < wave[0] + FLIGHT_S]
        for begins_s, own in self._waves:
            for sensor, traffic in own.items():
                for batch in traffic.batches(now_s - begins_s):
                    yield sensor, batch.payload


class Pipeline:
    """The worker's way from payloads to payloads."""

    def __init__(self) -> None:
        self._sensors = sensor_settings()
        self.engine = FusionEngine(EngineSettings(sensors=self._sensors), epoch_ms=1)
        self._encoder = PointEncoder([sensor.id for sensor in self._sensors], 1)
        self._counters = Counters(self._sensors)
        self._index = {sensor.id: index for index, sensor in enumerate(self._sensors)}
        self.reports = self.points = 0

    def turn(self, payloads: Iterator[tuple[str, bytes]], now_s: float) -> None:
        """One second of the service."""
        arrived = list(payloads)
        sensors = [self._index[sensor] for sensor, _ in arrived]
        opened = [open_batch(payload, MSGPACK, sensor_id=sensor, packed=True) for sensor, payload in arrived]
        plots = gather(opened, sensors=sensors, received_s=[now_s] * len(opened)).plots
        self.reports += len(plots)
        if len(plots):
            self._counters.see(plots)
            self._publish(self.engine.receive(plots, now_s=now_s), now_s)
        self._publish(self.engine.advance(now_s=now_s), now_s)
        self._counters.per_sensor([0] * len(self._sensors), [0] * len(self._sensors))

    def _publish(self, events: list[object], now_s: float) -> None:
        for event in events:
            if isinstance(event, FusedPoints):
                payloads = self._encoder.encode(event, published_s=now_s)
                self.points += len(payloads)
                for start in range(0, len(payloads), FEED_POINTS):
                    encode_feed(payloads[start : start + FEED_POINTS], MSGPACK, epoch=1, seq=0)


def main() -> int:
    """Run it; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", type=int, default=AIRCRAFT, help="in the air at a time")
    parser.add_argument("--minutes", type=int, default=MINUTES)
    args = parser.parse_args()
    sky, pipeline, memory_mb, held_mb = Sky(args.aircraft), Pipeline(), [], 0.0
    began_s = time.monotonic()
    for second in range(1, args.minutes * 60 + 1):
        pipeline.turn(sky.payloads(float(second)), START_S + second)
        held_mb = max(held_mb, rss_mb(os.getpid()))
        if second % 30 == 0:
            memory_mb.append(held_mb)
            gc.collect()
            held_mb = 0.0
            if second % 300 == 0:
                counts = pipeline.engine.track_counts()
                print(f"  minute {second // 60}: {memory_mb[-1]:.1f} MB, {counts}", flush=True)
    steady = np.array(memory_mb[FROM_MIN * 2 - 1 :])
    rows = [
        Row("reports", pipeline.reports),
        Row("points", pipeline.points),
        Row("memory at the end", steady[-1], "MB"),
        Row("largest change of the memory from minute 10 on", 100.0 * np.ptp(steady) / steady[0], "%", MUST, AIM),
        Row("took", time.monotonic() - began_s, "s"),
    ]
    return judged(f"{args.minutes} minutes, {args.aircraft} aircraft at a time", rows)


if __name__ == "__main__":
    sys.exit(main())
