"""Measurements: reports that belong to a track, in that track's fusion plane, with their covariance.

The shape in which reports reach the filters and the buffers. The part of a position's covariance that comes from the
time stamp is kept apart as a variance in time, because only the filter knows the velocity along which it acts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints, taken

__all__ = ["COLUMNS", "COLUMN_COUNT", "Measurements"]

# Order of the columns of a packed row; the buffers keep rows like this.
COLUMNS: Final = (
    "time_s",
    "east_m",
    "north_m",
    "r_ee",
    "r_en",
    "r_nn",
    "v_east_mps",
    "v_north_mps",
    "velocity_variance",
    "time_variance",
    "altitude_m",
    "vertical_rate_mps",
    "height_m",
    "sensor",
    "received_s",
    "stamp_s",
    "range_m",
    "azimuth_deg",
    # Not measured: what the manoeuvre detector found at this report, zero before it has been there. [m²/s⁵]
    "jerk_density",
)
COLUMN_COUNT: Final = len(COLUMNS)


@dataclass(slots=True, eq=False)
class Measurements:
    """Reports of known tracks, one row each; every column has shape ``(n,)``.

    Attributes
    ----------
    slot : int64
        Track slot.
    time_s, received_s : float64
        Time of applicability, corrected for the sensor's time bias; arrival. [s since the epoch]
    sensor : float64
        Sensor index (a float, so that all columns pack into one row).
    east_m, north_m : float64
        Foot point in the track's plane. [m]
    r_ee, r_en, r_nn : float64
        Covariance of the position without the part from the time stamp. [m²]
    v_east_mps, v_north_mps : float64
        Reported velocity in the plane, NaN where none. [m/s]
    velocity_variance : float64
        Per axis; NaN where no velocity is reported. [m²/s²]
    time_variance : float64
        Variance of the time stamp. [s²]
    altitude_m, vertical_rate_mps, height_m : float64
        Pressure altitude, its rate, geometric height; NaN where none. [m, m/s, m]
    stamp_s, range_m, azimuth_deg : float64
        Time, slant range and azimuth as the sensor reported them, for registration. [s since the epoch, m, deg]
    """

    slot: Ints
    time_s: Array
    received_s: Array
    sensor: Array
    east_m: Array
    north_m: Array
    r_ee: Array
    r_en: Array
    r_nn: Array
    v_east_mps: Array
    v_north_mps: Array
    velocity_variance: Array
    time_variance: Array
    altitude_m: Array
    vertical_rate_mps: Array
    height_m: Array
    stamp_s: Array
    range_m: Array
    azimuth_deg: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)

    def packed(self) -> Array:
        """Rows ``(n, COLUMN_COUNT)`` in the order of ``COLUMNS``, with no density of jerk yet."""
        rows = np.zeros((len(self), COLUMN_COUNT))
        for k, name in enumerate(COLUMNS[:-1]):
            rows[:, k] = getattr(self, name)
        return rows

    @property
    def trace_m2(self) -> Array:
        """Trace of the position covariance without the time part: how accurate the source is. [m²]"""
        return self.r_ee + self.r_nn
