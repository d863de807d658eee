"""The composed demo as tests see it: brought up by the real engine, looked at from outside, broken, taken down."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import cache
from pathlib import Path
from subprocess import PIPE, STDOUT
from typing import Any, Final

ROOT: Final = Path(__file__).parents[2]
DEPLOY: Final = ROOT / "deploy"
SCRIPTS: Final = ROOT / "tests" / "deploy"
RUN: Final = f"aeroskein-{secrets.token_hex(4)}"  # runs of several checkouts on one engine must not meet
SERVICE_LABEL: Final = '{{.Label "com.docker.compose.service"}}'
LIMIT_S: Final = 240.0  # a condition that has not come true by then never will, on a busy machine either
PAUSE_S: Final = 0.5  # every look starts programs, which take time from what is looked at
COMMAND_S: Final = 900.0  # building the image on a slow disk takes minutes


def run(*command: str | Path, check: bool = True, environment: dict[str, str] | None = None) -> str:
    """What a command writes to both outputs; fails with it."""
    done = subprocess.run(
        [str(part) for part in command],
        stdout=PIPE,
        stderr=STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        timeout=COMMAND_S,
        env=None if environment is None else os.environ | environment,
    )
    assert not check or done.returncode == 0, f"{' '.join(map(str, command))}:\n{done.stdout[-4000:]}"
    return done.stdout


@cache
def missing() -> str | None:
    """Why there can be no stack here; None where there can."""
    if shutil.which("docker") is None:
        return "no docker command"
    engine = subprocess.run(["docker", "info"], capture_output=True, text=True, timeout=60)
    if engine.returncode != 0:
        return "no Docker engine answers"
    if not compose_command():
        return "neither docker compose nor docker-compose"
    base = subprocess.run([SCRIPTS / "make_base_image.sh"], stdout=PIPE, stderr=STDOUT, text=True, timeout=COMMAND_S)
    return None if base.returncode == 0 else base.stdout.splitlines()[-1]


@cache
def compose_command() -> tuple[str, ...]:
    """``docker compose``, or the older ``docker-compose``; empty where there is neither."""
    for command in (("docker", "compose"), ("docker-compose",)):
        if shutil.which(command[0]):
            found = subprocess.run([*command, "version"], capture_output=True, timeout=60)
            if found.returncode == 0:
                return command
    return ()


@contextmanager
def built_image() -> Iterator[str]:
    """The image of this checkout, under a name of this run's own; AEROSKEIN_IMAGE names one that is there already."""
    name = os.environ.get("AEROSKEIN_IMAGE")
    if name:
        yield name
        return
    name = f"{RUN}:test"
    run(SCRIPTS / "make_image.sh", name)
    try:
        yield name
    finally:
        run("docker", "image", "rm", name, check=False)


def wait_until(condition: Callable[[], Any], what: str, limit_s: float = LIMIT_S) -> Any:
    """The condition's first true value; fails the test when the limit passes."""
    ends_s = time.monotonic() + limit_s
    while not (value := condition()):
        assert time.monotonic() < ends_s, f"waited {limit_s:g} s for {what}"
        time.sleep(PAUSE_S)
    return value


