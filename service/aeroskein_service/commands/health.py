"""``aeroskein health``: whether a process of ours is well, for supervisors and containers.

A fusion service says so itself over HTTP. Everything else (router, sensor feeds, consumers) holds a liveliness token on
Zenoh, which the router takes away when its connection breaks: asking for it proves the process, its network and the
router at once.
"""

from __future__ import annotations

import json
import sys
import threading
import urllib.error
import urllib.request
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from aeroskein_service.config import Config

__all__ = ["run", "run_alive"]

TIMEOUT_S: Final = 3.0


def run(url: str = "http://127.0.0.1:8080") -> int:
    """Ask ``/readyz`` below ``url``; 0 where the service is ready, else 1 and the reasons."""
    if not url.startswith(("http://", "https://")):
        url = f"http://{url}"
    target = url.rstrip("/")
    if not target.endswith("/readyz"):
        target += "/readyz"
    try:
        with urllib.request.urlopen(target, timeout=TIMEOUT_S):
            print("ready")
            return 0
    except urllib.error.HTTPError as error:
        with error:
            print(f"not ready: {_reasons(error.read())}", file=sys.stderr)
    except (OSError, ValueError) as error:
        why = getattr(error, "reason", error)
        print(f"no service answers at {target}: {getattr(why, 'strerror', None) or why}", file=sys.stderr)
    return 1


def run_alive(config: Config, service: str) -> int:
    """Ask the router for the liveliness token of a process; 0 where it is there, else 1 and one sentence.

    Parameters
    ----------
    config : Config
        Section ``zenoh`` as the process itself has it; with ``service.instance`` only that instance counts.
    service : str
        ``router``, ``sensor-adsb``, ``watch``, ``fusion``, ...
    """
    from aeroskein_service.keys import Keys
    from aeroskein_service.transport import OpenCancelledError, open_session

    keys, instance = Keys(config.zenoh.prefix), config.service.instance or "*"
    token = keys.alive_fusion(instance, "*") if service == "fusion" else keys.alive(service, instance)
    refusal: list[str] = []
    stop = threading.Event()

    def give_up(sentence: str) -> None:
        refusal.append(sentence)
        stop.set()

    try:
        with open_session(config.zenoh.link, announce=give_up, stop=stop) as session:
            if session.alive(token, timeout_s=TIMEOUT_S):
                print("alive")
                return 0
    except OpenCancelledError:
        print(f"not alive: {refusal[0]}", file=sys.stderr)
        return 1
    print(f"not alive: nothing holds {token}", file=sys.stderr)
    return 1


def _reasons(body: bytes) -> str:
    try:
        return "; ".join(json.loads(body)["reasons"])
    except (ValueError, KeyError, TypeError):
        return body[:200].decode("utf-8", "replace").strip() or "no reason given"
