"""What systemd is told: that the service is ready, that it still works, that it is stopping.

The protocol is one datagram to the socket in ``NOTIFY_SOCKET`` (sd_notify); without it nothing happens.
"""

from __future__ import annotations

import contextlib
import os
import socket

__all__ = ["notify", "watchdog_period_s"]


def notify(state: str) -> None:
    """Send ``READY=1``, ``WATCHDOG=1`` or ``STOPPING=1``; a supervisor that is gone is no error."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]  # the abstract namespace
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.sendto(state.encode(), address)


def watchdog_period_s() -> float | None:
    """How often ``WATCHDOG=1`` is due: half of what the unit's ``WatchdogSec`` says; None where it says nothing. [s]"""
    wanted_us = os.environ.get("WATCHDOG_USEC", "")
    return int(wanted_us) / 2e6 if wanted_us.isdigit() and int(wanted_us) > 0 else None
