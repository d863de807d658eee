"""Step 0 of the published ADS-B filter, all together: from reports to flights in their planes, ready to filter.

Gathering, regularising, projecting, the start, the errors of the sources, the indicators and the repair, in this order.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from aeroskein.adsb_filter.calibration import SourceErrors, estimate_source_errors
from aeroskein.adsb_filter.indicators import ACCELERATION, SPEED, SPIKE, indicators, repair
from aeroskein.adsb_filter.regularise import moving_rows, started_rows
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.conversion import SensorTable
from aeroskein.flights import Flights, gather, locate_flights, measure, split_at_holes, stale_rows
from aeroskein.lanes import continues
from aeroskein.measurements import Measurements
from aeroskein.planes import Planes, planes_of
from aeroskein.plots import Array, Bools, Ints, Plots
from aeroskein.settings import EngineSettings

__all__ = ["FilterSummary", "Prepared", "prepare"]


@dataclass(slots=True)
class FilterSummary:
    """What was done with the reports, as counts."""

    reports: int = 0
    flights: int = 0
    unidentified: int = 0
    duplicates: int = 0
    on_ground: int = 0
    unstarted: int = 0
    stale: int = 0
    spikes: int = 0
    too_fast: int = 0
    accelerations: int = 0
    repaired: int = 0
    outliers: int = 0
    fallbacks: dict[str, int] = field(default_factory=dict)
    """Flights whose result was rejected, by what they fell back to: ``filtered`` or ``original``."""
    source_errors: list[SourceErrors] | None = None
    """Estimated errors by sensor, where asked for."""


@dataclass(slots=True, eq=False)
class Prepared:
    """Flights ready to filter."""

    flights: Flights
    planes: Planes
    height_m: Array
    measurements: Measurements
    """With bad positions repaired, where that was asked for."""
    original: Measurements
    """As they were reported."""
    excluded: Bools
    """Reports that are no part of the original track: spikes and jumps that were repaired."""


def prepare(
    plots: Plots, engine: EngineSettings, settings: AdsbFilterSettings, summary: FilterSummary, estimate_errors: bool
) -> Prepared | None:
    """Gather flights, put them into their planes, and find what is bad in them.

    Parameters
    ----------
    plots, engine, settings, estimate_errors
        As in ``pipeline.filter_reports``.
    summary : FilterSummary
        What is left out is counted in it.

    Returns
    -------
    Prepared or None
        None where there is nothing to filter.
    """
    table = SensorTable(engine)
    gathered = gather(plots, settings.split_after_s, by_local_track=True)
    summary.unidentified, summary.duplicates = gathered.unidentified, gathered.duplicates
    flights = gathered.keep(moving_rows(gathered))
    summary.on_ground = len(gathered.plots) - len(flights.plots)
    if len(flights.plots) == 0:
        return None
    stale = stale_rows(flights)
    flights = split_at_holes(flights, ~stale, settings.split_after_s)
    located = locate_flights(flights, table, np.zeros((len(stale), 4)))
    planes = planes_of(settings.projection, flights.flight, located.lat_deg, located.lon_deg)
    measurements = measure(flights, located, planes, table, table.time_sigma_s)
    for name in ("east_m", "north_m", "v_east_mps", "v_north_mps"):
        getattr(measurements, name)[stale] = np.nan
    started = started_rows(measurements, settings.max_speed_mps)
    summary.stale, summary.unstarted = int(stale[started].sum()), int((~started).sum())
    if not started.any():
        return None
    if estimate_errors:
        own = started & ~table.is_radar[flights.plots.sensor]  # a radar's errors are not alike in all directions
        summary.source_errors = estimate_source_errors(measurements.take(own), len(engine.sensors))
        _use_errors(measurements, summary.source_errors)
    kept_flights = flights.flight[started][~continues(flights.flight[started])]
    measurements, flights, height_m = measurements.take(started), flights.keep(started), located.height_m[started]
    measurements.slot = flights.flight
    found = indicators(measurements, flights.plots.ground_speed_mps, settings)
    summary.spikes, summary.too_fast, summary.accelerations = (
        int((found & bit > 0).sum()) for bit in (SPIKE, SPEED, ACCELERATION)
    )
    original, excluded = measurements, np.zeros(len(found), dtype=np.bool_)
    if settings.indicators == "published":
        # The start was chosen with care, and has no neighbour to interpolate from.
        bad = (found > 0) & continues(measurements.slot)
        position_m = repair(measurements, bad)
        measurements = replace(measurements, east_m=position_m[:, 0].copy(), north_m=position_m[:, 1].copy())
        excluded = bad & (found & (SPIKE | SPEED) > 0)
        summary.repaired = int(bad.sum())
    return Prepared(flights, _PlanesOf(planes, kept_flights), height_m, measurements, original, excluded)


class _PlanesOf:
    """The planes of those flights that were kept, under their new numbers."""

    def __init__(self, planes: Planes, kept: Ints) -> None:
        self._planes = planes
        self._kept = kept

    def to_plane(self, flight: Ints, lat_deg: Array, lon_deg: Array) -> tuple[Array, Array]:
        return self._planes.to_plane(self._kept[flight], lat_deg, lon_deg)

    def from_plane(self, flight: Ints, e_m: Array, n_m: Array) -> tuple[Array, Array]:
        return self._planes.from_plane(self._kept[flight], e_m, n_m)

    def axes(self, flight: Ints, lat_deg: Array, lon_deg: Array, height_m: Array) -> Array:
        return self._planes.axes(self._kept[flight], lat_deg, lon_deg, height_m)


def _use_errors(measurements: Measurements, errors: list[SourceErrors]) -> None:
    """Replace the configured sigmas by the estimated ones, where there are any."""
    source = measurements.sensor.astype(np.int64)
    position = np.array([e.position_sigma_m for e in errors])[source]
    time = np.array([e.time_sigma_s for e in errors])[source]
    known = np.isfinite(position)
    measurements.r_ee[known] = measurements.r_nn[known] = position[known] ** 2
    measurements.r_en[known] = 0.0
    measurements.time_variance[known] = time[known] ** 2
