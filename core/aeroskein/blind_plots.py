"""Blind plots: radar plots that say nothing of their height take that of the track they are compared with.

Where such a plot lies depends on the height by kilometres near the radar. Compared with a track, it lies where it would
if it were that track's: at the altitude that others report of it, or at the height that its own plots speak for.
"""

from __future__ import annotations

import numpy as np

from aeroskein import conversion
from aeroskein.applied_biases import AppliedBiases
from aeroskein.conversion import Located
from aeroskein.engine_state import EngineState
from aeroskein.intake import Batch
from aeroskein.plots import Array, Bools, Ints, columns_of

__all__ = ["learn_heights", "located_as"]


def located_as(state: EngineState, biases: AppliedBiases, batch: Batch, plot: Ints, slot: Ints) -> Located:
    """Where the plots of pairs are if each is its track's.

    Parameters
    ----------
    plot, slot : (p,) int64
        Row of the report and slot of the track.
    """
    located = batch.located.take(plot)
    blind = np.flatnonzero(_blind(state, batch)[plot])
    if not len(blind):
        return located
    asked = batch.take(plot[blind])
    height, sigma = _heights(state, asked, slot[blind])
    before = state.block.before(asked.raw.time_s)
    better = conversion.locate(
        asked.plots, state.sensors, height, np.nan_to_num(sigma), biases.sigmas(asked.raw.sensor, before)
    )
    # A slant range that is shorter than the height says that it is another aircraft's.
    use = np.isfinite(height) & better.feasible
    located.put(blind[use], better.take(use))
    return located


def learn_heights(state: EngineState, biases: AppliedBiases, batch: Batch) -> None:
    """Show the plots of tracks whose height nobody reports to the filters that find it; slots are filled in."""
    rows = np.flatnonzero(_blind(state, batch) & (batch.slot >= 0))
    rows = rows[np.isnan(_reported(state, batch.take(rows), batch.slot[rows])[0])]
    if not len(rows):
        return
    plots, sensor = batch.plots, batch.plots.sensor[rows]
    left = biases.sigmas(sensor, state.block.before(batch.raw.time_s[rows]))
    sensors = state.sensors
    state.heights.take(
        batch.slot[rows], plots.time_s[rows], sensors.sites[sensor],
        columns_of(plots.range_m[rows], plots.azimuth_deg[rows]),
        columns_of(
            np.hypot(sensors.range_sigma_m[sensor], left[:, 0]),
            np.hypot(sensors.azimuth_sigma_deg[sensor], left[:, 1]),
        ),
    )  # fmt: skip


def _blind(state: EngineState, batch: Batch) -> Bools:
    plots = batch.plots
    blind: Bools = state.sensors.is_radar[plots.sensor] & np.isfinite(plots.range_m)
    blind &= np.isnan(plots.altitude_m) & np.isnan(plots.height_m)
    return blind


def _reported(state: EngineState, batch: Batch, slot: Ints) -> tuple[Array, Array]:
    """Geometric height of each row's track from what others report, and its sigma, ``(n,)``; NaN where none. [m]"""
    altitude, height, _, sigma = state.live.vertical.at(slot, batch.plots.time_s)
    located, before = batch.located, state.block.before(batch.raw.time_s)
    offset, offset_sigma = state.offsets.applied(slot, located.lat_deg, located.lon_deg, before)
    own = np.isfinite(height)
    return np.where(own, height, altitude + offset), np.where(own, sigma, np.hypot(sigma, offset_sigma))


def _heights(state: EngineState, batch: Batch, slot: Ints) -> tuple[Array, Array]:
    """The same, or what the track's own plots speak for."""
    height, sigma = _reported(state, batch, slot)
    silent = np.flatnonzero(np.isnan(height))
    if len(silent):
        height[silent], sigma[silent] = state.heights.at(slot[silent], batch.plots.time_s[silent])
    return height, sigma
