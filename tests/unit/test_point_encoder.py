"""Fused points to bytes: names on keys, nulls, flags, caches."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest
from tests.wire_samples import NOW_S, SENSORS, fused_points

from aeroskein.points import Flag, Product, Status
from aeroskein_service import point_encoder
from aeroskein_service.codec import MessageError, PointEncoder, decode_feed, decode_point, encode_feed
from aeroskein_service.messages import FLAG_NAMES, FUSED_FIELDS, STATUS_NAMES

ENCODER = PointEncoder(SENSORS, 1_790_000_000_000)


def first(points, encoder=ENCODER):
    payload = encoder.encode(points, published_s=NOW_S + 1.0)[0]
    return json.loads(payload) if encoder.content_type.endswith("json") else msgspec.msgpack.decode(payload)


def test_point_has_every_field_of_the_contract_and_no_other():
    assert tuple(sorted(first(fused_points()))) == tuple(sorted(set(FUSED_FIELDS) - {"renamed_to"}))


def test_live_point_as_the_contract_writes_it():
    assert first(fused_points()) == {
        "version": 1, "product": "live", "track": "3C6444", "track_number": 123, "address": "3C6444",
        "callsign": "DLH4AB", "mode_a": "7000", "epoch": 1_790_000_000_000, "seq": 7, "time_s": NOW_S,
        "published_s": NOW_S + 1.0, "lat_deg": 48.1, "lon_deg": 11.5, "altitude_m": 10_000.0, "height_m": 10_090.0,
        "ground_speed_mps": 230.0, "track_angle_deg": 91.5, "vertical_rate_mps": -0.5,
        "position_cov_m2": [25.0, 1.5, 24.0], "velocity_cov_m2ps2": [0.5, -0.1, 0.4], "status": "confirmed",
        "element": None, "span_s": None, "master": "adsb", "sources": {"adsb": 4, "radar1": 1}, "rejected": 2,
        "input_received_s": NOW_S + 0.4, "flags": [],
    }  # fmt: skip


def test_element_point_has_its_span_and_no_arrival():
    point = first(fused_points(product=Product.ELEMENT))

    assert (point["product"], point["element"], point["span_s"]) == ("element", 41, [NOW_S - 4.0, NOW_S])
    assert point["input_received_s"] is None


def test_point_of_a_track_without_address_is_named_by_its_number():
    point = first(fused_points(label=[-1], address=[-1], mode_a=[-1], callsign=[b""]))

    assert (point["track"], point["address"], point["mode_a"], point["callsign"]) == ("T000123", None, None, None)


def test_duplicate_of_an_address_keeps_its_number_as_its_name():
    point = first(fused_points(label=[-1], flags=[Flag.DUPLICATE_ADDRESS]))

    assert (point["track"], point["address"], point["flags"]) == ("T000123", "3C6444", ["duplicate_address"])


def test_renamed_track_says_its_new_name():
    point = first(fused_points(label=[-1], renamed_to=[0x00000A]))

    assert (point["track"], point["renamed_to"]) == ("T000123", "00000A")


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_number_that_is_none_is_sent_as_null(encoding, value):
    point = first(fused_points(altitude_m=[value]), PointEncoder(SENSORS, 1, encoding))

    assert point["altitude_m"] is None


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_covariance_with_a_gap_is_sent_as_null(encoding):
    point = first(fused_points(position_cov_m2=[[1.0, np.nan, 1.0]]), PointEncoder(SENSORS, 1, encoding))

    assert point["position_cov_m2"] is None


def test_every_flag_has_its_name_in_order_of_its_bit():
    assert tuple(flag.name.lower() for flag in Flag) == FLAG_NAMES
    assert first(fused_points(flags=[sum(Flag)]))["flags"] == list(FLAG_NAMES)


def test_every_status_has_its_name():
    assert tuple(status.name.lower() for status in Status) == STATUS_NAMES


def test_labels_are_the_tracks_of_the_points():
    points = fused_points(2, label=[-1, 0xABC])

    assert ENCODER.label(points) == ["T000123", "000ABC"]


def test_number_beyond_six_digits_is_written_in_full():
    assert ENCODER.label(fused_points(label=[-1], track_number=[12_345_678])) == ["T12345678"]


def test_no_points_give_no_bytes():
    assert ENCODER.encode(fused_points(0), published_s=NOW_S) == []


def test_identity_that_changes_is_not_served_from_the_cache():
    encoder = PointEncoder(SENSORS, 1)
    first(fused_points(callsign=[b"OLD"]), encoder)

    point = first(fused_points(callsign=[b"NEW"], mode_a=[0o0001], status=[Status.COASTING]), encoder)

    assert (point["callsign"], point["mode_a"], point["status"]) == ("NEW", "0001", "coasting")


def test_many_tracks_do_not_grow_the_caches(monkeypatch):
    monkeypatch.setattr(point_encoder, "CACHE_ENTRIES", 10)
    encoder = PointEncoder(SENSORS, 1)

    payloads = encoder.encode(fused_points(35, sources=np.arange(105).reshape(35, 3)), published_s=NOW_S)

    assert [msgspec.msgpack.decode(payload)["track_number"] for payload in payloads] == list(range(123, 158))
    assert len(encoder._tails) <= 10


def test_more_than_fifty_points_are_no_feed_message():
    with pytest.raises(ValueError, match="51 points"):
        encode_feed([b"\xc0"] * 51, "application/msgpack", epoch=1, seq=1)


@pytest.mark.parametrize("decoder", [decode_point, decode_feed])
@pytest.mark.parametrize(
    ("payload", "encoding"),
    [
        (b"", "application/msgpack"),
        (b"{}", "application/json"),
        (b"[" * 100_000, "application/json"),
        (b"{}", "text/x"),
    ],
)
def test_payload_that_is_no_point_is_a_message_error(decoder, payload, encoding):
    with pytest.raises(MessageError):
        decoder(payload, encoding)
