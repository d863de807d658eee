"""``aeroskein router``: a Zenoh router in this process, for installations that have no other."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from aeroskein_service.config import load_config
from aeroskein_service.keys import Keys
from aeroskein_service.signals import end_within, stop_on_signals
from aeroskein_service.transport import Router

__all__ = ["run"]

STOP_S: Final = 4.8


def run(config: Path | None = None, listen: Sequence[str] = ()) -> int:
    """Route until SIGINT or SIGTERM.

    Parameters
    ----------
    config : Path, optional
        A JSON5 file as zenohd reads it.
    listen : sequence of str
        Endpoints to listen at, instead of those of the file; without both: ``tcp/0.0.0.0:7447``.

    Returns
    -------
    int
        0 after an orderly end.

    Raises
    ------
    TransportError
        Where an endpoint is taken or the file cannot be used.
    """
    stop = stop_on_signals()
    if config is None and not listen:
        listen = ("tcp/0.0.0.0:7447",)
    router = Router(listen=listen, config_file=config)
    # Only prefix and instance are of interest, and only the environment can set them for a router.
    settings = load_config(sensors_required=False)
    router.declare_alive(Keys(settings.zenoh.prefix).alive("router", settings.service.effective_instance))
    print(f"routing at {', '.join(listen) or f'the endpoints of {config}'}", file=sys.stderr)
    stop.wait()
    timer = end_within(STOP_S)
    router.close()
    timer.cancel()
    return 0
