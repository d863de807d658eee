"""Deciding: which plot gets which track, over several scans, so that no single noisy scan swaps two aircraft.

A radar that numbers its targets (``local_track``) says which plots of successive scans are one target. For such a
target the cost of each candidate track is the mean of the last three scans, and an established pairing is given up only
after another one has been better three scans in a row. Plots of one scan do not arrive together: targets that have not
been seen yet in this scan take part with what is remembered of them, so that the first to arrive does not take what
belongs to the next. Tracks that got a report from the same sensor in this scan are taken: a plot without identity never
steals a track from a better claimant.

A plot that may as well be a neighbour's is given to nobody where its track does not need it: a track that others
report on gains nothing from a plot that is wrong one time in five.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.association.assignment import assign
from aeroskein.association.doubt import lead_of_chosen
from aeroskein.association.scoring import Candidates, Score
from aeroskein.plots import Array, Bools, Ints, apply_at

__all__ = ["Claims", "Decision", "PairingMemory"]

# Scans over which costs are averaged, and for which a challenger must be better.
SCANS: Final = 3
# Two reports of one sensor nearer in time than this share of its period belong to one scan.
SCAN_SHARE: Final = 0.5
# A target is expected to be seen again within so many periods.
EXPECTED_PERIODS: Final = 1.5
# A plot is withheld from a track that can spare it unless its assignment is as much better as this: right nine times in
# ten, as a difference of minus twice the log likelihood.
LEAD_MIN: Final = float(2.0 * np.log(9.0))
# A sensor's target not seen for this many periods, at least these seconds, is forgotten.
FORGET_PERIODS: Final = 5.0
FORGET_MIN_S: Final = 30.0
_NONE: Final = -1
_SENSOR_SHIFT: Final = 47


@dataclass(slots=True, eq=False)
class Decision:
    """What was decided, one entry per plot.

    Attributes
    ----------
    pair : (n,) int64
        Row of the candidate pair that was chosen, -1 where the plot stays without a track.
    contested : (n,) bool
        Plots without a track that lie in the gate of one all the same: not free to begin a new one at once.
    withheld : (n,) bool
        Plots that one of two tracks caused, without telling which: they begin nothing.
    sure : (n,) bool
        Plots whose track was the only one in the gate, or whose pairing is established: fit to learn from.
    """

    pair: Ints
    contested: Bools
    withheld: Bools
    sure: Bools


class Claims:
    """When each track last got a report from each sensor: ``(sensors, slots)``.

    Parameters
    ----------
    period_s : (sensors,) array
        Time between two reports of one target. [s]
    slots : int
        Track slots.
    """

    def __init__(self, period_s: Array, slots: int) -> None:
        self._period_s = period_s
        self._last_s = np.full((len(period_s), slots), -np.inf)

    def grow(self, slots: int) -> None:
        """Make room for more slots."""
        more = np.full((len(self._period_s), slots - self._last_s.shape[1]), -np.inf)
        self._last_s = np.concatenate([self._last_s, more], axis=1)

    def reset(self, slot: Ints) -> None:
        """These slots belong to new tracks."""
        self._last_s[:, slot] = -np.inf

    def note(self, sensor: Ints, slot: Ints, time_s: Array) -> None:
        """Reports that were given to tracks, ``(n,)`` each."""
        apply_at(np.maximum, self._last_s, sensor, slot, time_s)

    def taken(self, sensor: Ints, slot: Ints, time_s: Array) -> Bools:
        """Whether the track already has a report of this sensor in the scan of ``time_s``, ``(n,)``."""
        near: Bools = np.abs(time_s - self._last_s[sensor, slot]) < SCAN_SHARE * self._period_s[sensor]
        return near


class PairingMemory:
    """Established pairings of sensors' own targets with tracks, and the costs of the last scans."""

    def __init__(self, period_s: Array) -> None:
        self._period_s = period_s
        # Sorted by key; one entry per target of a sensor.
        self._key = np.empty(0, dtype=np.int64)
        self._partner = np.empty(0, dtype=np.int64)
        self._challenger = np.empty(0, dtype=np.int64)
        self._wins = np.empty(0, dtype=np.int64)
        self._scans = np.empty(0, dtype=np.int64)
        self._seen_s = np.empty(0)
        self._limit = np.empty(0)
        # One entry per target and candidate: costs of the last scans, newest first, NaN where it was no candidate.
        self._cost_key = np.empty(0, dtype=np.int64)
        self._cost_track = np.empty(0, dtype=np.int64)
        self._costs = np.empty((0, SCANS))

    def decide(
        self,
        sensor: Ints,
        local_track: Ints,
        time_s: Array,
        pairs: Candidates,
        score: Score,
        taken: Bools,
        spared: Bools,
    ) -> Decision:
        """Decide for the plots of one or several sensors, at most one scan of each.

        Parameters
        ----------
        sensor, local_track : (n,) int64
            Of each plot; -1 where the sensor does not number its targets.
        time_s : (n,) array
            Of each plot. [s since the epoch]
        pairs : Candidates
            ``track`` must name a track for good (its number), for it is remembered.
        score : Score
            Of the pairs.
        taken : (p,) bool array
            Pairs whose track has a report of this sensor in this scan.
        spared : (p,) bool array
            Pairs whose track does well without this plot.
        """
        n = len(sensor)
        pool = np.flatnonzero(score.inside)
        plot = pairs.plot[pool]
        # Every sensor sees a track for itself: what is assigned is the track as this sensor sees it.
        track = pairs.track[pool] * len(self._period_s) + sensor[plot]
        cost, limit = score.cost[pool].copy(), score.limit[pool]
        targets = self._enter(sensor, local_track, time_s)
        if len(targets):
            cost = self._averaged(targets, sensor, local_track, plot, track, cost, limit)
        # What is taken has been compared and remembered all the same: the next scan may decide otherwise.
        free = ~taken[pool]
        pool, plot, track, cost, limit = pool[free], plot[free], track[free], cost[free], limit[free]
        others = self._expected(sensor, local_track, time_s, track)
        chosen = assign(*(np.concatenate(both) for both in zip((plot, track, cost, limit), others, strict=True)))
        reserved = others[1][chosen[len(plot) :]]
        chosen = chosen[: len(plot)]
        if len(targets):
            chosen = self._with_hysteresis(
                targets, sensor, local_track, plot, track, cost, limit, chosen, np.isin(track, reserved)
            )
        lead = lead_of_chosen(plot, track, score.evidence[pool], score.evidence_limit[pool], chosen)
        doubtful = chosen & (lead < LEAD_MIN) & spared[pool] & (local_track[plot] < 0)
        withheld = np.zeros(n, dtype=np.bool_)
        withheld[plot[doubtful]] = True
        chosen &= ~doubtful
        pair = np.full(n, _NONE, dtype=np.int64)
        pair[plot[chosen]] = pool[chosen]
        in_gates = np.bincount(pairs.plot[score.inside], minlength=n)
        sure = (in_gates == 1) | self._established(sensor, local_track)
        return Decision(pair, (in_gates > 0) & (pair < 0), withheld, sure & (pair >= 0))

    def partner(self, sensor: Ints, local_track: Ints) -> Ints:
        """Established track of a sensor's targets, ``(n,)``; -1 where none."""
        place = self._place(_key(sensor, local_track))
        if not len(self._key):
            return np.full(len(sensor), _NONE, dtype=np.int64)
        return np.where((place >= 0) & (self._partner[place] >= 0), self._partner[place] // len(self._period_s), _NONE)

    # -- inside --------------------------------------------------------------------------------------------------
    def _established(self, sensor: Ints, local_track: Ints) -> Bools:
        """Targets that have had a partner for three scans and more, ``(n,)``."""
        place = self._place(_key(sensor, local_track))
        if not len(self._key):
            return np.zeros(len(sensor), dtype=np.bool_)
        known: Bools = (local_track >= 0) & (place >= 0) & (self._scans[place] > SCANS) & (self._partner[place] >= 0)
        return known

    def _place(self, key: Ints) -> Ints:
        if not len(self._key):
            return np.full(len(key), _NONE, dtype=np.int64)
        place = np.minimum(np.searchsorted(self._key, key), len(self._key) - 1)
        return np.where(self._key[place] == key, place, _NONE)

    def _enter(self, sensor: Ints, local_track: Ints, time_s: Array) -> Ints:
        """Rows of plots that begin a new scan of a numbered target, which are made known."""
        if len(time_s):
            self._forget(float(time_s.max()))
        rows = np.flatnonzero(local_track >= 0)
        key = _key(sensor[rows], local_track[rows])
        # Of several plots of one target the first counts.
        _, first = np.unique(key, return_index=True)
        rows, key = rows[first], key[first]
        new = self._place(key) < 0
        if new.any():
            self._insert(key[new])
        place = self._place(key)
        is_scan = time_s[rows] - self._seen_s[place] > SCAN_SHARE * self._period_s[sensor[rows]]
        place, rows = place[is_scan], rows[is_scan]
        self._seen_s[place] = time_s[rows]
        self._scans[place] += 1
        return rows

    def _insert(self, key: Ints) -> None:
        merged = np.concatenate([self._key, key])
        order = np.argsort(merged, kind="stable")
        n = len(key)
        self._key = merged[order]
        for name, empty in (("_partner", _NONE), ("_challenger", _NONE), ("_wins", 0), ("_scans", 0)):
            setattr(self, name, np.concatenate([getattr(self, name), np.full(n, empty, dtype=np.int64)])[order])
        self._seen_s = np.concatenate([self._seen_s, np.full(n, -np.inf)])[order]
        self._limit = np.concatenate([self._limit, np.zeros(n)])[order]

    def _forget(self, now_s: float) -> None:
        sensor = self._key >> _SENSOR_SHIFT
        limit_s = np.maximum(FORGET_PERIODS * self._period_s[sensor], FORGET_MIN_S)
        old = now_s - self._seen_s > limit_s
        if not old.any():
            return
        gone = self._key[old]
        for name in ("_key", "_partner", "_challenger", "_wins", "_scans", "_seen_s", "_limit"):
            setattr(self, name, getattr(self, name)[~old])
        self._drop_costs(np.isin(self._cost_key, gone))

    def _drop_costs(self, gone: Bools) -> None:
        self._cost_key, self._cost_track, self._costs = (
            self._cost_key[~gone],
            self._cost_track[~gone],
            self._costs[~gone],
        )

    def _averaged(
        self, targets: Ints, sensor: Ints, local_track: Ints, plot: Ints, track: Ints, cost: Array, limit: Array
    ) -> Array:
        """Costs of the pairs of ``targets`` averaged over the last scans; a scan outside the gate counts the limit."""
        mine = np.flatnonzero(np.isin(plot, targets))
        key = _key(sensor[plot[mine]], local_track[plot[mine]])
        touched = np.isin(self._cost_key, _key(sensor[targets], local_track[targets]))
        both = np.stack(
            [np.concatenate([self._cost_key[touched], key]), np.concatenate([self._cost_track[touched], track[mine]])]
        )
        names, index = np.unique(both, axis=1, return_inverse=True)
        index = index.reshape(-1)
        old, new = index[: int(touched.sum())], index[int(touched.sum()) :]
        costs = np.full((names.shape[1], SCANS), np.nan)
        costs[old, 1:] = self._costs[touched, :-1]
        costs[new, 0] = cost[mine]
        self._drop_costs(touched)
        kept = np.isfinite(costs).any(axis=1)
        self._cost_key = np.concatenate([self._cost_key, names[0][kept]])
        self._cost_track = np.concatenate([self._cost_track, names[1][kept]])
        self._costs = np.concatenate([self._costs, costs[kept]])
        place = self._place(key)
        self._limit[place] = limit[mine]
        out = cost.copy()
        out[mine] = self._means(costs[new], place)
        return out

    def _means(self, costs: Array, place: Ints) -> Array:
        """Mean costs ``(p,)`` over the last scans of targets; a scan outside the gate counts the limit.

        Scans before a track first was a candidate do not count: it may not have been there yet.
        """
        known = np.isfinite(costs)
        since = SCANS - np.argmax(known[:, ::-1], axis=1)
        scans = np.minimum(since, np.minimum(self._scans[place], SCANS))
        filled = np.where(known, costs, self._limit[place][:, None])
        mean: Array = np.where(np.arange(SCANS) < scans[:, None], filled, 0.0).sum(axis=1) / scans
        return mean

    def _expected(self, sensor: Ints, local_track: Ints, time_s: Array, track: Ints) -> tuple[Ints, Ints, Array, Array]:
        """Targets that are still to be seen in this scan and their tracks, as pairs that compete for ``track``.

        Plots are numbered from ``len(sensor)`` on.
        """
        entry = np.flatnonzero(np.isin(self._cost_track, track))
        key = self._cost_key[entry]
        place = self._place(key)
        of_sensor = key >> _SENSOR_SHIFT
        since_s = (float(time_s.max()) - self._seen_s[place]) / self._period_s[of_sensor]
        due = (since_s > SCAN_SHARE) & (since_s < EXPECTED_PERIODS) & ~np.isin(key, _key(sensor, local_track))
        entry, key, place = entry[due], key[due], place[due]
        _, number = np.unique(key, return_inverse=True)
        return len(sensor) + number, self._cost_track[entry], self._means(self._costs[entry], place), self._limit[place]

    def _with_hysteresis(
        self, targets: Ints, sensor: Ints, local_track: Ints,
        plot: Ints, track: Ints, cost: Array, limit: Array, chosen: Bools, reserved: Bools,
    ) -> Bools:  # fmt: skip
        proposed = np.full(len(sensor), _NONE, dtype=np.int64)
        proposed[plot[chosen]] = track[chosen]
        place = self._place(_key(sensor[targets], local_track[targets]))
        proposal, partner = proposed[targets], self._partner[place]
        # A pairing is established by three scans; until then each scan's mean decides anew.
        young = self._scans[place] <= SCANS
        agrees = young | (partner == _NONE) | (proposal == partner)
        again = ~agrees & (proposal == self._challenger[place])
        wins = np.where(agrees, 0, np.where(again, self._wins[place] + 1, 1))
        change = young | (partner == _NONE) | (wins >= SCANS)
        self._partner[place] = np.where(change, proposal, partner)
        self._challenger[place] = np.where(agrees | change, _NONE, proposal)
        self._wins[place] = np.where(change, 0, wins)
        held = ~agrees & ~change
        if not held.any():
            return chosen
        # A plot whose target keeps its partner goes there or nowhere; that track is not open to the other plots.
        keeper = np.full(len(sensor), _NONE, dtype=np.int64)
        keeper[targets[held]] = self._partner[place[held]]
        kept = keeper[plot] == track
        open_pair = (keeper[plot] == _NONE) & ~np.isin(track, keeper[keeper >= 0]) & ~reserved
        rest = np.flatnonzero(open_pair)
        chosen = kept
        chosen[rest] = assign(plot[rest], track[rest], cost[rest], limit[rest])
        return chosen


def _key(sensor: Ints, local_track: Ints) -> Ints:
    mask = (1 << _SENSOR_SHIFT) - 1
    key: Ints = (sensor.astype(np.int64) << _SENSOR_SHIFT) | (local_track & mask)
    return key
