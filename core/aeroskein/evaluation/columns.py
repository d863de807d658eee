"""What is judged and what it is judged against, as columns: published points of one file, and truth.

``PointColumns`` holds what a fused file says of each point (both products together); it differs from
``points.FusedPoints`` in that it knows when a point was published and nothing of the engine's slots, so that a file
written by any program that follows the message contract can be judged. A missing number is NaN, a missing integer -1,
a missing string empty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, Ints, joined, taken
from aeroskein.points import FusedPoints, Product, Status

__all__ = ["PointColumns", "Truth"]

_POINT_DTYPES: Final[dict[str, tuple[Any, Any]]] = {
    "product": (np.uint8, 0),
    "track_number": (np.int64, -1),
    "address": (np.int32, -1),
    "mode_a": (np.int16, -1),
    "callsign": ("S8", b""),
    "epoch": (np.int64, -1),
    "seq": (np.int64, -1),
    "status": (np.uint8, int(Status.CONFIRMED)),
    "element": (np.int64, -1),
    "flags": (np.uint16, 0),
}
_POINT_WIDTHS: Final = {"position_cov_m2": 3, "velocity_cov_m2ps2": 3, "span_s": 2}

_TRUTH_DTYPES: Final[dict[str, tuple[Any, Any]]] = {"flight": (np.int32, 0), "phase": (np.int16, -1)}


def _column(name: str, n: int, value: Any, dtype: Any, missing: Any, width: int | None) -> NDArray[Any]:
    """One column of ``n`` rows: given, repeated from a scalar, or missing throughout."""
    shape: tuple[int, ...] = (n,) if width is None else (n, width)
    if value is None:
        return np.full(shape, missing, dtype=dtype)
    column = np.asarray(value, dtype=dtype)
    if column.ndim == 0 or (width is not None and column.shape == (width,) != shape):
        column = np.broadcast_to(column, shape).copy()
    if column.shape != shape:
        raise ValueError(f"column {name} has shape {column.shape}, expected {shape}")
    return column


@dataclass(slots=True, eq=False)
class PointColumns:
    """Published points of one fused file, one row each, in the order of the file.

    Attributes
    ----------
    product : (n,) uint8
        ``Product``: live or element.
    track_number, epoch, seq : (n,) int64
        Identity and numbering of the point; -1 where absent.
    address, mode_a, callsign : (n,)
        Identity as in ``Plots``.
    time_s, published_s, input_received_s : (n,) float64
        Instant of the state; when it was sent; live only: arrival of the newest report used. [s since the epoch]
    lat_deg, lon_deg, altitude_m, height_m : (n,) float64
        Position. [deg, m]
    ground_speed_mps, track_angle_deg, vertical_rate_mps : (n,) float64
        Velocity. [m/s, deg]
    position_cov_m2, velocity_cov_m2ps2 : (n, 3) float64
        ``[ee, en, nn]``. [m², m²/s²]
    status : (n,) uint8
        ``Status``.
    element : (n,) int64
        Index of the element along its track, -1 for live.
    span_s : (n, 2) float64
        ``[start, end)`` of the element. [s since the epoch]
    flags : (n,) uint16
        ``Flag``.
    """

    product: NDArray[np.uint8]
    track_number: Ints
    address: NDArray[np.int32]
    mode_a: NDArray[np.int16]
    callsign: NDArray[np.bytes_]
    epoch: Ints
    seq: Ints
    time_s: Array
    published_s: Array
    input_received_s: Array
    lat_deg: Array
    lon_deg: Array
    altitude_m: Array
    height_m: Array
    ground_speed_mps: Array
    track_angle_deg: Array
    vertical_rate_mps: Array
    position_cov_m2: Array
    velocity_cov_m2ps2: Array
    status: NDArray[np.uint8]
    element: Ints
    span_s: Array
    flags: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.time_s)

    @classmethod
    def of(cls, n: int, **columns: Any) -> Self:
        """Make ``n`` rows from the given columns; a column not named is missing throughout, a scalar is repeated.

        Raises ``TypeError`` for a name that is no column and ``ValueError`` for a column of another length.
        """
        made: dict[str, Any] = {}
        for field in fields(cls):
            dtype, missing = _POINT_DTYPES.get(field.name, (np.float64, np.nan))
            value = columns.pop(field.name, None)
            made[field.name] = _column(field.name, n, value, dtype, missing, _POINT_WIDTHS.get(field.name))
        if columns:
            raise TypeError(f"PointColumns has no column {sorted(columns)[0]!r}")
        return cls(**made)

    @classmethod
    def from_fused(cls, points: FusedPoints, published_s: Array | float = np.nan, epoch_ms: int = -1) -> Self:
        """The same points as they would be in a file, straight from the engine's columns."""
        shared = {f.name for f in fields(cls)} & {f.name for f in fields(FusedPoints)} - {"product"}
        columns = {name: getattr(points, name) for name in shared}
        return cls.of(len(points), product=points.product, published_s=published_s, epoch=epoch_ms, **columns)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """One set of rows from several, in order; no parts give no rows."""
        if not parts:
            return cls.of(0)
        return joined(parts)

    def is_product(self, product: Product) -> Bools:
        """Which rows belong to the product, shape ``(n,)``."""
        return np.asarray(self.product == int(product), dtype=np.bool_)


