"""Questions over Zenoh: the dimension identifiers, their errors, and the operator's controls."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from tests.integration.harness import (
    ADDRESSES,
    Sensor,
    connect,
    flight,
    free_endpoint,
    make_config,
    report,
    running,
    wait_until,
)

from aeroskein_service.keys import Keys
from aeroskein_service.transport import Router, Session

KEYS = Keys("query/v1")
A, B, C = ADDRESSES


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """Three flights: A with a callsign, B fast and high, C without altitude."""
    endpoint = free_endpoint()
    config = make_config(tmp_path_factory.mktemp("query"), endpoint, KEYS.prefix)
    with Router(listen=[endpoint]), connect(endpoint) as session, running(config) as service:
        sensor, now_s = Sensor(session, KEYS), time.time()
        sensor.send([r | {"callsign": "DLH4AB"} for r in flight(A, now_s)])
        sensor.send([r | {"altitude_m": 12_000.0} for r in flight(B, now_s)])
        sensor.send([{k: v for k, v in r.items() if k != "altitude_m"} for r in flight(C, now_s)])
        wait_until(lambda: service.status and service.status["points"]["element"] >= 9, "elements")
        yield session


def ask(session: Session, what: str, parameters: str = "") -> dict[str, Any]:
    """The one good answer."""
    (answer,) = session.ask(KEYS.query(what) + (f"?{parameters}" if parameters else ""))
    assert answer.ok, answer.payload.decode()
    assert answer.encoding == "application/msgpack"
    message: dict[str, Any] = msgspec.msgpack.decode(answer.payload)
    assert message["version"] == 1
    return message


def refused(session: Session, selector: str) -> str:
    """The sentence with which a question is refused."""
    (answer,) = session.ask(f"{KEYS.prefix}/{selector}")
    assert not answer.ok
    return answer.payload.decode()


def tracks(session: Session, parameters: str = "") -> list[str]:
    return sorted(point["track"] for point in ask(session, "tracks", parameters)["tracks"])


def test_all_tracks_without_conditions(world):
    assert tracks(world) == sorted(ADDRESSES)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        (f"address={A.lower()},{B}", [A, B]),
        ("callsign=DLH4AB", [A]),
        ("callsign=DLH4AC", []),
        ("sensor=adsb", [A, B, C]),
        ("sensor=radar1", []),
        ("sensor=adsb,radar1", [A, B, C]),
        ("bbox=40,0,60,20", [A, B, C]),
        ("bbox=0,170,80,-170", []),
        ("bbox=0,5,80,-170", [A, B, C]),
        ("speed=150,250", [A, B, C]),
        ("speed=0,100", []),
        ("altitude=11000,13000", [B]),
        ("altitude=0,20000", [A, B]),
        (f"address={A},{B};altitude=11000,13000", [B]),
        (f"address={A};altitude=11000,13000", []),
        ("time=0,1", []),
    ],
)
def test_conditions_are_anded(world, parameters, expected):
    assert tracks(world, parameters) == sorted(expected)


def test_reports_come_by_sensor_as_they_were_sent(world):
    reply = ask(world, "reports", f"address={B}")
    assert list(reply["reports"]) == ["adsb"]
    reports = reply["reports"]["adsb"]
    assert len(reports) == 12
    assert {r["address"] for r in reports} == {B}
    assert all(r["altitude_m"] == 12_000.0 for r in reports)
    assert "truncated" not in reply


def test_time_span_limits_reports(world):
    newest_s = max(r["time_s"] for r in ask(world, "reports", f"address={A}")["reports"]["adsb"])
    some = ask(world, "reports", f"address={A};time={newest_s - 3.5},{newest_s}")["reports"]["adsb"]
    assert len(some) == 4


def test_limit_bounds_a_reply_and_says_so(world):
    reply = ask(world, "tracks", "limit=2")
    assert len(reply["tracks"]) == 2
    assert reply["truncated"] is True
    assert "truncated" not in ask(world, "tracks", "limit=3")
    reports = ask(world, "reports", "limit=5")
    assert sum(map(len, reports["reports"].values())) == 5
    assert reports["truncated"] is True


def test_elements_of_a_track_show_how_they_were_made(world):
    reply = ask(world, "elements", f"track={A}")
    assert reply["track"] == A
    assert 1 <= len(reply["elements"]) <= 20
    assert all(element for element in reply["elements"])


@pytest.mark.parametrize(
    ("selector", "name"),
    [
        ("query/tracks?adress=3C6444", "adress"),
        ("query/tracks?address=XYZ", "address"),
        ("query/tracks?sensor=radar9", "radar9"),
        ("query/tracks?bbox=1,2,3", "bbox"),
        ("query/tracks?bbox=60,0,40,20", "bbox"),
        ("query/tracks?speed=fast,200", "speed"),
        ("query/tracks?speed=200,100", "speed"),
        ("query/tracks?altitude=nan,5", "altitude"),
        ("query/tracks?limit=many", "limit"),
        ("query/tracks?limit=-1", "limit"),
        ("query/reports?time=5", "time"),
        ("query/elements", "track"),
        ("query/elements?track=FFFFFF", "FFFFFF"),
        ("query/elements?track=3C6444;limit=3", "limit"),
        ("control/sensor/adsb", "action"),
        ("control/sensor/adsb?action=maybe", "maybe"),
        ("control/sensor/adsb?action=off;now=1", "now"),
        ("control/registration/adsb?action=freeze", "radar"),
        ("control/registration/radar1?action=melt", "melt"),
        ("control/registration/radar1?action=set", "range_bias_m"),
        ("control/registration/radar1?action=set;range_bias_m=far", "range_bias_m"),
        ("control/registration/radar1?action=set;range_bias=5", "range_bias"),
        ("control/registration/radar1?action=freeze;range_bias_m=5", "range_bias_m"),
    ],
)
def test_bad_question_is_refused_with_the_name_of_what_is_wrong(world, selector, name):
    assert name in refused(world, selector)


def control(session: Session, what: str, parameters: str) -> dict[str, Any]:
    (answer,) = session.ask(f"{KEYS.prefix}/control/{what}?{parameters}")
    assert answer.ok, answer.payload.decode()
    message: dict[str, Any] = msgspec.msgpack.decode(answer.payload)
    return message


def test_registration_can_be_set_frozen_released_and_reset(world):
    state = control(world, "registration/radar1", "action=set;range_bias_m=120.5;azimuth_bias_deg=-0.2")
    assert (state["range_bias_m"], state["azimuth_bias_deg"]) == pytest.approx((120.5, -0.2))
    frozen = control(world, "registration/radar1", "action=freeze")
    assert frozen["state"] == "frozen"
    assert frozen["range_bias_m"] == pytest.approx(120.5)
    assert control(world, "registration/radar1", "action=release")["state"] != "frozen"
    assert control(world, "registration/radar1", "action=reset")["range_bias_m"] == 0.0


def test_sensor_that_is_off_is_not_used_until_it_is_on_again(tmp_path, endpoint, session, keys):
    with running(make_config(tmp_path, endpoint, keys.prefix)) as service:
        sensor, now_s = Sensor(session, keys), time.time()

        def counts() -> tuple[int, int]:
            state = service.status["sensors"]["adsb"] if service.status else {"accepted": 0, "rejected": {}}
            return state["accepted"], state["rejected"].get("sensor_off", 0)

        sensor.send(flight(A, now_s - 3.0))
        wait_until(lambda: counts() == (12, 0), "the first flight")
        for action, expected in (("off", (12, 1)), ("on", (13, 1))):
            (answer,) = session.ask(keys.control("sensor", "adsb") + f"?action={action}")
            assert msgspec.msgpack.decode(answer.payload)["action"] == action
            sensor.send([report(A, time.time())])
            wait_until(lambda expected=expected: counts() == expected, f"a report with the sensor {action}")
