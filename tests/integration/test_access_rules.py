"""The locked router of deploy/secure by user name and password: its table of rights on a real router."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from tests.integration.harness import Listener, free_port, wait_until

from aeroskein_service.link import Link
from aeroskein_service.transport import Router, SensorPublisher, Session, open_session

FILE = Path(__file__).parents[2] / "deploy" / "secure" / "router-passwords.json5"
USERS = ("adsb", "radar1", "fusion", "consumer", "web", "operator", "stranger")
JSON = "application/json"


@pytest.fixture(scope="module")
def sessions(tmp_path_factory) -> Iterator[dict[str, Session]]:
    """Everybody's session at the locked router."""
    folder = tmp_path_factory.mktemp("locked")
    users, endpoint = folder / "users", f"tcp/127.0.0.1:{free_port()}"
    users.write_text("".join(f"{name}:secret-of-{name}\n" for name in USERS))
    text = FILE.read_text().replace("/run/aeroskein/users", str(users))
    path = folder / "router.json5"
    path.write_text(re.sub(r"tcp/0\.0\.0\.0:7447", endpoint, text))
    with ExitStack() as held:
        held.enter_context(Router(config_file=path))
        yield {
            name: held.enter_context(open_session(Link(connect=(endpoint,), user=name, password=f"secret-of-{name}")))
            for name in USERS
        }


def put_until_heard(session: Session, key: str, heard: Listener, mark: str) -> None:
    """Put until it arrives: a publisher has to learn of its subscriber first."""

    def arrives() -> bool:
        session.put(key, json.dumps({"mark": mark}).encode(), JSON)
        return any(message == {"mark": mark} for message in heard.messages)

    wait_until(arrives, f"{mark} at {key}")


def test_only_the_sensor_itself_puts_on_its_key(sessions):
    # Given the service's subscription, when everybody puts on a sensor's key and the sensor does so last
    heard = Listener(sessions["fusion"], "atc/v1/reports/adsb/**")
    for name in ("radar1", "consumer", "web", "operator", "stranger"):
        for _ in range(5):
            sessions[name].put("atc/v1/reports/adsb", json.dumps({"mark": name}).encode(), JSON)
    put_until_heard(sessions["adsb"], "atc/v1/reports/adsb", heard, "adsb")
    # Then only the sensor's has arrived
    assert {message["mark"] for message in heard.messages} == {"adsb"}


def test_only_the_service_publishes(sessions):
    heard = Listener(sessions["consumer"], "atc/v1/feed/**")
    # Not the consumer itself: what it puts reaches its own subscription without passing the router.
    for name in ("adsb", "web", "operator", "stranger"):
        for _ in range(5):
            sessions[name].put("atc/v1/feed/live/x", json.dumps({"mark": name}).encode(), JSON)
    put_until_heard(sessions["fusion"], "atc/v1/feed/live/x", heard, "fusion")
    assert {message["mark"] for message in heard.messages} == {"fusion"}


def test_service_gets_what_a_sensor_had_put_before_it_came(sessions):
    # Given a sensor with a cache, when the service comes later, then the hidden keys let the cache's content through
    publisher = SensorPublisher(sessions["radar1"], "atc/v1/reports/radar1/early", JSON)
    for number in range(10):
        publisher.put(json.dumps({"mark": number}).encode())
    heard: list[bytes] = []
    sessions["fusion"].subscribe_recovering(
        "atc/v1/reports/radar1/early/**", lambda _key, payload, _encoding: heard.append(payload), history=100
    )
    wait_until(lambda: len(heard) >= 10, "the cache")
    assert [json.loads(payload)["mark"] for payload in heard] == list(range(10))


@pytest.mark.parametrize("asks", ["consumer", "web"])
def test_consumer_asks_for_tracks_and_not_for_control(sessions, asks):
    for what in ("query/tracks", "query/reports", "control/sensor/adsb"):
        key = f"atc/v1/{what}"
        sessions["fusion"].answer(key, lambda question: question.reply(b"{}", JSON))
    wait_until(lambda: sessions[asks].ask("atc/v1/query/tracks"), "an answer")
    wait_until(lambda: sessions["operator"].ask("atc/v1/control/sensor/adsb"), "an answer for the operator")
    assert bool(sessions["web"].ask("atc/v1/query/reports"))
    assert sessions["consumer"].ask("atc/v1/query/reports") == []
    assert sessions[asks].ask("atc/v1/control/sensor/adsb") == []
