"""Dimension identifiers as text: understood, or refused with the parameter's name."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.selection import Selection
from aeroskein_service.selecting import SelectionError, parse_selection

SENSORS = ("adsb", "radar1")


def refusal(text: str) -> str:
    with pytest.raises(SelectionError) as caught:
        parse_selection(text, SENSORS)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", Selection()),
        ("address=3C6444,4ca2d6", Selection(addresses=frozenset({0x3C6444, 0x4CA2D6}))),
        ("callsign=DLH4AB", Selection(callsign="DLH4AB")),
        ("sensor=radar1", Selection(sensors=frozenset({1}))),
        ("sensor=adsb,radar1", Selection(sensors=frozenset({0, 1}))),
        ("bbox=48,11,49,12.5", Selection(bbox=(48.0, 11.0, 49.0, 12.5))),
        ("bbox=-10,170,10,-170", Selection(bbox=(-10.0, 170.0, 10.0, -170.0))),
        ("speed=50,300", Selection(speed_mps=(50.0, 300.0))),
        ("altitude=-100,1e4", Selection(altitude_m=(-100.0, 10_000.0))),
        ("time=1790000000,1790000600.5", Selection(time_s=(1_790_000_000.0, 1_790_000_600.5))),
        ("speed=5,5", Selection(speed_mps=(5.0, 5.0))),
    ],
)
def test_condition_is_understood(text, expected):
    assert parse_selection(text, SENSORS) == expected


def test_conditions_are_joined():
    selection = parse_selection("bbox=48,11,49,12; speed = 50,300 ;", SENSORS)

    assert selection == Selection(bbox=(48.0, 11.0, 49.0, 12.0), speed_mps=(50.0, 300.0))


def test_conditions_may_come_by_name():
    assert parse_selection({"sensor": "adsb"}, SENSORS) == Selection(sensors=frozenset({0}))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sped=1,2", "sped: unknown parameter, expected one of address, callsign, sensor, bbox"),
        ("sensor=radar9", "sensor: unknown sensor 'radar9', expected one of adsb, radar1"),
        ("sensor=", "sensor: expected sensor ids"),
        ("sensor=adsb,,radar1", "sensor: expected sensor ids"),
        ("address=3C644", "address: '3C644' is no address"),
        ("address=", "address: expected ICAO addresses"),
        ("callsign=", "callsign: expected 1 to 8 characters"),
        ("callsign=DLH123456", "callsign: expected 1 to 8 characters"),
        ("speed=fast,300", "speed: 'fast' is not a number"),
        ("speed=nan,300", "speed: 'nan' is not a number"),
        ("speed=0,inf", "speed: 'inf' is not a number"),
        ("speed=50", "speed: expected min,max in m/s, got '50'"),
        ("speed=1,2,3", "speed: expected min,max in m/s"),
        ("speed=300,50", "speed: the minimum 300 is above the maximum 50"),
        ("altitude=2,1", "altitude: the minimum 2 is above the maximum 1"),
        ("time=2,1", "time: the minimum 2 is above the maximum 1"),
        ("time=,", "time: '' is not a number"),
        ("bbox=48,11,49", "bbox: expected lat_min,lon_min,lat_max,lon_max"),
        ("bbox=49,11,48,12", "bbox: lat_min 49 is above lat_max 48"),
        ("bbox=48,11,91,12", "bbox: lat 91 is outside -90 to 90"),
        ("bbox=48,-181,49,12", "bbox: lon -181 is outside -180 to 180"),
        ("speed=1,2;speed=3,4", "speed: stands twice"),
        ("speed", "speed: expected name=value"),
    ],
)
def test_condition_that_is_not_understood_is_refused_by_its_name(text, expected):
    assert refusal(text).startswith(expected)


def test_refusal_of_a_long_value_is_short():
    assert len(refusal("speed=" + "9" * 10_000)) < 200


@given(st.text(max_size=60))
def test_any_text_is_a_selection_or_a_refusal(text):
    with contextlib.suppress(SelectionError):
        assert isinstance(parse_selection(text, SENSORS), Selection)
