"""Dimension identifiers: the time span, airspace, speed range or identity that a question is limited to.

The element method takes "only the data inside the given dimension" from every device; the queries of the service and
``fuse --select`` use the same selection. All given conditions must hold; what lacks an asked value does not match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aeroskein.plots import Array, Bools, Plots
from aeroskein.points import FusedPoints

__all__ = ["Selection"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Conditions on tracks or reports; None means any.

    Attributes
    ----------
    addresses : ICAO addresses as numbers.
    callsign : exact aircraft identification.
    sensors : sensor indices; for points "this sensor contributed".
    bbox : (lat_min, lon_min, lat_max, lon_max), across the antimeridian where lon_min > lon_max. [deg]
    speed_mps, altitude_m, time_s : (lowest, highest), both included. [m/s, m, s]
    """

    addresses: frozenset[int] | None = None
    callsign: str | None = None
    sensors: frozenset[int] | None = None
    bbox: tuple[float, float, float, float] | None = None
    speed_mps: tuple[float, float] | None = None
    altitude_m: tuple[float, float] | None = None
    time_s: tuple[float, float] | None = None

    def of_points(self, points: FusedPoints) -> Bools:
        """Which fused points match, shape ``(n,)``."""
        match = self._common(
            points.address, points.callsign, points.lat_deg, points.lon_deg,
            points.ground_speed_mps, points.altitude_m, points.time_s,
        )  # fmt: skip
        if self.sensors is not None:
            wanted = np.array(sorted(self.sensors), dtype=np.int64)
            match &= (points.sources[:, wanted] > 0).any(axis=1)
        return match

    def of_plots(self, plots: Plots, lat_deg: Array, lon_deg: Array) -> Bools:
        """Which reports match, given their (converted) positions, shape ``(n,)``."""
        match = self._common(
            plots.address,
            plots.callsign,
            lat_deg,
            lon_deg,
            plots.ground_speed_mps,
            plots.altitude_m,
            plots.time_s,
        )
        if self.sensors is not None:
            match &= np.isin(plots.sensor, np.array(sorted(self.sensors), dtype=np.int64))
        return match

    def _common(
        self,
        address: np.ndarray,
        callsign: np.ndarray,
        lat_deg: Array,
        lon_deg: Array,
        speed_mps: Array,
        altitude_m: Array,
        time_s: Array,
    ) -> Bools:
        match = np.ones(len(time_s), dtype=np.bool_)
        if self.addresses is not None:
            match &= np.isin(address, np.array(sorted(self.addresses), dtype=np.int64))
        if self.callsign is not None:
            match &= callsign == self.callsign.encode("ascii", "replace")
        if self.bbox is not None:
            lat_min, lon_min, lat_max, lon_max = self.bbox
            match &= (lat_deg >= lat_min) & (lat_deg <= lat_max)
            east, west = lon_deg >= lon_min, lon_deg <= lon_max
            match &= (east & west) if lon_min <= lon_max else (east | west)
        for limits, value in (
            (self.speed_mps, speed_mps),
            (self.altitude_m, altitude_m),
            (self.time_s, time_s),
        ):
            if limits is not None:
                match &= (value >= limits[0]) & (value <= limits[1])
        return match
