"""Integrity: own positions (ADS-B) are believed only as far as radars confirm them.

Per track: unverified, verified, suspect. Two agreeing looks verify. A track becomes suspect when its positions disagree
with radar plots beyond chance and honest differences (``agreement.py``), or when radars that cover it (``cover.py``)
turn past it again and again without a plot. Hysteresis: five agreeing looks and some time bring a suspect track back.
Where many tracks disagree with one radar and with no other, the radar is in doubt, not the aircraft; where they
disagree with every radar, satellite navigation is disturbed in the region: both are alarms.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np

from aeroskein.ellipsoid import EARTH_M
from aeroskein.geodesy import frame_rows, to_ecef
from aeroskein.integrity.agreement import LEAST_SIGMAS, Agreement
from aeroskein.integrity.cover import CoverMap, polar_of
from aeroskein.integrity.own_positions import OWN_AGE_S, NewestOwn, OwnPositions
from aeroskein.lanes import newest_of_each
from aeroskein.plots import Array, Bools, Ints, columns_of
from aeroskein.settings import EngineSettings

__all__ = ["Belief", "Integrity", "Looks", "OwnPositions"]

# Sigmas of a mean difference, beyond what is honest, that make a track suspect: 2e-8 by chance.
SUSPECT_SIGMAS: Final = 5.5
# ... that count as disagreeing when it is asked how many tracks do, and that a track must be below to come back.
DISAGREE_SIGMAS: Final = LEAST_SIGMAS
# Minus log of the chance that an aircraft is there and was missed so often: before it has ever been seen by radar
# (one such question per flight; three turns of a radar that finds 95 %), and after (one per turn of every radar).
MISSED_NEW: Final = 8.9
MISSED_KNOWN: Final = 16.5
# Looks that verify, looks that bring back, and the time that takes at least. [s]
LOOKS_TO_VERIFY: Final = 2
LOOKS_TO_RETURN: Final = 5
RETURN_S: Final = 20.0
# A track verified long ago, and no longer seen by radar, is unverified again. [s]
VERIFIED_S: Final = 120.0
# Acceleration neglected when own positions are moved to a plot's time. [m/s²]
ACCELERATION_SIGMA: Final = 2.0
# A radar without any plot for so many periods was off: nothing that it did not see then was missed.
OFF_PERIODS: Final = 1.5
# A turn is over when the radar's newest plot is this share of a period past the expected look.
TURN_MARGIN: Final = 0.15
# How far back, in turns, an aircraft counts as having been in cover that is proven only now, and how many missed turns
# that is evidence for at most.
LOOK_BACK_PERIODS: Final = 8.0
LOOK_BACK_MISSES: Final = 3.0
# A radar is in doubt when this share of at least so many tracks disagree with it.
DOUBT_SHARE: Final = 0.3
DOUBT_TRACKS: Final = 4


class Belief(IntEnum):
    """What a track's own positions are worth."""

    UNVERIFIED = 0
    VERIFIED = 1
    SUSPECT = 2


@dataclass(slots=True, eq=False)
class Looks:
    """Radar plots of tracks, corrected for registration, ``(n,)`` columns.

    Attributes
    ----------
    sensor, slot : int64
        Radar and track slot.
    time_s : float64
        [s since the epoch]
    place_m : (n, 2) float64
        East and north in the track's plane. [m]
    covariance_m2 : (n, 3) float64
        ``[ee, en, nn]`` with the covariance of the biases. [m²]
    range_m, azimuth_deg, height_m : float64
        As seen from the radar, for its cover; NaN where the height is unknown. [m, deg, m]
    """

    sensor: Ints
    slot: Ints
    time_s: Array
    place_m: Array
    covariance_m2: Array
    range_m: Array
    azimuth_deg: Array
    height_m: Array


