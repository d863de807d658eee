"""What the page knows of the service: its newest status, rates, registration, and how long it has been silent."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.web_samples import NOW_S, Clock

from aeroskein_service.web.sensor_table import MOST_SENSORS, SensorTable
from aeroskein_service.web.service_watch import ServiceWatch


def status(instance: str = "one", at_s: float = NOW_S, accepted: int = 0, started_s: float = NOW_S - 100.0) -> bytes:
    state = {"accepted": accepted, "rejected": {"outlier": accepted // 10}, "latency_s": 0.4, "inbox": 2}
    message = {
        "version": 1,
        "instance": instance,
        "time_s": at_s,
        "started_s": started_s,
        "sensors": {"adsb": state},
        "alarms": [],
    }
    return msgspec.json.encode(message)


def registration(sensor: str = "radar1", **changes: Any) -> bytes:
    fields = ("range_bias_m", "azimuth_bias_deg", "time_bias_s", "range_bias_sigma_m", "azimuth_bias_sigma_deg",
              "time_bias_sigma_s", "range_gain", "range_gain_sigma")  # fmt: skip
    state = dict.fromkeys(fields, 1.0) | {
        "sensor": sensor,
        "time_s": NOW_S,
        "state": "converged",
        "samples": 9,
        "aircraft": 3,
    }
    return msgspec.msgpack.encode(state | changes)


def test_rates_are_what_was_counted_between_two_statuses():
    clock = Clock()
    watch = ServiceWatch(SensorTable(), clock)
    for seconds, accepted in ((0.0, 100), (2.0, 300)):
        clock.now_s = NOW_S + seconds
        watch.note_status("", status(at_s=clock.now_s, accepted=accepted), "")
        watch.turn(clock.now_s)
    rates = watch.report(clock.now_s)["rates"]["sensors"]["adsb"]
    assert rates["accepted_per_s"] == pytest.approx(100.0)
    assert rates["rejected_per_s"] == pytest.approx(10.0)
    assert len(watch.history()["rates"]) == 1


def test_restarted_service_takes_over_and_gives_no_negative_rate():
    clock = Clock()
    watch = ServiceWatch(SensorTable(), clock)
    watch.note_status("", status("old", accepted=1000), "")
    watch.turn(clock.now_s)
    clock.now_s += 1.0
    watch.note_status("", status("new", clock.now_s, 5, started_s=clock.now_s), "")
    watch.turn(clock.now_s)
    assert watch.current["instance"] == "new"
    assert watch.report(clock.now_s)["rates"] is None


def test_silence_is_counted_from_the_last_status():
    clock = Clock()
    watch = ServiceWatch(SensorTable(), clock)
    watch.note_status("", status(), "")
    watch.turn(NOW_S)
    assert watch.silent_s(NOW_S + 7.0) == 7.0
    assert watch.report(NOW_S + 7.0)["heard"] is True


def test_service_that_was_never_heard_is_silent_since_the_page_began():
    watch = ServiceWatch(SensorTable(), Clock())
    watch.turn(NOW_S)
    assert watch.silent_s(NOW_S + 3.0) == 3.0
    assert watch.report(NOW_S)["heard"] is False


def test_sensor_with_a_registration_state_is_a_radar():
    table = SensorTable()
    watch = ServiceWatch(table, Clock())
    watch.note_registration("", registration(range_bias_m=80.0), "application/msgpack")
    assert [(s["id"], s["radar"]) for s in table.describe()] == [("radar1", True)]
    assert watch.report(NOW_S)["registration"]["radar1"]["range_bias_m"] == 80.0


@given(st.binary(max_size=100), st.sampled_from(["application/json", "application/msgpack", "?"]))
def test_any_payload_is_taken_or_counted(payload, encoding):
    watch = ServiceWatch(SensorTable(), Clock())
    watch.note_status("", payload, encoding)
    watch.note_registration("", payload, encoding)
    watch.turn(NOW_S)
    assert watch.broken == 2


def test_more_sensors_than_bits_share_the_last_one():
    table = SensorTable()
    assert [table.index(f"s{k}") for k in range(MOST_SENSORS + 3)] == [*range(MOST_SENSORS), *[MOST_SENSORS - 1] * 3]
    assert len(table.describe()) == MOST_SENSORS
