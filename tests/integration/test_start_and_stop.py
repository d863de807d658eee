"""The service as a process: what it says when it cannot start, how it waits, and how it ends."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import pytest
from tests.integration.harness import (
    ADDRESSES,
    Listener,
    Process,
    Sensor,
    connect,
    flight,
    free_endpoint,
    free_port,
    make_config,
    report,
    running,
    wait_until,
    write_config,
)

from aeroskein_service.neighbours import AnotherServiceError, Claim
from aeroskein_service.transport import Router, Session


def one_sentence(process: Process) -> str:
    """Standard error, which must be a single line without a traceback."""
    lines = process.err.strip().splitlines()
    assert len(lines) == 1, process.err
    return lines[0]


def get(url: str) -> tuple[int, dict]:
    try:
        with urllib.request.urlopen(url, timeout=5.0) as response:
            return response.status, json.load(response)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.load(error)
    except OSError:
        return 0, {}


def test_service_waits_for_a_router_and_says_so(tmp_path, keys):
    # Given no router
    endpoint, http = free_endpoint(), f"127.0.0.1:{free_port()}"
    config = write_config(tmp_path, endpoint, keys.prefix)
    config.write_text(config.read_text().replace('listen = ""', f'listen = "{http}"'))
    with Process(tmp_path, "run", "--config", config) as service:
        service.wait_for_err(f"waiting for a Zenoh router at {endpoint}")
        # The page, a process of its own, passes health checks on: it may still be starting.
        wait_until(lambda: get(f"http://{http}/livez")[0] == 200, "an answer that the service lives")
        status, body = get(f"http://{http}/readyz")
        assert status == 503
        assert endpoint in body["reasons"][0]
        # When it comes up
        with Router(listen=[endpoint]), connect(endpoint) as session:
            service.wait_for_err("service_started")
            # Then the service is ready with its first reports
            sensor = Sensor(session, keys)
            sensor.send(flight(ADDRESSES[0], time.time()))
            wait_until(lambda: get(f"http://{http}/readyz")[0] == 200, "readiness")
            with Process(tmp_path, "health", "--url", f"http://{http}") as health:
                assert health.wait() == 0
            with urllib.request.urlopen(f"http://{http}/metrics", timeout=5.0) as response:
                assert b'aeroskein_reports_accepted_total{sensor="adsb"} 12.0' in response.read()
            assert service.stop() == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_service_that_waits_for_a_router_ends_on_a_signal(tmp_path, keys, number):
    config = write_config(tmp_path, free_endpoint(), keys.prefix)
    with Process(tmp_path, "run", "--config", config) as service:
        service.wait_for_err("waiting for")
        service.signal(number)
        assert service.wait() == 0


def test_wrong_endpoint_is_one_sentence(tmp_path, keys):
    with Process(tmp_path, "run", "--config", write_config(tmp_path, "tpc/127.0.0.1:7447", keys.prefix)) as service:
        assert service.wait() == 2
        assert "zenoh.connect" in one_sentence(service)


def test_misspelt_key_stops_the_program_before_it_starts(tmp_path, keys):
    config = write_config(tmp_path, free_endpoint(), keys.prefix)
    config.write_text(config.read_text().replace("watermark_s", "watermrak_s"))
    with Process(tmp_path, "run", "--config", config) as service:
        assert service.wait() == 2
        assert "fusion.watermrak_s" in one_sentence(service)


def test_taken_http_address_is_one_sentence(tmp_path, endpoint, keys):
    config = write_config(tmp_path, endpoint, keys.prefix)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        config.write_text(config.read_text().replace('listen = ""', f'listen = "{where}"'))
        with Process(tmp_path, "run", "--config", config) as service:
            assert service.wait() == 1
            assert f"cannot listen at {where}: address already in use" in service.err.splitlines()[-1]


def test_taken_router_port_is_one_sentence(tmp_path, endpoint):
    with Process(tmp_path, "router", "--listen", endpoint) as router:
        assert router.wait() == 1
        assert f"another program already listens at {endpoint}" in one_sentence(router)


def test_router_file_that_cannot_be_read_is_one_sentence(tmp_path):
    broken = tmp_path / "router.json5"
    broken.write_text("{ mode: ")
    with Process(tmp_path, "router", "--config", broken) as router:
        assert router.wait() == 1
        assert "router.json5" in one_sentence(router)


def test_health_without_a_service_is_one_sentence(tmp_path):
    with Process(tmp_path, "health", "--url", f"http://127.0.0.1:{free_port()}") as health:
        assert health.wait() == 1
        assert "no service answers" in one_sentence(health)


def test_second_service_refuses_to_start(tmp_path, endpoint, keys):
    config = make_config(tmp_path, endpoint, keys.prefix, {"service.instance": "first"})
    with running(config), Process(tmp_path, "run", "--config", tmp_path / "config.toml") as second:
        assert second.wait() == 1
        assert "another fusion service, 'first', is alive" in second.err.splitlines()[-1]


class TogetherSession(Session):
    """A session that goes on after its first look around only when the other has looked too."""

    barrier = threading.Barrier(2)
    looked = False

    def alive(self, key: str, *, timeout_s: float = 2.0) -> list[str]:
        found = super().alive(key, timeout_s=timeout_s)
        if not self.looked:
            self.looked = True
            self.barrier.wait(30.0)
        return found


def test_of_two_started_together_the_lower_name_stays(endpoint, keys):
    # Given two services that both have seen nobody
    refused = {}

    def start(name: str, session: Session) -> None:
        try:
            Claim(TogetherSession(session._session), keys, name).confirm(threading.Event())
        except AnotherServiceError as error:
            refused[name] = str(error)

    with connect(endpoint) as one, connect(endpoint) as other:
        threads = [threading.Thread(target=start, args=pair) for pair in (("a", one), ("b", other))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    # Then the higher one gives up
    assert list(refused) == ["b"]
    assert "'a'" in refused["b"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_clean_stop_publishes_what_is_open_and_leaves_nothing(tmp_path, endpoint, session, keys, number):
    with Process(tmp_path, "run", "--config", write_config(tmp_path, endpoint, keys.prefix)) as service:
        service.wait_for_err("service_started")
        elements = Listener(session, keys.fused("element", ADDRESSES[0]))
        status = Listener(session, keys.status())
        sensor, now_s = Sensor(session, keys), time.time()
        sensor.send(flight(ADDRESSES[0], now_s))
        elements.wait_for(lambda points: len(points) >= 3, "elements")
        # When it is told to end
        service.signal(number)
        assert service.wait() == 0
        # Then the last element reaches over the newest report, and the last status has counted everything
        elements.wait_for(lambda points: points[-1]["span_s"][1] > now_s, "the last element")
        last = status.wait_for(
            lambda messages: messages[-1]["points"]["element"] == len(elements.messages) and messages[-1],
            "the last status",
        )
        assert last["sensors"]["adsb"]["accepted"] == 12
        wait_until(lambda: not session.alive(keys.alive_fusion()), "the token to go")


def test_second_signal_ends_at_once(tmp_path):
    # Given a process that does not come to an end after the first signal
    script = (
        "import time\n"
        "from aeroskein_service.signals import stop_on_signals\n"
        "stop = stop_on_signals()\n"
        "print('ready', flush=True)\n"
        "stop.wait()\n"
        "print('stopping', flush=True)\n"
        "time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == "stopping\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 1


def test_failed_worker_ends_the_service_with_a_sentence(tmp_path, endpoint, session, keys, monkeypatch):
    config = make_config(tmp_path, endpoint, keys.prefix)
    with running(config) as service:
        sensor = Sensor(session, keys)
        monkeypatch.setattr(service._engine, "receive", lambda plots, now_s: 1 / 0)
        sensor.send([report(ADDRESSES[0], time.time())])
        wait_until(lambda: service.failure is not None, "the failure to be noticed")
        assert "worker failed: division by zero" in service.not_live()[0]
        assert service.not_ready()


def test_watch_prints_points_as_lines_and_as_json(tmp_path, endpoint, session, keys):
    path = write_config(tmp_path, endpoint, keys.prefix)
    with running(make_config(tmp_path, endpoint, keys.prefix)):
        sensor = Sensor(session, keys)
        with (
            Process(tmp_path, "watch", "--config", path) as lines,
            Process(tmp_path, "watch", "--config", path, "--json", "--track", ADDRESSES[1]) as track,
            Process(tmp_path, "watch", "--config", path, "--json", "--product", "element") as elements,
        ):

            def fly() -> bool:
                sensor.send([report(address, time.time()) for address in ADDRESSES])
                return all(process.out.count("\n") >= 3 for process in (lines, track, elements))

            wait_until(fly, "three lines of each")
            for process in (lines, track, elements):
                assert process.stop() == 0
                assert process.err == ""
            assert any(line.split()[1] == ADDRESSES[0] for line in lines.out.splitlines())
            points = [json.loads(line) for line in track.out.splitlines()]
            assert {(p["track"], p["product"]) for p in points} == {(ADDRESSES[1], "live")}
            assert {json.loads(line)["product"] for line in elements.out.splitlines()} == {"element"}
