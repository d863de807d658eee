"""Errors of single points: fused minus true, at the point's own time, one row per judged point.

The fused position is set at the true height before the difference is taken, so a wrong height never shows as a
horizontal error. Differences are formed in Earth-centred coordinates and then resolved twice: along and across the
true track for the reader, and east-north at the point itself for the covariance that the point states there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.geometry import (
    east_north,
    east_north_axes,
    east_north_axes_at,
    ecef,
    rotate_to_east_north,
    up_vector,
    velocity_ecef,
)
from aeroskein.evaluation.truth_curve import CLIMB_RATE_MPS, TURN_RATE_DEGPS, TruthCurve, TruthStates
from aeroskein.plots import Array, Bools, Ints, taken

__all__ = ["MIN_ANGLE_SPEED_MPS", "Residuals", "along_across", "nees", "residuals_of"]

# Below 40 kt a velocity error of 1 m/s is 3 degrees of track angle and a hovering aircraft has none at all.
MIN_ANGLE_SPEED_MPS: Final = 20.0
# Below this, "along" and "across" have no direction to refer to.
_MIN_ALONG_SPEED_MPS: Final = 2.0


@dataclass(slots=True, eq=False)
class Residuals:
    """Errors (fused minus true) of the judged points, one row each, ordered by flight, track and time.

    Attributes
    ----------
    row : (n,) int64
        Row of the point in its ``PointColumns``.
    flight : (n,) int64
        Flight of truth it was compared with.
    track_number : (n,) int64
    time_s : (n,) float64
        [s since the epoch]
    error_m : (n, 2) float64
        East and north, in the plane at the truth. [m]
    horizontal_m, along_m, across_m : (n,) float64
        Distance; ahead of the truth and right of it, NaN where truth hardly moves. [m]
    height_m, altitude_m : (n,) float64
        Vertical errors, NaN where either side has none. [m]
    velocity_mps, ground_speed_mps, track_angle_deg, vertical_rate_mps : (n,) float64
        Length of the velocity difference; differences; the angle only above ``MIN_ANGLE_SPEED_MPS``. [m/s, deg]
    position_nees, velocity_nees : (n,) float64
        Squared error in units of the stated covariance, 2 degrees of freedom; NaN without a covariance. [1]
    phase : (n,) int16
        Phase of the truth.
    is_turning, is_climbing : (n,) bool
        By the motion of the truth, whatever the phase is called.
    truth_speed_mps : (n,) float64
        [m/s]
    age_s : (n,) float64
        Time from the state to its publication. [s]
    flags : (n,) uint16
        ``Flag`` of the point.
    """

    row: Ints
    flight: Ints
    track_number: Ints
    time_s: Array
    error_m: Array
    horizontal_m: Array
    along_m: Array
    across_m: Array
    height_m: Array
    altitude_m: Array
    velocity_mps: Array
    ground_speed_mps: Array
    track_angle_deg: Array
    vertical_rate_mps: Array
    position_nees: Array
    velocity_nees: Array
    phase: NDArray[np.int16]
    is_turning: Bools
    is_climbing: Bools
    truth_speed_mps: Array
    age_s: Array
    flags: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)


def residuals_of(points: PointColumns, flight: Ints, curve: TruthCurve) -> Residuals:
    """Compare points with the flights they belong to.

    Parameters
    ----------
    points : PointColumns
        The points, one product.
    flight : (n,) int array
        Flight of each point, -1 where it belongs to none.
    curve : TruthCurve

    Returns
    -------
    Residuals
        Only the points that have a flight, a position, and a truth at their time.
    """
    truth = curve.at(flight, points.time_s)
    valid = truth.valid & np.isfinite(points.lat_deg) & np.isfinite(points.lon_deg)
    rows = np.flatnonzero(valid)
    rows = rows[np.lexsort((points.time_s[rows], points.track_number[rows], flight[rows]))]
    kept, truth = points.take(rows), taken(truth, rows)

    east, north = east_north_axes(truth.up)
    own_east, own_north = east_north_axes_at(kept.lat_deg, kept.lon_deg)
    height = np.nan_to_num(truth.height_m)
    offset = ecef(up_vector(kept.lat_deg, kept.lon_deg), height) - truth.position
    error_m = rotate_to_east_north(offset, east, north)
    speed, velocity = _velocity_errors(kept, truth, east, north)
    along, across = along_across(error_m, speed["true"])
    position_nees = nees(rotate_to_east_north(offset, own_east, own_north), kept.position_cov_m2)
    velocity_nees = nees(rotate_to_east_north(velocity, own_east, own_north), kept.velocity_cov_m2ps2)
    return Residuals(
        row=rows,
        flight=flight[rows],
        track_number=kept.track_number,
        time_s=kept.time_s,
        error_m=error_m,
        horizontal_m=np.hypot(error_m[:, 0], error_m[:, 1]),
        along_m=along,
        across_m=across,
        height_m=kept.height_m - truth.height_m,
        altitude_m=kept.altitude_m - truth.altitude_m,
        velocity_mps=np.hypot(speed["error"][:, 0], speed["error"][:, 1]),
        ground_speed_mps=kept.ground_speed_mps - np.hypot(speed["true"][:, 0], speed["true"][:, 1]),
        track_angle_deg=_angle_error_deg(speed["fused"], speed["true"]),
        vertical_rate_mps=kept.vertical_rate_mps - truth.vertical_rate_mps,
        position_nees=position_nees,
        velocity_nees=velocity_nees,
        phase=truth.phase,
        is_turning=np.abs(truth.turn_rate_degps) > TURN_RATE_DEGPS,
        is_climbing=np.abs(np.nan_to_num(truth.vertical_rate_mps)) > CLIMB_RATE_MPS,
        truth_speed_mps=np.hypot(speed["true"][:, 0], speed["true"][:, 1]),
        age_s=kept.published_s - kept.time_s,
        flags=kept.flags,
    )


def nees(error: Array, covariance: Array) -> Array:
    """Normalised estimation error squared of two components: ``e' P^-1 e``.

    Parameters
    ----------
    error : (n, 2) array
        East and north. [x]
    covariance : (n, 3) array
        ``[ee, en, nn]``. [x²]

    Returns
    -------
    (n,) array
        Chi-square with 2 degrees of freedom for an honest covariance (Bar-Shalom, Li, Kirubarajan 2001, 5.4.2);
        NaN where the covariance is absent or not positive definite. [1]
    """
    ee, en, nn = covariance[:, 0], covariance[:, 1], covariance[:, 2]
    determinant = ee * nn - en * en
    honest = (ee > 0.0) & (determinant > 0.0)
    square = nn * error[:, 0] ** 2 - 2.0 * en * error[:, 0] * error[:, 1] + ee * error[:, 1] ** 2
    return np.asarray(np.divide(square, determinant, out=np.full(len(error), np.nan), where=honest))


def _velocity_errors(
    kept: PointColumns, truth: TruthStates, east: Array, north: Array
) -> tuple[dict[str, Array], Array]:
    """True and fused velocity and their difference in the truth's plane; the difference in Earth-centred axes."""
    own = east_north(kept.ground_speed_mps, kept.track_angle_deg)
    fused = velocity_ecef(kept.lat_deg, kept.lon_deg, own, np.zeros(len(kept)))
    rise = np.sum(truth.velocity * truth.up, axis=1)
    level = truth.velocity - truth.up * rise[:, None]
    parts = {
        "true": rotate_to_east_north(level, east, north),
        "fused": rotate_to_east_north(fused, east, north),
        "error": rotate_to_east_north(fused - level, east, north),
    }
    return parts, fused - level


def along_across(error_m: Array, true_mps: Array) -> tuple[Array, Array]:
    """Components ahead of and right of the true direction of motion; NaN where there is hardly any."""
    speed = np.hypot(true_mps[:, 0], true_mps[:, 1])
    moving = speed > _MIN_ALONG_SPEED_MPS
    direction = true_mps / np.where(moving, speed, 1.0)[:, None]
    along = np.sum(error_m * direction, axis=1)
    across = error_m[:, 0] * direction[:, 1] - error_m[:, 1] * direction[:, 0]
    return np.where(moving, along, np.nan), np.where(moving, across, np.nan)


def _angle_error_deg(fused_mps: Array, true_mps: Array) -> Array:
    """Fused minus true track angle in (-180, 180], NaN where the truth is slower than the angle needs. [deg]"""
    cross = fused_mps[:, 0] * true_mps[:, 1] - fused_mps[:, 1] * true_mps[:, 0]
    dot = np.sum(fused_mps * true_mps, axis=1)
    fast = np.hypot(true_mps[:, 0], true_mps[:, 1]) >= MIN_ANGLE_SPEED_MPS
    return np.where(fast, np.degrees(np.arctan2(cross, dot)), np.nan)
