"""The composed demo as tests see it: brought up by the real engine, looked at from outside, broken, taken down."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[2]
DEPLOY: Final = ROOT / "deploy"
IMAGE: Final = "aeroskein:demo"
LIMIT_S: Final = 120.0  # a condition that has not come true by then never will, on a busy machine either
COMMAND_S: Final = 900.0  # building the image on a slow disk takes minutes


def run(*command: str | Path, check: bool = True, environment: dict[str, str] | None = None) -> str:
    """What a command writes to both outputs; fails with it."""
    done = subprocess.run(
        [str(part) for part in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
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
    return None if compose_command() else "neither docker compose nor docker-compose"


@cache
def compose_command() -> tuple[str, ...]:
    """``docker compose``, or the older ``docker-compose``; empty where there is neither."""
    for command in (("docker", "compose"), ("docker-compose",)):
        if shutil.which(command[0]):
            found = subprocess.run([*command, "version"], capture_output=True, timeout=60)
            if found.returncode == 0:
                return command
    return ()


def build_image() -> str:
    """Build the image unless AEROSKEIN_IMAGE names one that is there; its name."""
    name = os.environ.get("AEROSKEIN_IMAGE")
    if name:
        return name
    run(ROOT / "tests" / "deploy" / "make_image.sh", IMAGE)
    return IMAGE


def wait_until(condition: Callable[[], Any], what: str, limit_s: float = LIMIT_S) -> Any:
    """The condition's first true value; fails the test when the limit passes."""
    ends_s = time.monotonic() + limit_s
    while not (value := condition()):
        assert time.monotonic() < ends_s, f"waited {limit_s:g} s for {what}"
        time.sleep(0.2)
    return value


class Stack:
    """One composed project with a name of its own.

    Parameters
    ----------
    name : str
        Of the project.
    files : sequence of str
        Compose files in deploy/, later ones winning.
    environment : dict
        Variables for them.
    """

    def __init__(self, name: str, files: Sequence[str], environment: dict[str, str]) -> None:
        self.name = name
        self._environment = environment
        self._compose = [*compose_command(), "-p", name]
        for file in files:
            self._compose += ["-f", str(DEPLOY / file)]

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
        mine = f"label=com.docker.compose.project={self.name}"
        label = '{{.Label "com.docker.compose.service"}}'
        return run("docker", "container", "ls", "--filter", mine, "--format", label).split()

    def container(self, service: str) -> str:
        """Its container's id."""
        return self.compose("ps", "-q", service).split()[-1]

    def inspect(self, service: str) -> dict[str, Any]:
        """All that the engine knows about it."""
        found: dict[str, Any] = json.loads(run("docker", "inspect", self.container(service)))[0]
        return found

    def health(self, service: str) -> str:
        """starting, healthy or unhealthy."""
        state: str = self.inspect(service)["State"]["Health"]["Status"]
        return state

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

    def cut(self, service: str, network: str) -> None:
        """Take its network away."""
        run("docker", "network", "disconnect", f"{self.name}_{network}", self.container(service))

    def join(self, service: str, network: str) -> None:
        """Give its network back."""
        run("docker", "network", "connect", "--alias", service, f"{self.name}_{network}", self.container(service))

    # -- what is written ---------------------------------------------------------------------------------------------
    def log(self, service: str) -> list[tuple[float, str]]:
        """Its lines, each with the time at which the engine got it. [s since the epoch]"""
        lines = run("docker", "logs", "--timestamps", self.container(service)).splitlines()
        return [(seconds(stamp), text) for stamp, _, text in (line.partition(" ") for line in lines)]

    def points(self, since_s: float = 0.0) -> Iterator[tuple[float, dict[str, Any]]]:
        """Fused points that the consumer printed, with the time of printing."""
        for at_s, text in self.log("consumer"):
            if at_s >= since_s and text.startswith("{"):
                yield at_s, json.loads(text)


def seconds(stamp: str) -> float:
    """The engine's way of writing a time, nanoseconds and all. [s since the epoch]"""
    whole, _, fraction = stamp.rstrip("Z").partition(".")
    return datetime.fromisoformat(f"{whole}+00:00").timestamp() + float(f"0.{fraction or 0}")
