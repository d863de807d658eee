"""Believing: what integrity must see of each batch, and what its verdicts mean for the tracks.

Own positions and radar plots of the same track are shown to integrity in the track's plane; its beliefs become the
flags ``adsb_unverified`` and ``adsb_suspect``. The own positions of a suspect track are kept out of its estimate while
radars see it, and out of registration.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.engine_state import EngineState
from aeroskein.intake import Batch
from aeroskein.integrity import Belief, Integrity, Looks, OwnPositions
from aeroskein.measurements import Measurements
from aeroskein.plots import Bools, Ints, columns_of, joined
from aeroskein.points import Flag

__all__ = ["Believing"]

# What a doubted position still says: which part of the sky. [m]
DOUBTED_SIGMA_M: Final = 5000.0
# A radar sees a track while its last plot is younger than this many of its periods. [periods]
LIVE_PERIODS: Final = 2.5
# Small batches are shown to integrity together, for it judges once a second only: after so long, or so many reports.
GATHER_S: Final = 0.2
GATHER: Final = 1000


class Believing:
    """Beliefs in the own positions of all tracks; nothing happens where there is no radar to check them."""

    def __init__(self, state: EngineState) -> None:
        self._state = state
        self._integrity = Integrity(state.settings, state.tracks.capacity)
        self._slots = state.tracks.capacity
        self._own_positions = ~state.sensors.is_radar
        self._own, self._looks = list[OwnPositions](), list[Looks]()
        self._gathered, self._shown_s = 0, -math.inf

    def clear(self, slots: Ints) -> None:
        """These slots belong to new tracks."""
        self._show()
        self._follow_capacity()
        self._integrity.reset(slots)

    def moved(self, slots: Ints) -> None:
        """These tracks have new planes."""
        self._show()  # in the planes of before, as are the places that it is compared with
        self._integrity.moved(slots)

    def lost(self, sensor: int) -> None:
        """Reports of this sensor were lost before they came here."""
        self._show()
        self._integrity.lost(sensor)

    def note(self, batch: Batch, reports: Measurements, unsure: Bools, now_s: float) -> None:
        """Show a batch of reports, with their tracks, in their planes; unsure ones may be another track's.

        Own positions of suspect tracks that a radar sees count for next to nothing from then on; changes the reports
        in place.
        """
        self._follow_capacity()
        sensor = reports.sensor.astype(np.int64)
        is_own = self._own_positions[sensor]
        own, seen = is_own.nonzero()[0], (~is_own).nonzero()[0]
        if len(seen):
            # A plot that may be a neighbour's says that the track was seen, not where.
            vague = np.where(unsure[seen], DOUBTED_SIGMA_M**2, 0.0)
            self._looks.append(
                Looks(
                    sensor[seen], reports.slot[seen], reports.time_s[seen],
                    columns_of(reports.east_m[seen], reports.north_m[seen]),
                    columns_of(reports.r_ee[seen] + vague, reports.r_en[seen], reports.r_nn[seen] + vague),
                    batch.plots.range_m[seen], batch.plots.azimuth_deg[seen], batch.located.height_m[seen],
                )
            )  # fmt: skip
        if len(own):
            self._note_own(reports, own, now_s)
        self._gathered += len(reports)
        if self._gathered >= GATHER or now_s - self._shown_s >= GATHER_S:
            self._shown_s = now_s
            self._show()

    def _note_own(self, reports: Measurements, own: Ints, now_s: float) -> None:
        """Own positions, rows ``(n,)`` of the reports: show them, then discount those of suspect tracks."""
        slot, tv = reports.slot[own], reports.time_variance[own]
        velocity = columns_of(reports.v_east_mps[own], reports.v_north_mps[own])
        silent = np.isnan(velocity[:, 0])
        if silent.any():
            _, _, v_east, v_north = self._state.live.bank.steady(slot[silent])
            velocity[silent] = columns_of(v_east, v_north)
        covariance = columns_of(
            reports.r_ee[own] + tv * velocity[:, 0] ** 2,
            reports.r_en[own] + tv * velocity[:, 0] * velocity[:, 1],
            reports.r_nn[own] + tv * velocity[:, 1] ** 2,
        )
        place = columns_of(reports.east_m[own], reports.north_m[own])
        self._own.append(OwnPositions(slot, reports.time_s[own], place, velocity, covariance))
        belief = self._integrity.belief(slot)
        self._state.tracks.flags[slot[belief == Belief.UNVERIFIED]] |= np.uint16(Flag.ADSB_UNVERIFIED)
        suspect = (belief == Belief.SUSPECT).nonzero()[0]
        if len(suspect):
            fresh_s = LIVE_PERIODS * self._state.sensors.period_s
            fresh = now_s - self._state.tracks.sensor_received_s[slot[suspect]] <= fresh_s
            doubted = own[suspect[(fresh & ~self._own_positions).any(axis=1)]]
            reports.r_ee[doubted] += DOUBTED_SIGMA_M**2
            reports.r_nn[doubted] += DOUBTED_SIGMA_M**2
            reports.velocity_variance[doubted] = np.nan

    def _show(self) -> None:
        """Show integrity what has been gathered."""
        if self._own:
            self._integrity.own(joined(self._own))
        if self._looks:
            self._integrity.looks(joined(self._looks))
        self._own, self._looks, self._gathered = [], [], 0

    def check(self, now_s: float) -> None:
        """Judge all tracks with own positions, about once a second, and set their flags."""
        self._show()
        state, tracks = self._state, self._state.tracks
        self._follow_capacity()
        active = tracks.active
        heard = np.isfinite(tracks.sensor_received_s[active][:, self._own_positions]).any(axis=1)
        heard &= (tracks.flags[active] & np.uint16(Flag.ON_GROUND)) == 0
        slots = active[heard & np.isfinite(state.live.bank.time_s[active])]
        if not len(slots):
            return
        frames = state.frames.rows[tracks.frame[slots]]
        east, north, _, _ = state.live.bank.steady(slots)
        lat, lon = geodesy.from_plane(frames, east, north)
        altitude, height, _ = state.live.vertical.at(slots, np.full(len(slots), now_s))
        self._integrity.check(now_s, slots, lat, lon, np.where(np.isnan(height), altitude, height))
        belief = self._integrity.belief(slots)
        flags = tracks.flags[slots] & ~np.uint16(Flag.ADSB_UNVERIFIED | Flag.ADSB_SUSPECT)
        flags[belief == Belief.UNVERIFIED] |= np.uint16(Flag.ADSB_UNVERIFIED)
        flags[belief == Belief.SUSPECT] |= np.uint16(Flag.ADSB_SUSPECT)
        tracks.flags[slots] = flags

    def trusted(self, slots: Ints) -> Bools:
        """Tracks whose own positions may be used, ``(n,)``."""
        self._follow_capacity()
        return self._integrity.trusted(slots)

    def alarms(self) -> list[str]:
        """What an operator should know, one sentence each."""
        return self._integrity.alarms()

    def _follow_capacity(self) -> None:
        if self._slots < self._state.tracks.capacity:
            self._slots = self._state.tracks.capacity
            self._integrity.grow(self._slots)
