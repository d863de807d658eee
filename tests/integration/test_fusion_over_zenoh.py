"""Reports put on Zenoh come back as fused points: on the track's key, in the feed, counted in the status."""

from __future__ import annotations

import time
from itertools import pairwise

import pytest
from tests.integration.harness import ADDRESSES, Listener, Sensor, flight, make_config, report, running, wait_until


@pytest.fixture
def service(tmp_path, endpoint, keys):
    with running(make_config(tmp_path, endpoint, keys.prefix)) as started:
        yield started


def fly(session, keys, batches: int = 4) -> None:
    """Twelve seconds of three flights at once, then some batches live."""
    sensor, now_s = Sensor(session, keys), time.time()
    for address in ADDRESSES:
        sensor.send(flight(address, now_s))
    for _ in range(batches):
        time.sleep(0.2)
        sensor.send([report(address, time.time()) for address in ADDRESSES])


def test_every_point_is_on_its_tracks_key_and_in_the_feed(service, session, keys):
    # Given consumers of the keys and of the feed
    products = ("live", "element")
    on_keys = {product: Listener(session, keys.fused(product, "*")) for product in products}
    feeds = {product: Listener(session, keys.feed(product), recovering=True) for product in products}
    # When three aircraft fly
    fly(session, keys)
    for product in products:
        on_keys[product].wait_for(lambda points: len(points) >= 9, f"{product} points")
    service.stop()
    # Then both consumers have the same points, and the key names the track
    for product in products:
        wanted = service.status["points"][product]
        on_keys[product].wait_for(lambda points, wanted=wanted: len(points) == wanted, "all points on keys")
        in_feed = feeds[product].wait_for(
            lambda messages, wanted=wanted: (
                (p := [x for m in messages for x in m["points"]]) and len(p) == wanted and p
            ),
            "all points in the feed",
        )
        assert sorted(in_feed, key=str) == sorted(on_keys[product].messages, key=str)
        for key, point in on_keys[product].received:
            assert key == keys.fused(product, point["track"])
            assert point["track"] in ADDRESSES


def test_sequences_have_no_holes(service, session, keys):
    on_keys = {product: Listener(session, keys.fused(product, "*")) for product in ("live", "element")}
    feed = Listener(session, keys.feed("live"), recovering=True)
    fly(session, keys)
    for listener in on_keys.values():
        listener.wait_for(lambda points: len(points) >= 12, "points")
    for product, listener in on_keys.items():
        for address in ADDRESSES:
            seqs = [p["seq"] for p in listener.messages if p["address"] == address]
            assert seqs == list(range(len(seqs))), product
    assert [m["seq"] for m in feed.messages] == list(range(len(feed.messages)))


def test_spans_of_elements_are_contiguous(service, session, keys):
    elements = Listener(session, keys.fused("element", ADDRESSES[0]))
    fly(session, keys)
    points = elements.wait_for(lambda points: len(points) >= 5 and points, "elements")
    assert [p["element"] for p in points] == list(range(len(points)))
    assert all(before["span_s"][1] == after["span_s"][0] for before, after in pairwise(points))


def test_live_point_lies_on_the_flight(service, session, keys):
    live = Listener(session, keys.fused("live", ADDRESSES[0]))
    fly(session, keys)
    point = live.wait_for(lambda points: len(points) >= 3 and points[-1], "live points")
    true = report(ADDRESSES[0], point["time_s"])
    assert point["lat_deg"] == pytest.approx(true["lat_deg"], abs=2e-4)
    assert point["lon_deg"] == pytest.approx(true["lon_deg"], abs=2e-4)
    assert point["ground_speed_mps"] == pytest.approx(200.0, abs=3.0)
    assert point["sources"] == {"adsb": 1}
    assert 0.0 <= point["published_s"] - point["input_received_s"] < 10.0


def test_status_counts_what_happened(service, session, keys):
    listener = Listener(session, keys.status(service.instance))
    fly(session, keys, batches=2)
    status = listener.wait_for(
        lambda messages: next((m for m in messages if m["sensors"]["adsb"]["accepted"] == 42), None), "all reports"
    )
    adsb, radar = status["sensors"]["adsb"], status["sensors"]["radar1"]
    assert (adsb["batches"], adsb["lost_batches"], adsb["rejected"], adsb["dropped"]) == (5, 0, {}, 0)
    assert (radar["accepted"], radar["batches"], radar["last_report_s"]) == (0, 0, None)
    assert status["tracks"]["confirmed"] == 3
    assert all(status["stages_us"][stage] > 0.0 for stage in ("decode", "engine", "encode", "publish"))


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


def test_instance_holds_a_liveliness_token(service, session, keys):
    assert session.alive(keys.alive_fusion()) == [keys.alive_fusion(service.instance)]
    service.stop()
    wait_until(lambda: not session.alive(keys.alive_fusion()), "the token to go")


def test_radar_registration_is_published(service, session, keys):
    listener = Listener(session, keys.registration("radar1"))
    state = listener.wait_for(lambda messages: messages and messages[-1], "a registration state")
    assert state["sensor"] == "radar1"
    assert state["state"] in ("converging", "converged", "frozen", "off")


def test_json_output_has_the_same_fields(tmp_path, endpoint, session, keys):
    with running(make_config(tmp_path, endpoint, keys.prefix, {"output.encoding": "json"})):
        live = Listener(session, keys.fused("live", "*"))
        feed = Listener(session, keys.feed("live"), recovering=True)
        fly(session, keys, batches=1)
        point = live.wait_for(lambda points: points and points[-1], "a live point")
        assert point in feed.wait_for(lambda m: m and [p for one in m for p in one["points"]], "the feed")
