"""What the engine is compared with: the fixed reference estimators, the published circle and the raw reports.

The reference estimators (``aeroskein.smoothing``) get the very reports of the scene, all of them and in order of time,
in a plane at the middle of each flight; a radar's plots get the true difference of height and altitude, so that nothing
but estimation differs. Their parameters stand in ``aeroskein/smoothing/parameters.py`` and are not touched here.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from benchmarks.accuracy_libraries import library_estimates
from benchmarks.accuracy_scenes import Scene, Sky

from aeroskein import conversion, geodesy
from aeroskein.enclosing_circle import smallest_circles
from aeroskein.evaluation import PointColumns
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Ints, Plots
from aeroskein.points import FusedPoints, Product
from aeroskein.smoothing import ReferenceEstimates, reference_filter, reference_smoother

__all__ = ["References"]

# What a radar plot's height is off by when the difference of height and altitude is known: the encoder. [m]
HEIGHT_SIGMA_M = 10.0


class References:
    """Reference estimates for one scene, made when asked for.

    Parameters
    ----------
    scene, sky : Scene, Sky
        What was flown and reported.
    bias : dict, optional
        True biases of radars by sensor id (range m, azimuth deg, time s), taken out before.
    clean : bool
        Whether the reports without gross errors are used.
    """

    def __init__(
        self,
        scene: Scene,
        sky: Sky,
        *,
        bias: dict[str, tuple[float, float, float]] | None = None,
        clean: bool = False,
    ) -> None:
        self._sky = sky
        names = [s.id for s in scene.sensors]
        plots = sky.clean if clean else sky.plots
        plots = plots.take(np.arange(len(plots)))
        for name, (range_m, azimuth_deg, time_s) in (bias or {}).items():
            mine = plots.sensor == names.index(name)
            plots.range_m[mine] -= range_m
            plots.azimuth_deg[mine] = (plots.azimuth_deg[mine] - azimuth_deg) % 360.0
            plots.time_s[mine] -= time_s
        self._measure(scene, plots)

    def _measure(self, scene: Scene, plots: Plots) -> None:
        curve, n = self._sky.curve, len(plots)
        flight = np.searchsorted(curve.addresses, plots.address)
        table = conversion.SensorTable(scene.engine_settings())
        height = np.where(np.isnan(plots.height_m), plots.altitude_m + self._sky.offset_m[flight], plots.height_m)
        located = conversion.locate(plots, table, height, np.full(n, HEIGHT_SIGMA_M), np.zeros((n, 4)))
        middle = curve.at(np.arange(len(curve.names)), 0.5 * (curve.start_s + curve.end_s))
        lat = np.degrees(np.arcsin(middle.up[:, 2]))
        lon = np.degrees(np.arctan2(middle.up[:, 1], middle.up[:, 0]))
        self._frames = geodesy.frame_rows(lat, lon)
        time_sigma = table.time_sigma_s[plots.sensor]
        m = conversion.measure(plots, plots, located, flight, self._frames[flight], table, time_sigma)
        self.measurements: Measurements = m.take(np.lexsort((m.time_s, m.slot)))

    def smoother(self, points: FusedPoints, lag_s: float | None) -> PointColumns:
        """The smoother at the instants of published points."""
        flight = np.searchsorted(self._sky.curve.addresses, points.address)
        return self._columns(reference_smoother(self.measurements, flight, points.time_s, lag_s=lag_s))

    def zero_lag(self, points: FusedPoints, model: Literal["imm", "imm-ukf"]) -> PointColumns:
        """A zero-lag filter at the instants of live points: its estimate at the newest report until then."""
        found = reference_filter(self.measurements, model)
        flight = np.searchsorted(self._sky.curve.addresses, points.address)
        row = last_rows(found.flight, found.time_s, flight, points.time_s)
        exact = (row >= 0) & (np.abs(found.time_s[row] - points.time_s) < 1e-6)
        row = row[exact & (found.flight[row] == flight)]
        return self._columns(
            ReferenceEstimates(
                found.flight[row], found.time_s[row], found.position_m[row], found.velocity_mps[row],
                found.position_cov_m2[row], found.velocity_cov_m2ps2[row],
            )
        )  # fmt: skip

    def library(self, name: str) -> PointColumns:
        """Another library's estimator at the times of the reports."""
        return self._columns(library_estimates(self.measurements, name))

    def _columns(self, estimates: ReferenceEstimates) -> PointColumns:
        """Estimates as points that can be judged; where there is none, positions are NaN."""
        known = np.isfinite(estimates.position_m[:, 0])
        position = np.where(known[:, None], estimates.position_m, 0.0)
        frames = self._frames[estimates.flight]
        lat, lon = geodesy.from_plane(frames, position[:, 0], position[:, 1])
        back = geodesy.invert_axes(geodesy.local_axes(frames, lat, lon, np.zeros(len(lat))))
        v_east, v_north = geodesy.rotate_vector(back, *estimates.velocity_mps.T)
        cov = estimates.position_cov_m2
        upper = np.stack([cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]], axis=1)
        return PointColumns.of(
            len(lat),
            product=int(Product.ELEMENT),
            address=self._sky.curve.addresses[estimates.flight],
            track_number=estimates.flight,
            time_s=estimates.time_s,
            lat_deg=np.where(known, lat, np.nan),
            lon_deg=np.where(known, lon, np.nan),
            ground_speed_mps=np.hypot(v_east, v_north),
            track_angle_deg=np.degrees(np.arctan2(v_east, v_north)) % 360.0,
            position_cov_m2=geodesy.rotate_covariance(back, upper),
        )

    def circle(self, points: FusedPoints) -> PointColumns:
        """The published circle: smallest circle around the reports of each element's span, at their mean time."""
        m = self.measurements
        flight = np.searchsorted(self._sky.curve.addresses, points.address)
        first = last_rows(m.slot, m.time_s, flight, points.span_s[:, 0], inclusive=False) + 1
        end = last_rows(m.slot, m.time_s, flight, points.span_s[:, 1], inclusive=False) + 1
        some = np.flatnonzero(end > first)
        first, end, flight = first[some], end[some], flight[some]
        row = first[:, None] + np.arange(int((end - first).max()))
        inside = row < end[:, None]
        row = np.where(inside, row, first[:, None])
        centres, _ = smallest_circles(np.stack([m.east_m[row], m.north_m[row]], axis=2), inside)
        time_s = (np.where(inside, m.time_s[row] - m.time_s[first][:, None], 0.0).sum(axis=1)) / inside.sum(axis=1)
        lat, lon = geodesy.from_plane(self._frames[flight], centres[:, 0], centres[:, 1])
        return PointColumns.of(
            len(lat),
            product=int(Product.ELEMENT),
            address=self._sky.curve.addresses[flight],
            track_number=flight,
            time_s=m.time_s[first] + time_s,
            lat_deg=lat,
            lon_deg=lon,
        )


def last_rows(table_flight: Ints, table_s: Array, flight: Ints, time_s: Array, *, inclusive: bool = True) -> Ints:
    """Row of a table ordered by flight and time that is the last one of its flight at each instant (or before it).

    The row before the flight's first one where there is none.
    """
    # Times apart by less than a microsecond are one instant; one key orders flight first, then time.
    origin = float(table_s.min()) - 1e4
    span = float(max(table_s.max(), time_s.max())) - origin + 1e4
    key = table_flight * span + (table_s - origin)
    asked = flight * span + (time_s - origin) + (1e-6 if inclusive else -1e-6)
    return np.searchsorted(key, asked, side="right") - 1
