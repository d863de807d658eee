"""Nonsense sent to the page's server: it ends the connection that sends it, and harms nobody else."""

from __future__ import annotations

import json
import random
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise

import pytest
from tests.integration.harness import Process, free_endpoint, free_port, wait_until, write_config
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from aeroskein_service.transport import Router

SEED = 7
CONNECTIONS = 40
MESSAGES = 30
GOOD = (
    {"type": "view", "box": [47.0, 9.0, 49.0, 12.0], "pinned": [1, 2]},
    {"type": "shown", "frame": 3},
    {"type": "seek", "time_s": 1.79e9},
    {"type": "play", "on": True, "speed": 2.0},
)
ODD = (None, True, -1, 0, 2**70, 1e308, "", "\x00", "é" * 40, [], {}, [[[]]], "NaN", -0.0)


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[tuple[str, Process]]:
    """A page beside a router; gives its address and process. Empty pictures are pictures too."""
    folder, endpoint, http = tmp_path_factory.mktemp("hostile"), free_endpoint(), f"127.0.0.1:{free_port()}"
    config = write_config(folder, endpoint, "test/v1")
    with Router(listen=[endpoint]), Process(folder, "web", "--config", config, "--listen", http) as web:
        web.wait_for_err("the page is at")
        yield http, web
        assert web.stop() == 0


@contextmanager
def looking(http: str) -> Iterator[list[int]]:
    """One who looks at every picture; gives the list of their numbers, which grows."""
    frames: list[int] = []

    def look(client: ClientConnection) -> None:
        with suppress(ConnectionClosed):
            for message in client:
                if isinstance(message, bytes):
                    frames.append(int.from_bytes(message[4:8], "little"))
                    client.send(json.dumps({"type": "shown", "frame": frames[-1]}))

    with connect(f"ws://{http}/ws", compression=None) as client:
        thread = threading.Thread(target=look, args=(client,), daemon=True)
        thread.start()
        yield frames
    thread.join(5.0)


def nonsense(rng: random.Random) -> str | bytes | list[str]:
    """A message that may be right, nearly right, or nothing at all; a list is sent in fragments."""
    kind = rng.randrange(8)
    if kind == 0:
        return rng.randbytes(rng.randrange(5000))
    if kind == 1:
        return "".join(chr(rng.randrange(0x20, 0xD7FF)) for _ in range(rng.randrange(300)))
    if kind == 2:
        return "[" * rng.randrange(1, 4000)
    message = dict(rng.choice(GOOD))
    if kind == 3:
        message[rng.choice(list(message))] = rng.choice(ODD)
    elif kind == 4:
        message["box"] = [rng.choice((*ODD, 91.0, -181.0, 10.0)) for _ in range(rng.randrange(6))]
    elif kind == 5:
        message |= {"more" * rng.randrange(1, 9): rng.choice(ODD)}
    text = json.dumps(message)
    if kind == 6:
        at = rng.randrange(len(text))
        return text[:at] + chr(rng.randrange(0x21, 0x7F)) + text[at + 1 :]
    return [text[: len(text) // 2], text[len(text) // 2 :]] if kind == 7 else text


def pester(http: str, rng: random.Random) -> int | None:
    """One connection full of nonsense; the code with which it was ended, none where it was borne."""
    try:
        with connect(f"ws://{http}/ws", compression=None, max_size=None) as client:
            for _ in range(MESSAGES):
                client.send(nonsense(rng))
            until(client, 0.2)
    except ConnectionClosed as closed:
        return None if closed.rcvd is None else closed.rcvd.code
    return None


def until(client: ClientConnection, seconds: float) -> None:
    """Read what comes for a while."""
    ends_s = time.monotonic() + seconds
    while (left_s := ends_s - time.monotonic()) > 0.0:
        try:
            client.recv(timeout=left_s)
        except TimeoutError:
            return


def throw(http: str, content: bytes) -> None:
    """Send bytes to the port, whatever they are, and take what comes."""
    host, port = http.split(":")
    with socket.create_connection((host, int(port)), timeout=5.0) as raw:
        raw.settimeout(0.3)
        with suppress(TimeoutError, ConnectionError):
            raw.sendall(content)
            while raw.recv(65536):
                pass


def rss_mb(pid: int) -> float:
    """Memory of a process. [MB]"""
    with open(f"/proc/{pid}/status") as lines:
        return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmRSS"))


def test_nonsense_ends_its_own_connection_and_harms_nobody_else(server):
    # Given one who looks, and is shown every picture
    http, web = server
    with looking(http) as frames:
        wait_until(lambda: len(frames) >= 2, "pictures")
        before_mb = rss_mb(web.popen.pid)
        # When others send nonsense of every kind, on the WebSocket and below it
        rng = random.Random(SEED)
        codes = [pester(http, rng) for _ in range(CONNECTIONS)]
        upgrade = f"GET /ws HTTP/1.1\r\nHost: {http}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        upgrade += "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
        for size in (1, 10, 200, 5000):
            throw(http, rng.randbytes(size))
            throw(http, upgrade.encode() + rng.randbytes(size))
            throw(http, upgrade[: rng.randrange(len(upgrade))].encode())
        seen = len(frames)
        wait_until(lambda: len(frames) > seen + 1, "pictures after it")
    # Then most of them were sent away by the rules, the pictures went on, and nothing grew or broke
    assert set(codes) <= {None, 1007, 1008, 1009}
    assert sum(code is not None for code in codes) > CONNECTIONS // 2
    assert all(1 <= after - before <= 3 for before, after in pairwise(frames))
    assert "Traceback" not in web.err
    assert rss_mb(web.popen.pid) - before_mb < 50.0


def test_message_that_is_too_long_ends_the_connection_at_once(server):
    http, _ = server
    with connect(f"ws://{http}/ws", compression=None) as client:
        client.send(json.dumps(GOOD[0] | {"more": "x" * 5000}))
        with pytest.raises(ConnectionClosed) as closed:
            until(client, 10.0)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1009


@pytest.mark.parametrize("origin", ["https://evil.example", "http://127.0.0.1:1", "null"])
def test_page_of_another_site_gets_no_picture(server, origin):
    http, _ = server
    with pytest.raises(InvalidStatus) as refused, connect(f"ws://{http}/ws", origin=origin):
        pass
    assert refused.value.response.status_code == 403
