"""Keys: what the contract spells, and nothing that Zenoh refuses."""

from __future__ import annotations

import pytest

from aeroskein_service.keys import Keys, default_instance, is_chunk, is_prefix, track_label

KEYS = Keys("atc/v1")


def test_keys_are_spelled_as_in_the_contract():
    assert KEYS.reports("radar1") == "atc/v1/reports/radar1"
    assert KEYS.reports_below("radar1") == "atc/v1/reports/radar1/**"
    assert KEYS.fused("live", "3C6444") == "atc/v1/fused/live/3C6444"
    assert KEYS.feed("element", "tower-1") == "atc/v1/feed/element/tower-1"
    assert KEYS.registration("radar1") == "atc/v1/registration/radar1"
    assert KEYS.status("tower-1") == "atc/v1/status/tower-1"
    assert KEYS.dispositions("adsb") == "atc/v1/debug/dispositions/adsb"
    assert KEYS.alive_fusion("tower-1") == "atc/v1/alive/fusion/1of1/tower-1"
    assert KEYS.alive("router", "tower-1") == "atc/v1/alive/router/tower-1"
    assert KEYS.query("tracks") == "atc/v1/query/tracks"
    assert KEYS.control("sensor", "adsb") == "atc/v1/control/sensor/adsb"


@pytest.mark.parametrize(
    ("key", "sensor"),
    [
        ("atc/v1/reports/adsb", "adsb"),
        ("atc/v1/reports/adsb/north/1", "adsb"),
        ("atc/v1/reports/adsb/@adv/pub/1/2/_", "adsb"),
        ("atc/v1/fused/live/3C6444", None),
        ("other/reports/adsb", None),
    ],
)
def test_sensor_is_the_chunk_after_reports(key, sensor):
    assert KEYS.sensor_of(key) == sensor


@pytest.mark.parametrize(
    ("label", "number", "expected"),
    [(0x3C6444, 7, "3C6444"), (0xA, 7, "00000A"), (-1, 123, "T000123"), (-1, 12_345_678, "T12345678")],
)
def test_track_is_named_by_its_address_or_its_number(label, number, expected):
    assert track_label(label, number) == expected


@pytest.mark.parametrize("text", ["", "a/b", "a*", "$a", "a?", "a#", "@a", "a b"])
def test_chunk_that_zenoh_would_not_take_is_refused(text):
    assert not is_chunk(text)
    assert not is_prefix(f"atc/{text}/v1") or text == "a/b"


def test_instance_of_a_process_is_a_chunk():
    assert is_chunk(default_instance())
