"""What survives: a service that is killed, a router that is killed, a demo whose parts die."""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest
from tests.integration.harness import (
    ADDRESSES,
    Listener,
    Process,
    Sensor,
    connect,
    flight,
    free_endpoint,
    is_running,
    make_config,
    report,
    running,
    seams,
    wait_until,
    write_config,
)

from aeroskein_service.commands.demo import _write_config
from aeroskein_service.process_tree import ProcessTree
from aeroskein_service.service import HISTORY_S


def test_restart_uses_no_number_again_and_publishes_no_second_twice(tmp_path, endpoint, session, keys):
    # Given a service with a state folder that has published elements
    config = make_config(tmp_path, endpoint, keys.prefix, {"service.state_dir": str(tmp_path / "state")})
    elements = Listener(session, keys.fused("element", "*"))
    sensor, first_s = Sensor(session, keys), time.time()
    with running(config):
        sensor.send(flight(ADDRESSES[0], first_s))
        elements.wait_for(lambda points: len(points) >= 4, "elements")
    before = list(elements.messages)
    # When it is started again and gets reports from before and after
    with running(config):
        sensor.send([report(ADDRESSES[0], first_s + seconds) for seconds in range(-5, 3)])
        after = elements.wait_for(lambda points: points[len(before) :], "elements after the restart")
    # Then the track has a new number, and its elements begin where the last one ended
    assert {p["track_number"] for p in before} == {1}
    assert all(p["track_number"] > 1 for p in after)
    assert min(p["span_s"][0] for p in after) >= max(p["span_s"][1] for p in before)


def test_registration_that_was_set_is_in_force_after_a_restart(tmp_path, endpoint, session, keys):
    config = make_config(tmp_path, endpoint, keys.prefix, {"service.state_dir": str(tmp_path / "state")})
    with running(config):
        (answer,) = session.ask(
            keys.control("registration", "radar1") + "?action=set;range_bias_m=120.5;time_bias_s=0.25"
        )
        assert answer.ok, answer.payload.decode()
    states = Listener(session, keys.registration("radar1"))
    with running(config):
        first = states.wait_for(lambda messages: messages[:1], "the registration of the radar")[0]
    assert (first["range_bias_m"], first["time_bias_s"]) == pytest.approx((120.5, 0.25))


def test_killed_service_repeats_neither_numbers_nor_elements(tmp_path, endpoint, session, keys):
    path = write_config(tmp_path, endpoint, keys.prefix)
    # A slow machine may take long to start the service again: its reports are not too old for that.
    content = path.read_text().replace("[fusion]", "[fusion]\nmax_age_s = 600.0")
    path.write_text(content + f'\n[service]\nstate_dir = "{tmp_path / "state"}"\n')
    elements = Listener(session, keys.fused("element", "*"))
    sensor, first_s = Sensor(session, keys), time.time()
    with Process(tmp_path, "run", "--config", path) as service:
        service.wait_for_err("service_started")
        sensor.send(flight(ADDRESSES[0], first_s))
        elements.wait_for(lambda points: len(points) >= 4, "elements")
        service.signal(signal.SIGKILL)
        service.wait()
    before = list(elements.messages)
    with Process(tmp_path, "run", "--config", path) as service:
        service.wait_for_err("service_started")
        sensor.send([report(ADDRESSES[0], first_s + seconds) for seconds in range(-5, 5)])
        after = elements.wait_for(lambda points: points[len(before) :], "elements after the restart")
        assert service.stop() == 0
    assert min(p["track_number"] for p in after) > max(p["track_number"] for p in before)
    assert min(p["span_s"][0] for p in after) >= max(p["span_s"][1] for p in before)


def test_every_second_is_in_an_element_when_a_killed_service_is_started_again(tmp_path, endpoint, session, keys):
    path = write_config(tmp_path, endpoint, keys.prefix)
    path.write_text(path.read_text() + f'\n[service]\nstate_dir = "{tmp_path / "state"}"\n')
    elements = Listener(session, keys.fused("element", "*"))
    # Given aircraft that fly on whatever happens to the service
    with Sensor(session, keys).flying(ADDRESSES, 0.25):
        with Process(tmp_path, "run", "--config", path) as service:
            service.wait_for_err("service_started")
            elements.wait_for(lambda points: len(points) >= 3 * len(ADDRESSES), "elements")
            service.signal(signal.SIGKILL)
            service.wait()
        heard, epoch = len(elements.messages), elements.messages[-1]["epoch"]
        # When it is started again
        with Process(tmp_path, "run", "--config", path) as service:
            service.wait_for_err("service_started")
            began_s = time.time()
            elements.wait_for(lambda points: len(points) >= heard + 3 * len(ADDRESSES), "elements")
            assert service.stop() == 0
    # Then elements follow on each other from the first to the last, as far back as sensors can repeat their reports
    assert {p["address"] for p in elements.messages if p["epoch"] != epoch} == set(ADDRESSES)
    for of_one in seams(elements.messages).values():
        for ended_s, next_s in of_one:
            assert ended_s <= next_s <= max(ended_s, began_s - HISTORY_S + 1.0)


