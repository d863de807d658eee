"""The published ADS-B filter from reports to points: the one file that knows the order of its steps.

    reports ─► flights (gather, regularise) ─► plane ─► indicators, repair ─► start ─► filter ─► smooth ─► check
    ─► points

A result that one of the three divergence checks rejects falls back to the next simpler one: from smoothed to filtered,
from filtered to the original track; such points carry the flag ``guarded``.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Final

import numpy as np

from aeroskein.adsb_filter.divergence import diverged
from aeroskein.adsb_filter.linear import filter_linear, smooth_linear
from aeroskein.adsb_filter.prepare import FilterSummary, prepare
from aeroskein.adsb_filter.publish import fused_points
from aeroskein.adsb_filter.record import Filtered
from aeroskein.adsb_filter.settings import AdsbFilterSettings, Model
from aeroskein.adsb_filter.start import position_covariance, start_states
from aeroskein.adsb_filter.turning import bank_of, filter_turning, smooth_turning
from aeroskein.flights import interpolated
from aeroskein.lanes import continues
from aeroskein.measurements import Measurements
from aeroskein.plots import Bools, Ints, Plots
from aeroskein.points import FusedPoints
from aeroskein.settings import EngineSettings

__all__ = ["FilterSummary", "filter_flights", "filter_reports"]

# Reports filtered together: their models' states and covariances take about a quarter of a gigabyte. [reports]
CHUNK_REPORTS: Final = 100_000


def filter_reports(
    plots: Plots,
    engine: EngineSettings,
    settings: AdsbFilterSettings,
    *,
    model: Model,
    smooth: bool,
    estimate_errors: bool = False,
) -> tuple[FusedPoints | None, FilterSummary]:
    """Filter the reports of one source, or of several that report positions of their own.

    Parameters
    ----------
    plots : Plots
        The reports, of any number of aircraft, in any order.
    engine : EngineSettings
        The sensors.
    settings : AdsbFilterSettings
        Thresholds and choices.
    model : str
        ``linear``, ``ukf`` or ``imm``.
    smooth : bool
        Whether the estimates are smoothed backwards.
    estimate_errors : bool
        Whether position and time errors of each source are estimated from straight flight and used instead of the
        configured ones.

    Returns
    -------
    points : FusedPoints or None
        One per report; None where nothing could be filtered.
    summary : FilterSummary
        What was done.
    """
    summary = FilterSummary(reports=len(plots))
    prepared = prepare(plots, engine, settings, summary, estimate_errors)
    if prepared is None:
        return None, summary
    flight = prepared.flights.flight
    summary.flights = int(flight[-1]) + 1
    parts, guarded_parts = [], []
    for rows in _chunks(flight):
        part, guarded = filter_flights(
            _renumbered(prepared.measurements, rows), _renumbered(prepared.original, rows), prepared.excluded[rows],
            settings, model, smooth, summary,
        )  # fmt: skip
        parts.append(part)
        guarded_parts.append(guarded)
    result = Filtered(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Filtered)})
    summary.outliers = int((~result.accepted & np.isfinite(prepared.measurements.east_m)).sum())
    points = fused_points(
        prepared.flights, prepared.planes, prepared.height_m, result, np.concatenate(guarded_parts),
        smoothed=smooth, sensors=len(engine.sensors),
    )  # fmt: skip
    return points, summary


def _chunks(flight: Ints) -> list[slice]:
    """Rows of whole flights, about ``CHUNK_REPORTS`` at a time."""
    first = np.flatnonzero(~continues(flight))
    chunk = first // CHUNK_REPORTS
    starts = first[np.flatnonzero(np.diff(chunk, prepend=-1))]
    return [slice(int(a), int(b)) for a, b in zip(starts, np.append(starts[1:], len(flight)), strict=True)]


def _renumbered(measurements: Measurements, rows: slice) -> Measurements:
    part = measurements.take(np.arange(rows.start, rows.stop))
    part.slot = part.slot - part.slot[0]
    return part


def filter_flights(
    measurements: Measurements,
    original: Measurements,
    excluded: Bools,
    settings: AdsbFilterSettings,
    model: Model,
    smooth: bool,
    summary: FilterSummary,
) -> tuple[Filtered, Bools]:
    """Filter, smooth and judge; fall back where a result is rejected.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane by flight and time; each flight begins with a position.
    original : Measurements
        The same before any repair: what results are compared with, and fall back to.
    excluded : (n,) bool
        Reports of the original track that are no part of it.
    settings, model, smooth
        As in ``filter_reports``.
    summary : FilterSummary
        Fallbacks are counted in it.

    Returns
    -------
    result : Filtered
        One estimate per report.
    guarded : (n,) bool
        Which of them are a fallback.
    """
    flight = measurements.slot
    candidates = [*_results(measurements, settings, model, smooth), ("original", _original(original, excluded))]
    result = candidates[0][1]
    guarded = np.zeros(len(flight), dtype=np.bool_)
    pending = diverged(result, original, excluded, settings) > 0
    for name, candidate in candidates[1:]:
        if not pending.any():
            break
        summary.fallbacks[name] = summary.fallbacks.get(name, 0) + int(pending.sum())
        at = pending[flight]
        for f in fields(Filtered):
            getattr(result, f.name)[at] = getattr(candidate, f.name)[at]
        guarded |= at
        if name != "original":
            pending &= diverged(candidate, original, excluded, settings) > 0
    return result, guarded


def _results(
    measurements: Measurements, settings: AdsbFilterSettings, model: Model, smooth: bool
) -> list[tuple[str, Filtered]]:
    """The asked-for result first, then the simpler one it may fall back to."""
    start = start_states(measurements, settings)
    results = []
    if model == "linear":
        linear = filter_linear(measurements, start, settings)
        if smooth:
            results.append(("smoothed", smooth_linear(linear, measurements).filtered()))
        results.append(("filtered", linear.filtered()))
    else:
        bank = bank_of(settings, several=model == "imm")
        turning = filter_turning(measurements, start, bank, settings)
        if smooth:
            results.append(("smoothed", smooth_turning(turning, measurements, bank).filtered()))
        results.append(("filtered", turning.filtered()))
    return results


def _original(original: Measurements, excluded: Bools) -> Filtered:
    """The reports themselves with their own covariance; missing and excluded positions interpolated in time."""
    result = Filtered.empty(len(original))
    flight, time_s = original.slot, original.time_s
    for axis, column in enumerate((original.east_m, original.north_m)):
        result.position_m[:, axis] = interpolated(flight, time_s, np.where(excluded, np.nan, column))
    result.velocity_mps[:] = np.stack([original.v_east_mps, original.v_north_mps], axis=1)
    known = np.nan_to_num(result.velocity_mps)
    result.position_cov_m2[:] = position_covariance(original, known)
    result.velocity_cov_m2ps2[:] = original.velocity_variance[:, None, None] * np.eye(2)
    result.accepted[:] = np.isfinite(original.east_m) & ~excluded
    return result
