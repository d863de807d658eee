"""``aeroskein web``: the page, as a consumer of the feed or over a fused or report file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from aeroskein.errors import AeroskeinError
from aeroskein_service.config import Config
from aeroskein_service.http import bind, url_of
from aeroskein_service.signals import end_within, stop_on_signals
from aeroskein_service.web.page import show_page
from aeroskein_service.web.source import Source

__all__ = ["run"]

STOP_S: Final = 4.8


class SwitchedOffError(AeroskeinError):
    """The configuration says that there is no page."""

    exit_status: Final = 2


def run(config: Config, file: Path | None = None) -> int:
    """Serve the page until SIGINT or SIGTERM.

    Parameters
    ----------
    config : Config
        Sections ``http`` and ``zenoh``; the sensors give sites and periods. A report file needs its sensors.
    file : Path, optional
        A fused or report file to be replayed instead of what happens now.

    Returns
    -------
    int
        0 after an orderly end.

    Raises
    ------
    AeroskeinError
        Where the address is taken, or the file cannot be used; the message is one sentence.
    """
    if not config.http.listen:
        raise SwitchedOffError("http.listen is empty, which switches the page off: give an address, as --listen")
    stop = stop_on_signals()
    listener = bind(config.http.listen)
    source: Source | None = None
    if file is not None:
        from aeroskein_service.web.replay_files import open_replay

        source = open_replay(file, config)
    print(f"the page is at {url_of(listener)}", file=sys.stderr, flush=True)
    with listener:
        show_page(config, listener, stop, source=source)
    end_within(STOP_S)
    return 0
