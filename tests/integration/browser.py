"""A real browser before the page: the system's Chromium through playwright, and the traffic that it looks at.

Where either is missing the tests are skipped, and say so.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.integration.harness import Sensor, report

from aeroskein_service.keys import Keys
from aeroskein_service.transport import Session

# Without a GPU: WebGL in software, as on the machines that run the tests. Root has no sandbox.
FLAGS = ["--disable-gpu", "--enable-unsafe-swiftshader", "--no-sandbox"]
# Chromium's own remarks about WebGL without a graphics card, and about an interface of this machine that came or went
# (containers of other tests), on which it drops what it loads and the page tries again: no page can avoid either.
DROPPED = "ERR_NETWORK_CHANGED"
REMARKS = ("GL Driver Message", "GPU stall", DROPPED)
# What a test that waited in vain wants to know.
STATE = """(() => {
  const names = ["count", "frame", "draws", "labels", "passed", "centre", "resting", "connects", "selected", "banner"];
  const seen = Object.fromEntries([...names, "faults", "query"].map((name) => [name, window.__view?.[name]]));
  return JSON.stringify({ ...seen, hidden: document.hidden, focus: document.activeElement?.id, ms: performance.now() });
})()"""
VIEWPORT = {"width": 1400, "height": 900}
LIMIT_MS = 60_000

FLEET = tuple(f"{0x400000 + k:06X}" for k in range(100))


def chromium() -> str:
    """The browser's path; skips the test where there is none."""
    pytest.importorskip("playwright", reason="playwright is not installed: it is in the dev dependencies")
    found = os.environ.get("AEROSKEIN_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    return found


@contextmanager
def launched() -> Iterator[Any]:
    """A browser."""
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


class Page:
    """One page of the browser, with what it said and asked for."""

    def __init__(
        self, browser: Any, url: str, query: str = "", before: Callable[[Any], Any] | None = None, **options: Any
    ) -> None:
        self.said: list[str] = []
        self.asked: list[str] = []
        self._dropped = False
        self._url = url
        self.context = browser.new_context(viewport=VIEWPORT, **options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(LIMIT_MS)
        self.page.on("console", lambda message: self._note(f"{message.type}: {message.text}"))
        self.page.on("pageerror", lambda error: self._note(f"error: {error}"))
        self.page.on("request", lambda request: self.asked.append(request.url))
        if before is not None:
            before(self.page)
        self.open(query)

    def open(self, query: str = "") -> None:
        """Load the page with what stands in the address; what it said before is forgotten."""
        self.said.clear()
        self.asked.clear()
        for limit_ms in (LIMIT_MS / 3, LIMIT_MS / 3, LIMIT_MS):
            self._dropped = False
            try:
                self.page.goto(f"{self._url}/?{query}")
                self.wait("__view.ready", limit_ms)
                return
            except Exception:  # playwright's own class, which is not there where it is not installed
                # The browser may have given up all files of the page, and with them what loads it again.
                if limit_ms == LIMIT_MS or not self._dropped:
                    raise

    def _note(self, text: str) -> None:
        self._dropped |= DROPPED in text
        if not any(remark in text for remark in REMARKS):
            self.said.append(text)

    def wait(self, expression: str, limit_ms: float = LIMIT_MS) -> Any:
        """Wait until an expression about ``__view`` is true; its value."""
        try:
            return self.page.wait_for_function(f"window.__view && ({expression})", timeout=limit_ms).json_value()
        except Exception as error:  # playwright's own class, which is not there where it is not installed
            raise AssertionError(
                f"waited for {expression}; the page: {self.get(STATE)}; it said {self.said}"
            ) from error

    def get(self, expression: str) -> Any:
        """An expression's value."""
        return self.page.evaluate(expression)

    def press(self, *keys: str) -> None:
        """Press keys one after the other."""
        for key in keys:
            self.page.keyboard.press(key)

    def close(self) -> None:
        """Close it."""
        self.context.close()


class Traffic:
    """A hundred aircraft that an ADS-B receiver reports once a second, until closed."""

    def __init__(self, session: Session, keys: Keys, addresses: tuple[str, ...] = FLEET) -> None:
        self._sensor = Sensor(session, keys, epoch=int(time.time() * 1000))
        self._addresses = addresses
        self._stop = threading.Event()
        self.changes: dict[str, dict[str, Any]] = {}
        self.batches = 0
        self.silent: set[str] = set()
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self._thread.start()

    def _fly(self) -> None:
        # The receiver has been on for some seconds: elements are there soon.
        for back in range(10, 0, -1):
            self._send(time.time() - back)
        while not self._stop.wait(1.0):
            self._send(time.time())

    def _send(self, time_s: float) -> None:
        heard = [a for a in self._addresses if a not in self.silent]
        self._sensor.send([self.report(address, time_s) for address in heard])
        self.batches += 1

    def report(self, address: str, time_s: float) -> dict[str, Any]:
        """What is reported about an aircraft: each on its own meridian and level."""
        index = self._addresses.index(address)
        usual = {
            "lon_deg": 8.0 + 0.05 * index,
            "callsign": f"SKN{index:03d}",
            "mode_a": f"{0o1000 + index:04o}",
            "altitude_m": 3000.0 + 80.0 * index,
            "nac_p": 9,
            "nac_v": 2,
        }
        return report(address, time_s) | usual | self.changes.get(address, {})

    def close(self) -> None:
        """Stop."""
        self._stop.set()
        self._thread.join(5.0)


def write_picture(page: Page, name: str) -> None:
    """Keep a picture, where the environment names a folder for them."""
    folder = os.environ.get("AEROSKEIN_PICTURES")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        page.page.screenshot(path=str(Path(folder) / f"{name}.png"))
