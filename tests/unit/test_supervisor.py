"""What systemd is told over its socket."""

from __future__ import annotations

import socket

import pytest

from aeroskein_service.supervisor import notify, watchdog_period_s


def test_supervisor_gets_the_state(tmp_path, monkeypatch):
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(path)
        monkeypatch.setenv("NOTIFY_SOCKET", path)
        notify("READY=1")
        assert listener.recv(100) == b"READY=1"


def test_without_a_supervisor_nothing_happens(tmp_path, monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    notify("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    notify("READY=1")


@pytest.mark.parametrize(("wanted", "period_s"), [("10000000", 5.0), ("", None), ("0", None), ("soon", None)], ids=str)
def test_watchdog_is_fed_twice_in_its_time(monkeypatch, wanted, period_s):
    monkeypatch.setenv("WATCHDOG_USEC", wanted)
    assert watchdog_period_s() == period_s
