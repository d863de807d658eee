"""What has arrived and is not worked on yet: bounded queues between Zenoh's threads and the one worker.

A callback of Zenoh must never wait, or every subscription of its session freezes; so a full queue drops its oldest
batch, counts it, and lets the new one in. Each sensor has its own bound: a flood from one drops nothing of another.
When the worker is too slow for all of it, it sheds: the oldest batch of the sensor that has most waiting goes first.
"""

from __future__ import annotations

import heapq
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from aeroskein_service.transport import OnMessage, Question

__all__ = ["Arrival", "Inbox"]

# Bytes one sensor may have waiting whatever the number of its batches: a batch of 500 reports is about 50 kB.
BYTES: Final = 64_000_000
QUESTIONS: Final = 256  # queries that may wait; more than that are refused at once


class Arrival(NamedTuple):
    """One payload as it came in."""

    order: int
    received_s: float
    sensor: int
    key: str
    payload: bytes
    encoding: str


class Inbox:
    """Bounded queues, one per sensor, and one of questions.

    Parameters
    ----------
    sensors : int
        How many sensors there are.
    capacity : int
        Batches each of them may have waiting.
    clock : callable
        Gives the time of receipt. [s since the epoch]
    """

    def __init__(self, sensors: int, capacity: int, clock: Callable[[], float] = time.time) -> None:
        self._queues: list[deque[Arrival]] = [deque() for _ in range(sensors)]
        self._bytes = [0] * sensors
        self._count = 0
        self._questions: deque[Question] = deque()
        self._capacity = capacity
        self._clock = clock
        self._lock = threading.Lock()
        self._news = threading.Event()
        self._open = True
        self.dropped = [0] * sensors

    def receiver(self, sensor: int) -> OnMessage:
        """The callback for one sensor's subscription."""
        queue, lock, news, clock = self._queues[sensor], self._lock, self._news, self._clock

        def receive(key: str, payload: bytes, encoding: str) -> None:
            received_s = clock()
            with lock:
                if not self._open:
                    return
                self._count += 1
                queue.append(Arrival(self._count, received_s, sensor, key, payload, encoding))
                self._bytes[sensor] += len(payload)
                while len(queue) > self._capacity or (self._bytes[sensor] > BYTES and len(queue) > 1):
                    self._drop_oldest(sensor)
            news.set()

        return receive

    def ask(self, question: Question) -> None:
        """Queue a question for the worker, or refuse it when too many wait."""
        with self._lock:
            accepted = self._open and len(self._questions) < QUESTIONS
            if accepted:
                self._questions.append(question)
        if accepted:
            self._news.set()
        else:
            question.refuse("the service is busy, ask again" if self._open else "the service is stopping")

    def wake(self) -> None:
        """Let a waiting worker go on."""
        self._news.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait until something has arrived or the time is up; whether something has."""
        return self._news.wait(timeout_s)

    def take(self, most_bytes: int) -> list[Arrival]:
        """What waits, in order of arrival: the oldest batches up to a number of bytes, one at least."""
        with self._lock:
            self._news.clear()
            taken: list[Arrival] = []
            left = most_bytes
            for arrival in heapq.merge(*self._queues):
                if taken and len(arrival.payload) > left:
                    self._news.set()
                    break
                left -= len(arrival.payload)
                taken.append(arrival)
            for arrival in taken:
                self._queues[arrival.sensor].popleft()
                self._bytes[arrival.sensor] -= len(arrival.payload)
            return taken

    def oldest_s(self) -> float | None:
        """When the oldest batch that waits has arrived; None where none waits. [s since the epoch]"""
        with self._lock:
            return min((queue[0].received_s for queue in self._queues if queue), default=None)

    def shed(self, keep_bytes: int) -> None:
        """Drop batches until so few bytes wait: the oldest of the sensor that has most waiting, and again.

        The sensor that has least waiting is touched last, and those that are too loud end up equal.
        """
        with self._lock:
            waiting = sum(self._bytes)
            while waiting > keep_bytes:
                sensor = max(range(len(self._bytes)), key=self._bytes.__getitem__)
                waiting -= self._drop_oldest(sensor)

    def _drop_oldest(self, sensor: int) -> int:
        size = len(self._queues[sensor].popleft().payload)
        self._bytes[sensor] -= size
        self.dropped[sensor] += 1
        return size

    def questions(self) -> list[Question]:
        """All questions that wait."""
        with self._lock:
            asked = list(self._questions)
            self._questions.clear()
        return asked

    def close(self) -> None:
        """Take nothing more; what is there can still be taken."""
        with self._lock:
            self._open = False
        self._news.set()

    def depths(self) -> list[int]:
        """Batches waiting, by sensor."""
        return [len(queue) for queue in self._queues]
