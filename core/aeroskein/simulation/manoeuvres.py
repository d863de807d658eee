"""Manoeuvres: turn rate, acceleration and vertical rate as trapezoids, ramped up and down as aircraft do.

Every change of course, speed or height is one trapezoid whose area is the change. The ramps are 0.6 deg/s² for the turn
rate (an airliner rolls into a standard-rate turn in about 5 s), 0.3 m/s³ for the acceleration and 0.5 m/s² (0.05 g) for
the vertical rate: the kinematics of the numerical study in docs/algorithm.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["ACCELERATION_RAMP_MPS3", "TURN_RAMP_RADPS2", "VERTICAL_RAMP_MPS2", "Legs", "ramped", "trapezoid"]

TURN_RAMP_RADPS2: Final = float(np.radians(0.6))
ACCELERATION_RAMP_MPS3: Final = 0.3
VERTICAL_RAMP_MPS2: Final = 0.5


def trapezoid(since_s: Array, duration_s: Array, top: Array, ramp: float) -> Array:
    """Value of trapezoids some time after they began; 0 before and after. Negative tops give negative values."""
    height = np.minimum(since_s, duration_s - since_s)
    height *= ramp
    np.minimum(height, np.abs(top), out=height)
    np.maximum(height, 0.0, out=height)
    height *= np.sign(top)
    return height


def ramped(change: Array, top: Array, ramp: float) -> tuple[Array, Array]:
    """Lay out trapezoids with the area ``change``, no higher than ``top`` and no steeper than ``ramp``.

    Returns
    -------
    top : (n,) array
        Height reached, with the sign of the change; lower than asked where the change is small.
    duration_s : (n,) array
        From first to last non-zero value; 0 where nothing changes. [s]
    """
    area = np.abs(change)
    reached = np.minimum(np.abs(top), np.sqrt(area * ramp))
    safe = np.maximum(reached, 1e-12)
    return np.sign(change) * reached, np.where(area > 0.0, area / safe + reached / ramp, 0.0)


@dataclass(slots=True, eq=False)
class Legs:
    """The leg that each aircraft flies now: first straight on, then three trapezoids that begin together.

    Attributes
    ----------
    begin_s : (n,) float64
        When the manoeuvre begins. [s since the anchor]
    end_block : (n,) int64
        Block of time with which the next leg begins.
    turn_radps, acceleration_mps2, vertical_mps : (n,) float64
        Tops of the trapezoids. [rad/s, m/s², m/s]
    turn_s, acceleration_s, vertical_s : (n,) float64
        Their durations. [s]
    """

    begin_s: Array
    end_block: Ints
    turn_radps: Array
    turn_s: Array
    acceleration_mps2: Array
    acceleration_s: Array
    vertical_mps: Array
    vertical_s: Array

    @classmethod
    def none(cls, n: int) -> Legs:
        """Legs that have ended before the first block."""
        return cls(np.zeros(n), np.full(n, -1, dtype=np.int64), *(np.zeros(n) for _ in range(6)))

    def rates(self, rows: Ints, time_s: Array) -> tuple[Array, Array, Array]:
        """Turn rate [rad/s], acceleration [m/s²] and vertical rate [m/s] of some rows at times, in pairs."""
        since_s = time_s - self.begin_s[rows]
        return (
            trapezoid(since_s, self.turn_s[rows], self.turn_radps[rows], TURN_RAMP_RADPS2),
            trapezoid(since_s, self.acceleration_s[rows], self.acceleration_mps2[rows], ACCELERATION_RAMP_MPS3),
            trapezoid(since_s, self.vertical_s[rows], self.vertical_mps[rows], VERTICAL_RAMP_MPS2),
        )

    def active(self, start_s: float, end_s: float) -> Bools:
        """Which rows manoeuvre at all between two times."""
        longest_s = np.maximum(np.maximum(self.turn_s, self.acceleration_s), self.vertical_s)
        return (self.begin_s < end_s) & (self.begin_s + longest_s > start_s)
