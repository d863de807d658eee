"""The log: structlog on standard error, for people on a terminal and as JSON lines elsewhere.

An event is a fixed name; facts are keywords: ``log.info("track_confirmed", track_number=12)``. The standard library's
loggers (uvicorn, zenoh) go the same way. Nothing is logged for each report, and complaints are rate-limited where they
are made.
"""

from __future__ import annotations

import logging
import sys
from typing import Any, Final, Protocol, TextIO

import structlog

__all__ = ["configure"]

LEVELS: Final = {"debug": logging.DEBUG, "info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


class _Settings(Protocol):
    @property
    def level(self) -> str: ...
    @property
    def format(self) -> str: ...


def configure(settings: _Settings, stream: TextIO | None = None) -> None:
    """Set up all logging of this process; may be called again.

    Parameters
    ----------
    settings : LogSettings
        Level and format.
    stream : text stream, optional
        Where to write; standard error where absent.
    """
    stream = sys.stderr if stream is None else stream
    people = settings.format == "console" or (settings.format == "auto" and stream.isatty())
    level = LEVELS[settings.level]
    shared: list[Any] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.stdlib.LoggerFactory(),
        cache_logger_on_first_use=False,
    )
    last: list[Any] = (
        [structlog.dev.ConsoleRenderer(colors=stream.isatty())]
        if people
        else [structlog.processors.format_exc_info, structlog.processors.JSONRenderer(sort_keys=False)]
    )
    handler = logging.StreamHandler(stream)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=[*shared, structlog.stdlib.add_logger_name],
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last],
        )
    )
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level)
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access", "zenoh"):
        logger = logging.getLogger(name)
        logger.handlers = []
        logger.propagate = True
