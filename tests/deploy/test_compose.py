"""The demo comes up, fuses and goes down on a real Docker engine, in an image that holds what it needs and no more."""

from __future__ import annotations

import json
import re
import subprocess
import urllib.request
from pathlib import Path

import pytest
from tests.deploy.conftest import environment
from tests.deploy.stack import RUN, Stack, run, seconds, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

SERVICES = {"router", "adsb", "radar1", "radar2", "fusion", "web", "consumer"}
SIZE_BYTES = 400e6


def test_every_container_becomes_healthy(stack):
    wait_until(lambda: stack.healthy() >= SERVICES, "all to be healthy")
    assert set(stack.services()) == SERVICES


def test_fused_points_of_all_three_sensors_reach_the_consumer(stack, figures):
    first = wait_until(lambda: next(stack.points(), None), "a fused point at the consumer")
    begun_s = max(stack.started_s(service) for service in SERVICES)
    figures["first fused point after the last container's start, s"] = round(first[0] - begun_s, 1)

    def mixed() -> bool:
        return {name for _, point in stack.points() for name in point["sources"]} >= {"adsb", "radar1", "radar2"}

    wait_until(mixed, "points to which all sensors contributed")


def test_consumer_misses_no_point_of_any_track(stack):
    # Given a while of points, when each track's are put in order, then their numbers have no hole
    wait_until(lambda: sum(1 for _ in stack.points()) > 500, "500 points")
    numbers: dict[int, list[int]] = {}
    for _, point in stack.points():
        numbers.setdefault(point["track_number"], []).append(point["seq"])
    holes = {track: seen for track, seen in numbers.items() if seen != list(range(seen[0], seen[0] + len(seen)))}
    assert not holes


def fetched(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=30) as answer:
        return bytes(answer.read())


def test_page_is_at_the_published_port_of_this_machine_only(stack):
    where = stack.compose("port", "web", "8080").strip()
    assert where.startswith("127.0.0.1:")
    wait_until(lambda: "web" in stack.healthy(), "the page to be healthy")
    assert b"<html" in fetched(f"http://{where}/").lower()


def test_service_is_ready_and_tells_its_metrics_inside_the_network(stack):
    wait_until(lambda: "fusion" in stack.healthy(), "the service to be healthy")
    inside = f"http://{stack.address('fusion', 'core')}:8080"
    assert json.loads(fetched(f"{inside}/readyz"))["ok"]
    assert b"aeroskein_" in fetched(f"{inside}/metrics")


def test_nothing_restarts_and_no_log_has_an_error(stack):
    wait_until(lambda: sum(1 for _ in stack.points()) > 500, "500 points")
    for service in SERVICES:
        assert stack.inspect(service)["RestartCount"] == 0, service
        for _, line in stack.log(service):
            assert not line.startswith(("aeroskein:", "Traceback")), line
            if line.startswith("{") and service == "fusion":
                # Warnings tell of waiting for the router and of a busy machine; neither is an error.
                told = json.loads(line)
                assert told["level"] == "info" or told["event"] in ("router", "live_points_thinned"), line


def test_containers_run_without_privileges(stack):
    for service in SERVICES:
        found = stack.inspect(service)
        assert found["Config"]["User"] == "10001:10001"
        assert found["HostConfig"]["ReadonlyRootfs"]
        assert found["HostConfig"]["CapDrop"] == ["ALL"]
        assert "no-new-privileges:true" in found["HostConfig"]["SecurityOpt"]
        wrote = subprocess.run(["docker", "exec", stack.container(service), "touch", "/app/x"], capture_output=True)
        assert wrote.returncode != 0


def test_sensor_reaches_the_router_and_no_other_container(stack):
    look = "import socket, sys; socket.create_connection((sys.argv[1], int(sys.argv[2])), timeout=3)"

    def reaches(address: str, port: int) -> bool:
        inside = ["docker", "exec", stack.container("adsb"), "/opt/aeroskein/bin/python", "-c", look]
        return subprocess.run([*inside, address, str(port)], capture_output=True).returncode == 0

    wait_until(lambda: reaches("router", 7447), "the router to be reached")
    assert not reaches(stack.address("fusion", "core"), 8080)
    assert not reaches(stack.address("web", "front"), 8080)


def test_image_is_small_and_holds_no_compiler_no_test_and_no_key(image, figures):
    size = int(run("docker", "image", "inspect", "--format", "{{.Size}}", image))
    figures["image, MB"] = round(size / 1e6)
    assert size < SIZE_BYTES

    def inside(*command: str) -> list[Path]:
        everything = ["docker", "run", "--rm", "--user", "0:0", "--network", "none", "--entrypoint", command[0], image]
        return [Path(line) for line in run(*everything, *command[1:], check=False).splitlines()]

    paths = inside("find", "/", "-xdev", "-type", "f", "-o", "-xdev", "-type", "l")
    names = {path.name for path in paths}
    programs = {path.name for path in paths if path.parent.name in ("bin", "sbin")}
    assert {"aeroskein", "python3"} <= programs
    assert not [
        name
        for name in programs
        if re.fullmatch(r"(.*-)?(gcc|g\+\+|cc|c\+\+|clang|cpp|ld|as|make|pytest)(-[\d.]+)?", name)
    ]
    assert {"fusion.toml", "service.py"} <= names
    assert not [path for path in paths if path.name.startswith(("test_", "conftest."))]
    assert not [path for path in paths if {"test", "tests"} & set(path.parent.parts)]
    # A text file with a key in it, wherever it lies.
    secrets = inside(
        "grep", "-rlIE", "BEGIN .*PRIVATE KEY", "/app", "/opt", "/etc", "/usr", "/var", "/root", "/home", "/run"
    )
    assert not secrets


def test_image_has_compiled_whatever_it_imports(image):
    # Given a root that cannot be written, when each role imports what it runs
    roles = ("router", "simulate", "run", "web", "watch", "health")
    modules = ", ".join(["aeroskein_service.worker", *(f"aeroskein_service.commands.{role}" for role in roles)])
    inside = ["docker", "run", "--rm", "--read-only", "--network", "none", "--entrypoint", "/opt/aeroskein/bin/python"]
    told = run(*inside, image, "-v", "-c", f"import {modules}")
    # Then every module comes out of a file that was compiled when the image was made
    assert len(re.findall(r"code object from '\S+\.pyc'", told)) > 100
    assert not re.findall(r"code object from (/\S+\.py)$", told, re.MULTILINE)


def test_container_is_soon_at_work(image, figures):
    alone = run("docker", "run", "-d", "--read-only", "--network", "none", image, "router").strip()
    try:
        log = ["docker", "logs", "--timestamps", alone]
        routes = wait_until(lambda: re.search(r"^(\S+) routing", run(*log), re.MULTILINE), "a router")
        begun_s = seconds(run("docker", "inspect", "--format", "{{.State.StartedAt}}", alone).strip())
        figures["start of a router's container, until it routes, s"] = round(seconds(routes[1]) - begun_s, 1)
    finally:
        run("docker", "rm", "--force", alone)


def test_going_down_leaves_nothing(image):
    stack = Stack(f"{RUN}-down", environment(image))
    stack.up("router", "fusion")
    assert stack.leftovers()
    stack.down()
    assert not stack.leftovers()
