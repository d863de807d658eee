"""Linear rows: what one comparison says about the biases, for the filter.

Bias of one radar ``b = [range m, azimuth deg, time s, range gain]``: what the radar reports too much. A plot stamped
``t`` shows the aircraft where it was at ``t - b_time``, so with the radial and across velocities ``v_r, v_a``, slant
range r and ground range rho

    range error  = b_range + r b_gain - v_r b_time + v_r l - u.o + noise
    across error = rho b_azimuth      - v_a b_time + v_a l - n.o + noise

where ``l`` is the latency of the aircraft's ADS-B and ``o`` its slowly changing position offset (satellite navigation
errors live for a minute): both belong to the aircraft, not to the radar, so they are states of their own. Without an
anchor the same aircraft seen by two radars gives the difference of two such lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints, columns_of, joined, taken
from aeroskein.registration.comparisons import RAD_PER_DEG, Comparisons, Geometry
from aeroskein.settings import EngineSettings

__all__ = ["BIASES", "Noise", "Rows", "anchored_rows", "bias_jacobian", "usable"]

# States per radar.
BIASES: Final = 4
# States per aircraft: latency, offset east, offset north.
NUISANCES: Final = 3

# Closer than this an azimuth error hardly moves the plot and the slant range is mostly height. [m]
GROUND_MIN_M: Final = 8_000.0
# Above this elevation (sine) an unknown height error shows up as range error: 20 m of 100 m at 0.2.
ELEVATION_MAX_SIN: Final = 0.2
# A larger disagreement is a wrong identity, not a bias. [m]
ERROR_MAX_M: Final = 20_000.0
# A reference further from the plot's stamp is extrapolation. [s]
REFERENCE_AGE_MAX_S: Final = 6.0
# The reference comes out of a filter, so neighbouring plots of a 4 s radar see partly the same error of it; that part
# is not averaged away as white noise would be. Slower errors are states of the aircraft.
REFERENCE_CORRELATION: Final = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Random errors of every sensor: ``(sensors,)`` arrays; NaN where a sensor is no radar."""

    range_sigma_m: Array
    azimuth_sigma_deg: Array
    time_sigma_s: Array

    @classmethod
    def of(cls, settings: EngineSettings) -> Self:
        """Read them from the settings."""
        radars = np.array([s.is_radar for s in settings.sensors])
        columns = [(s.range_sigma_m, s.azimuth_sigma_deg, s.effective_time_sigma_s) for s in settings.sensors]
        table = np.where(radars[:, None], np.array(columns, dtype=np.float64), np.nan)
        return cls(*(np.ascontiguousarray(column) for column in table.T))

    def polar(self, sensor: Ints, ground_m: Array, radial_mps: Array, across_mps: Array) -> Array:
        """Covariance of plots along (radial, across), with the jitter of the stamp: ``(n, 2, 2)``. [m²]"""
        motion = columns_of(radial_mps, across_mps) * self.time_sigma_s[sensor, None]
        covariance = motion[:, :, None] * motion[:, None, :]
        covariance[:, 0, 0] += self.range_sigma_m[sensor] ** 2
        covariance[:, 1, 1] += (ground_m * RAD_PER_DEG * self.azimuth_sigma_deg[sensor]) ** 2
        return covariance


@dataclass(slots=True, eq=False)
class Rows:
    """Two-component measurements of biases, one per row.

    Attributes
    ----------
    time_s : (n,) float64
        When. [s since the epoch]
    error_m : (n, 2) float64
        What was measured. [m]
    covariance_m2 : (n, 2, 2) float64
        Of its noise. [m²]
    sensor, other : (n,) int64
        Radar, and the radar it is compared with; -1 where it is an anchored reference.
    of_sensor, of_other : (n, 2, 4) float64
        Sensitivity to their biases.
    range_m : (n, 2) float64
        Slant range from either. [m]
    aircraft : (n,) int64
        Track number.
    of_aircraft : (n, 2, 3) float64
        Sensitivity to the aircraft's latency and offset; zero for pairs of radars.
    of_height : (n, 2) float64
        Sensitivity to the error that all heights have in common, in sigmas of the height. [m]
    """

    time_s: Array
    error_m: Array
    covariance_m2: Array
    sensor: Ints
    other: Ints
    of_sensor: Array
    of_other: Array
    range_m: Array
    aircraft: Ints
    of_aircraft: Array
    of_height: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)

    @classmethod
    def concatenate(cls, parts: list[Self]) -> Self:
        """One set of rows from several, in order; at least one part is needed."""
        return joined(parts)


def usable(rows: Comparisons, geometry: Geometry) -> NDArray[np.bool_]:
    """Which comparisons can say something about biases, shape ``(n,)``."""
    finite = np.isfinite(geometry.range_error_m + geometry.across_error_m + geometry.radial_mps + rows.height_sigma_m)
    # Only an anchored reference lends its covariance.
    finite &= np.isfinite(rows.position_cov_m2).all(axis=1) | ~rows.anchored
    with np.errstate(invalid="ignore"):
        return (
            finite
            & (geometry.ground_m > GROUND_MIN_M)
            & (np.abs(geometry.up_m) < ELEVATION_MAX_SIN * geometry.range_m)
            & (np.hypot(geometry.range_error_m, geometry.across_error_m) < ERROR_MAX_M)
            & (np.abs(rows.time_s - rows.reference_time_s) < REFERENCE_AGE_MAX_S)
        )


def bias_jacobian(range_m: Array, ground_m: Array, radial_mps: Array, across_mps: Array) -> Array:
    """Sensitivity of (slant range, across) [m] to one radar's biases: ``(n, 2, 4)``."""
    jacobian = np.zeros((len(range_m), 2, BIASES))
    jacobian[:, 0, 0] = 1.0
    jacobian[:, 0, 2] = -radial_mps
    jacobian[:, 0, 3] = range_m
    jacobian[:, 1, 1] = ground_m * RAD_PER_DEG
    jacobian[:, 1, 2] = -across_mps
    return jacobian


def anchored_rows(rows: Comparisons, geometry: Geometry, noise: Noise) -> Rows:
    """Measurements of a radar's biases against references that may be believed."""
    n = len(rows)
    axes = np.stack([geometry.radial_en, geometry.across_en], axis=1)
    plane = rows.position_cov_m2[:, [[0, 1], [1, 2]]]
    covariance = noise.polar(rows.sensor, geometry.ground_m, geometry.radial_mps, geometry.across_mps)
    covariance += REFERENCE_CORRELATION * (axes @ plane @ axes.swapaxes(1, 2))
    of_height, none = geometry.radial_up * rows.height_sigma_m, np.zeros(n)
    covariance[:, 0, 0] += of_height**2
    of_aircraft = np.empty((n, 2, NUISANCES))
    of_aircraft[:, 0, 0] = geometry.radial_mps
    of_aircraft[:, 1, 0] = geometry.across_mps
    of_aircraft[:, :, 1:] = -axes
    return Rows(
        time_s=rows.time_s,
        error_m=columns_of(geometry.range_error_m, geometry.across_error_m),
        covariance_m2=covariance,
        sensor=rows.sensor,
        other=np.full(n, -1),
        of_sensor=bias_jacobian(geometry.range_m, geometry.ground_m, geometry.radial_mps, geometry.across_mps),
        of_other=np.zeros((n, 2, BIASES)),
        range_m=columns_of(geometry.range_m, none),
        aircraft=rows.aircraft,
        of_aircraft=of_aircraft,
        of_height=columns_of(of_height, none),
    )
