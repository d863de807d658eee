"""``aeroskein demo``: the whole job in one process tree (router, sensors, service, consumer), and where to look."""

from __future__ import annotations

import importlib.resources
import socket
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Final

from rich.console import Console

from aeroskein_service.config import Config, load_config
from aeroskein_service.demo_view import DemoView
from aeroskein_service.process_tree import ChildError, ProcessTree
from aeroskein_service.recording import find_recording
from aeroskein_service.signals import end_within, stop_on_signals
from aeroskein_service.transport import OpenCancelledError, open_session

__all__ = ["run"]

STOP_S: Final = 4.9


def run(real: bool = False, duration: float | None = None) -> int:
    """Run the demo until Ctrl-C, or for ``duration`` seconds.

    Returns
    -------
    int
        0 after an orderly end.

    Raises
    ------
    NoRecordingError
        With ``real``, where the recorded sample is not installed.
    ChildError
        Where one of the processes ended by itself.
    """
    if real:
        find_recording()
    stop = stop_on_signals()
    with tempfile.TemporaryDirectory(prefix="aeroskein-demo-") as name:
        folder = Path(name)
        path = _write_config(folder, "recorded.toml" if real else "simulated.toml")
        config = load_config(path)
        tree = ProcessTree(folder, stop)
        try:
            _start(tree, config, path, real)
            _look(config, stop, duration)
        finally:
            timer = end_within(STOP_S)
            # The service finishes while its sensors are gone and the router is still there.
            tree.end(last=["router"])
            timer.cancel()
        if tree.died is not None:
            raise ChildError(tree.died)
    return 0


def _write_config(folder: Path, name: str) -> Path:
    """The packaged configuration, with free ports where the environment sets none."""
    text = importlib.resources.files("aeroskein_service.demo").joinpath(name).read_text()
    path = folder / "demo.toml"
    path.write_text(text)
    config = load_config(path)
    if config.origin("zenoh", "connect") == "default":
        text += f'\n[zenoh]\nconnect = ["tcp/127.0.0.1:{_free_port()}"]\n'
    if config.origin("http", "listen") == "default":
        text += f'\n[http]\nlisten = "127.0.0.1:{_free_port()}"\n'
    path.write_text(text)
    return path


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _start(tree: ProcessTree, config: Config, path: Path, real: bool) -> None:
    tree.start("router", "router", *(f"--listen={endpoint}" for endpoint in config.zenoh.connect))
    tree.start("service", "run", "--config", str(path))
    begin = f"--begin={time.time():.3f}"
    for sensor in config.sensor_ids:
        tree.start(sensor, "simulate", "--config", str(path), "--sensor", sensor, begin, *(["--real"] if real else []))
    tree.__enter__()
    where = config.zenoh.connect[0]
    print(f"aeroskein demo: {config.area.name}, sensors {', '.join(config.sensor_ids)}")
    print(f"  router   {where}")
    print(f"  points   aeroskein watch --connect {where}     (keys {config.zenoh.prefix}/fused/live/<address>)")
    if config.http.listen:
        print(f"  page     http://{config.http.listen}/     (health /readyz, metrics /metrics)")
    if real:
        print("  ADS-B is recorded, the radars are simulated from it")
    print("  Ctrl-C ends everything", flush=True)


def _look(config: Config, stop: threading.Event, duration: float | None) -> None:
    """Be a consumer until the end."""
    try:
        session = open_session(config.zenoh.link, stop=stop)
    except OpenCancelledError:
        return
    with session:
        view = DemoView(session, config)
        ends_s = None if duration is None else time.monotonic() + duration
        console = Console()
        if console.is_terminal:
            view.draw(console, stop, ends_s)
        else:
            view.print_lines(sys.stdout, stop, ends_s)
