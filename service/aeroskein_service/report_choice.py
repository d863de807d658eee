"""Which reports of a file lie in given dimensions: the first step of the element method, before anything is fused.

A radar plot lies where its range and azimuth put it at its own height, without registration, which is not known yet.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aeroskein import geodesy
from aeroskein.conversion import UNKNOWN_HEIGHT_M
from aeroskein.plots import Array, Bools, Plots
from aeroskein.radar_geometry import radar_to_geodetic
from aeroskein.selection import Selection
from aeroskein.settings import SensorSettings

__all__ = ["ReportChoice"]


class ReportChoice:
    """Says of reports whether they are selected.

    Parameters
    ----------
    selection : Selection
        The dimensions.
    sensors : sequence of SensorSettings
        By index; the sites of the radars are in them.
    """

    def __init__(self, selection: Selection, sensors: Sequence[SensorSettings]) -> None:
        self._selection = selection
        self._has_site = np.array([s.lat_deg is not None and s.lon_deg is not None for s in sensors], dtype=np.bool_)
        self._sites = geodesy.frame_rows(
            np.array([s.lat_deg or 0.0 for s in sensors]),
            np.array([s.lon_deg or 0.0 for s in sensors]),
            np.array([s.height_m or 0.0 for s in sensors]),
        )

    def __call__(self, plots: Plots) -> Bools:
        """Which of these reports match, shape ``(n,)``."""
        return self._selection.of_plots(plots, *self._positions(plots))

    def _positions(self, plots: Plots) -> tuple[Array, Array]:
        """Latitude and longitude of every report, NaN where a polar one has no site. [deg]"""
        lat_deg, lon_deg = plots.lat_deg.copy(), plots.lon_deg.copy()
        if self._selection.bbox is None:
            return lat_deg, lon_deg
        at = np.flatnonzero(np.isfinite(plots.range_m) & self._has_site[plots.sensor])
        if len(at):
            height_m = np.where(np.isnan(plots.height_m), plots.altitude_m, plots.height_m)[at]
            height_m = np.where(np.isnan(height_m), UNKNOWN_HEIGHT_M, height_m)
            sites = self._sites[plots.sensor[at]]
            fix = radar_to_geodetic(sites, plots.range_m[at], plots.azimuth_deg[at], height_m)
            lat_deg[at], lon_deg[at] = fix.lat_deg, fix.lon_deg
        return lat_deg, lon_deg
