"""Blind plots: radar plots that say nothing of their height take that of the track they are compared with.

Where such a plot lies depends on the height by kilometres near the radar. Compared with a track, it lies where it would
if it were that track's: at the altitude that others report of it, or at the height that its own plots speak for.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import conversion, geodesy, kalman
from aeroskein.applied_biases import AppliedBiases
from aeroskein.association import Candidates
from aeroskein.conversion import Located
from aeroskein.ellipsoid import EARTH_M, from_ecef
from aeroskein.engine_state import EngineState
from aeroskein.height_finding import HEIGHT_SIGMA_M
from aeroskein.intake import Batch
from aeroskein.plots import Array, Bools, Ints, Plots, columns_of
from aeroskein.radar_geometry import turned_covariance
from aeroskein.silence import CONE_DEG

__all__ = ["learn_heights", "located_as", "sharpen", "steer"]

# One sigma per axis of the acceleration of a flight that may be turning, and of a straight one. [m/s²]
TURNING_SIGMA: Final = 3.0
STRAIGHT_SIGMA: Final = 0.1
# A flight that fell silent on the way up comes back no higher above the radar than where it was last seen, give or take
# this; and a radar is not blind below the first. What it says from higher up meanwhile is not that flight. [deg]
CONE_SLACK_DEG: Final = 5.0
SILENT_PERIODS: Final = 1.5
NOWHERE_M: Final = 1e7


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


def sharpen(
    state: EngineState, batch: Batch, slot: Ints, located: Located, pairs: Candidates, seen_by_others: Bools
) -> None:
    """Compare plots with tracks whose height is not known as if it were, with what both hang on it in common.

    A wrong height moves the track and the plot alike, and so does the bias of the one radar that sees the flight:
    taken for errors of their own, they would open the gate by kilometres.

    Parameters
    ----------
    slot : (p,) int64
        Slot of the track of each pair.
    located : Located
        Where the plots of the pairs are, as its track's.
    seen_by_others : (p,) bool
        Tracks that another sensor reports too: nothing of these hangs on one height or bias.
    """
    own = np.flatnonzero(state.heights.follows(slot))
    own = own[_blind(state, batch)[pairs.plot[own]] & ~seen_by_others[own]]
    if not len(own):
        return
    slot, plots = slot[own], batch.plots.take(pairs.plot[own])
    time_s, squared_sigma_m, first, frame, x = state.heights.leaning(slot)
    use = (time_s == state.live.bank.time_s[slot]) & (first == plots.sensor)
    if not use.any():
        return
    own, slot, plots, frame, x = own[use], slot[use], plots.take(use), frame[use], x[use]
    place = located.take(own)
    new = state.frames.rows[state.tracks.frame[slot]]
    # What the track leans by at the time of the plot, in its plane.
    after_s = plots.time_s - time_s[use]
    after = x[:, :2] + after_s[:, None] * x[:, 2:]
    east, north = geodesy.to_plane(new, place.lat_deg, place.lon_deg)
    turn = geodesy.move_frame(new, frame, east, north)[2]
    track = np.linalg.solve(turn, after[:, :, None])[:, :, 0]
    lat, lon, site_m = from_ecef(state.sensors.sites[plots.sensor, 0:3])
    site = columns_of(*geodesy.to_plane(new, lat, lon))
    line = columns_of(east, north) - site
    rise_m = place.height_m - site_m
    noise, slope = _seen_from(state, plots, line, rise_m)
    by_plot = -(slope * squared_sigma_m[use] / np.maximum(np.hypot(line[:, 0], line[:, 1]), 1.0))[:, None] * line
    cross = by_plot[:, :, None] * track[:, None, :]
    axes = geodesy.local_axes(new, place.lat_deg, place.lon_deg, place.height_m)
    before = geodesy.rotate_covariance(axes, place.covariance)
    both = noise + columns_of(by_plot[:, 0] ** 2, by_plot[:, 0] * by_plot[:, 1], by_plot[:, 1] ** 2)
    both -= columns_of(2.0 * cross[:, 0, 0], cross[:, 0, 1] + cross[:, 1, 0], 2.0 * cross[:, 1, 1])
    pairs.step_cov_m2[own] += both - before
    last = columns_of(*state.live.bank.steady(slot)[:2]) - site
    steepest_deg = np.maximum(_elevation_deg(last, rise_m), CONE_DEG) + CONE_SLACK_DEG
    silent = after_s > SILENT_PERIODS * state.sensors.period_s[plots.sensor]
    pairs.step_m[own[silent & (_elevation_deg(line, rise_m) > steepest_deg)]] = NOWHERE_M


def _elevation_deg(from_site: Array, rise_m: Array) -> Array:
    """Elevation ``(n,)`` of what lies so far from a radar ``(n, 2)``, and so much higher."""
    ground_m = np.hypot(from_site[:, 0], from_site[:, 1])
    return np.asarray(np.degrees(np.arctan2(rise_m - 0.5 * ground_m**2 / EARTH_M, ground_m)))


def _seen_from(state: EngineState, plots: Plots, line: Array, rise_m: Array) -> tuple[Array, Array]:
    """Noise ``(n, 3)`` of plots whose height is known, and how many metres they are nearer a metre higher ``(n,)``.

    ``line`` ``(n, 2)`` is where they lie from their radars, ``rise_m`` ``(n,)`` how much higher. [m]
    """
    sensor = plots.sensor
    sin_el = rise_m / plots.range_m - 0.5 * plots.range_m / EARTH_M
    range_sigma_m = state.sensors.range_sigma_m[sensor]
    # As in ``radar_covariance``: no steeper than the ground range that can be told from none.
    lowest = np.minimum(np.sqrt(2.0 * np.hypot(range_sigma_m, HEIGHT_SIGMA_M) / plots.range_m), 1.0)
    cos_el = np.maximum(np.sqrt(np.maximum(1.0 - sin_el**2, 0.0)), lowest)
    slope = np.sign(sin_el) * np.sqrt(1.0 - cos_el**2) / cos_el
    radial = (range_sigma_m / cos_el) ** 2 + (slope * HEIGHT_SIGMA_M) ** 2
    across = (np.radians(state.sensors.azimuth_sigma_deg[sensor]) * plots.range_m * cos_el) ** 2
    e, n = line.T / np.maximum(np.hypot(line[:, 0], line[:, 1]), 1.0)
    return columns_of(*turned_covariance(radial, across, e, n)), slope


def learn_heights(state: EngineState, biases: AppliedBiases, batch: Batch, made: Ints, velocity: Array) -> None:
    """Show the plots of tracks whose height nobody reports to the filters that find it; slots are filled in.

    Parameters
    ----------
    made : (k,) int64
        Tracks that begin with a plot in this batch.
    velocity : (k, 3) array
        Their velocities, and one sigma of them. [m/s]
    """
    rows = np.flatnonzero(_blind(state, batch) & (batch.slot >= 0))
    rows = rows[np.isnan(_reported(state, batch.take(rows), batch.slot[rows])[0])]
    if not len(rows):
        return
    plots, sensor = batch.plots, batch.plots.sensor[rows]
    left = biases.sigmas(sensor, state.block.before(batch.raw.time_s[rows]))
    sensors = state.sensors
    state.heights.take(
        batch.slot[rows], plots.time_s[rows], sensor.astype(np.int64), sensors.sites[sensor],
        columns_of(plots.range_m[rows], plots.azimuth_deg[rows]),
        columns_of(sensors.range_sigma_m[sensor], sensors.azimuth_sigma_deg[sensor]),
        left[:, :2],
        np.concatenate([velocity, np.full((1, 3), np.nan)])[_place_among(batch.slot[rows], made)],
    )  # fmt: skip


def steer(state: EngineState, slots: Ints) -> None:
    """Put tracks whose height nobody reports where they are over all heights that are likely.

    The live filter was told of each plot at the height that was thought right at the time. When that changes, all of
    them have been wrong together, of which its covariance says nothing.
    """
    slots, bank = slots[state.heights.follows(slots)], state.live.bank
    if not len(slots):
        return
    slots = np.unique(slots)
    time_s, frame, x, P = state.heights.motion(slots)
    own = np.flatnonzero((time_s == bank.time_s[slots]) & ~np.isfinite(state.live.vertical.at(slots, time_s)[0]))
    if not len(own):
        return
    slots, frame, x, P = slots[own], frame[own], x[own], P[own]
    new = state.frames.rows[state.tracks.frame[slots]]
    state_x, full = np.zeros((6, len(slots))), np.zeros((len(slots), 6, 6))
    state_x[0], state_x[1], turn = geodesy.move_frame(frame, new, x[:, 0], x[:, 1])
    state_x[2:4] = geodesy.rotate_vector(turn, x[:, 2], x[:, 3])
    T = np.zeros((len(slots), 4, 4))
    T[:, :2, :2] = T[:, 2:, 2:] = turn
    moved = T @ P @ T.swapaxes(1, 2)
    full[:, :4, :4] = 0.5 * (moved + moved.swapaxes(1, 2))
    full[:, [4, 5], [4, 5]] = (STRAIGHT_SIGMA**2 + x[:, 4] * TURNING_SIGMA**2)[:, None]
    bank.start(slots, state_x, kalman.from_matrix(full), time_s[own])


def _place_among(slots: Ints, some: Ints) -> Ints:
    """Where each slot stands among some, ``(n,)``; -1 where it does not."""
    where = np.full(max(slots.max(initial=-1), some.max(initial=-1)) + 1, -1)
    where[some] = np.arange(len(some))
    return where[slots]


def _blind(state: EngineState, batch: Batch) -> Bools:
    plots = batch.plots
    blind: Bools = state.sensors.is_radar[plots.sensor] & np.isfinite(plots.range_m)
    blind &= np.isnan(plots.altitude_m) & np.isnan(plots.height_m)
    return blind


def _reported(state: EngineState, batch: Batch, slot: Ints) -> tuple[Array, Array]:
    """Geometric height of each row's track from what others report, and its sigma, ``(n,)``; NaN where none. [m]"""
    altitude, height, _ = state.live.vertical.at(slot, batch.plots.time_s)
    sigma = state.live.vertical.sigma_at(slot, batch.plots.time_s)
    located, before = batch.located, state.block.before(batch.raw.time_s)
    offset, offset_sigma = state.offsets.applied(
        slot, before, lambda rows: (located.lat_deg[rows], located.lon_deg[rows])
    )
    own = np.isfinite(height)
    return np.where(own, height, altitude + offset), np.where(own, sigma, np.hypot(sigma, offset_sigma))


def _heights(state: EngineState, batch: Batch, slot: Ints) -> tuple[Array, Array]:
    """The same, or what the track's own plots speak for."""
    height, sigma = _reported(state, batch, slot)
    silent = np.flatnonzero(np.isnan(height))
    if len(silent):
        height[silent], sigma[silent] = state.heights.at(slot[silent], batch.plots.time_s[silent])
    return height, sigma
