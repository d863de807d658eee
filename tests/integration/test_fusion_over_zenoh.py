"""Reports put on Zenoh come back as fused points: on the track's key, in the feed, counted in the status."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import pytest
from tests.integration.harness import (
    ADDRESSES,
    Listener,
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
from aeroskein_service.transport import Router

KEYS = Keys("flown/v1")
PRODUCTS = ("live", "element")


class Flown(NamedTuple):
    """What consumers got while three aircraft flew: twelve seconds at once, then some batches live."""

    on_keys: dict[str, list[tuple[str, Any]]]
    in_feed: dict[str, list[Any]]
    status: list[Any]
    last_status: dict[str, Any]
    registration: list[Any]
    alive: tuple[list[str], list[str]]
    instance: str


def points_of(messages: list[Any]) -> list[Any]:
    return [point for message in messages for point in message["points"]]


@pytest.fixture(scope="module", params=["msgpack", "json"])
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flown]:
    endpoint = free_endpoint()
    config = make_config(tmp_path_factory.mktemp("flown"), endpoint, KEYS.prefix, {"output.encoding": request.param})
    with Router(listen=[endpoint]), connect(endpoint) as session:
        on_keys = {product: Listener(session, KEYS.fused(product, "*")) for product in PRODUCTS}
        feeds = {product: Listener(session, KEYS.feed(product), recovering=True) for product in PRODUCTS}
        status, registration = Listener(session, KEYS.status()), Listener(session, KEYS.registration("radar1"))
        with running(config) as service:
            alive = session.alive(KEYS.alive_fusion())
            sensor, now_s = Sensor(session, KEYS), time.time()
            for address in ADDRESSES:
                sensor.send(flight(address, now_s))
            for _ in range(4):
                time.sleep(0.2)
                sensor.send([report(address, time.time()) for address in ADDRESSES])
            for listener in on_keys.values():
                listener.wait_for(lambda points: len(points) >= 12, "points")
            status.wait_for(lambda states: states and states[-1]["sensors"]["adsb"]["accepted"] == 48, "all reports")
        wanted: Any = service.status["points"] if service.status else {}
        for product in PRODUCTS:
            on_keys[product].wait_for(lambda points, n=wanted[product]: len(points) == n, f"all {product} points")
            feeds[product].wait_for(lambda batches, n=wanted[product]: len(points_of(batches)) == n, "the whole feed")
        status.wait_for(lambda states: states[-1] == service.status, "the last status")
        wait_until(lambda: not session.alive(KEYS.alive_fusion()), "the token to go")
        yield Flown(
            {product: listener.received for product, listener in on_keys.items()},
            {product: listener.messages for product, listener in feeds.items()},
            status.messages,
            dict(service.status or {}),
            registration.messages,
            (alive, session.alive(KEYS.alive_fusion())),
            service.instance,
        )


@pytest.mark.parametrize("product", PRODUCTS)
def test_every_point_is_on_its_tracks_key_and_in_the_feed(flown, product):
    in_feed = points_of(flown.in_feed[product])
    assert len(in_feed) >= 12
    assert sorted(in_feed, key=str) == sorted((point for _, point in flown.on_keys[product]), key=str)


@pytest.mark.parametrize("product", PRODUCTS)
def test_key_names_the_track_and_the_product(flown, product):
    for key, point in flown.on_keys[product]:
        assert key == KEYS.fused(product, point["track"])
        assert (point["product"], point["version"]) == (product, 1)
        assert point["track"] in ADDRESSES


@pytest.mark.parametrize("product", PRODUCTS)
def test_sequence_of_every_track_has_no_hole(flown, product):
    for address in ADDRESSES:
        seqs = [point["seq"] for _, point in flown.on_keys[product] if point["address"] == address]
        assert len(seqs) >= 4
        assert seqs == list(range(len(seqs)))


@pytest.mark.parametrize("product", PRODUCTS)
def test_sequence_of_the_feed_has_no_hole(flown, product):
    assert [message["seq"] for message in flown.in_feed[product]] == list(range(len(flown.in_feed[product])))
    assert {message["epoch"] for message in flown.in_feed[product]} == {flown.on_keys[product][0][1]["epoch"]}


def test_spans_of_elements_are_contiguous(flown):
    for address in ADDRESSES:
        points = [point for _, point in flown.on_keys["element"] if point["address"] == address]
        assert [point["element"] for point in points] == list(range(len(points)))
        assert all(before["span_s"][1] == after["span_s"][0] for before, after in pairwise(points))


def test_live_points_lie_on_the_flight(flown):
    for address in ADDRESSES:
        # The last that a report made: where the machine is slow, the track has coasted since.
        points = [point for _, point in flown.on_keys["live"] if point["address"] == address]
        point = [point for point in points if "coasted" not in point["flags"]][-1]
        true = report(address, point["time_s"])
        assert point["lat_deg"] == pytest.approx(true["lat_deg"], abs=2e-4)
        assert point["lon_deg"] == pytest.approx(true["lon_deg"], abs=2e-4)
        assert point["ground_speed_mps"] == pytest.approx(200.0, abs=3.0)
        assert point["sources"] == {"adsb": 1}
        assert 0.0 <= point["published_s"] - point["input_received_s"] < 10.0


def test_last_status_counts_what_happened(flown):
    assert flown.status[-1] == flown.last_status
    adsb, radar = flown.last_status["sensors"]["adsb"], flown.last_status["sensors"]["radar1"]
    assert (adsb["accepted"], adsb["batches"], adsb["lost_batches"]) == (48, 7, 0)
    assert (adsb["rejected"], adsb["dropped"], adsb["inbox"]) == ({}, 0, 0)
    assert (radar["accepted"], radar["batches"], radar["last_report_s"]) == (0, 0, None)
    assert flown.last_status["tracks"]["confirmed"] + flown.last_status["tracks"]["coasting"] == 3


def test_status_comes_every_second_with_the_time_of_each_stage(flown):
    assert all(status["instance"] == flown.instance for status in flown.status)
    assert all(after["time_s"] - before["time_s"] < 10.0 for before, after in pairwise(flown.status))
    assert all(flown.last_status["stages_us"][stage] > 0.0 for stage in ("decode", "engine", "encode", "publish"))


def test_service_is_alive_while_it_runs_and_not_after(flown):
    assert flown.alive == ([KEYS.alive_fusion(flown.instance)], [])


def test_radar_registration_is_published(flown):
    assert flown.registration
    assert {state["sensor"] for state in flown.registration} == {"radar1"}
    assert {state["state"] for state in flown.registration} <= {"converging", "converged", "frozen", "off"}


# -- with a service of their own ---------------------------------------------------------------------------------------
@pytest.fixture
def service(tmp_path, endpoint, keys):
    with running(make_config(tmp_path, endpoint, keys.prefix)) as started:
        yield started


def test_status_names_a_sensor_nobody_configured(service, session, keys):
    listener = Listener(session, keys.status())
    misspelt = Sensor(session, keys, "radra1")
    misspelt.send(flight(ADDRESSES[0], time.time()))
    alarms = listener.wait_for(
        lambda messages: [a for m in messages for a in m["alarms"] if "radra1" in a], "an alarm about the sensor"
    )
    assert "not in the configuration" in alarms[0]


def test_one_subscription_takes_the_bare_key_and_everything_below(service, session, keys):
    now_s = time.time()
    # Given the same epoch and number on two keys: two sequences, no repetition
    sensors = [Sensor(session, keys), Sensor(session, keys, below="/north/1")]
    for sensor, address in zip(sensors, ADDRESSES, strict=False):
        sensor.send(flight(address, now_s))
    wait_until(lambda: service.status and service.status["sensors"]["adsb"]["accepted"] == 24, "both batches")
    assert service.status["sensors"]["adsb"]["rejected"] == {}


def test_dispositions_flow_only_while_somebody_follows_them(service, session, keys):
    sensor = Sensor(session, keys)
    sensor.send(flight(ADDRESSES[0], time.time() - 1.0))
    wait_until(lambda: service.status and service.status["sensors"]["adsb"]["accepted"], "reports")
    assert service._engine.want_dispositions is False
    # When somebody follows
    listener = Listener(session, keys.dispositions("adsb"))
    wait_until(lambda: service._engine.want_dispositions, "the subscriber to be noticed")
    sensor.send([report(ADDRESSES[0], time.time()), report("FFFFF1", time.time(), lat_deg=91.0)])
    # Then each report's fate is told
    rows = listener.wait_for(lambda messages: [row for m in messages for row in m["dispositions"]], "dispositions")
    assert rows[0]["track"] == ADDRESSES[0]
    assert rows[0]["reason"] is None
