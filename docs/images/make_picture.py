"""The picture in the README: what ``aeroskein demo`` shows on a terminal, drawn from the fused points of a real run.

    .venv/bin/python docs/images/make_picture.py --seconds 180

starts the demo on free ports, follows it as any consumer does, and writes its last frame beside this file as SVG.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.terminal_theme import SVG_EXPORT_THEME

from aeroskein_service.config import load_config
from aeroskein_service.demo_view import DemoView
from aeroskein_service.transport import open_session

HERE: Final = Path(__file__).resolve().parent
COLUMNS: Final = 132
TRACKS: Final = 14
# Loaded from the net by whoever looks; any monospaced face does.
WEB_FONTS: Final = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)


def free_port() -> int:
    """A port on 127.0.0.1 that nobody listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def picture(endpoint: str, seconds: float) -> str:
    """Follow the demo for some time and draw its last frame."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "picture.toml")
        path.write_text(f'[zenoh]\nconnect = ["{endpoint}"]\n')
        config = load_config(path, sensors_required=False)
    console = Console(record=True, width=COLUMNS, height=60, file=io.StringIO(), force_terminal=True)
    with open_session(config.zenoh.link) as session:
        view = DemoView(session, config)
        ends_s = time.monotonic() + seconds
        while time.monotonic() < ends_s:
            time.sleep(0.5)
            frame = view.frame(TRACKS)
    console.print(frame)
    return WEB_FONTS.sub("", console.export_svg(title="aeroskein demo", theme=SVG_EXPORT_THEME))


def main() -> None:
    """Run the demo and make the picture."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--seconds", type=float, default=180.0, help="how long the demo runs before the frame")
    arguments.add_argument("--output", type=Path, default=HERE / "demo.svg")
    given = arguments.parse_args()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    demo = subprocess.Popen(
        [Path(sys.executable).with_name("aeroskein"), "demo"],
        env=os.environ | {"AEROSKEIN_ZENOH__CONNECT": f'["{endpoint}"]'},
        stdout=subprocess.DEVNULL,
    )
    try:
        given.output.write_text(picture(endpoint, given.seconds), encoding="utf-8")
    finally:
        demo.send_signal(signal.SIGINT)
        demo.wait(timeout=10)


if __name__ == "__main__":
    main()
