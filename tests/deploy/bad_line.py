"""A bad line for one container: delay, jitter and loss on every frame that it sends.

The kernel's netem does this where there is one. Elsewhere a relay in user space does: the container's link is taken off
its bridge and joined to it again through the relay, which holds frames back, lets some overtake others and loses some.
Both work below TCP, as a line does. Needs root on the machine of the engine.
"""

from __future__ import annotations

import heapq
import itertools
import os
import random
import re
import select
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Final

__all__ = ["BadLineError", "Line", "bad_line"]

EVERY_PROTOCOL: Final = 0x0003
SOL_PACKET, PACKET_VNET_HDR, PACKET_OUTGOING = 263, 15, 4
# An unsplit segment of 64 kB, its Ethernet header and what the kernel says about checksum and splitting.
FRAME_BYTES: Final = 65_536 + 64
IDLE_S: Final = 0.2


class BadLineError(Exception):
    """There can be none here; the message says why."""


@dataclass
class Line:
    """What the line does, and did."""

    delay_s: float
    jitter_s: float
    loss: float
    made_by: str = ""
    frames: int = 0
    lost: int = 0


def _ip(*arguments: str) -> str:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True)
    if done.returncode != 0:
        raise BadLineError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout


@contextmanager
def bad_line(pid: int, line: Line) -> Iterator[Line]:
    """Make the only network of the container with this process bad until the block ends."""
    if os.geteuid() != 0:
        raise BadLineError("only root can spoil a container's network")
    inside = ["nsenter", "-t", str(pid), "-n"]
    links = subprocess.run([*inside, "ip", "-o", "link"], capture_output=True, text=True)
    found = re.search(r"\d+: (eth\d+)@if(\d+):", links.stdout)
    if found is None:
        raise BadLineError(f"the container's network is not on this machine: {links.stderr.strip()}")
    device, index = found.groups()
    queue = [*inside, "tc", "qdisc"]
    netem = ["netem", "delay", f"{line.delay_s * 1e3:g}ms", f"{line.jitter_s * 1e3:g}ms", "loss", f"{line.loss:.0%}"]
    with ExitStack() as held:
        if subprocess.run([*queue, "add", "dev", device, "root", *netem], capture_output=True).returncode == 0:
            line.made_by = "netem"
            held.callback(subprocess.run, [*queue, "del", "dev", device, "root"], check=True)
        else:
            line.made_by = "relay"
            held.enter_context(_relayed(int(index), line))
        yield line


@contextmanager
def _relayed(index: int, line: Line) -> Iterator[None]:
    """Put a relay between the host's end of the container's link and its bridge."""
    end = socket.if_indextoname(index)
    bridge = re.search(r" master (\S+)", _ip("-o", "link", "show", "dev", end))
    if bridge is None:
        raise BadLineError(f"{end} is on no bridge")
    near, far = f"bad{index}a", f"bad{index}b"
    with ExitStack() as held:
        _ip("link", "add", near, "type", "veth", "peer", "name", far)
        held.callback(_ip, "link", "del", near)
        for name in (near, far):
            _ip("link", "set", "dev", name, "addrgenmode", "none")
            _ip("link", "set", "dev", name, "up")
        _ip("link", "set", "dev", far, "master", bridge[1])
        outer, inner = (held.enter_context(_tap(name)) for name in (near, end))
        stop = threading.Event()
        relay = threading.Thread(target=_relay, args=(inner, outer, line, stop), name="bad-line")
        _ip("link", "set", "dev", end, "nomaster")
        held.callback(_ip, "link", "set", "dev", end, "master", bridge[1])
        relay.start()
        held.callback(relay.join)
        held.callback(stop.set)
        yield


def _tap(name: str) -> socket.socket:
    """Every frame of a device, with what the kernel has left undone about it."""
    tap = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)
    tap.setsockopt(SOL_PACKET, PACKET_VNET_HDR, 1)
    tap.bind((name, EVERY_PROTOCOL))
    return tap


def _relay(inner: socket.socket, outer: socket.socket, line: Line, stop: threading.Event) -> None:
    """Pass frames on: from outside at once, from inside as the line has it."""
    drawn, order = random.Random(1), itertools.count()
    under_way: list[tuple[float, int, bytes]] = []
    while not stop.is_set():
        wait_s = min(IDLE_S, max(0.0, under_way[0][0] - time.monotonic())) if under_way else IDLE_S
        for tap in select.select([inner, outer], [], [], wait_s)[0]:
            frame, (_, _, kind, *_) = tap.recvfrom(FRAME_BYTES)
            if kind == PACKET_OUTGOING:
                continue  # the relay's own
            if tap is outer:
                inner.send(frame)
                continue
            line.frames += 1
            if drawn.random() < line.loss:
                line.lost += 1
                continue
            late_s = line.delay_s + line.jitter_s * drawn.uniform(-1.0, 1.0)
            heapq.heappush(under_way, (time.monotonic() + late_s, next(order), frame))
        while under_way and under_way[0][0] <= time.monotonic():
            outer.send(heapq.heappop(under_way)[2])
