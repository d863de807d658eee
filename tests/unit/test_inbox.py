"""The inbox: order of arrival, a bound per sensor, the oldest goes first and is counted."""

from __future__ import annotations

import itertools
import threading

from aeroskein_service.inbox import BYTES, Inbox


class Question:
    """Stands for a query: remembers how it was refused."""

    refused = ""

    def refuse(self, sentence: str) -> None:
        self.refused = sentence


def make(sensors: int = 2, capacity: int = 3) -> Inbox:
    ticks = itertools.count()
    return Inbox(sensors, capacity, clock=lambda: float(next(ticks)))


def test_batches_come_out_in_order_of_arrival():
    inbox = make()
    for sensor in (1, 0, 1, 0):
        inbox.receiver(sensor)("key", b"", "json")
    assert [(a.sensor, a.received_s) for a in inbox.take(10)] == [(1, 0.0), (0, 1.0), (1, 2.0), (0, 3.0)]


def test_full_inbox_drops_the_oldest_and_counts_it():
    inbox = make()
    for payload in (b"a", b"b", b"c", b"d", b"e"):
        inbox.receiver(0)("key", payload, "json")
    assert [a.payload for a in inbox.take(10)] == [b"c", b"d", b"e"]
    assert inbox.dropped == [2, 0]


def test_flood_of_one_sensor_drops_nothing_of_another():
    inbox = make()
    inbox.receiver(1)("key", b"other", "json")
    for _ in range(100):
        inbox.receiver(0)("key", b"flood", "json")
    assert inbox.take(10)[0].payload == b"other"
    assert inbox.dropped == [97, 0]


def test_huge_payloads_are_bounded_by_their_bytes():
    inbox = make(capacity=1000)
    for _ in range(5):
        inbox.receiver(0)("key", bytes(BYTES // 2), "json")
    assert inbox.depths() == [2, 0]


def test_what_is_not_taken_stays_and_keeps_the_worker_awake():
    inbox = make(capacity=10)
    for sensor in (0, 1, 0):
        inbox.receiver(sensor)("key", b"1234", "json")
    assert [a.sensor for a in inbox.take(9)] == [0, 1]
    assert inbox.wait(0.0)
    assert [a.sensor for a in inbox.take(9)] == [0]
    assert not inbox.wait(0.0)


def test_one_batch_is_taken_however_large_it_is():
    inbox = make()
    inbox.receiver(0)("key", b"large", "json")
    assert len(inbox.take(1)) == 1


def test_the_age_of_what_waits_is_that_of_the_oldest():
    inbox = make()
    assert inbox.oldest_s() is None
    for sensor in (1, 0):
        inbox.receiver(sensor)("key", b"x", "json")
    assert inbox.oldest_s() == 0.0
    inbox.take(1)
    assert inbox.oldest_s() == 1.0


def test_shedding_drops_the_oldest_of_the_loudest_sensor_and_counts_it():
    inbox = make(capacity=100)
    for payload in (b"00", b"01", b"02", b"03"):
        inbox.receiver(0)("key", payload, "json")
    inbox.receiver(1)("key", b"10", "json")
    inbox.shed(6)
    assert [a.payload for a in inbox.take(100)] == [b"02", b"03", b"10"]
    assert inbox.dropped == [2, 0]


def test_shedding_makes_two_loud_sensors_equal_before_it_touches_a_quiet_one():
    inbox = make(sensors=3, capacity=100)
    for sensor, many in ((0, 8), (1, 12), (2, 2)):
        for _ in range(many):
            inbox.receiver(sensor)("key", b"x", "json")
    inbox.shed(10)
    assert inbox.depths() == [4, 4, 2]
    assert inbox.dropped == [4, 8, 0]


def test_shedding_of_little_enough_drops_nothing():
    inbox = make(capacity=100)
    inbox.receiver(0)("key", b"1234", "json")
    inbox.shed(4)
    assert inbox.dropped == [0, 0]
    inbox.shed(0)
    assert inbox.dropped == [1, 0]


def test_question_to_a_closed_inbox_is_refused():
    inbox, question = make(), Question()
    inbox.close()
    inbox.ask(question)
    assert "stopping" in question.refused


def test_too_many_questions_are_refused():
    inbox = make()
    asked = [Question() for _ in range(300)]
    for question in asked:
        inbox.ask(question)
    assert sum(bool(q.refused) for q in asked) == 300 - len(inbox.questions())
    assert asked[-1].refused


def test_arrival_wakes_a_waiting_worker():
    inbox = make()
    woken = []
    worker = threading.Thread(target=lambda: woken.append(inbox.wait(10.0)))
    worker.start()
    inbox.receiver(0)("key", b"", "json")
    worker.join()
    assert woken == [True]
