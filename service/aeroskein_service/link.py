"""How a process reaches the Zenoh router: the address and login of one link, and what Zenoh is told about it.

Plain data without zenoh, so that the configuration can be checked before anything is opened.
"""

from __future__ import annotations

import socket
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

__all__ = ["BASE_SETTINGS", "Link", "client_settings"]

PROTOCOLS: Final = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream")
ATTEMPT_MS: Final = 1000  # one try to reach the router; short, so that a signal is answered within it
# Reconnection after a router restart took 2 to 4 s with the default back-off and 0.4 s with this one.
RETRY: Final = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2}
# Batches of 64 kB that may wait per priority before DROP drops: the default 2 loses points of one engine batch.
QUEUE_BATCHES: Final = 16

BASE_SETTINGS: Final[dict[str, Any]] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    # Implicit shared memory loses messages silently when the receiver is descheduled for 100 ms.
    "transport/shared_memory/enabled": False,
    "transport/link/tx/queue/size/data": QUEUE_BATCHES,
}
"""What every process of ours has in common, by Zenoh's configuration keys."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """How to reach the router.

    Attributes
    ----------
    connect : endpoints, tried in order: ``("tcp/127.0.0.1:7447",)``.
    user, password : empty where the router asks for none.
    tls_root_ca, tls_certificate, tls_private_key : PEM files; empty where not used.
    tls_verify_name : whether the router's certificate must carry the name we connect to.
    """

    connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    user: str = ""
    password: str = field(default="", repr=False)
    tls_root_ca: str = ""
    tls_certificate: str = ""
    tls_private_key: str = ""
    tls_verify_name: bool = True

    @property
    def where(self) -> str:
        """The endpoints for a sentence."""
        return ", ".join(self.connect)

    def complaint(self) -> str | None:
        """What cannot work, as one sentence; None where nothing is wrong."""
        for endpoint in self.connect:
            if endpoint.partition("/")[0] not in PROTOCOLS:
                return f"zenoh.connect: {endpoint!r} is no endpoint, expected for example 'tcp/127.0.0.1:7447'"
        for name in ("tls_root_ca", "tls_certificate", "tls_private_key"):
            path = getattr(self, name)
            if path and not Path(path).is_file():
                return f"zenoh.{name}: no such file: {path}"
        return None

    def answers(self) -> bool:
        """Whether something accepts a connection there: tells a refused login from a router that is not up."""
        return any(_accepts(endpoint) for endpoint in self.connect)


def client_settings(link: Link) -> dict[str, Any]:
    """Zenoh's configuration of a client of this router, by configuration key."""
    settings: dict[str, Any] = BASE_SETTINGS | {
        "mode": "client",
        "connect/endpoints": list(link.connect),
        "connect/timeout_ms": ATTEMPT_MS,
        "connect/exit_on_failure": True,
        "connect/retry": RETRY,
        # A cached sample needs a time stamp of its own, or a history request limited by age cannot judge it.
        "timestamping/enabled": True,
    }
    if link.user:
        settings["transport/auth/usrpwd"] = {"user": link.user, "password": link.password}
    tls: dict[str, Any] = {}
    if link.tls_root_ca:
        tls["root_ca_certificate"] = link.tls_root_ca
        tls["verify_name_on_connect"] = link.tls_verify_name
    if link.tls_certificate:
        tls |= {
            "connect_certificate": link.tls_certificate,
            "connect_private_key": link.tls_private_key,
            "enable_mtls": True,
        }
    if tls:
        settings["transport/link/tls"] = tls
    return settings


def _accepts(endpoint: str) -> bool:
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.partition("?")[0].partition("#")[0].rpartition(":")
    if protocol not in ("tcp", "tls", "ws") or not port.isdigit():
        return False
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=0.5):
            return True
    except OSError:
        return False