class Stack:
    """One composed project with a name of its own.

    Parameters
    ----------
    name : str
        Of the project.
    environment : dict
        Variables for the compose file.
    profile : str, optional
        Which profile; its services are called by the names of those that they stand for, ``adsb`` for ``adsb-secure``.
    """

    def __init__(self, name: str, environment: dict[str, str], profile: str = "") -> None:
        self.name = name
        self._environment = environment
        self._compose = [*compose_command(), "-p", name, "-f", str(DEPLOY / "compose.yaml")]
        if profile:
            self._compose += ["--profile", profile]
        self._profile = profile
        self._containers: dict[str, str] = {}

    def compose(self, *arguments: str, check: bool = True) -> str:
        """Run the compose tool on this project."""
        return run(*self._compose, *arguments, check=check, environment=self._environment)

    def up(self, *services: str) -> None:
        """Start everything, or some services."""
        self.compose("up", "-d", "--no-build", *services)

    def down(self) -> None:
        """Remove everything that belongs to the project."""
        self.compose("down", "-v", "--remove-orphans", "-t", "5", check=False)

    def leftovers(self) -> str:
        """Containers, networks and volumes of the project that still exist."""
        mine = f"label=com.docker.compose.project={self.name}"
        return "".join(
            run("docker", kind, "ls", "-q", *(["-a"] if kind == "container" else []), "--filter", mine)
            for kind in ("container", "network", "volume")
        )

    # -- one container -----------------------------------------------------------------------------------------------
    def services(self) -> list[str]:
        """Names of the services that run."""
        return self._names()

    def healthy(self) -> set[str]:
        """Names of the services that are healthy."""
        return set(self._names("--filter", "health=healthy"))

    def _names(self, *filters: str) -> list[str]:
        mine = f"label=com.docker.compose.project={self.name}"
        names = run("docker", "container", "ls", "--filter", mine, *filters, "--format", SERVICE_LABEL).split()
        return [name.removesuffix(f"-{self._profile}") for name in names]

    def container(self, service: str) -> str:
        """Its container's id."""
        if service not in self._containers:
            mine = f"label=com.docker.compose.project={self.name}"
            listed = run(
                "docker", "container", "ls", "-a", "--filter", mine, "--format", f"{{{{.ID}}}} {SERVICE_LABEL}"
            )
            named = {name: identity for identity, name in (line.split() for line in listed.splitlines())}
            self._containers |= {name.removesuffix(f"-{self._profile}"): found for name, found in named.items()}
        return self._containers[service]

    def inspect(self, service: str) -> dict[str, Any]:
        """All that the engine knows about it."""
        found: dict[str, Any] = json.loads(run("docker", "inspect", self.container(service)))[0]
        return found

    def started_s(self, service: str) -> float:
        """When the container's process was started. [s since the epoch]"""
        return seconds(self.inspect(service)["State"]["StartedAt"])

    def address(self, service: str, network: str) -> str:
        """Its address on one of the networks."""
        address: str = self.inspect(service)["NetworkSettings"]["Networks"][f"{self.name}_{network}"]["IPAddress"]
        return address

    def kill(self, service: str) -> None:
        """End it without warning."""
        run("docker", "kill", "--signal", "KILL", self.container(service))

    def start(self, service: str) -> None:
        """Start a killed container again."""
        run("docker", "start", self.container(service))

    def pause(self, service: str) -> None:
        """Let its processes stand still."""
        run("docker", "exec", self.container(service), "sh", "-c", "kill -STOP -1")

    def resume(self, service: str) -> None:
        """Let them go on."""
        run("docker", "exec", self.container(service), "sh", "-c", "kill -CONT -1")

    def cut(self, service: str, network: str) -> None:
        """Take its network away."""
        run("docker", "network", "disconnect", f"{self.name}_{network}", self.container(service))

    def join(self, service: str, network: str) -> None:
        """Give its network back."""
        run("docker", "network", "connect", "--alias", service, f"{self.name}_{network}", self.container(service))

    # -- what is written ---------------------------------------------------------------------------------------------
    def log(self, service: str, since_s: float = 0.0) -> list[tuple[float, str]]:
        """Its lines, each with the time at which the engine got it. [s since the epoch]"""
        lines = run("docker", "logs", "--timestamps", "--since", f"{since_s:.3f}", self.container(service)).splitlines()
        return [(seconds(stamp), text) for stamp, _, text in (line.partition(" ") for line in lines)]

    def points(self, since_s: float = 0.0) -> Iterator[tuple[float, dict[str, Any]]]:
        """Fused points that the consumer printed, with the time of printing."""
        for at_s, text in self.log("consumer", since_s):
            if text.startswith("{"):
                yield at_s, json.loads(text)


def seconds(stamp: str) -> float:
    """The engine's way of writing a time, nanoseconds and all. [s since the epoch]"""
    whole, _, fraction = stamp.rstrip("Z").partition(".")
    return datetime.fromisoformat(f"{whole}+00:00").timestamp() + float(f"0.{fraction or 0}")
