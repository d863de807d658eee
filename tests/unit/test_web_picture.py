"""The live picture: what it shows of a track, how long, and under which name."""

from __future__ import annotations

import numpy as np
import pytest
from tests.web_samples import NOW_S, Clock, picture, show, tracks

from aeroskein.settings import SensorSettings
from aeroskein_service.web.records import NAMED_BY_ADDRESS, UNKNOWN_ADDRESS, UNKNOWN_ANGLE, record_label
from aeroskein_service.web.sensor_table import SensorTable

TERMINATED = 3


def test_record_holds_what_the_point_says():
    shown = picture()
    show(shown, tracks(1, lat_deg=[-33.5], lon_deg=[151.25], position_cov_m2=[[9.0, 0.0, 25.0]], mode_a=[0o7700]))
    record = shown.records(NOW_S + 1.5)[0]
    assert record["lat"] * 1e-7 == pytest.approx(-33.5, abs=1e-7)
    assert record["lon"] * 1e-7 == pytest.approx(151.25, abs=1e-7)
    assert record["sigma_m"] == 5.0
    assert record["speed"] * 0.1 == pytest.approx(230.0)
    assert record["angle"] * 360.0 / 65536.0 == pytest.approx(91.5, abs=0.003)
    assert record["rate"] * 0.01 == pytest.approx(-0.5)
    assert record["age"] * 0.01 == pytest.approx(1.5)
    assert (record["mode_a"], record["address"], record["callsign"]) == (0o7700, 0x400000, b"DLH4AB")
    assert record["named"] == NAMED_BY_ADDRESS
    assert record_label(record) == "400000"


def test_track_without_address_is_called_by_its_number():
    shown = picture()
    show(shown, tracks(1, label=[-1], address=[-1], track_number=[42]))
    record = shown.records(NOW_S)[0]
    assert (record["address"], record_label(record)) == (UNKNOWN_ADDRESS, "T000042")
    assert shown.point("T000042").track_number == 42


def test_unknown_velocity_is_marked_as_unknown():
    shown = picture()
    show(shown, tracks(1, ground_speed_mps=[np.nan], track_angle_deg=[np.nan]))
    assert shown.records(NOW_S)[0]["speed"] == UNKNOWN_ANGLE


def test_track_keeps_its_row_when_it_is_renamed():
    shown = picture()
    show(shown, tracks(1, label=[-1], address=[-1], track_number=[7]))
    show(shown, tracks(1, track_number=[7]))
    assert len(shown) == 1
    assert record_label(shown.records(NOW_S)[0]) == "400000"
    assert shown.point("T000007") is None


def test_terminated_track_goes_after_a_moment():
    clock = Clock()
    shown = picture(clock)
    show(shown, tracks(2, status=[1, TERMINATED]))
    shown.prune()
    assert len(shown) == 2
    clock.now_s += 6.0
    shown.prune()
    assert shown.numbers() == {123}


def test_tracks_of_a_silent_service_stay_frozen():
    clock = Clock()
    shown = picture(clock)
    show(shown, tracks(3))
    clock.now_s += 3600.0
    shown.prune()
    assert len(shown) == 3
    assert shown.silent_s == 3600.0


def test_tracks_of_an_earlier_service_go_when_another_has_taken_over():
    clock = Clock()
    shown = picture(clock)
    show(shown, tracks(3), epoch=1000)
    clock.now_s += 5.0
    # When a service that was started later speaks, with numbers from the beginning
    show(shown, tracks(1, time_s=[clock.now_s], altitude_m=[1.0]), epoch=2000)
    shown.prune()
    # Then only its track is left, though it has the number of an earlier one
    assert shown.numbers() == {123}
    assert shown.records(clock.now_s)["altitude_m"].tolist() == [1.0]


def test_track_that_the_service_has_forgotten_goes_in_the_end():
    clock = Clock()
    shown = picture(clock)
    show(shown, tracks(2))
    clock.now_s += 61.0
    show(shown, tracks(1, time_s=[clock.now_s]))
    shown.prune()
    assert shown.numbers() == {123}


def test_sensor_contributes_for_two_and_a_half_of_its_periods():
    radar = SensorSettings(id="radar1", kind="ssr", lat_deg=48.0, lon_deg=11.0, height_m=400.0, period_s=8.0)
    clock, table = Clock(), SensorTable([SensorSettings(id="adsb", kind="adsb"), radar])
    shown = picture(clock, table)
    show(shown, tracks(1, sources=[[1, 1, 0]]))
    assert shown.records(NOW_S + 4.0)["sensors"].tolist() == [0b11]
    assert shown.records(NOW_S + 19.0)["sensors"].tolist() == [0b10]
    assert shown.records(NOW_S + 21.0)["sensors"].tolist() == [0]


def test_more_tracks_than_expected_have_room():
    shown = picture()
    show(shown, tracks(3000))
    assert sorted(shown.records(NOW_S)["number"].tolist()) == list(range(123, 3123))


def test_search_finds_by_callsign_address_number_and_code_best_first():
    shown = picture()
    show(shown, tracks(3, callsign=[b"SKN123", b"XSKN12", b"OTHER"], mode_a=[0o1000, 0o2000, 0o7700]))
    assert [t["callsign"] for t in shown.find("skn12", 10)] == ["SKN123", "XSKN12"]
    assert [t["track"] for t in shown.find("400002", 10)] == ["400002"]
    assert [t["callsign"] for t in shown.find("7700", 10)] == ["OTHER"]
    assert len(shown.find("4000", 2)) == 2
    assert shown.find("nobody", 10) == []
