"""Reports to columns: decoded reports of one batch or file chunk become ``Plots``, without a loop in Python.

The columns of a list of structs are taken by ``zip`` over tuples; a column that nobody sent costs only a count. Text
fields go through bounded caches, because the same aircraft come again every second. What a column cannot hold gets a
marker that ``aeroskein.cleaning.check_values`` refuses: an infinite number for a sent NaN, -2 for a bad address.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, Final, Generic, NamedTuple, TypeVar, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein.cleaning import BAD_ADDRESS_MARK, check_values
from aeroskein.plots import ON_GROUND, SIMULATED, SPI, Array, Plots
from aeroskein_service.messages import Report

__all__ = [
    "FLAGS",
    "NUMBERS",
    "QUALITIES",
    "Columns",
    "Texts",
    "columns_of",
    "judged",
    "parse_address",
    "parse_callsign",
    "parse_mode_a",
]

# Aircraft seen by one service within hours; a text that was forgotten is only parsed again.
CACHE_ENTRIES: Final = 65_536

_ADDRESS: Final = re.compile(r"[0-9A-Fa-f]{6}")
_CALLSIGN: Final = re.compile(r"[ -~]{1,8}")
_MODE_A: Final = re.compile(r"[0-7]{4}")

# The number columns are the first fields of a report; received_s is not among them, the sensor does not send it.
NUMBERS: Final = Report.__struct_fields__[: Report.__struct_fields__.index("local_track")]
QUALITIES: Final = ("nac_p", "nac_v", "nic", "sil")
FLAGS: Final = (("on_ground", ON_GROUND), ("simulated", SIMULATED), ("spi", SPI))
_FIELD: Final = {name: index for index, name in enumerate(Report.__struct_fields__)}

_T = TypeVar("_T")
_Text = TypeVar("_Text")


class Texts(dict[_Text | None, _T | None], Generic[_Text, _T]):
    """A bounded cache from a text on the wire to its value in a column, None where it is unreadable."""

    def __init__(self, parse: Callable[[_Text], _T | None], missing: _T) -> None:
        super().__init__({None: missing})
        self._parse = parse
        self._absent = missing

    def of(self, texts: Sequence[_Text | None], missing: _T) -> tuple[list[_T], NDArray[np.bool_] | None]:
        """Values with the unreadable ones left out, and which those were; None where all were readable."""
        values = [self[text] for text in texts]
        if None not in values:
            return cast(list[_T], values), None
        return [missing if v is None else v for v in values], np.array([v is None for v in values])

    def __missing__(self, text: _Text) -> _T | None:
        if len(self) > CACHE_ENTRIES:
            self.clear()
            self[None] = self._absent
        value = self[text] = self._parse(text)
        return value


def parse_address(text: str) -> int:
    """The 24-bit address in six hex digits, ``BAD_ADDRESS_MARK`` where it is something else."""
    return int(text, 16) if _ADDRESS.fullmatch(text) else BAD_ADDRESS_MARK


def parse_callsign(text: str) -> bytes | None:
    """Up to eight printable ASCII characters without blanks around them; None where it is something else."""
    text = text.strip(" ")
    if not text:
        return b""
    return text.encode("ascii") if _CALLSIGN.fullmatch(text) else None


def parse_mode_a(text: str) -> int | None:
    """The number of four octal digits, None where it is something else."""
    return int(text, 8) if _MODE_A.fullmatch(text) else None


_ADDRESSES: Final[Texts[str, int]] = Texts(parse_address, -1)
_CALLSIGNS: Final[Texts[str, bytes]] = Texts(parse_callsign, b"")
_MODES_A: Final[Texts[str, int]] = Texts(parse_mode_a, -1)


class Columns(NamedTuple):
    """Reports in columns, with what is wrong with each.

    Attributes
    ----------
    plots : Plots
        One row for each report, in order, the bad ones too.
    reasons : (n,) uint8
        ``Reason`` of ``check_values``, 0 where the report is good.
    bad_callsign, bad_mode_a : (n,) bool, or None
        Whose callsign or Mode A code was dropped because it was none; None where nobody's was.
    """

    plots: Plots
    reasons: NDArray[np.uint8]
    bad_callsign: NDArray[np.bool_] | None
    bad_mode_a: NDArray[np.bool_] | None


def columns_of(reports: Sequence[msgspec.Struct], *, received_s: float | Array, sensor: int | NDArray[Any]) -> Columns:
    """Make columns of decoded reports and check their values.

    A speed over ground without a track angle, or the other way round, is no velocity and becomes absent; a standing
    target has no direction, so its angle is taken as north.

    Parameters
    ----------
    reports : sequence of Report
        Or of a struct whose first fields are those of ``Report``.
    received_s : float or (n,) array
        Arrival. [s since the epoch]
    sensor : int or (n,) array
        Index of the sensor.
    """
    n = len(reports)
    if n == 0:
        return Columns(Plots.of(0), np.zeros(0, dtype=np.uint8), None, None)
    fields = list(zip(*map(msgspec.structs.astuple, reports), strict=True))
    numbers = _numbers(fields, n)
    qualities = np.full((len(QUALITIES), n), -1, dtype=np.int8)
    for row, name in enumerate(QUALITIES):
        values = fields[_FIELD[name]]
        if values.count(None) != n:
            qualities[row] = [-1 if v is None else v for v in values]
    callsign, bad_callsign = _CALLSIGNS.of(fields[_FIELD["callsign"]], b"")
    mode_a, bad_mode_a = _MODES_A.of(fields[_FIELD["mode_a"]], -1)
    rows: dict[str, Any] = dict(zip((*NUMBERS, *QUALITIES), (*numbers, *qualities), strict=True))
    plots = Plots(
        **rows,
        received_s=_repeated(received_s, n, np.float64),
        sensor=_repeated(sensor, n, np.int16),
        address=np.array([_ADDRESSES[a] for a in fields[_FIELD["address"]]], dtype=np.int32),
        mode_a=np.array(mode_a, dtype=np.int16),
        callsign=np.array(callsign, dtype="S8"),
        local_track=_local_tracks(fields[_FIELD["local_track"]]),
        flags=_flags(fields, n),
    )
    return judged(plots, bad_callsign, bad_mode_a)


def judged(plots: Plots, bad_callsign: NDArray[np.bool_] | None, bad_mode_a: NDArray[np.bool_] | None) -> Columns:
    """Check the values of columns, and make half a velocity none, as ``columns_of`` says."""
    reasons = check_values(plots)
    _join_velocity(plots)
    return Columns(plots, reasons, bad_callsign, bad_mode_a)


def _numbers(fields: list[tuple[Any, ...]], n: int) -> Array:
    """The number columns, one a row, with NaN where nothing was sent and infinity where NaN was sent."""
    numbers = np.full((len(NUMBERS), n), np.nan)
    absent = [values.count(None) for values in fields[: len(NUMBERS)]]
    for row, values in enumerate(fields[: len(NUMBERS)]):
        if absent[row] != n:
            numbers[row] = values
    nans = np.isnan(numbers).sum(axis=1)
    for row in np.flatnonzero(nans != absent).tolist():
        sent = [v is not None and math.isnan(v) for v in fields[row]]
        numbers[row, sent] = np.inf
    return numbers


def _local_tracks(values: tuple[int | None, ...]) -> NDArray[np.int64]:
    if values.count(None) == len(values):
        return np.full(len(values), -1, dtype=np.int64)
    return np.array([-1 if v is None else v for v in values], dtype=np.int64)


def _flags(fields: list[tuple[Any, ...]], n: int) -> NDArray[np.uint8]:
    flags = np.zeros(n, dtype=np.uint8)
    for name, bit in FLAGS:
        values = fields[_FIELD[name]]
        if True in values:
            flags[[v is True for v in values]] |= bit
    return flags


def _repeated(value: Any, n: int, dtype: Any) -> NDArray[Any]:
    column = np.empty(n, dtype=dtype)
    column[:] = value
    return column


def _join_velocity(plots: Plots) -> None:
    half = np.isnan(plots.ground_speed_mps) != np.isnan(plots.track_angle_deg)
    if half.any():
        plots.track_angle_deg[half & (plots.ground_speed_mps == 0.0)] = 0.0
        half &= plots.ground_speed_mps != 0.0
        plots.ground_speed_mps[half] = np.nan
        plots.track_angle_deg[half] = np.nan
