"""Candidates: reports beside the tracks near them, in the shape in which association scores them.

The coarse gate is a distance on the globe; what passes it is predicted to the report's time and compared in the track's
own plane, in every factor that both have.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy, kalman
from aeroskein.association import Candidates, PointGrid, mode_a_cost, velocity_factors
from aeroskein.conversion import Located
from aeroskein.engine_state import EngineState
from aeroskein.intake import Batch
from aeroskein.plots import Array, Ints

__all__ = ["TrackGrid", "candidates"]

# Tracks move 250 m in this time; the coarse gate has room for that. [s]
GRID_PERIOD_S: Final = 1.0
# How much of a report's own uncertainty the coarse gate has room for: that of a primary plot near its radar, whose
# height nobody knows, is kilometres. [sigmas]
BLUR_SIGMAS: Final = 3.0
# Acceleration that a track may begin between its last report and this one, if it turns. [m²/s⁵]
JERK_DENSITY: Final = 1.0
# After this a manoeuvre is over: a track that has not been seen for longer flies straight on, at any of the velocities
# that it may have come to. [s]
MANOEUVRE_S: Final = 15.0
# One sigma per axis of a velocity that a radar's own tracker reports: it lags in turns. [m/s]
RADAR_VELOCITY_SIGMA_MPS: Final = 8.0
# A track's Mode A code is evidence once it was heard so often in a row, or came with an address.
MODE_A_HEARD: Final = 3
# Altitudes of one aircraft by two sources may differ by this beyond their noise. [m]
ALTITUDE_SLACK_M: Final = 30.0


class TrackGrid:
    """Where the tracks are, good for a second.

    Parameters
    ----------
    reach_m : float
        Largest distance of a track from a report, beyond three sigmas of the report's own; these count up to the same
        again. [m]
    """

    def __init__(self, reach_m: float) -> None:
        self._reach_m = reach_m
        self._made_s = -np.inf
        self._tracks = -1

    def near(self, state: EngineState, located: Located, now_s: float) -> tuple[Ints, Ints]:
        """Pairs ``(p,)`` of a report ``(n,)`` and the slot of a track within reach, ordered by report."""
        if now_s - self._made_s >= GRID_PERIOD_S or state.tracks.next_number != self._tracks:
            active = state.tracks.active
            self._slots = active[np.isfinite(state.live.bank.time_s[active])]
            frames = state.frames.rows[state.tracks.frame[self._slots]]
            east, north, v_east, v_north = state.live.bank.steady(self._slots)
            age_s = np.maximum(now_s - state.live.bank.time_s[self._slots], 0.0)
            places = geodesy.to_ecef(*geodesy.from_plane(frames, east + v_east * age_s, north + v_north * age_s))
            self._grid = PointGrid(places, 2.0 * self._reach_m)
            self._made_s, self._tracks = now_s, state.tracks.next_number
        own_m = BLUR_SIGMAS * np.sqrt(located.covariance[:, 0] + located.covariance[:, 2])
        places = geodesy.to_ecef(located.lat_deg, located.lon_deg)
        query, point = self._grid.near(places, self._reach_m + np.minimum(own_m, self._reach_m))
        slot = self._slots[point]
        alive = np.isfinite(state.live.bank.time_s[slot]) & state.tracks.used[slot]
        return query[alive], slot[alive]


def candidates(state: EngineState, batch: Batch, plot: Ints, slot: Ints, located: Located) -> Candidates:
    """Compare reports with tracks.

    Parameters
    ----------
    state : EngineState
        Tracks.
    batch : Batch
        Reports.
    plot, slot : (p,) int64
        Pairs: row of the report, slot of the track.
    located : Located
        Where the reports of the pairs are, ``(p,)``.
    """
    tracks, plots = state.tracks, batch.plots
    frames = state.frames.rows[tracks.frame[slot]]
    lat, lon = located.lat_deg, located.lon_deg
    east, north = geodesy.to_plane(frames, lat, lon)
    axes = geodesy.local_axes(frames, lat, lon, located.height_m)
    noise = geodesy.rotate_covariance(axes, located.covariance)
    x, P = _predicted(state, slot, plots.time_s[plot])
    back = geodesy.invert_axes(axes)
    v = np.stack(geodesy.rotate_vector(back, x[2], x[3]), axis=1)
    radar = state.sensors.is_radar[plots.sensor[plot]]
    vertical, time_s = state.live.vertical, plots.time_s[plot]
    altitude, altitude_sigma = vertical.at(slot, time_s)[0], vertical.sigma_at(slot, time_s)
    step = plots.altitude_m[plot] - altitude
    sigma = np.hypot(altitude_sigma, np.hypot(state.sensors.altitude_sigma_m[plots.sensor[plot]], ALTITUDE_SLACK_M))
    time_variance = state.sensors.time_sigma_s[plots.sensor[plot]] ** 2
    covariance = noise + P[[0, 1, 7]].T + (time_variance * np.stack([x[2] ** 2, x[2] * x[3], x[3] ** 2])).T
    code = np.where(tracks.mode_a_heard >= MODE_A_HEARD, tracks.mode_a, -1)
    return Candidates.of(
        plot, tracks.number[slot],
        np.stack([east - x[0], north - x[1]], axis=1), covariance,
        **velocity_factors(
            plots.ground_speed_mps[plot], plots.track_angle_deg[plot],
            np.where(radar, RADAR_VELOCITY_SIGMA_MPS, state.sensors.velocity_sigma_mps[plots.sensor[plot]]),
            v, geodesy.rotate_covariance(back, P[[12, 13, 17]].T),
        ),
        altitude_step_m=step,
        altitude_sigma_m=np.where(np.isfinite(step), sigma, np.nan),
        mode_a_cost=mode_a_cost(plots.mode_a[plot], code[slot], code[tracks.active]),
    )  # fmt: skip


def _predicted(state: EngineState, slot: Ints, time_s: Array) -> tuple[Array, Array]:
    """States ``(6, p)`` and covariances ``(24, p)`` of tracks at the times of reports, which may lie a little back."""
    own, index = np.unique(slot, return_inverse=True)
    bank = state.live.bank
    x, P = state.live.state_at(own, bank.time_s[own])
    x, P = x[:, index], np.ascontiguousarray(P[:, index])
    h = time_s - bank.time_s[slot]
    back = np.minimum(h, 0.0)
    step = np.minimum(np.abs(h), MANOEUVRE_S)
    kalman.predict(x, P, step, JERK_DENSITY * state.heights.may_turn(slot, step))
    long = np.flatnonzero(np.abs(h) > MANOEUVRE_S)
    if len(long):
        x[:, long], P[:, long] = _straight_on(x[:, long], P[:, long], np.abs(h[long]) - MANOEUVRE_S)
    # For a report from before, the state goes back by twice what the prediction took it forward.
    x[0:2] += 2.0 * back * (x[2:4] - np.abs(back) * x[4:6])
    return x, P


def _straight_on(x: Array, P: Array, h: Array) -> tuple[Array, Array]:
    """States and covariances after ``h`` ``(n,)`` of flight without any acceleration. [s]"""
    x[4:6] = 0.0
    _, _, p13, _, p23, p33 = kalman.blocks(P)
    for block in (p13, p23, p33):
        block[...] = 0.0
    kalman.predict(x, P, h, np.zeros(len(h)))
    return x, P
