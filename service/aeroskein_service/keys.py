"""Zenoh keys of everything that crosses the boundary: one place that spells them, for the service and its neighbours.

The layout is fixed depth with the version early, so that an access rule is a prefix; ``docs/messages.md`` lists it.
"""

from __future__ import annotations

import os
import re
import socket
from dataclasses import dataclass
from typing import Final

__all__ = ["Keys", "default_instance", "is_chunk", "is_prefix", "track_label"]

DEFAULT_PREFIX: Final = "atc/v1"
# Zenoh forbids wildcards and empty chunks in a concrete key; a chunk that starts with @ is hidden from wildcards.
_CHUNK: Final = re.compile(r"[^/*$?#@\s][^/*$?#\s]*")


def is_chunk(text: str) -> bool:
    """Whether ``text`` can stand between two slashes of a key."""
    return _CHUNK.fullmatch(text) is not None


def is_prefix(text: str) -> bool:
    """Whether ``text`` is one or more chunks without leading or trailing slash."""
    return all(is_chunk(chunk) for chunk in text.split("/"))


def default_instance() -> str:
    """Host and process number as one chunk: ``tower1-4711``."""
    host = re.sub(r"[^A-Za-z0-9_.-]", "-", socket.gethostname()) or "host"
    return f"{host}-{os.getpid()}"


def track_label(label: int, track_number: int) -> str:
    """The chunk that names a track: its address where ``label`` is one, else ``T`` and the number."""
    return f"{label:06X}" if label >= 0 else f"T{track_number:06d}"


@dataclass(frozen=True, slots=True)
class Keys:
    """Every key under one prefix."""

    prefix: str = DEFAULT_PREFIX

    def reports(self, sensor: str) -> str:
        """Where a sensor puts its batches."""
        return f"{self.prefix}/reports/{sensor}"

    def reports_below(self, sensor: str) -> str:
        """What the service subscribes to for one sensor; ``**`` matches the bare key too."""
        return f"{self.prefix}/reports/{sensor}/**"

    def sensor_of(self, key: str) -> str | None:
        """The sensor chunk of a reports key, None where ``key`` is something else."""
        head = f"{self.prefix}/reports/"
        return key[len(head) :].split("/", 1)[0] if key.startswith(head) else None

    def fused(self, product: str, track: str) -> str:
        """One track's fused points of one product; ``track`` may be ``*``."""
        return f"{self.prefix}/fused/{product}/{track}"

    def feed(self, product: str, instance: str = "*") -> str:
        """All fused points of one product, in batches."""
        return f"{self.prefix}/feed/{product}/{instance}"

    def registration(self, sensor: str) -> str:
        """A radar's registration state."""
        return f"{self.prefix}/registration/{sensor}"

    def status(self, instance: str = "*") -> str:
        """The service's status."""
        return f"{self.prefix}/status/{instance}"

    def dispositions(self, sensor: str) -> str:
        """What became of each report of a sensor."""
        return f"{self.prefix}/debug/dispositions/{sensor}"

    def alive_fusion(self, instance: str = "*", shard: str = "1of1") -> str:
        """Liveliness token of a fusion service."""
        return f"{self.prefix}/alive/fusion/{shard}/{instance}"

    def alive(self, service: str, instance: str) -> str:
        """Liveliness token of any other process of ours."""
        return f"{self.prefix}/alive/{service}/{instance}"

    def query(self, what: str) -> str:
        """A queryable: ``tracks``, ``reports`` or ``elements``."""
        return f"{self.prefix}/query/{what}"

    def control(self, what: str, sensor: str) -> str:
        """A control: ``registration`` or ``sensor`` of one sensor."""
        return f"{self.prefix}/control/{what}/{sensor}"