class Integrity:
    """Beliefs of all tracks.

    Parameters
    ----------
    settings : EngineSettings
        Sensors.
    slots : int
        Track slots.
    """

    def __init__(self, settings: EngineSettings, slots: int) -> None:
        sensors = settings.sensors
        self._ids = [s.id for s in sensors]
        self._period_s = np.array([s.period_s for s in sensors])
        self._sites: dict[int, Array] = {}
        self._site_height_m: dict[int, float] = {}
        self._covers: dict[int, CoverMap] = {}
        for k, s in enumerate(sensors):
            if s.is_radar:
                lat, lon = np.array([s.lat_deg], dtype=np.float64), np.array([s.lon_deg], dtype=np.float64)
                self._sites[k] = frame_rows(lat, lon, s.height_m or 0.0)[0]
                self._site_height_m[k] = s.height_m or 0.0
                self._covers[k] = CoverMap(s.range_max_m)
        self._agreement = Agreement(self._period_s, slots)
        self._newest_s = np.full(len(sensors), -np.inf)
        self._in_doubt = np.zeros(len(sensors), dtype=np.bool_)
        self._region = 0
        self._belief = np.zeros(slots, dtype=np.uint8)
        self._good = np.zeros(slots, dtype=np.int64)
        self._missed = np.zeros(slots)
        self._looked_s = np.full(slots, -np.inf)
        self._suspected_s = np.full(slots, -np.inf)
        self._own = NewestOwn(slots)
        self._due_s = np.full((len(sensors), slots), np.nan)
        # Since when each radar has been turning, and where each track was, as each radar sees it, while it was not yet
        # in its cover: time, range, azimuth, elevation.
        self._on_s = np.full(len(sensors), np.inf)
        self._before = np.full((len(sensors), slots, 4), np.nan)
        self._hits = np.zeros((len(sensors), slots), dtype=np.int64)

    def grow(self, slots: int) -> None:
        """Make room for more slots."""
        more = slots - len(self._belief)
        self._agreement.grow(slots)
        self._own.grow(slots)
        for name in ("_belief", "_good", "_missed", "_hits"):
            column = getattr(self, name)
            shape = (column.shape[0], more) if name == "_hits" else (more, *column.shape[1:])
            setattr(self, name, np.concatenate([column, np.zeros(shape, column.dtype)], axis=int(name == "_hits")))
        for name in ("_looked_s", "_suspected_s"):
            setattr(self, name, np.concatenate([getattr(self, name), np.full(more, -np.inf)]))
        for name in ("_due_s", "_before"):
            column = getattr(self, name)
            shape = (column.shape[0], more, *column.shape[2:])
            setattr(self, name, np.concatenate([column, np.full(shape, np.nan)], axis=1))

    def reset(self, slot: Ints) -> None:
        """These slots belong to new tracks."""
        self._agreement.reset(slot)
        self._belief[slot] = self._good[slot] = 0
        self._missed[slot] = 0.0
        self._looked_s[slot] = self._suspected_s[slot] = -np.inf
        self._own.forget(slot)
        self._due_s[:, slot] = np.nan
        self._before[:, slot] = np.nan
        self._hits[:, slot] = 0

    def moved(self, slot: Ints) -> None:
        """The planes of these tracks have moved: stored places no longer hold."""
        self._own.forget(slot)

    def lost(self, sensor: int) -> None:
        """Plots of this sensor were lost on their way here: what it has not shown until now was not missed."""
        self._count_from(sensor, float(self._newest_s[sensor]))

    # -- what is believed ----------------------------------------------------------------------------------------
    def belief(self, slot: Ints) -> Ints:
        """``Belief`` of each track, ``(n,)``."""
        return self._belief[slot].astype(np.int64)

    def trusted(self, slot: Ints) -> Bools:
        """Whose own positions may anchor registration, ``(n,)``: all but suspect ones."""
        return np.asarray(self._belief[slot] != Belief.SUSPECT)

    def missed(self, slot: Ints) -> Array:
        """Minus log of the chance that each track is there and has been missed as it was, ``(n,)``."""
        return self._missed[slot]

    def alarms(self) -> list[str]:
        """What an operator should know, one sentence each."""
        out = [f"most aircraft disagree with {self._ids[k]}: its registration or its north is in doubt"
               for k in np.flatnonzero(self._in_doubt)]  # fmt: skip
        if self._region:
            out.append(f"own positions of {self._region} aircraft disagree with all radars: satellite navigation")
        suspects = int((self._belief == Belief.SUSPECT).sum())
        if suspects:
            out.append(f"own positions of {suspects} aircraft are suspect")
        return out

    # -- input ---------------------------------------------------------------------------------------------------
    def own(self, reports: OwnPositions) -> None:
        """Take ADS-B reports in; of several of one track the newest counts, unless it stands alone."""
        self._own.take(reports)

    def looks(self, plots: Looks) -> None:
        """Take radar plots in, of all tracks, after the ADS-B reports that came with them."""
        for k in np.unique(plots.sensor):
            rows = np.flatnonzero(plots.sensor == k)
            if plots.time_s[rows].min() > self._newest_s[k] + OFF_PERIODS * self._period_s[k]:
                self._count_from(int(k), float(plots.time_s[rows].min()))
            self._newest_s[k] = max(self._newest_s[k], float(plots.time_s[rows].max()))
            if k in self._covers:
                self._learn_cover(int(k), plots, rows)
        # Of several plots of one radar on one track the newest counts.
        rows = np.sort(newest_of_each(plots.sensor * len(self._belief) + plots.slot, plots.time_s))
        sensor, slot, time_s = plots.sensor[rows], plots.slot[rows], plots.time_s[rows]
        self._due_s[sensor, slot] = time_s + self._period_s[sensor]
        self._before[sensor, slot] = np.nan
        self._hits[sensor, slot] += 1
        step_s = time_s - self._own.time_s[slot]
        near = np.abs(step_s) < OWN_AGE_S
        rows, sensor, slot, time_s, step_s = rows[near], sensor[near], slot[near], time_s[near], step_s[near]
        own = self._own.rows[slot]
        difference = plots.place_m[rows] - own[:, 0:2] - own[:, 2:4] * step_s[:, None]
        covariance = plots.covariance_m2[rows] + own[:, 4:7]
        flown_m2 = (0.5 * ACCELERATION_SIGMA * step_s**2) ** 2
        covariance[:, 0] += flown_m2
        covariance[:, 2] += flown_m2
        # A radar in doubt neither confirms nor contradicts.
        sure = ~self._in_doubt[sensor]
        agrees = self._agreement.add(sensor, slot, time_s, difference, covariance, own[:, 2:4], sure)
        np.maximum.at(self._looked_s, slot[agrees & sure], time_s[agrees & sure])
        self._missed[slot[agrees]] = 0.0
        self._good[slot[~agrees & sure]] = 0
        np.add.at(self._good, slot[agrees & sure], 1)

    def check(self, now_s: float, slot: Ints, lat_deg: Array, lon_deg: Array, height_m: Array) -> Ints:
        """Judge tracks that have own positions, about once a second.

        Parameters
        ----------
        now_s : float
            [s since the epoch]
        slot : (n,) int64
            Tracks with ADS-B, each once, none of them on the ground.
        lat_deg, lon_deg, height_m : (n,) array
            Where they say they are; NaN in the height counts as 0. [deg, m]

        Returns
        -------
        int64 array
            Slots whose belief has changed.
        """
        current = now_s - self._own.time_s[slot] < OWN_AGE_S + 2.0
        ecef_m = to_ecef(lat_deg, lon_deg, np.nan_to_num(height_m))
        for k, site in self._sites.items():
            self._count_misses(k, slot, current, *polar_of(site, ecef_m), now_s)
        before = self._belief[slot].copy()
        believed = ~self._in_doubt
        combined, by_sensor = self._agreement.strength(slot, now_s, believed)
        against_all = self._find_doubt(slot, by_sensor)
        if (self._in_doubt == believed).any():  # another radar is in doubt now, or one no longer
            combined, _ = self._agreement.strength(slot, now_s, ~self._in_doubt)
        wrong = (combined > SUSPECT_SIGMAS) | against_all
        missed = (self._missed[slot] > MISSED_NEW).nonzero()[0]
        if len(missed):
            limit = np.where(self._hits[:, slot[missed]].sum(axis=0) > 0, MISSED_KNOWN, MISSED_NEW)
            wrong[missed] |= self._missed[slot[missed]] > limit
        self._suspected_s[slot[wrong]] = now_s
        self._good[slot[wrong]] = 0
        self._belief[slot[wrong]] = Belief.SUSPECT
        self._restore(slot, wrong, combined, now_s)
        changed: Ints = slot[self._belief[slot] != before]
        return changed

    # -- inside --------------------------------------------------------------------------------------------------
    def _restore(self, slot: Ints, wrong: Bools, combined: Array, now_s: float) -> None:
        belief = self._belief[slot]
        calm = ~wrong & (combined < DISAGREE_SIGMAS)
        rows = (calm & (belief != Belief.VERIFIED)).nonzero()[0]
        some, suspect = slot[rows], belief[rows] == Belief.SUSPECT
        good = self._good[some] >= np.where(suspect, LOOKS_TO_RETURN, LOOKS_TO_VERIFY)
        belief[rows[good & (~suspect | (now_s - self._suspected_s[some] >= RETURN_S))]] = Belief.VERIFIED
        old = ((belief == Belief.VERIFIED) & (now_s - self._looked_s[slot] > VERIFIED_S)).nonzero()[0]
        belief[old] = Belief.UNVERIFIED
        self._belief[slot] = belief
        self._good[slot[old]] = 0

    def _find_doubt(self, slot: Ints, by_sensor: Array) -> Bools:
        """Find radars with which many tracks disagree; gives the tracks that disagree with several radars, ``(n,)``."""
        known = (self._hits[:, slot] >= 3) & np.isfinite(self._due_s[:, slot])
        against = known & (by_sensor > DISAGREE_SIGMAS)
        # Two radars at once do not err on one aircraft: it is the aircraft.
        several: Bools = against.sum(axis=0) >= 2
        count = known.sum(axis=1)
        many = (against & ~several).sum(axis=1) / np.maximum(count, 1) >= np.where(
            self._in_doubt, 0.3 * DOUBT_SHARE, DOUBT_SHARE
        )
        in_doubt = many & (count >= DOUBT_TRACKS)
        if (in_doubt & ~self._in_doubt).any():
            self._agreement.forget_slow()
        self._in_doubt = in_doubt
        rows = several.nonzero()[0]
        self._region = len(rows) if len(rows) >= DOUBT_TRACKS else 0
        if len(rows):
            several[rows] = np.sort(by_sensor[:, rows], axis=0)[-2] > DISAGREE_SIGMAS + 1.0
        return several

    def _count_from(self, k: int, since_s: float) -> None:
        """Nothing that a sensor did not show before this was missed. [s since the epoch]"""
        self._due_s[k] = np.nan
        self._before[k] = np.nan
        self._on_s[k] = since_s

    def _learn_cover(self, k: int, plots: Looks, rows: Ints) -> None:
        range_m = plots.range_m[rows]
        up_m = plots.height_m[rows] - self._site_height_m[k]
        # Geometric elevation at the antenna: the earth falls away by r² / 2R.
        sine = up_m / np.maximum(range_m, 1.0) - range_m / (2.0 * EARTH_M)
        elevation = np.degrees(np.arcsin(np.minimum(np.maximum(sine, -1.0), 1.0)))
        azimuth = plots.azimuth_deg[rows]
        tracked = self._hits[k, plots.slot[rows]] >= 3
        self._covers[k].seen(range_m, azimuth, elevation, float(plots.time_s[rows].max()), tracked)

    def _count_misses(
        self, k: int, slot: Ints, current: Bools, range_m: Array, azimuth_deg: Array, elevation_deg: Array, now_s: float
    ) -> None:
        detection = self._covers[k].detection(range_m, azimuth_deg, elevation_deg, now_s)
        expected = current & (detection > 0.0) & np.isfinite(self._newest_s[k])
        due = self._due_s[k, slot]
        period_s = self._period_s[k]
        # Within one period of entering cover the radar must have turned past.
        entering = (expected & np.isnan(due)).nonzero()[0]
        due[entering] = self._in_cover_since(k, slot[entering], now_s) + period_s
        due[~expected] = np.nan
        self._remember_before(k, slot, current & ~expected, expected, range_m, azimuth_deg, elevation_deg, now_s)
        turns = np.floor((self._newest_s[k] - due) / period_s - TURN_MARGIN) + 1.0
        # One turn at a time, but for those that look back.
        most = np.ones(len(slot))
        most[entering] = LOOK_BACK_MISSES
        missed = (expected & (turns > 0.0)).nonzero()[0]
        late, turns = slot[missed], np.minimum(turns[missed], most[missed])
        due[missed] += turns * period_s
        self._due_s[k, slot] = due
        self._missed[late] -= turns * np.log(1.0 - detection[missed])
        # Only aircraft that another look confirms teach the map where the radar is blind.
        real = missed[(self._hits[k, late] >= 3) & (now_s - self._looked_s[late] < 3.0 * period_s)]
        self._covers[k].looked(
            range_m[real], azimuth_deg[real], elevation_deg[real], np.zeros(len(real), dtype=np.bool_)
        )

    def _in_cover_since(self, k: int, slot: Ints, now_s: float) -> Array:
        """Since when tracks that now are in a radar's cover have been in it, ``(n,)``. [s since the epoch]

        Cover that is proven only now was there before: where a track was a few turns ago may lie in it too.
        """
        newest, then = self._newest_s[k], self._before[k, slot]
        known = np.isfinite(then[:, 0])
        place = np.where(known[:, None], then, 0.0).T[1:]
        covered = known & (self._covers[k].detection(place[0], place[1], place[2], now_s) > 0.0)
        earliest = max(self._on_s[k], newest - (LOOK_BACK_MISSES + TURN_MARGIN) * self._period_s[k])
        since: Array = np.where(covered, np.clip(then[:, 0], earliest, newest), newest)
        return since

    def _remember_before(
        self, k: int, slot: Ints, outside: Bools, inside: Bools,
        range_m: Array, azimuth_deg: Array, elevation_deg: Array, now_s: float,
    ) -> None:  # fmt: skip
        """Keep where tracks are that a radar's cover does not hold, for when it turns out that it does."""
        self._before[k, slot[inside]] = np.nan
        at = outside.nonzero()[0]
        at = at[~(now_s - self._before[k, slot[at], 0] < LOOK_BACK_PERIODS * self._period_s[k])]
        here = columns_of(np.full(len(at), now_s), range_m[at], azimuth_deg[at], elevation_deg[at])
        self._before[k, slot[at]] = here
