"""The composed demo, built and brought up once for all tests of a file; nothing of it is left afterwards."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.deploy.stack import ROOT, RUN, Stack, built_image, missing
from tests.integration.harness import free_port

ASKED_FOR = "AEROSKEIN_COMPOSE_TESTS"


@pytest.fixture(scope="session")
def image() -> Iterator[str]:
    """The image of this checkout."""
    if not os.environ.get(ASKED_FOR):
        pytest.skip(f"takes minutes: make test-compose, or set {ASKED_FOR}=1")
    reason = missing()
    if reason is not None:
        pytest.skip(reason)
    with built_image() as name:
        yield name


@pytest.fixture(scope="module")
def stack(image: str) -> Iterator[Stack]:
    """The demo as the README starts it, on a free port."""
    made = Stack(RUN, environment(image))
    try:
        made.up()
        yield made
    finally:
        made.down()


def environment(image: str) -> dict[str, str]:
    """What the compose files are told."""
    return {"AEROSKEIN_IMAGE": image, "AEROSKEIN_PORT": str(free_port())}


MEASURED: dict[str, Any] = {}


@pytest.fixture(scope="session")
def figures() -> dict[str, Any]:
    """What the tests measured; told at the end, and kept in build/deploy-figures.json."""
    return MEASURED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Tell the figures."""
    if not MEASURED:
        return
    terminalreporter.section("measured")
    for name, value in sorted(MEASURED.items()):
        terminalreporter.write_line(f"{name}: {value}")
    path = Path(ROOT, "build", "deploy-figures.json")
    path.parent.mkdir(exist_ok=True)
    known = json.loads(path.read_text()) if path.exists() else {}
    path.write_text(json.dumps(known | MEASURED, indent=1, sort_keys=True) + "\n")
