"""``aeroskein health``: whether a service is ready, for supervisors and containers."""

from __future__ import annotations

import json
import sys
import urllib.error
import urllib.request
from typing import Final

__all__ = ["run"]

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


def _reasons(body: bytes) -> str:
    try:
        return "; ".join(json.loads(body)["reasons"])
    except (ValueError, KeyError, TypeError):
        return body[:200].decode("utf-8", "replace").strip() or "no reason given"
