"""Cones of silence: straight above itself a radar is blind, so that silence there says nothing.

A track that only such a radar sees would end over it and begin anew under another number on the other side. While it
should be in the cone of the radar that saw it last, its silence does not count.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.conversion import UNKNOWN_HEIGHT_M
from aeroskein.engine_state import EngineState
from aeroskein.plots import Bools, Ints
from aeroskein.points import Status
from aeroskein.radar_geometry import geodetic_to_radar

__all__ = ["excuse"]

# Antennas look up to 45 degrees or a little more; the margin is for where the track may be by now. [deg]
CONE_DEG: Final = 40.0
# An airliner at 12 km is through in this time; who stays longer has landed there, or turned. [s]
LONGEST_S: Final = 120.0


def excuse(state: EngineState, now_s: float) -> None:
    """Note of all silent tracks which of them nobody could see now; to be called about once a second."""
    tracks = state.tracks
    silent = np.flatnonzero(tracks.used & (tracks.status == Status.COASTING))
    silent = silent[now_s - tracks.received_s[silent] < LONGEST_S]
    if len(silent):
        tracks.excused_s[silent[_overhead(state, silent, now_s)]] = now_s


def _overhead(state: EngineState, slots: Ints, now_s: float) -> Bools:
    """Whether each track, where it should be by now, is in the cone of the radar that saw it last, ``(n,)``."""
    east, north, v_east, v_north = state.live.bank.steady(slots)
    age_s = np.maximum(now_s - state.live.bank.time_s[slots], 0.0)
    frames = state.frames.rows[state.tracks.frame[slots]]
    lat, lon = geodesy.from_plane(frames, east + v_east * age_s, north + v_north * age_s)
    time_s = np.full(len(slots), now_s)
    found, sigma = state.heights.at(slots, time_s)
    altitude, height, _ = state.live.vertical.at(slots, time_s)
    for better in (altitude, found + sigma, np.full(len(slots), UNKNOWN_HEIGHT_M)):
        height = np.where(np.isnan(height), better, height)
    last = state.tracks.sensor_received_s[slots].argmax(axis=1)
    _, _, elevation_deg = geodetic_to_radar(state.sensors.sites[last], lat, lon, height)
    overhead: Bools = state.sensors.is_radar[last] & (elevation_deg > CONE_DEG)
    return overhead
