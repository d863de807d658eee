"""What the service says about itself: counters, alarms, metrics, stage times, and warnings that do not flood."""

from __future__ import annotations

import numpy as np
import pytest

from aeroskein.plots import Plots
from aeroskein.reasons import Reason
from aeroskein.settings import SensorSettings
from aeroskein_service.complaints import Complaints
from aeroskein_service.http import ListenError, bind
from aeroskein_service.metrics import Metrics
from aeroskein_service.stage_clock import StageClock
from aeroskein_service.status import Counters, is_fresh, sensor_alarms

SENSORS = (
    SensorSettings(id="adsb", kind="adsb"),
    SensorSettings(id="radar1", kind="ssr", lat_deg=48.0, lon_deg=11.0, height_m=400.0, period_s=8.0),
)


def per_sensor(counters: Counters, dropped=(0, 0)):
    return counters.per_sensor([0, 0], list(dropped))


def test_counts_go_to_their_sensor_and_reason():
    counters = Counters(SENSORS)
    counters.reports[0, Reason.ACCEPTED] += 5
    counters.reject(1, Reason.OUTLIER, 2)
    counters.reject(1, Reason.BAD_ENCODING)
    states = per_sensor(counters)
    assert (states["adsb"]["accepted"], states["adsb"]["rejected"]) == (5, {})
    assert (states["radar1"]["accepted"], states["radar1"]["rejected"]) == (0, {"outlier": 2, "bad_encoding": 1})


def test_dropped_batches_count_as_overload_once():
    counters = Counters(SENSORS)
    for dropped in ([3, 0], [3, 0], [5, 1]):
        counters.drop(dropped)
    assert counters.reports[:, Reason.OVERLOAD].tolist() == [5, 1]


def test_latency_is_the_mean_age_on_arrival_since_the_last_look():
    counters = Counters(SENSORS)
    sensor = np.array([0, 0, 1])
    counters.see(Plots.of(3, sensor=sensor, time_s=[10.0, 11.0, 12.0], received_s=[10.5, 12.5, 15.0]))
    first = per_sensor(counters)
    assert (first["adsb"]["latency_s"], first["radar1"]["latency_s"]) == (1.0, 3.0)
    assert (first["adsb"]["last_report_s"], first["radar1"]["last_report_s"]) == (12.5, 15.0)
    # A sensor that was silent keeps its last value
    counters.see(Plots.of(1, sensor=0, time_s=20.0, received_s=20.25))
    second = per_sensor(counters)
    assert (second["adsb"]["latency_s"], second["radar1"]["latency_s"]) == (0.25, 3.0)


def test_sensor_without_reports_has_no_latency():
    assert per_sensor(Counters(SENSORS))["adsb"]["latency_s"] is None


def test_freshness_goes_by_the_sensors_own_period():
    adsb, radar = SENSORS
    assert is_fresh(adsb, 100.0, 110.0)
    assert not is_fresh(adsb, 100.0, 110.1)
    assert is_fresh(radar, 100.0, 124.0)
    assert not is_fresh(adsb, None, 0.0)


def test_alarms_name_silent_and_flooding_sensors():
    counters = Counters(SENSORS)
    counters.see(Plots.of(1, sensor=0, time_s=99.0, received_s=100.0))
    before, now = per_sensor(counters), per_sensor(counters, dropped=(7, 0))
    alarms = sensor_alarms(SENSORS, now, before, now_s=105.0, started_s=50.0)
    assert alarms == [
        "adsb sends faster than the service works: 7 batches dropped so far",
        "no report from radar1 for 55 s",
    ]


def status():
    counters = Counters(SENSORS)
    counters.reject(1, Reason.OUTLIER, 2)
    return {
        "started_s": 1.0,
        "sensors": per_sensor(counters),
        "tracks": {"confirmed": 4},
        "points": {"live": 9},
        "stages_us": {"decode": 1.5},
        "alarms": ["something"],
    }


def test_metrics_show_the_status():
    text = Metrics(status, lambda: True).text().decode()
    for line in (
        'aeroskein_reports_rejected_total{reason="outlier",sensor="radar1"} 2.0',
        'aeroskein_stage_seconds{stage="decode"} 1.5e-06',
        "aeroskein_tracks_confirmed 4.0",
        "aeroskein_points_live_total 9.0",
        "aeroskein_router_connected 1.0",
        "aeroskein_alarms 1.0",
    ):
        assert line in text.splitlines()


def test_metrics_have_no_labels_but_sensor_reason_and_stage():
    for line in Metrics(status, lambda: True).text().decode().splitlines():
        if line.startswith("aeroskein_") and "{" in line:
            labels = {part.partition("=")[0] for part in line.partition("{")[2].partition("}")[0].split(",")}
            assert labels <= {"sensor", "reason", "stage"}, line


def test_metrics_before_the_first_status_say_that_there_is_no_router():
    assert "aeroskein_router_connected 0.0" in Metrics(lambda: None, lambda: False).text().decode()


def test_stage_times_are_means_since_the_last_look():
    clock = StageClock()
    clock.add("decode", 4_000, 2)
    clock.add("decode", 8_000, 2)
    clock.add("advance", 5_000, 0)
    assert clock.take_us() == {"decode": 3.0}
    # Time spent while nothing came out is booked on the next that does
    clock.add("advance", 5_000, 4)
    assert clock.take_us() == {"decode": 3.0, "advance": 2.5}


class Log:
    def __init__(self) -> None:
        self.lines: list[tuple[str, dict]] = []

    def warning(self, event: str, **details) -> None:
        self.lines.append((event, details))


def test_same_complaint_is_made_once_in_ten_seconds_and_says_what_was_held_back():
    log, now = Log(), [0.0]
    complaints = Complaints(log, clock=lambda: now[0])
    for now_s in (0.0, 1.0, 9.9, 10.0):
        now[0] = now_s
        complaints.warn("batch_rejected", sensor="adsb")
    complaints.warn("batch_rejected", sensor="radar1")
    assert [(details["sensor"], details["not_shown"]) for _, details in log.lines] == [
        ("adsb", 0),
        ("adsb", 2),
        ("radar1", 0),
    ]


@pytest.mark.parametrize("listen", ["8080", "localhost:", "localhost:http", "127.0.0.1:70000"])
def test_address_that_is_none_is_named(listen):
    with pytest.raises(ListenError, match=r"http\.listen"):
        bind(listen).close()


def test_free_port_is_found_and_a_taken_one_is_named():
    with bind("127.0.0.1:0") as taken:
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(ListenError, match=f"cannot listen at {where}: address already in use"):
            bind(where)
