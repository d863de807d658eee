"""A router and a session of its own for every test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from tests.integration.harness import connect, free_endpoint

from aeroskein_service.keys import Keys
from aeroskein_service.transport import Router, Session

PREFIX = "test/v1"


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Where a router listens."""
    where = free_endpoint()
    with Router(listen=[where]):
        yield where


@pytest.fixture
def session(endpoint: str) -> Iterator[Session]:
    """A session beside the service's own."""
    with connect(endpoint) as opened:
        yield opened


@pytest.fixture
def keys() -> Keys:
    """The tests' keys."""
    return Keys(PREFIX)
