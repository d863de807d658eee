"""The log: JSON lines or lines for people, one way for all loggers."""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator

import pytest
import structlog

from aeroskein_service.config import LogSettings
from aeroskein_service.log import configure


@pytest.fixture
def stream() -> Iterator[io.StringIO]:
    root = logging.getLogger()
    handlers, level = root.handlers, root.level
    yield io.StringIO()
    root.handlers, root.level = handlers, level
    structlog.reset_defaults()


def test_line_is_json_with_event_level_time_and_facts_where_nobody_looks(stream):
    configure(LogSettings(), stream)

    structlog.get_logger("part").info("track_confirmed", track_number=12)

    line = json.loads(stream.getvalue())
    assert (line["event"], line["level"], line["track_number"]) == ("track_confirmed", "info", 12)
    assert line["timestamp"].endswith("Z")


def test_loggers_of_the_standard_library_go_the_same_way(stream):
    configure(LogSettings(), stream)

    logging.getLogger("uvicorn.error").warning("port %d is taken", 80)

    line = json.loads(stream.getvalue())
    assert (line["event"], line["level"], line["logger"]) == ("port 80 is taken", "warning", "uvicorn.error")


def test_line_for_people_is_no_json(stream):
    configure(LogSettings(format="console"), stream)

    structlog.get_logger().info("service_started", instance="a")

    assert "service_started" in stream.getvalue()
    with pytest.raises(ValueError):
        json.loads(stream.getvalue())


@pytest.mark.parametrize("settings", [LogSettings(level="warning"), LogSettings(level="warning", format="console")])
def test_lines_below_the_level_are_not_written(stream, settings):
    configure(settings, stream)

    structlog.get_logger().info("quiet")
    logging.getLogger("zenoh").info("quiet")
    structlog.get_logger().warning("loud")

    assert "quiet" not in stream.getvalue()
    assert "loud" in stream.getvalue()


def test_exception_is_one_line_with_its_traceback(stream):
    configure(LogSettings(), stream)

    try:
        raise ValueError("broken")
    except ValueError:
        structlog.get_logger().exception("worker_failed")

    assert len(stream.getvalue().splitlines()) == 1
    assert "ValueError: broken" in json.loads(stream.getvalue())["exception"]


def test_configuring_twice_writes_each_line_once(stream):
    configure(LogSettings(), stream)
    configure(LogSettings(), stream)

    structlog.get_logger().info("once")

    assert len(stream.getvalue().splitlines()) == 1
