"""Whatever a sensor sends is counted under its reason, and the good reports sent around it are all fused.

All cases run at once in one service, each as a sensor of its own.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from tests.integration.harness import Sensor, connect, flight, free_endpoint, make_config, report, running, wait_until

from aeroskein_service.keys import Keys
from aeroskein_service.messages import JSON, MSGPACK
from aeroskein_service.transport import Router

PREFIX = "hostile/v1"
KEYS = Keys(PREFIX)
GOOD = 12  # reports around each bad thing


class Case(NamedTuple):
    """What a bad sensor does between its good reports, and what the status must say."""

    payload: Callable[[Sensor, list[dict[str, Any]]], bytes]
    rejected: dict[str, int]
    accepted: int = GOOD
    encoding: str = MSGPACK


def whole(reason: str, payload: Callable[[Sensor], bytes], encoding: str = MSGPACK) -> Case:
    """A batch that must be rejected whole."""
    return Case(lambda sensor, good: payload(sensor), {reason: 1}, encoding=encoding)


def single(reason: str, bad: Callable[[dict[str, Any]], Any]) -> Case:
    """A batch in which only one report is bad; ``bad`` makes it from a good one."""
    return Case(lambda sensor, good: sensor.batch([good[0], bad(good[1]), good[2]]), {reason: 1}, GOOD + 2)


def field(reason: str, **fields: Any) -> Case:
    """A report with bad fields."""
    return single(reason, lambda good: good | fields)


def now(sensor: Sensor) -> list[dict[str, Any]]:
    return [report("400001", time.time())]


def python_json(sensor: Sensor, good: list[dict[str, Any]]) -> bytes:
    """Python's own writer puts NaN, which is no JSON."""
    return json.dumps(
        {"version": 1, "epoch": 5, "seq": 0, "reports": [good[0], good[1] | {"height_m": np.nan}]}
    ).encode()


CASES: Mapping[str, Case] = {
    "random bytes": whole("malformed", lambda s: np.random.default_rng(7).bytes(3000)),
    "nothing": whole("malformed", lambda s: b""),
    "cut msgpack": whole("malformed", lambda s: s.batch(now(s))[:50]),
    "a number": whole("malformed", lambda s: msgspec.msgpack.encode(7)),
    "nested lists": whole("malformed", lambda s: b"\x91" * 2000 + b"\x90"),
    "no reports": whole("malformed", lambda s: s.batch([])),
    "reports that are no list": whole("malformed", lambda s: s.batch({"a": 1})),
    "wrong version": whole("bad_version", lambda s: s.batch(now(s), version=2)),
    "no version": whole("bad_version", lambda s: s.batch(now(s), version=None)),
    "negative number": whole("malformed", lambda s: s.batch(now(s), seq=-1)),
    "number beyond 64 bits": whole("malformed", lambda s: s.batch(now(s), seq=2**63)),
    "another sensor": whole("wrong_sensor", lambda s: s.batch(now(s), sensor="radar1")),
    "501 reports": whole("too_many_reports", lambda s: s.batch(now(s) * 501)),
    "100000 reports": whole("too_many_reports", lambda s: s.batch(now(s) * 100_000)),
    "unknown encoding": whole("bad_encoding", lambda s: s.batch(now(s)), "application/cbor"),
    "no encoding": whole("bad_encoding", lambda s: s.batch(now(s)), ""),
    "msgpack called JSON": whole("malformed", lambda s: s.batch(now(s)), JSON),
    "NaN position": field("bad_value", lat_deg=float("nan")),
    "infinite altitude": field("bad_value", altitude_m=float("inf")),
    "latitude 91": field("bad_value", lat_deg=91.0),
    "text for a number": field("bad_value", lat_deg="48"),
    "speed of light": field("bad_value", ground_speed_mps=3e8),
    "no time": field("bad_value", time_s=None),
    "two positions": field("bad_value", range_m=1000.0, azimuth_deg=10.0),
    "half a position": field("bad_value", lon_deg=None),
    "no position": field("no_position", lat_deg=None, lon_deg=None),
    "bad address": field("bad_address", address="XYZ123"),
    "address of seven digits": field("bad_address", address="3C64440"),
    "address as a number": field("bad_address", address=7),
    "a minute ahead": single("future", lambda good: good | {"time_s": time.time() + 60.0}),
    "year 2100": field("future", time_s=4.1e9),
    "a minute old": single("too_old", lambda good: good | {"time_s": time.time() - 60.0}),
    "year 1970": field("too_old", time_s=0.0),
    "a number for a report": single("malformed", lambda good: 7),
    "callsign too long": Case(
        lambda s, good: s.batch([good[0], good[1] | {"callsign": "FAR TOO LONG"}]), {"bad_callsign": 1}, GOOD + 2
    ),
    "Mode A 8888": Case(lambda s, good: s.batch([good[0], good[1] | {"mode_a": "8888"}]), {"bad_mode_a": 1}, GOOD + 2),
    "NaN in JSON": Case(python_json, {"bad_value": 1}, GOOD + 1, JSON),
}