@dataclass(slots=True, eq=False)
class Truth:
    """Where the aircraft really were, sample by sample, in any order.

    Attributes
    ----------
    names : tuple of str
        The flights; the ``track`` of a truth file.
    addresses : (flights,) int32
        ICAO address of each flight, -1 where its name is none.
    callsigns : (flights,) S8
        Aircraft identification of each flight, empty where unknown.
    phases : tuple of str
        The phases of flight that occur.
    flight : (n,) int32
        Index into ``names``.
    time_s : (n,) float64
        [s since the epoch]
    lat_deg, lon_deg, height_m, altitude_m : (n,) float64
        WGS-84 position, height above the ellipsoid, pressure altitude (NaN where the truth has none). [deg, m]
    ground_speed_mps, track_angle_deg, vertical_rate_mps : (n,) float64
        Velocity over ground. [m/s, deg]
    phase : (n,) int16
        Index into ``phases``, -1 where not said.
    """

    names: tuple[str, ...]
    addresses: NDArray[np.int32]
    callsigns: NDArray[np.bytes_]
    phases: tuple[str, ...]
    flight: NDArray[np.int32]
    time_s: Array
    lat_deg: Array
    lon_deg: Array
    height_m: Array
    altitude_m: Array
    ground_speed_mps: Array
    track_angle_deg: Array
    vertical_rate_mps: Array
    phase: NDArray[np.int16]

    def __len__(self) -> int:
        return len(self.time_s)

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        n: int,
        *,
        phases: Sequence[str] = (),
        addresses: Sequence[int] | None = None,
        callsigns: Sequence[bytes] | None = None,
        **columns: Any,
    ) -> Self:
        """Make a truth of ``n`` samples; addresses come from the names unless given.

        Raises ``TypeError`` for a name that is no column and ``ValueError`` for a column of another length.
        """
        made: dict[str, Any] = {}
        for field in fields(cls)[4:]:
            dtype, missing = _TRUTH_DTYPES.get(field.name, (np.float64, np.nan))
            made[field.name] = _column(field.name, n, columns.pop(field.name, None), dtype, missing, None)
        if columns:
            raise TypeError(f"Truth has no column {sorted(columns)[0]!r}")
        if addresses is None:
            addresses = [address_of(name) for name in names]
        if callsigns is None:
            callsigns = [b""] * len(names)
        return cls(
            names=tuple(names),
            addresses=np.array(addresses, dtype=np.int32).reshape(len(names)),
            callsigns=np.array(callsigns, dtype="S8").reshape(len(names)),
            phases=tuple(phases),
            **made,
        )


def address_of(name: str) -> int:
    """The ICAO address that a name spells in six hex digits, -1 where it spells none."""
    if len(name) != 6:
        return -1
    try:
        return int(name, 16) if name.isalnum() else -1
    except ValueError:
        return -1
