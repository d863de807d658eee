"""Comparisons: radar plots beside a reference for the same aircraft, and the geometry between them.

A comparison holds what the radar said, unchanged, and a state of the same aircraft that this radar had no part in. The
geometry is exact (ECEF), so that no map projection can look like a bias. All that follows is linear in metres along
two directions: away from the radar (slant) and across, clockwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.ellipsoid import ecef_axes, to_ecef
from aeroskein.plots import Array, Bools, Ints, columns_of, joined, taken
from aeroskein.units import wrap_angle_deg

__all__ = ["RAD_PER_DEG", "Comparisons", "Geometry", "geometry_of"]

RAD_PER_DEG: Final = np.pi / 180.0

_DTYPES: Final[dict[str, Any]] = {"sensor": np.int64, "aircraft": np.int64, "anchored": np.bool_}


@dataclass(slots=True, eq=False)
class Comparisons:
    """Plots of radars with a reference each, one row per plot.

    Attributes
    ----------
    sensor : (n,) int64
        Index of the radar in the settings.
    aircraft : (n,) int64
        Track number: names the aircraft, never reused.
    time_s : (n,) float64
        Stamp of the plot as reported. [s since the epoch]
    range_m, azimuth_deg : (n,) float64
        Slant range and azimuth as reported, not corrected. [m, deg]
    reference_time_s : (n,) float64
        Instant of the reference state; best within a few seconds of the true time of the plot. [s since the epoch]
    lat_deg, lon_deg, height_m : (n,) float64
        Reference position; the height above the ellipsoid. [deg, m]
    v_east_mps, v_north_mps, vertical_rate_mps : (n,) float64
        Velocity of the aircraft itself (at its height). NaN in the vertical rate counts as 0. [m/s]
    position_cov_m2 : (n, 3) float64
        ``[ee, en, nn]`` of the reference position. [m²]
    height_sigma_m : (n,) float64
        One sigma of the height; 100 m and more where only pressure altitude is known. [m]
    anchored : (n,) bool
        True where the reference rests on ADS-B (or WAM) alone and may be believed. Where False only height and
        velocity of the reference are used, and radars are compared with each other.
    """

    sensor: Ints
    aircraft: Ints
    time_s: Array
    range_m: Array
    azimuth_deg: Array
    reference_time_s: Array
    lat_deg: Array
    lon_deg: Array
    height_m: Array
    v_east_mps: Array
    v_north_mps: Array
    vertical_rate_mps: Array
    position_cov_m2: Array
    height_sigma_m: Array
    anchored: Bools

    def __len__(self) -> int:
        return len(self.time_s)

    @classmethod
    def of(cls, **columns: Any) -> Self:
        """Make rows from columns; scalars are repeated.

        Raises
        ------
        ValueError
            If the columns do not have one length.
        """
        n = len(np.atleast_1d(columns["time_s"]))
        made: dict[str, Any] = {}
        for field in fields(cls):
            shape = (n, 3) if field.name == "position_cov_m2" else (n,)
            column = np.asarray(columns[field.name], dtype=_DTYPES.get(field.name, np.float64))
            if column.ndim < len(shape):
                column = np.broadcast_to(column, shape).copy()
            if column.shape != shape:
                raise ValueError(f"column {field.name} has shape {column.shape}, expected {shape}")
            made[field.name] = column
        return cls(**made)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """One set of rows from several, in order; at least one part is needed."""
        return joined(parts)


@dataclass(slots=True, eq=False)
class Geometry:
    """Where the reference stands as the radar sees it, at the plot's stamp.

    Attributes
    ----------
    range_error_m, across_error_m : (n,) float64
        Reported minus reference: slant range, and azimuth times ground range. [m]
    range_m, ground_m, up_m : (n,) float64
        Of the reference: slant range, and its parts along and above the radar's horizon plane. [m]
    radial_mps, across_mps : (n,) float64
        Velocity away from the radar and clockwise across. [m/s]
    radial_en, across_en : (n, 2) float64
        Those two directions in east and north at the aircraft.
    radial_up : (n,) float64
        Share of a change of height in the slant range.
    plot_m : (n, 3) float64
        The plot itself in ECEF, its height taken from the reference. [m]
    velocity_en : (n, 2) float64
        Velocity over ground at the aircraft. [m/s]
    """

    range_error_m: Array
    across_error_m: Array
    range_m: Array
    ground_m: Array
    up_m: Array
    radial_mps: Array
    across_mps: Array
    radial_en: Array
    across_en: Array
    radial_up: Array
    plot_m: Array
    velocity_en: Array

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)


def geometry_of(rows: Comparisons, sites: Array) -> Geometry:
    """Place references and plots in the radars' own coordinates.

    Parameters
    ----------
    rows : Comparisons
        What to compare.
    sites : (sensors, 12) array
        Frames at the antennas (``geodesy.frame_rows`` with the antenna's height); only radars' rows are read.

    Returns
    -------
    Geometry
        Rows in the same order.
    """
    site = sites[rows.sensor]
    # East, north and up at the aircraft, (n, 3, 3), and its velocity along them.
    axes = np.stack(ecef_axes(rows.lat_deg, rows.lon_deg), axis=1)
    climb = np.where(np.isnan(rows.vertical_rate_mps), 0.0, rows.vertical_rate_mps)
    velocity = columns_of(rows.v_east_mps, rows.v_north_mps, climb)
    reference_m = to_ecef(rows.lat_deg, rows.lon_deg, rows.height_m)
    reference_m += np.einsum("na,nac->nc", velocity, axes) * (rows.time_s - rows.reference_time_s)[:, None]

    # The radar's own east, north and up.
    site_m, site_axes = site[:, 0:3], site[:, 3:12].reshape(-1, 3, 3)
    away = reference_m - site_m
    e_m, n_m, up_m = np.ascontiguousarray(np.einsum("nac,nc->na", site_axes, away).T)
    range_m = np.sqrt(e_m**2 + n_m**2 + up_m**2)
    ground_m = np.maximum(np.hypot(e_m, n_m), 1.0)
    radial = np.einsum("nac,nc->na", axes, away / np.maximum(range_m, 1.0)[:, None])
    clockwise = (site_axes[:, 0] * n_m[:, None] - site_axes[:, 1] * e_m[:, None]) / ground_m[:, None]
    across = np.einsum("nac,nc->na", axes, clockwise)

    azimuth_error_deg = wrap_angle_deg(rows.azimuth_deg - np.degrees(np.arctan2(e_m, n_m)))
    plot_ground_m = np.sqrt(np.maximum(rows.range_m**2 - up_m**2, 0.0))
    plot_rad = rows.azimuth_deg * RAD_PER_DEG
    plot = columns_of(plot_ground_m * np.sin(plot_rad), plot_ground_m * np.cos(plot_rad), up_m)
    return Geometry(
        range_error_m=rows.range_m - range_m,
        across_error_m=azimuth_error_deg * RAD_PER_DEG * ground_m,
        range_m=range_m,
        ground_m=ground_m,
        up_m=up_m,
        radial_mps=np.einsum("na,na->n", radial, velocity),
        across_mps=np.einsum("na,na->n", across, velocity),
        radial_en=radial[:, :2],
        across_en=across[:, :2],
        radial_up=radial[:, 2],
        plot_m=site_m + np.einsum("na,nac->nc", plot, site_axes),
        velocity_en=velocity[:, :2],
    )
