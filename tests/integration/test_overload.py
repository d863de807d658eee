"""More than the worker takes: what is given up, in which order, that it is said, and that it ends by itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle

from tests.integration.harness import ADDRESSES, Listener, Sensor, make_config, report, running, wait_until

from aeroskein_service.keys import Keys
from aeroskein_service.transport import Session

# With a field that nobody knows, a batch is as large as one of 500 reports.
PADDING = "x" * 100_000
MANY = [f"{number:06X}" for number in range(0x400000, 0x400032)]


@contextmanager
def feeding(session: Session, keys: Keys) -> Iterator[None]:
    """One loud and one quiet sensor, until the end of the block."""
    over = threading.Event()
    loud, quiet = Sensor(session, keys), Sensor(session, keys, "radar1")

    def feed() -> None:
        for address in cycle(MANY):
            if over.wait(0.02):
                return
            now_s = time.time()
            loud.send([report(address, now_s, padding=PADDING)])
            quiet.send([{"time_s": now_s, "address": ADDRESSES[1], "range_m": 50_000.0, "azimuth_deg": 10.0}])

    thread = threading.Thread(target=feed)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_overload_is_said_thins_live_points_drops_of_the_loud_sensor_only_and_ends(tmp_path, endpoint, session, keys):
    # Given a worker that needs twice the time in which its input comes
    config = make_config(tmp_path, endpoint, keys.prefix, {"service.patience_s": 0.4})
    live = Listener(session, keys.feed("live"), recovering=True)
    with running(config) as service:
        engine, slow = service._engine, threading.Event()
        assert engine is not None
        receive = engine.receive

        def slowly(plots, *, now_s):
            if slow.is_set():
                time.sleep(0.2)
            return receive(plots, now_s=now_s)

        engine.receive = slowly
        lost = list[str]()
        engine.lost_input = lost.append
        slow.set()

        def overloaded() -> bool:
            return any(alarm.startswith("overloaded") for alarm in service.status["alarms"])

        # When both sensors send
        with feeding(session, keys):
            # Then live points are thinned and it is said, and the loud sensor loses batches
            wait_until(lambda: service.status and overloaded(), "the alarm")
            wait_until(lambda: service.status["sensors"]["adsb"]["dropped"] > 0, "drops")
            wait_until(lambda: engine._state.live.every_s == 4.0, "the last step of thinning")
            # And when the worker is fast again, so is everything, by itself
            slow.clear()
            wait_until(lambda: not overloaded() and engine._state.live.every_s == 0.0, "the end of it")
        wait_until(lambda: service.status["sensors"]["adsb"]["inbox"] == 0, "an empty inbox")
        sensors = service.status["sensors"]
    assert sensors["adsb"]["rejected"]["overload"] == sensors["adsb"]["dropped"]
    assert sensors["radar1"]["dropped"] == 0
    assert set(lost) == {"adsb"}
    # Thinned live points leave no hole in their numbers.
    points = [point for message in live.messages for point in message["points"]]
    for track in {point["track"] for point in points}:
        seqs = [point["seq"] for point in points if point["track"] == track]
        assert seqs == list(range(len(seqs)))
