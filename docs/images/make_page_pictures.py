"""The pictures of the page in the README and in web.md: what a browser shows of ``aeroskein demo``.

    .venv/bin/python docs/images/make_page_pictures.py --seconds 150

starts the demo on free ports, opens its page in the system's Chromium, and writes the map and the element view beside
this file as PNG.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

from make_picture import free_port
from playwright.sync_api import sync_playwright

HERE: Final = Path(__file__).resolve().parent
FLAGS: Final = ["--disable-gpu", "--enable-unsafe-swiftshader", "--no-sandbox"]
SIZE: Final = {"width": 1400, "height": 860}
# The map fitted to the traffic, and the elements of the fastest aircraft that ADS-B and radars see.
PICTURES: Final = {
    "page.png": "theme=dark&color=altitude&trailtime=300",
    "elements.png": "theme=light&view=elements&sel={label}",
}
FASTEST: Final = """__view.tracks.map((t) => __view.track(t)).filter((t) => t.status === 1 && t.source === 0)
  .sort((a, b) => b.speed - a.speed)[0].label"""


def show(page: Any, url: str, query: str, path: Path) -> None:
    """Open the page, let it settle, and keep what it shows."""
    page.goto(f"{url}/?{query}")
    page.wait_for_function("window.__view && __view.ready && __view.mapArcs > 0")
    page.wait_for_timeout(6000)
    page.screenshot(path=str(path))


def main() -> None:
    """Run the demo and make the pictures."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--seconds", type=float, default=150.0, help="how long the demo runs before")
    given = arguments.parse_args()
    http = f"127.0.0.1:{free_port()}"
    environ = os.environ | {
        "AEROSKEIN_HTTP__LISTEN": http,
        "AEROSKEIN_ZENOH__CONNECT": f'["tcp/127.0.0.1:{free_port()}"]',
    }
    demo = subprocess.Popen(
        [Path(sys.executable).with_name("aeroskein"), "demo"], env=environ, stdout=subprocess.DEVNULL
    )
    try:
        time.sleep(given.seconds)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            page = browser.new_page(viewport=SIZE)
            for name, query in PICTURES.items():
                label = page.evaluate(FASTEST) if "{label}" in query else ""
                show(page, f"http://{http}", query.format(label=label), HERE / name)
            browser.close()
    finally:
        demo.send_signal(signal.SIGINT)
        demo.wait(timeout=10)


if __name__ == "__main__":
    main()
