"""Each profile of the demo is brought up by its name alone and does what it is for (``secure`` has a file of its own).

The official images of Zenoh and Prometheus are pulled where they can be. Elsewhere stand-ins under other names show
that the profile itself holds: our own router called as zenohd is, and Prometheus from Debian's package.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.deploy.conftest import environment
from tests.deploy.stack import DEPLOY, RUN, Stack, run, wait_until
from tests.integration.harness import free_port

from aeroskein_service.recording import NoRecordingError, find_recording

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

PROMETHEUS = """
FROM {base}
COPY prometheus/usr/bin/prometheus /bin/prometheus
COPY busybox-static/bin/busybox /bin/wget
RUN install -d -o 65534 /prometheus
USER 65534
ENTRYPOINT ["/bin/prometheus"]
CMD ["--config.file=/etc/prometheus/prometheus.yml", "--storage.tsdb.path=/prometheus"]
"""
ZENOHD = """
FROM {base}
HEALTHCHECK NONE
ENTRYPOINT ["aeroskein", "router"]
"""


@contextmanager
def running(profile: str, settings: dict[str, str]) -> Iterator[Stack]:
    """The demo in one profile; nothing is left of it."""
    stack = Stack(f"{RUN}-{profile}", settings, profile)
    try:
        stack.up()
        yield stack
    finally:
        stack.down()
    assert not stack.leftovers()


def official(variable: str) -> str | None:
    """The image that the compose file names, where it can be had."""
    named = re.search(rf"\$\{{{variable}:-(\S+)\}}", (DEPLOY / "compose.yaml").read_text())
    assert named
    pulled = subprocess.run(["docker", "pull", "--quiet", named[1]], capture_output=True)
    return named[1] if pulled.returncode == 0 else None


@contextmanager
def stand_in(variable: str, folder: Path, dockerfile: str) -> Iterator[str]:
    """An image of this run's own, removed afterwards."""
    name = f"{RUN}:{variable.lower()}"
    (folder / "Dockerfile").write_text(dockerfile)
    run("docker", "build", "--quiet", "-t", name, folder)
    try:
        yield name
    finally:
        run("docker", "image", "rm", name, check=False)


def fuses_all(stack: Stack) -> bool:
    """Whether all three sensors are in the points that the consumer got."""
    return {name for _, point in stack.points() for name in point["sources"]} >= {"adsb", "radar1", "radar2"}


def test_recorded_traffic_is_fused_with_its_radars(image):
    try:
        recording = find_recording()
    except NoRecordingError as error:
        pytest.skip(str(error))

    def around_paris() -> bool:
        points = [point for _, point in stack.points() if point["status"] == "confirmed"]
        near = {point["track"] for point in points if abs(point["lat_deg"] - 48.9) < 3.0}
        return len(near) > 5 and {name for point in points for name in point["sources"]} >= {"adsb", "radar1"}

    with running("real", environment(image) | {"AEROSKEIN_RECORDING": str(recording.parents[3])}) as stack:
        wait_until(around_paris, "confirmed tracks around Paris")


def test_demo_runs_through_the_official_router(image, tmp_path, figures):
    def fuses(router: str) -> None:
        with running("zenohd", environment(image) | {"ZENOH_IMAGE": router}) as stack:
            wait_until(lambda: fuses_all(stack), "points to which all sensors contributed")
            assert stack.inspect("router")["Config"]["Image"] == router
            wait_until(lambda: "router" in stack.healthy(), "the router to be healthy")

    router = official("ZENOH_IMAGE")
    figures["profile zenohd: router"] = router or "stand-in"
    if router:
        fuses(router)
    else:
        with stand_in("ZENOH", tmp_path, ZENOHD.format(base=image)) as made:
            fuses(made)


def test_prometheus_scrapes_the_service(image, tmp_path, figures):
    def scrapes(prometheus: str) -> None:
        port = free_port()
        settings = {"PROMETHEUS_IMAGE": prometheus, "PROMETHEUS_PORT": str(port)}
        with running("metrics", environment(image) | settings) as stack:

            def answer(question: str) -> Any:
                try:
                    with urllib.request.urlopen(f"http://127.0.0.1:{port}/api/v1/{question}", timeout=10) as reply:
                        return json.load(reply)["data"]
                except OSError:
                    return None

            def tracks() -> float:
                found = answer("query?query=aeroskein_tracks_confirmed")
                return float(found["result"][0]["value"][1]) if found and found["result"] else 0.0

            wait_until(lambda: tracks() > 0.0, "tracks in Prometheus")
            (target,) = answer("targets")["activeTargets"]
            assert (target["health"], target["labels"]["job"]) == ("up", "aeroskein")
            wait_until(lambda: "prometheus" in stack.healthy(), "Prometheus to be healthy")

    prometheus = official("PROMETHEUS_IMAGE")
    figures["profile metrics: Prometheus"] = prometheus or "stand-in"
    if prometheus:
        scrapes(prometheus)
        return
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        pytest.skip("Prometheus can neither be pulled nor be taken from Debian's packages")
    fetched = subprocess.run(["apt-get", "-qq", "download", "prometheus", "busybox-static"], cwd=tmp_path)
    if fetched.returncode != 0:
        pytest.skip("Prometheus can neither be pulled nor be fetched with apt-get")
    for package in ("prometheus", "busybox-static"):
        (archive,) = tmp_path.glob(f"{package}_*.deb")
        run("dpkg-deb", "-x", archive, tmp_path / package)
        archive.unlink()
    base = re.search(r"^ARG BASE=(\S+)", (DEPLOY / "Dockerfile").read_text(), re.MULTILINE)
    assert base
    with stand_in("PROMETHEUS", tmp_path, PROMETHEUS.format(base=base[1])) as made:
        scrapes(made)
