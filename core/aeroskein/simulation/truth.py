"""Truth: where each aircraft really is, as columns, and what it is doing there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints, joined, taken

__all__ = ["Identity", "Motion", "Phase", "States", "TruthStates"]


class Phase(IntEnum):
    """What an aircraft is doing; of several at once the first in this list counts."""

    HOVER = 0
    TURN = 1
    ACCELERATION = 2
    DECELERATION = 3
    CLIMB = 4
    DESCENT = 5
    STRAIGHT = 6

    @property
    def wire_name(self) -> str:
        """The name used in truth files."""
        return self.name.lower()


@dataclass(slots=True, eq=False)
class States:
    """Kinematic states of some aircraft at some times, one row each.

    Attributes
    ----------
    up : (m, 3) float64
        Upward unit normal of the ellipsoid at the foot point, in ECEF axes.
    plane_m : (m, 3) float64
        ECEF of the point to which horizontal errors are added: straight above or below the target. [m]
    height_m, altitude_m : (m,) float64
        Height above the ellipsoid; pressure altitude as the encoder would give it without steps. [m]
    velocity_mps : (m, 3) float64
        Horizontal velocity in ECEF axes. [m/s]
    vertical_rate_mps : (m,) float64
        Rate of height. [m/s]
    """

    up: Array
    plane_m: Array
    height_m: Array
    altitude_m: Array
    velocity_mps: Array
    vertical_rate_mps: Array


@dataclass(slots=True, eq=False)
class Identity:
    """Who each aircraft is; one row per slot, changed when another flight takes the slot over.

    Attributes
    ----------
    key : (n,) uint64
        What a flight's constant errors are hashed from.
    address : (n,) int32
        ICAO 24-bit address.
    mode_a : (n,) int16
        Mode 3/A code, -1 where unknown.
    callsign : (n,) S8
        Aircraft identification.
    """

    key: NDArray[np.uint64]
    address: NDArray[np.int32]
    mode_a: NDArray[np.int16]
    callsign: NDArray[np.bytes_]


class Motion(Protocol):
    """What a sensor model needs to know about the aircraft in one block of time."""

    @property
    def index(self) -> int:
        """Number of the block since the anchor."""
        ...

    @property
    def start_s(self) -> float:
        """Start of the block. [s since the epoch]"""
        ...

    @property
    def end_s(self) -> float:
        """End of the block, not included. [s since the epoch]"""
        ...

    @property
    def rows(self) -> Ints:
        """Slots with an aircraft in the air in this block."""
        ...

    @property
    def identity(self) -> Identity:
        """Who is in each slot."""
        ...

    def at(self, rows: Ints, time_s: Array) -> States:
        """States of slots ``rows`` at times inside the block, row by row."""
        ...


@dataclass(slots=True, eq=False)
class TruthStates:
    """Truth samples, one row each; every column has shape ``(n,)``.

    Attributes
    ----------
    time_s : float64
        [s since the epoch, UTC]
    slot : int64
        Which of the simulator's aircraft.
    address : int32
        ICAO 24-bit address; the track's name in truth files.
    lat_deg, lon_deg, height_m : float64
        WGS-84 position. [deg, deg, m]
    altitude_m : float64
        Pressure altitude. [m]
    ground_speed_mps, track_angle_deg, vertical_rate_mps : float64
        Velocity over ground at the aircraft's height. [m/s, deg, m/s]
    phase : uint8
        ``Phase``.
    """

    time_s: Array
    slot: Ints
    address: NDArray[np.int32]
    lat_deg: Array
    lon_deg: Array
    height_m: Array
    altitude_m: Array
    ground_speed_mps: Array
    track_angle_deg: Array
    vertical_rate_mps: Array
    phase: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """One set of rows from several, in order; at least one part is needed."""
        return joined(parts)

    def by_track(self) -> Self:
        """The same rows ordered by address, then time: the order of a truth file."""
        return self.take(np.lexsort((self.time_s, self.address)))
