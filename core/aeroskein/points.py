"""Fused points as columns: what the engine publishes, for both products, before any encoding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints

__all__ = ["Flag", "FusedPoints", "Product", "Status"]


class Product(IntEnum):
    """Which of the two products a point belongs to."""

    LIVE = 0
    ELEMENT = 1


class Status(IntEnum):
    """Life cycle of a track."""

    TENTATIVE = 0
    CONFIRMED = 1
    COASTING = 2
    TERMINATED = 3


class Flag(IntFlag):
    """What a consumer should know about a point."""

    COASTED = 1
    GUARDED = 2
    BIAS_UNCERTAIN = 4
    ADSB_UNVERIFIED = 8
    ADSB_SUSPECT = 16
    DUPLICATE_ADDRESS = 32
    ON_GROUND = 64


@dataclass(slots=True, eq=False)
class FusedPoints:
    """Fused points of one product, one row each.

    Attributes
    ----------
    product : Product
        Live (zero lag) or element.
    slot : (n,) int64
        Engine slot of the track; for bookkeeping inside the process, never published.
    track_number : (n,) int64
        Never reused.
    label : (n,) int32
        The address that names the track on its key, -1 where the key is ``T<number>``.
    address, mode_a, callsign : (n,)
        Identity as in ``Plots``.
    seq : (n,) int64
        Counts the points of this track and product from 0 without holes.
    time_s : (n,) float64
        Instant for which the state is valid. [s since the epoch]
    lat_deg, lon_deg, altitude_m, height_m : (n,) float64
        Position; NaN where unknown. [deg, m]
    ground_speed_mps, track_angle_deg, vertical_rate_mps : (n,) float64
        Velocity; NaN where unknown. [m/s, deg]
    position_cov_m2, velocity_cov_m2ps2 : (n, 3) float64
        ``[ee, en, nn]`` in the local plane at the point; NaN in mode ``patent``. [m², m²/s²]
    status : (n,) uint8
        ``Status``.
    element : (n,) int64
        Index of the element along its track, -1 for live.
    span_s : (n, 2) float64
        ``[start, end)`` of the element, NaN for live. [s since the epoch]
    master : (n,) int16
        Sensor index of the master, -1 where none.
    sources : (n, sensors) int32
        Accepted reports per sensor.
    rejected : (n,) int32
        Reports gated out.
    input_received_s : (n,) float64
        Live only: arrival of the newest report used; NaN otherwise. [s since the epoch]
    flags : (n,) uint16
        ``Flag``.
    renamed_to : (n,) int32
        The address that becomes the key from now on, -1 usually.
    """

    product: Product
    slot: Ints
    track_number: Ints
    label: NDArray[np.int32]
    address: NDArray[np.int32]
    mode_a: NDArray[np.int16]
    callsign: NDArray[np.bytes_]
    seq: Ints
    time_s: Array
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
    master: NDArray[np.int16]
    sources: NDArray[np.int32]
    rejected: NDArray[np.int32]
    input_received_s: Array
    flags: NDArray[np.uint16]
    renamed_to: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return type(self)(self.product, *[getattr(self, name)[rows] for name in _COLUMNS])

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """One set of rows from several of the same product, in order; at least one part is needed."""
        if len(parts) == 1:
            return parts[0]
        return cls(parts[0].product, *[np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMNS])


_COLUMNS: Final = tuple(field.name for field in fields(FusedPoints))[1:]
