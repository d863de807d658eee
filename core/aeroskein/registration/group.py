"""One group of radars that can share aircraft: queue, filter, pairs, jumps and the watch over aircraft."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints
from aeroskein.registration.comparisons import Comparisons, geometry_of
from aeroskein.registration.consistency import contradicting_aircraft
from aeroskein.registration.filter import LATENCY_SIGMA_S, OFFSET_SIGMA_M, BiasFilter
from aeroskein.registration.jumps import JumpWatch
from aeroskein.registration.pairs import PairBuffer
from aeroskein.registration.places import Places
from aeroskein.registration.rows import BIASES, Noise, Rows, anchored_rows, usable

__all__ = ["RadarGroup"]

# Comparisons are taken in about once a second: the filter costs the same for one row as for forty. [s]
STEP_S: Final = 1.0
# Comparisons held back at most; more than the step of a large group.
QUEUE_MAX: Final = 512
# The first plots of a radar are taken in together: this many, or what came in this time. [s]
FIRST_ROWS: Final = 12
FIRST_WAIT_S: Final = 20.0
# Aircraft whose errors are states, per radar and in one group; beyond that more aircraft add little but time.
PLACES_PER_RADAR: Final = 32
PLACES_MIN, PLACES_MAX = 64, 192
# After a start or a jump nothing is called a jump for this long. [s]
QUIET_S: Final = 30.0
# How often aircraft are compared with each other, and how far back. [s]
WATCH_EVERY_S: Final = 10.0
WATCH_WINDOW_S: Final = 60.0
# A radar is young for this long: what a wrong aircraft taught it then is worth forgetting. [s]
YOUNG_S: Final = 240.0
# The scatter of latencies and offsets is adapted this often; by at most this factor at a time, within these limits.
SCATTER_EVERY_S: Final = 20.0
SCATTER_STEP_MAX: Final = 1.5
LATENCY_LIMITS_S: Final = (0.03, 0.5)
OFFSET_LIMITS_M: Final = (2.0, 40.0)
# Values that the assumed scatter counts for, beside those seen.
SCATTER_PRIOR_COUNT: Final = 4.0
# A step of expectation maximisation is short; its fourth power goes about as far as the data carry.
SCATTER_POWER: Final = 4.0
# Range gain: begins after this long, from this many aircraft, with this prior. 0.2 m per km is a bad radar.
GAIN_AFTER_S: Final = 1800.0
GAIN_AIRCRAFT: Final = 20
GAIN_SIGMA: Final = 2e-4
# Plots over which the mean range is taken, about the memory of the range bias.
RANGE_SAMPLES: Final = 10_000
# Track numbers remembered per radar, to count each aircraft once.
SEEN_MAX: Final = 4096


class RadarGroup:
    """Estimates the biases of the radars ``members`` (sensor indices) jointly.

    Parameters
    ----------
    members : (k,) int64
        Sensor indices.
    sites : (sensors, 12) array
        Frames at the antennas.
    noise : Noise
        Random errors of all sensors.
    period_s : (sensors,) array
        Periods of all sensors. [s]
    mean, sigma : (k, 4) array
        Prior.
    """

    def __init__(self, members: Ints, sites: Array, noise: Noise, period_s: Array, mean: Array, sigma: Array) -> None:
        k = len(members)
        capacity = min(max(PLACES_PER_RADAR * k, PLACES_MIN), PLACES_MAX)
        self.members = members
        self.filter = BiasFilter(mean, sigma, capacity)
        self.samples = np.zeros(k, dtype=np.int64)
        self.aircraft = np.zeros(k, dtype=np.int64)
        self.started_s = np.full(k, np.nan)
        self.last_s = np.full(k, -np.inf)
        self.jumps = np.zeros(k, dtype=np.int64)
        self._start = (mean.copy(), sigma.copy())
        self._sites, self._noise = sites, noise
        self._local = np.full(len(sites), -1, dtype=np.int64)
        self._local[members] = np.arange(k)
        self._places = Places(capacity, k)
        self._pairs = PairBuffer(noise, period_s)
        self._watch = [JumpWatch() for _ in range(k)]
        self._queue: list[Comparisons] = []
        self._queued = 0
        self._oldest_s = np.inf
        self._recent: list[Rows] = []
        self._mean_range_m = np.zeros(k)
        self._seen = [np.empty(0, dtype=np.int64) for _ in range(k)]
        self._next_watch_s = self._next_scatter_s = -np.inf

    # -- input ---------------------------------------------------------------------------------------------------
    def add(self, rows: Comparisons) -> bool:
        """Queue comparisons of this group's radars; says whether a second's worth was there, so that all went in."""
        if len(rows) == 0:
            return False
        self._queue.append(rows)
        self._queued += len(rows)
        self._oldest_s = min(self._oldest_s, float(rows.time_s.min()))
        due = self._queued >= QUEUE_MAX or float(rows.time_s.max()) - self._oldest_s >= STEP_S
        if due:
            self.flush()
        return due

    def flush(self) -> None:
        """Take in what is queued."""
        if not self._queue:
            return
        rows = self._ripe(Comparisons.concatenate(self._queue))
        if len(rows) == 0:
            return
        geometry = geometry_of(rows, self._sites)
        keep = np.flatnonzero(usable(rows, geometry) & ~self.filter.considered[self._local[rows.sensor]])
        if len(keep) == 0:
            return
        keep = keep[np.argsort(rows.time_s[keep], kind="stable")]
        anchored = rows.anchored[keep]
        with_anchor, alone = keep[anchored], keep[~anchored]
        made: list[Rows] = []
        if len(with_anchor):
            made.append(anchored_rows(rows.take(with_anchor), geometry.take(with_anchor), self._noise))
        if len(alone):
            pairs = self._pairs.add(rows.take(alone), geometry.take(alone))
            if pairs is not None:
                made.append(pairs)
        if made:
            self._take_in(Rows.concatenate(made))

    def _ripe(self, rows: Comparisons) -> Comparisons:
        """What is to be taken in now; the first plots of a new radar wait for each other.

        One wild plot alone would be believed, because nothing is known yet; a dozen show which of them is wild.
        """
        if self.samples.all():
            self._queue, self._queued, self._oldest_s = [], 0, np.inf
            return rows
        k = self._local[rows.sensor]
        count = np.bincount(k, minlength=len(self.members))
        span_s = float(rows.time_s.max() - rows.time_s.min())
        wait = (self.samples == 0) & (count < FIRST_ROWS) & (span_s < FIRST_WAIT_S)
        later = wait[k]
        self._queue = [rows.take(later)] if later.any() else []
        self._queued = int(later.sum())
        self._oldest_s = float(rows.time_s[later].min()) if later.any() else np.inf
        return rows.take(~later)

    def advance(self, now_s: float) -> None:
        """Let time pass: what waits for a full second goes in, and uncertainty grows."""
        if now_s - self._oldest_s >= STEP_S:
            self.flush()
        if not self._queue:
            self.filter.predict(now_s)

    # -- control -------------------------------------------------------------------------------------------------
    def restart(self, k: int, mean: Array, sigma: Array) -> None:
        """Begin anew with one radar."""
        self.flush()
        self.filter.restart(k, mean, sigma)
        self.samples[k], self.aircraft[k], self._seen[k] = 0, 0, np.empty(0, dtype=np.int64)
        self.started_s[k], self.last_s[k] = np.nan, -np.inf
        self._forget_recent(k)
        self._start[0][k], self._start[1][k] = mean, sigma

    def adjust(self, k: int, change: Array, slack: Array) -> None:
        """The radar's own processor has changed its correction: move the mean, and widen it by a sigma ``slack``."""
        self.flush()
        self.filter.shift(k, change, slack)
        self._forget_recent(k)

    def hold(self, k: int, held: bool) -> None:
        """Freeze one radar, or let it go."""
        self.flush()
        self.filter.considered[k] = held
        self._forget_recent(k)

    # -- the step ------------------------------------------------------------------------------------------------
    def _take_in(self, rows: Rows) -> None:
        now_s = float(rows.time_s.max())
        self.filter.predict(now_s)
        radar, other = self._local[rows.sensor], np.where(rows.other >= 0, self._local[rows.other], -1)
        anchored = rows.other < 0
        place = np.full(len(rows), -1)
        place[anchored], fresh = self._places.assign(rows.aircraft[anchored], radar[anchored], now_s)
        if len(fresh):
            self.filter.clear_aircraft(fresh)
        used = (place >= 0) | ~anchored
        if not used.any():
            return
        if not used.all():
            rows, radar, other, place = rows.take(used), radar[used], other[used], place[used]
        innovation, spread = self.filter.update(rows, radar, other, place)
        self._recent.append(rows)
        self._count(rows, radar, other, now_s)
        self._look_for_jumps(rows, radar, other, innovation, spread, now_s)
        self._look_at_aircraft(now_s)
        self._adapt_scatter(now_s)

    def _count(self, rows: Rows, radar: Ints, other: Ints, now_s: float) -> None:
        for k in range(len(self.members)):
            own = (radar == k) | (other == k)
            if not own.any():
                continue
            if not self.last_s[k] > -np.inf:
                self._watch[k].quiet_until_s = now_s + QUIET_S
            self.samples[k] += int(own.sum())
            share = own.sum() / max(min(self.samples[k], RANGE_SAMPLES), 1)
            mean_m = np.where(radar[own] == k, rows.range_m[own, 0], rows.range_m[own, 1]).mean()
            self._mean_range_m[k] += min(share, 1.0) * (mean_m - self._mean_range_m[k])
            known, aircraft = self._seen[k], rows.aircraft[own]
            if not np.isin(aircraft, known).all():
                # Track numbers grow, so the lowest ones are those that will not come again.
                seen = np.union1d(known, aircraft)
                self.aircraft[k] += len(seen) - len(known)
                self._seen[k] = seen[-SEEN_MAX:]
            self.last_s[k] = now_s
            if np.isnan(self.started_s[k]):
                self.started_s[k] = now_s
            ripe = now_s - self.started_s[k] > GAIN_AFTER_S and self.aircraft[k] >= GAIN_AIRCRAFT
            if ripe and not self.filter.gain_free[k]:
                self.filter.free_gain(k, GAIN_SIGMA, float(self._mean_range_m[k]))

    def _look_for_jumps(
        self, rows: Rows, radar: Ints, other: Ints, innovation: Array, spread: Array, now_s: float
    ) -> None:
        found: list[tuple[float, int, Array]] = []
        for k, watch in enumerate(self._watch):
            for index, sensitivity in ((radar, rows.of_sensor), (other, rows.of_other)):
                own = index == k
                if own.any():
                    watch.add(rows.time_s[own], rows.aircraft[own], innovation[own], spread[own], sensitivity[own])
            jump = watch.check(now_s)
            if jump is not None:
                found.append((jump[0], k, jump[1]))
        if found:
            # A jump of one radar shows in its pairs with every other; the radar that explains most has jumped.
            _, k, shift = max(found, key=lambda item: item[0])
            self._jumped(k, shift, now_s)

    def _jumped(self, k: int, shift: Array, now_s: float) -> None:
        mean = self.filter.biases[k].copy()
        mean[:3] += shift
        sigma = self._start[1][k].copy()
        sigma[:3] = np.maximum(sigma[:3], 0.3 * np.abs(shift))
        # A jump says nothing about the clock's prior or the gain, which is estimated again later.
        sigma[3] = 0.0
        self.filter.restart(k, mean, sigma)
        self.jumps[k] += 1
        self.started_s[k] = now_s
        for watch in self._watch:
            watch.clear()
            watch.quiet_until_s = max(watch.quiet_until_s, now_s + QUIET_S)
        self._forget_recent(k)

    def _forget_recent(self, k: int) -> None:
        sensor = self.members[k]
        self._recent = [r.take((r.sensor != sensor) & (r.other != sensor)) for r in self._recent]
        self._pairs.forget(int(sensor))
        self._watch[k].clear()

    # -- aircraft ------------------------------------------------------------------------------------------------
    def _look_at_aircraft(self, now_s: float) -> None:
        if now_s < self._next_watch_s:
            return
        self._next_watch_s = now_s + WATCH_EVERY_S
        self._recent = [r for r in self._recent if len(r) and r.time_s[-1] > now_s - WATCH_WINDOW_S]
        if not self._recent:
            return
        rows = Rows.concatenate(self._recent)
        wrong = contradicting_aircraft(rows.take(rows.other < 0), self.filter.latency_sigma_s)
        wrong = wrong[~self._places.is_banned(wrong, now_s)]
        if len(wrong) == 0:
            return
        freed = self._places.ban(wrong, now_s)
        self.filter.clear_aircraft(freed)
        self._recent = [rows.take(~np.isin(rows.aircraft, wrong))]
        seen = self._local[np.unique(rows.sensor[np.isin(rows.aircraft, wrong)])]
        if (now_s - self.started_s[seen] < YOUNG_S).any():
            self._start_again(seen, now_s)

    def _start_again(self, radars: Ints, now_s: float) -> None:
        """Begin the given young radars anew from the plots of the last minute, without the aircraft just banned."""
        for k in radars[now_s - self.started_s[radars] < YOUNG_S]:
            self.filter.restart(int(k), self._start[0][k], self._start[1][k])
            self.started_s[k] = now_s
            self._watch[k].clear()
            self._watch[k].quiet_until_s = now_s + QUIET_S
        self.filter.clear_aircraft(np.flatnonzero(self._places.aircraft >= 0))
        rows = Rows.concatenate(self._recent)
        rows = rows.take(np.argsort(rows.time_s, kind="stable"))
        radar = self._local[rows.sensor]
        mine: Bools = np.isin(radar, radars) & (rows.other < 0)
        rows, radar = rows.take(mine), radar[mine]
        if len(rows) == 0:
            return
        place, fresh = self._places.assign(rows.aircraft, radar, now_s)
        self.filter.clear_aircraft(fresh)
        there = place >= 0
        self.filter.update(rows.take(there), radar[there], np.full(int(there.sum()), -1), place[there])

    def _adapt_scatter(self, now_s: float) -> None:
        """Learn from the aircraft in use how much latencies and offsets scatter (expectation maximisation)."""
        if now_s < self._next_scatter_s:
            return
        first = not np.isfinite(self._next_scatter_s)
        self._next_scatter_s = now_s + SCATTER_EVERY_S
        place = np.flatnonzero(self._places.aircraft[: self.filter.used] >= 0)
        if first or len(place) == 0:
            return
        mean, sigma = self.filter.aircraft_errors()
        square = mean[place] ** 2 + sigma[place] ** 2
        latency = _next_sigma(self.filter.latency_sigma_s, LATENCY_SIGMA_S, square[:, 0])
        self.filter.rescale_latency(place, float(np.clip(latency, *LATENCY_LIMITS_S)))
        offset = _next_sigma(self.filter.offset_sigma_m, OFFSET_SIGMA_M, square[:, 1:].ravel())
        # Old offsets are forgotten within a minute, so the new scatter takes over by itself.
        self.filter.offset_sigma_m = float(np.clip(offset, *OFFSET_LIMITS_M))

    @property
    def covariances(self) -> Array:
        """``(k, 4, 4)``: each radar's own."""
        k = np.arange(len(self.members))
        return self.filter.bias_covariance[k, :, k, :].reshape(-1, BIASES, BIASES)

    # -- what survives a restart ---------------------------------------------------------------------------------
    def export(self) -> dict[str, Any]:
        """Plain content: biases with their joint covariance, and what has been counted."""
        return {
            "members": self.members.tolist(),
            "time_s": self.filter.time_s if np.isfinite(self.filter.time_s) else None,
            "mean": self.filter.biases.tolist(),
            "covariance": self.filter.bias_covariance.reshape(self.filter.head, self.filter.head).tolist(),
            "held": self.filter.considered.tolist(),
            "samples": self.samples.tolist(),
            "aircraft": self.aircraft.tolist(),
            "started_s": [None if np.isnan(s) else float(s) for s in self.started_s],
            "mean_range_m": self._mean_range_m.tolist(),
            "latency_sigma_s": self.filter.latency_sigma_s,
        }

    def load(self, content: dict[str, Any], places: list[tuple[int, int]]) -> None:
        """Take an ``export`` over; ``places`` are pairs (place in the export, place here)."""
        old, new = (np.array(side, dtype=np.int64) for side in zip(*places, strict=True))
        k = len(content["mean"])
        joint = np.array(content["covariance"], dtype=np.float64).reshape(k, BIASES, k, BIASES)
        mean, covariance = self.filter.biases.copy(), self.filter.bias_covariance.copy()
        mean[new] = np.array(content["mean"], dtype=np.float64)[old]
        covariance[new] = 0.0
        covariance[:, :, new] = 0.0
        covariance[new[:, None], :, new[None, :], :] = joint[old[:, None], :, old[None, :], :]
        self.filter.load(mean, covariance)
        self.filter.considered[new] = np.array(content["held"], dtype=np.bool_)[old]
        self.filter.latency_sigma_s = float(content["latency_sigma_s"])
        self.filter.clear_aircraft(np.arange(self.filter.capacity))
        if content["time_s"] is not None:
            self.filter.time_s = max(self.filter.time_s, float(content["time_s"]))
        self.samples[new] = np.array(content["samples"], dtype=np.int64)[old]
        for a, b in places:
            self.aircraft[b] = int(content["aircraft"][a])
            self.last_s[b] = -np.inf if content["time_s"] is None else float(content["time_s"])
            self._mean_range_m[b] = content["mean_range_m"][a]
            started = content["started_s"][a]
            self.started_s[b] = np.nan if started is None else started


def _next_sigma(old: float, prior: float, square: Array) -> float:
    variance = (SCATTER_PRIOR_COUNT * prior**2 + square.sum()) / (SCATTER_PRIOR_COUNT + len(square))
    factor = (np.sqrt(variance) / old) ** SCATTER_POWER
    return old * float(np.clip(factor, 1.0 / SCATTER_STEP_MAX, SCATTER_STEP_MAX))
