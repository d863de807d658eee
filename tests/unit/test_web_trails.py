"""Trails, and recorded pictures: where every aircraft was at any instant."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.web_samples import NOW_S, messages, records, tracks

from aeroskein.points import Product
from aeroskein_service.web.recorded import ENDED_S, HOLD_S, LiveRows, RecordedPicture
from aeroskein_service.web.sensor_table import SensorTable
from aeroskein_service.web.trails import POINT, POINTS, TrailStore, chosen_numbers


def store(*lots: dict, epoch: int = 1000) -> TrailStore:
    made = TrailStore(SensorTable())
    for columns in lots:
        for payload, encoding in messages(tracks(product=Product.ELEMENT, **columns), epoch=epoch):
            made.note("feed", payload, encoding)
    made.drain()
    return made


def unpacked(packed: bytes) -> dict[int, list[tuple[float, float]]]:
    version, count = struct.unpack_from("<II", packed)
    assert version == 1
    made, at = {}, 8 + 8 * count
    for k in range(count):
        number, n = struct.unpack_from("<II", packed, 8 + 8 * k)
        made[number] = [tuple(v * 1e-7 for v in struct.unpack_from("<ii", packed, at + 8 * i)) for i in range(n)]
        at += 8 * n
    assert at == len(packed)
    return made


def test_trail_is_the_points_of_the_elements_in_order():
    lots = [{"n": 2, "time_s": np.full(2, NOW_S + 4.0 * k), "lat_deg": [50.0 + k, 10.0]} for k in range(5)]
    trail = store(*lots).of_track(123)
    assert trail["lat_deg"] == pytest.approx([50.0, 51.0, 52.0, 53.0, 54.0])
    assert trail["time_s"] == [NOW_S + 4.0 * k for k in range(5)]


def test_trail_keeps_its_newest_points():
    lots = [{"n": 1, "time_s": [NOW_S + k], "element": [k]} for k in range(POINTS + 10)]
    trail = store(*lots).of_track(123)
    assert trail["element"] == list(range(10, POINTS + 10))


def test_trails_of_a_box_go_back_so_many_seconds():
    made = store(*({"n": 2, "time_s": np.full(2, NOW_S + 4.0 * k), "lat_deg": [50.0, 10.0]} for k in range(6)))
    shown = records([50.0, 10.0], [11.5, 11.5], number=[123, 124])
    trails = unpacked(made.packed(chosen_numbers(shown, (40.0, 0.0, 60.0, 20.0)), 9.0, 100))
    assert {number: len(points) for number, points in trails.items()} == {123: 3}
    assert trails[123][0] == pytest.approx((50.0, 11.5))


def test_trails_are_those_of_the_tracks_that_were_chosen():
    shown = records([50.0, 10.0], [11.5, 11.5], number=[123, 124])
    assert chosen_numbers(shown, None) == [123, 124]
    assert chosen_numbers(shown, frozenset({124, 999})) == [124]
    assert chosen_numbers(shown, (0.0, 0.0, 20.0, 20.0)) == [124]


def test_trail_of_an_earlier_service_is_not_continued():
    made = store({"n": 1, "time_s": [NOW_S]})
    for payload, encoding in messages(tracks(1, Product.ELEMENT, time_s=[NOW_S + 60.0]), epoch=2000):
        made.note("feed", payload, encoding)
    made.drain()
    assert made.of_track(123)["time_s"] == [NOW_S + 60.0]


def test_trail_of_a_track_that_is_gone_is_forgotten():
    made = store({"n": 3})
    made.keep_only({124})
    assert [len(made.of_track(number)["time_s"]) for number in (123, 124, 125)] == [0, 1, 0]


# -- recorded pictures -------------------------------------------------------------------------------------------------
def recorded(
    number: list[int], time_s: list[float], contributes_s: tuple[float, ...] = (), **columns
) -> RecordedPicture:
    n = len(number)
    rows = records([48.0] * n, [11.0] * n, **({"number": number} | columns))
    none = np.zeros(0, dtype=np.int64)
    epoch = np.full(n, 7, dtype=np.int64)
    live = LiveRows(rows, NOW_S + np.array(time_s), epoch)
    return RecordedPicture(live, np.array(contributes_s), np.zeros(0, dtype=POINT), none, none)


@settings(max_examples=60)
@given(
    rows=st.lists(st.tuples(st.integers(1, 4), st.floats(0, 60), st.integers(1, 3)), min_size=1, max_size=30),
    at=st.floats(-5, 80),
)
def test_picture_of_an_instant_is_the_newest_state_of_every_track_that_still_holds(rows, at):
    number, time_s, status = (list(column) for column in zip(*rows, strict=True))
    picture = recorded(number, time_s, altitude_m=np.arange(len(rows)), status=status)
    # The same one by one
    expected = {}
    for track in set(number):
        states = [(NOW_S + t, k) for k, (m, t, _) in enumerate(rows) if m == track and NOW_S + t <= NOW_S + at]
        if states:
            newest = max(states)
            hold = ENDED_S if status[newest[1]] == 3 else HOLD_S
            if NOW_S + at - newest[0] <= hold - 1e-6:
                expected[track] = newest[0]
    shown = picture.at(NOW_S + at)
    found = {int(r["number"]): NOW_S + at - r["age"] * 0.01 for r in shown}
    assert set(expected) <= set(found)
    for track, when in found.items():
        if track in expected:
            assert when == pytest.approx(expected[track], abs=0.006)
        else:
            assert NOW_S + at - when >= min(HOLD_S, ENDED_S) - 0.01


def test_sensor_counts_as_contributing_while_its_last_report_is_young():
    picture = recorded([1] * 6, [0, 1, 2, 3, 4, 5], (2.0, 1.0), sensors=[0b11, 0b01, 0b00, 0b00, 0b00, 0b10])
    seen = [int(picture.at(NOW_S + t)["sensors"][0]) for t in range(6)]
    assert seen == [0b11, 0b11, 0b01, 0b01, 0b00, 0b10]


def test_track_of_a_name_is_the_one_that_had_it_then():
    picture = recorded([1, 2], [0.0, 100.0], address=[0x400000] * 2, named=[1, 1])
    assert picture.epoch_and_number(picture.track_at("400000", NOW_S + 1.0)) == (7, 1)
    assert picture.epoch_and_number(picture.track_at("400000", NOW_S + 100.0)) == (7, 2)
    assert picture.track_at("4CA2D6", NOW_S) is None


def test_trail_of_a_recorded_track_ends_at_the_instant():
    picture = recorded([1] * 10, list(range(10)))
    trail = picture.trail(0, NOW_S + 6.0, 3.0)
    assert (trail["time_s"] - NOW_S).tolist() == [3.0, 4.0, 5.0, 6.0]
