"""The page while something is down: it says so, keeps the picture, and takes the banner away when all is well again."""

from __future__ import annotations

import os
import signal
import urllib.request
from pathlib import Path

import pytest
from tests.integration.browser import FLEET, Page, Traffic, launched, write_picture
from tests.integration.harness import Process, free_endpoint, free_port, is_running, write_config

from aeroskein_service.keys import Keys
from aeroskein_service.transport import Router

pytestmark = pytest.mark.slow
KEYS = Keys("test/v1")
FEW = FLEET[:5]


@pytest.fixture(scope="module")
def browser():
    with launched() as opened:
        yield opened


def test_killed_page_is_started_again_and_the_service_does_not_notice(browser, tmp_path, endpoint, session):
    # Given a service that serves the page itself
    http = f"127.0.0.1:{free_port()}"
    config = write_config(tmp_path, endpoint, KEYS.prefix)
    config.write_text(config.read_text().replace('listen = ""', f'listen = "{http}"'))
    with Process(tmp_path, "run", "--config", config) as service:
        service.wait_for_err("service_started")
        traffic = Traffic(session, KEYS, FEW)
        shown = Page(browser, f"http://{http}")
        shown.wait("__view.count === 5")
        before = shown.get("__view.connects")
        # When the page's process is killed
        os.kill(child_named(service.popen.pid, "web.child"), signal.SIGKILL)
        # Then the banner says that nothing moves, until the next one has started at the same address
        shown.wait("__view.banner.kind === 'frozen'")
        shown.wait(f"__view.connects > {before} && __view.banner.kind !== 'frozen' && __view.count === 5")
        with urllib.request.urlopen(f"http://{http}/readyz", timeout=10.0) as answer:
            assert answer.status == 200
        assert service.popen.poll() is None
        shown.close()
        traffic.close()
        assert service.stop() == 0


def child_named(parent: int, text: str) -> int:
    """The living child of a process whose command line holds a text."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
            command = path.with_name("cmdline").read_bytes().decode("utf-8", "replace")
        except OSError:
            continue
        if int(fields[1]) == parent and text in command and is_running(int(path.parent.name)):
            return int(path.parent.name)
    raise AssertionError(f"no child {text!r} of process {parent}")


def test_killed_service_brings_the_banner_and_a_restarted_one_takes_it_away(browser, tmp_path, endpoint, session):
    # Given a page of its own beside a service
    http = f"127.0.0.1:{free_port()}"
    config = write_config(tmp_path, endpoint, KEYS.prefix)
    traffic = Traffic(session, KEYS, FEW)
    with Process(tmp_path, "web", "--config", config, "--listen", http) as web:
        web.wait_for_err("the page is at")
        with Process(tmp_path, "run", "--config", config) as service:
            service.wait_for_err("service_started")
            shown = Page(browser, f"http://{http}")
            shown.wait("__view.count === 5 && __view.banner.kind !== 'frozen'")
            service.signal(signal.SIGKILL)
            service.wait()
        # When it is killed, the picture stays, and the page says that it is frozen
        banner = shown.wait("__view.banner.kind === 'frozen' && __view.banner")
        assert "silent" in banner["text"]
        assert shown.get("__view.count") == 5
        write_picture(shown, "frozen")
        # When it is back, it moves again, with each aircraft there once
        with Process(tmp_path, "run", "--config", config) as again:
            again.wait_for_err("service_started")
            shown.wait("__view.banner.kind !== 'frozen' && __view.tracks.length === 5")
            shown.wait("new Set(__view.tracks).size === 5")
            frame = shown.get("__view.frame")
            shown.wait(f"__view.frame > {frame} + 1")
            assert again.stop() == 0
        shown.close()
        assert web.stop() == 0
    traffic.close()


def test_page_without_a_router_says_what_it_waits_for(browser, tmp_path):
    endpoint, http = free_endpoint(), f"127.0.0.1:{free_port()}"
    config = write_config(tmp_path, endpoint, KEYS.prefix)
    with Process(tmp_path, "web", "--config", config, "--listen", http) as web:
        web.wait_for_err("the page is at")
        shown = Page(browser, f"http://{http}")
        waits = f"__view.banner.text.includes('Zenoh router at {endpoint}')"
        assert shown.wait(f"{waits} && __view.banner.kind") == "frozen"
        # When the router comes up
        with Router(listen=[endpoint]):
            shown.wait("__view.banner.text.includes('No fusion service')")
            shown.close()
            assert web.stop() == 0
