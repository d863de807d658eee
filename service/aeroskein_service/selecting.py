"""Dimension identifiers as text: what a query or ``fuse --select`` asks for becomes a ``Selection``, or one sentence.

``bbox=48,11,49,12;time=1790000000,1790000600;speed=50,300`` is both the form of Zenoh's parameters and that of the
command line. All conditions must hold; a condition that is not understood is refused, never ignored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from aeroskein.errors import AeroskeinError
from aeroskein.selection import Selection
from aeroskein_service.report_columns import parse_address, parse_callsign

__all__ = ["SelectionError", "parse_selection"]


class SelectionError(AeroskeinError, ValueError):
    """A condition that cannot be understood; the message names it.

    Parameters
    ----------
    name : str
        The parameter.
    expected : str
        What would have been understood, and what came instead.
    """

    exit_status: Final = 2

    def __init__(self, name: str, expected: str) -> None:
        super().__init__(f"{name}: {expected}")
        self.name = name


def parse_selection(conditions: str | Mapping[str, str], sensors: Sequence[str]) -> Selection:
    """Read the conditions of a query.

    Parameters
    ----------
    conditions : str or mapping
        ``"name=value;name=value"``, or the values by name.
    sensors : sequence of str
        The configured sensor ids, by index.

    Raises
    ------
    SelectionError
        For an unknown parameter or sensor, something that is not a number, or a minimum above its maximum.
    """
    given = _split(conditions) if isinstance(conditions, str) else conditions
    found: dict[str, Any] = {}
    for name, text in given.items():
        reader = _READERS.get(name)
        if reader is None:
            raise SelectionError(_short(name), f"unknown parameter, expected one of {', '.join(_READERS)}")
        key, value = reader(name, text, sensors)
        found[key] = value
    return Selection(**found)


def _split(text: str) -> dict[str, str]:
    parts: dict[str, str] = {}
    for part in text.split(";"):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not part.strip():
            continue
        if not equals:
            raise SelectionError(_short(name), "expected name=value")
        if name in parts:
            raise SelectionError(_short(name), "stands twice")
        parts[name] = value
    return parts


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."


def _list(name: str, text: str, expected: str) -> list[str]:
    items = [item.strip() for item in text.split(",")]
    if not all(items):
        raise SelectionError(name, f"expected {expected}, got {_short(text)!r}")
    return items


def _numbers(name: str, text: str, count: int, expected: str) -> tuple[float, ...]:
    items = text.split(",")
    if len(items) != count:
        raise SelectionError(name, f"expected {expected}, got {_short(text)!r}")
    values = []
    for item in items:
        try:
            value = float(item)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise SelectionError(name, f"{_short(item)!r} is not a number, expected {expected}")
        values.append(value)
    return tuple(values)


def _addresses(name: str, text: str, _: Sequence[str]) -> tuple[str, Any]:
    expected = "ICAO addresses of six hex digits such as 3C6444,4CA2D6"
    items = _list(name, text, expected)
    for item in items:
        if parse_address(item) < 0:
            raise SelectionError(name, f"{_short(item)!r} is no address, expected {expected}")
    return "addresses", frozenset(parse_address(item) for item in items)


def _callsign(name: str, text: str, _: Sequence[str]) -> tuple[str, Any]:
    if not parse_callsign(text):
        raise SelectionError(name, f"expected 1 to 8 characters, got {_short(text)!r}")
    return "callsign", text.strip(" ")


def _sensors(name: str, text: str, sensors: Sequence[str]) -> tuple[str, Any]:
    items = _list(name, text, "sensor ids")
    for item in items:
        if item not in sensors:
            raise SelectionError(name, f"unknown sensor {_short(item)!r}, expected one of {', '.join(sensors)}")
    return "sensors", frozenset(list(sensors).index(item) for item in items)


def _bbox(name: str, text: str, _: Sequence[str]) -> tuple[str, Any]:
    values = _numbers(name, text, 4, "lat_min,lon_min,lat_max,lon_max in degrees")
    lat_min, lon_min, lat_max, lon_max = values
    for value, limit, what in (
        (lat_min, 90, "lat"),
        (lat_max, 90, "lat"),
        (lon_min, 180, "lon"),
        (lon_max, 180, "lon"),
    ):
        if abs(value) > limit:
            raise SelectionError(name, f"{what} {value:g} is outside -{limit} to {limit}")
    if lat_min > lat_max:
        raise SelectionError(name, f"lat_min {lat_min:g} is above lat_max {lat_max:g}")
    return "bbox", values


def _limits(key: str, expected: str) -> Callable[[str, str, Sequence[str]], tuple[str, Any]]:
    def read(name: str, text: str, _: Sequence[str]) -> tuple[str, Any]:
        lowest, highest = _numbers(name, text, 2, expected)
        if lowest > highest:
            raise SelectionError(name, f"the minimum {lowest:g} is above the maximum {highest:g}")
        return key, (lowest, highest)

    return read


_READERS: Final[dict[str, Callable[[str, str, Sequence[str]], tuple[str, Any]]]] = {
    "address": _addresses,
    "callsign": _callsign,
    "sensor": _sensors,
    "bbox": _bbox,
    "speed": _limits("speed_mps", "min,max in m/s"),
    "altitude": _limits("altitude_m", "min,max in metres"),
    "time": _limits("time_s", "t0,t1 in seconds since the epoch"),
}
