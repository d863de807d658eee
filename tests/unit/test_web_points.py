"""Points of the feed become columns: quickly where they are built as the service builds them, right in any case."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.web_samples import NOW_S, messages, picture, show, tracks
from tests.wire_samples import SENSORS, fused_points

from aeroskein_service.codec import PointEncoder, encode_feed
from aeroskein_service.messages import FEED_POINTS, MSGPACK
from aeroskein_service.web.known_parts import UNKNOWN
from aeroskein_service.web.live_picture import NUMBERS
from aeroskein_service.web.live_points import read_point
from aeroskein_service.web.quick_points import BODY, START, TAIL, QuickReader, Read

NULLABLE = ("lat_deg", "altitude_m", "height_m", "ground_speed_mps", "vertical_rate_mps", "input_received_s")


def feed(points: list[bytes]) -> list[bytes]:
    """Points as messages of the feed."""
    starts = range(0, len(points), FEED_POINTS)
    return [encode_feed(points[k : k + FEED_POINTS], MSGPACK, epoch=1, seq=k) for k in starts]


def second_time(points: list[bytes]) -> Read:
    """Points that are read after they have been filled and learned once; each has a place and a tail of its own."""
    reader = QuickReader(NUMBERS, tail=1)
    read = reader.read(feed(points))
    for row in read.unknown():
        read.fill(row, row, (row + 1000,), (0.0,) * (len(NUMBERS) + 2))
    reader.learn(read, range(len(read)))
    again = reader.read(feed(points))
    assert again.numbers.shape == (len(NUMBERS) + 2, len(again))
    return again


@given(absent=st.lists(st.sets(st.sampled_from([*NULLABLE, "position_cov_m2"])), min_size=1, max_size=12))
def test_quick_reading_gives_the_numbers_that_reading_field_by_field_gives(absent):
    # Given points that lack different fields
    n = len(absent)
    columns: dict[str, Any] = {
        name: [np.nan if name in gone else 10.0 + k for k, gone in enumerate(absent)] for name in NULLABLE
    }
    columns["position_cov_m2"] = [[np.nan] * 3 if "position_cov_m2" in gone else [4.0, 1.0, 9.0] for gone in absent]
    payloads = PointEncoder(SENSORS, 1).encode(fused_points(n, **columns), NOW_S)
    # When both read them
    read = second_time(payloads)
    # Then all are read, and every number is the same
    assert read.places.tolist() == list(range(n))
    assert (read.tails >= 1000).all()
    for row, payload in enumerate(payloads):
        assert read.point(row) == payload
        slow = read_point(payload, MSGPACK)
        values = [getattr(slow, name) for name in NUMBERS[:-1]] + list(slow.position_cov_m2 or (None,) * 3)
        expected = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
        assert np.array_equal(read.numbers[:, row], expected, equal_nan=True)


@given(st.lists(st.binary(max_size=80), min_size=1, max_size=6))
def test_bytes_that_are_no_body_are_left_to_the_slow_way(bodies):
    head = PointEncoder(SENSORS, 1).encode(fused_points(1), NOW_S)[0].partition(BODY)[0]
    read = second_time([head + BODY + body + TAIL + b"rest" for body in bodies])
    assert (read.places == UNKNOWN).all() or any(b"\xcb" in body for body in bodies)


@given(st.lists(st.binary(min_size=1, max_size=80), min_size=1, max_size=6), st.sampled_from([b"", START]))
def test_bytes_that_are_no_point_are_left_to_the_slow_way(points, start):
    read = second_time([start + point for point in points])
    assert (read.places == UNKNOWN).all()
    assert len(read.left) + len(read.epochs) == len(feed(points))


@given(st.lists(st.binary(max_size=80), max_size=6))
def test_bytes_that_are_no_message_are_left_to_the_slow_way(payloads):
    read = QuickReader(NUMBERS, tail=1).read(payloads)
    assert (len(read), read.left) == (0, list(range(len(payloads))))


def test_body_with_an_integer_in_place_of_a_float_is_left_to_the_slow_way():
    point = msgspec.msgpack.decode(PointEncoder(SENSORS, 1).encode(fused_points(1), NOW_S)[0])
    read = second_time([msgspec.msgpack.encode(point | {"altitude_m": 10_000})])
    assert (read.places == UNKNOWN).all()


@given(st.lists(st.tuples(st.integers(0, 1500), st.binary(min_size=1, max_size=4)), min_size=1, max_size=3))
def test_changed_bytes_are_understood_as_the_slow_way_understands_them(changes):
    # Given a message that a picture has learned to read quickly, with some bytes changed
    points = tracks(3)
    payload = bytearray(messages(points)[0][0])
    for at, changed in changes:
        payload[at : at + len(changed)] = changed
    quick, slow = picture(), picture()
    for shown in (quick, slow):
        show(shown, points)
        show(shown, points)
    # When one picture reads it quickly and another field by field
    quick.note("feed", bytes(payload), MSGPACK)
    slow.note("feed", bytes(payload), f"{MSGPACK};slowly")
    for shown in (quick, slow):
        shown.drain()
    # Then both show the same, where the message is one
    if slow.broken == 0:
        assert quick.broken == 0
        assert quick.records(NOW_S).tobytes() == slow.records(NOW_S).tobytes()


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_second_message_about_a_track_is_read_as_the_first(encoding):
    # Given a picture that has seen every track once, so that it now reads quickly
    shown = picture()
    show(shown, tracks(120, altitude_m=np.arange(120.0)), encoding=encoding)
    before = shown.records(NOW_S)
    # When the same comes again, an altitude and a speed later
    show(shown, tracks(120, altitude_m=np.arange(120.0) + 7.0, ground_speed_mps=np.full(120, 99.0)), encoding=encoding)
    # Then only these have changed
    after = shown.records(NOW_S)
    assert np.allclose(after["altitude_m"] - before["altitude_m"], 7.0)
    assert set(after["speed"].tolist()) == {990}
    for name in ("number", "lat", "lon", "angle", "rate", "address", "callsign", "mode_a", "flags", "sensors"):
        assert np.array_equal(before[name], after[name]), name


def test_point_built_by_another_hand_is_understood():
    # Given a message of the contract with its fields in another order and whole numbers as integers
    payload, _ = messages(tracks(1))[0]
    feed = msgspec.msgpack.decode(payload)
    feed["points"] = [
        dict(reversed(point.items())) | {"altitude_m": 9000, "vertical_rate_mps": None} for point in feed["points"]
    ]
    shown = picture()
    # When it comes twice
    for _ in range(2):
        shown.note("feed", msgspec.msgpack.encode(feed), "application/msgpack")
        shown.drain()
    # Then it is shown
    record = shown.records(NOW_S)[0]
    assert record["altitude_m"] == 9000.0
    assert record["rate"] == -0x8000
    assert shown.broken == 0


@given(st.binary(max_size=200), st.sampled_from(["application/msgpack", "application/json", "text/plain", ""]))
def test_any_payload_is_read_or_counted_as_broken(payload, encoding):
    shown = picture()
    shown.note("feed", payload, encoding)
    shown.drain()
    assert len(shown) == 0


def test_broken_point_costs_only_itself():
    payload, encoding = messages(tracks(3))[0]
    feed = msgspec.msgpack.decode(payload)
    feed["points"][1]["time_s"] = "noon"
    shown = picture()
    shown.note("feed", msgspec.msgpack.encode(feed), encoding)
    shown.drain()
    assert (len(shown), shown.broken) == (2, 1)
