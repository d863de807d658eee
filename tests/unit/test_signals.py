"""Stopping on signals, whatever the main thread is doing just then."""

import subprocess
import sys

import pytest

LOCKED = """
import signal
from aeroskein_service.signals import stop_on_signals
stop = stop_on_signals()
with stop._cond:  # as inside stop.wait(), between its taking the lock and letting it go
    signal.raise_signal(signal.SIGTERM)
assert stop.wait(30.0)
"""
TWICE = """
import signal
from aeroskein_service.signals import stop_on_signals
stop_on_signals()
signal.raise_signal(signal.SIGINT)
signal.raise_signal(signal.SIGTERM)
raise SystemExit(7)
"""


@pytest.mark.parametrize(("program", "status"), [(LOCKED, 0), (TWICE, 1)], ids=["while waiting", "twice"])
def test_a_signal_is_never_lost_and_a_second_one_ends_at_once(program: str, status: int) -> None:
    assert subprocess.run([sys.executable, "-c", program], timeout=60.0, check=False).returncode == status