def test_killed_router_loses_nothing(tmp_path, keys):
    # Given sensor, service and a consumer of the feed, around a router that is killed and comes back
    endpoint = free_endpoint()
    config = make_config(tmp_path, endpoint, keys.prefix, {"fusion.watermark_s": 8.0})
    with Process(tmp_path, "router", "--listen", endpoint) as router:
        router.wait_for_err("routing")
        with connect(endpoint) as session, running(config) as service:
            sensor = Sensor(session, keys)
            feed = Listener(session, keys.feed("live"), recovering=True)
            sent = 0

            def send(batches: int) -> None:
                nonlocal sent
                for _ in range(batches):
                    sensor.send([report(address, time.time()) for address in ADDRESSES])
                    sent += len(ADDRESSES)
                    time.sleep(0.05)

            def accepted() -> int:
                return service.status["sensors"]["adsb"]["accepted"] if service.status else 0

            send(20)
            wait_until(lambda: accepted() == sent, "the first reports")
            router.signal(signal.SIGKILL)
            router.wait()
            send(20)
            assert accepted() < sent
            assert any("no connection" in reason for reason in service.not_ready())
            with Process(tmp_path, "router", "--listen", endpoint) as again:
                again.wait_for_err("routing")
                send(20)
                # Then every report was used, and the consumer has every point
                wait_until(lambda: accepted() == sent, "the reports of the outage")
                state = service.status["sensors"]["adsb"]
                assert (state["lost_batches"], state["rejected"]) == (0, {})
                wait_until(
                    lambda: sum(len(m["points"]) for m in feed.messages) == service.status["points"]["live"],
                    "all points at the consumer",
                )
                assert all(after["seq"] == before["seq"] + 1 for before, after in pairwise(feed.messages))


def children(parent: int) -> list[int]:
    """Process numbers of the living children of a process."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(fields[1]) == parent and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found


def test_demo_fuses_and_ends_with_every_process_on_ctrl_c(tmp_path):
    with Process(tmp_path, "demo") as demo:
        wait_until(lambda: "\n40 tracks" in demo.out or demo.popen.poll() is not None, "fused tracks")
        assert "aeroskein watch --connect tcp/127.0.0.1:" in demo.out
        processes = children(demo.popen.pid)
        assert len(processes) == 5
        demo.signal(signal.SIGINT)
        assert demo.wait() == 0
        assert not any(map(is_running, processes))


def test_demo_that_is_killed_leaves_nothing_behind(tmp_path):
    with Process(tmp_path, "demo") as demo:
        wait_until(lambda: "Ctrl-C" in demo.out, "the demo to start")
        processes = children(demo.popen.pid)
        demo.signal(signal.SIGKILL)
        demo.wait()
    wait_until(lambda: not any(map(is_running, processes)), "its processes to end")


def test_demo_ends_with_a_sentence_when_a_part_of_it_dies(tmp_path):
    with Process(tmp_path, "demo") as demo:
        wait_until(lambda: "Ctrl-C" in demo.out, "the demo to start")
        processes = children(demo.popen.pid)
        by_name = {
            part: pid for pid in processes for part in Path(f"/proc/{pid}/cmdline").read_text().split("\0") if part
        }
        subprocess.run(["kill", "-9", str(by_name["radar2"])], check=True)
        assert demo.wait() == 1
        assert demo.err.startswith("aeroskein: radar2 ended with status -9")
        assert not any(map(is_running, processes))


def test_demo_takes_ports_that_are_configured(tmp_path, monkeypatch):
    monkeypatch.setenv("AEROSKEIN_HTTP__LISTEN", "127.0.0.1:18080")
    text = _write_config(tmp_path, "simulated.toml").read_text()
    assert "[http]" not in text
    assert 'connect = ["tcp/127.0.0.1:' in text


@pytest.mark.parametrize("name", ["simulated.toml", "recorded.toml"])
def test_demo_configurations_are_valid(tmp_path, name):
    assert "[zenoh]" in _write_config(tmp_path, name).read_text()


def test_process_tree_names_the_child_that_died_and_its_last_words(tmp_path):
    stop = threading.Event()
    with ProcessTree(tmp_path, stop) as tree:
        tree.start("wrong", "run", "--config", str(tmp_path / "missing.toml"))
        assert stop.wait(30.0)
        assert tree.died is not None
        assert tree.died.startswith("wrong ended with status 2: aeroskein: ")


def test_service_ends_in_order_when_its_router_is_gone(tmp_path, keys):
    endpoint = free_endpoint()
    with Process(tmp_path, "router", "--listen", endpoint) as router:
        router.wait_for_err("routing")
        with Process(tmp_path, "run", "--config", write_config(tmp_path, endpoint, keys.prefix)) as service:
            service.wait_for_err("service_started")
            router.signal(signal.SIGKILL)
            router.wait()
            assert service.stop() == 0
            assert "service_stopped" in service.err