def sensor_id(name: str) -> str:
    return "-".join(name.lower().split())


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Every sensor's status after all of them have sent good reports, something bad, and good reports again."""
    endpoint = free_endpoint()
    sensors = "".join(f'[[sensors]]\nid = "{sensor_id(name)}"\nkind = "adsb"\n' for name in CASES)
    # What comes behind the watermark would be late; on a busy machine that must not depend on how fast this test is.
    folder = tmp_path_factory.mktemp("hostile")
    config = make_config(folder, endpoint, PREFIX, {"fusion.watermark_s": 10.0}, sensors=sensors)
    with Router(listen=[endpoint]), connect(endpoint) as session, running(config) as service:
        at_s = time.time()
        speakers = [Sensor(session, KEYS, sensor_id(name)) for name in CASES]
        flights = [flight(f"{0x400100 + index:06X}", at_s, GOOD + 3) for index in range(len(CASES))]

        def all_have(batches: int) -> Any:
            state = service.status["sensors"] if service.status else {}
            return all(state.get(s.sensor, {"batches": 0})["batches"] == batches for s in speakers) and state

        for sensor, good in zip(speakers, flights, strict=True):
            sensor.send(good[: GOOD // 2])
        # What is put past a sensor's own publisher is not repeated, so every subscription must be known before.
        wait_until(lambda: all_have(1), "a batch of every sensor")
        for sensor, good, case in zip(speakers, flights, CASES.values(), strict=True):
            session.put(KEYS.reports(sensor.sensor), case.payload(sensor, good[GOOD:]), case.encoding)
            sensor.send(good[GOOD // 2 : GOOD])
        yield wait_until(lambda: all_have(3), "three batches of every sensor")


@pytest.mark.parametrize("name", CASES)
def test_bad_input_is_counted_and_harms_nothing_else(states, name):
    state = states[sensor_id(name)]
    assert state["rejected"] == CASES[name].rejected
    assert state["accepted"] == CASES[name].accepted


@pytest.fixture
def service(tmp_path, endpoint, keys):
    with running(make_config(tmp_path, endpoint, keys.prefix)) as started:
        yield started


def test_repeated_batch_adds_nothing_and_a_hole_is_a_lost_batch(service, session, keys):
    sensor, good = Sensor(session, keys), flight("400001", time.time(), 12)
    payload = sensor.batch(good[:6])
    sensor.put(payload)
    sensor.put(payload)
    sensor.seq += 3
    sensor.send(good[6:])
    state = wait_until(
        lambda: (s := service.status) and s["sensors"]["adsb"]["batches"] == 3 and s["sensors"]["adsb"], "all batches"
    )
    assert state["rejected"] == {"duplicate_batch": 1}
    assert state["accepted"] == 12
    assert state["lost_batches"] == 3


def test_overflow_of_the_inbox_is_counted_and_the_newest_is_kept(tmp_path, endpoint, session, keys):
    # Given an inbox of 3 batches and a worker that is held up
    config = make_config(tmp_path, endpoint, keys.prefix, {"service.inbox_batches": 3})
    with running(config) as service:
        sensor, engine = Sensor(session, keys), service._engine
        receive = engine.receive

        def slowly(plots, *, now_s):
            time.sleep(1.5)
            return receive(plots, now_s=now_s)

        engine.receive = slowly
        now_s = time.time()
        # When 20 batches come
        for back in range(20, 0, -1):
            sensor.send([report("400001", now_s - back)])
            if back == 20:
                time.sleep(0.3)
        wait_until(lambda: service.status and service.status["sensors"]["adsb"]["dropped"] == 16, "drops")
        # Then the last three were fused, and the rest counts as overload
        state = wait_until(
            lambda: (s := service.status["sensors"]["adsb"]) and s["accepted"] == 4 and s, "the newest batches"
        )
        assert state["rejected"] == {"overload": 16}
        assert state["lost_batches"] == 16
