"""Closing elements: the windowed worker that divides each flight along its master track while it moves.

Per track there is a row of boundaries (division points in time), the settled state behind which nothing changes any
more, and the mode bank that runs in order of time. When the clock has passed the look-ahead's end by the watermark, the
open element is closed: its reports are gathered, the manoeuvre detector runs over what is new, the estimator runs
forward and back, the settled state moves on, and the next division point is laid as far ahead as the elements are long.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from aeroskein import manoeuvre
from aeroskein.closed import Closed, Estimate
from aeroskein.elements import element_boundaries
from aeroskein.estimator import estimate, go_on
from aeroskein.gating import GateMemory
from aeroskein.measurements import COLUMNS
from aeroskein.mode_bank import ModeBank
from aeroskein.plots import Array, Bools, Ints
from aeroskein.rings import Rings
from aeroskein.settings import EngineSettings
from aeroskein.windows import NOTHING, REPORT, Window, gather

__all__ = ["ElementTable"]

# Reports up to this much behind the look-ahead's end stay open to revision: the density of jerk at a report depends
# on the four seconds behind it, and late reports up to four seconds must find their place. [s]
REVISION_S: Final = 4.0
# The window over which a manoeuvre detected somewhere counts: it began before it showed, that is before four seconds of
# reports, or, where they are rare, before four reports (and marks) within the longer time. [s]
BEFORE_S: Final = 1.0
AFTER_S: Final = 4.0
AFTER_REPORTS: Final = 4
AFTER_MOST_S: Final = 16.0
# Sources faster than this allow the set element length; without any, elements are twice as long. [s]
FAST_PERIOD_S: Final = 4.0
# Columns of a report that the detector uses, in its order.
MEASURED: Final = slice(COLUMNS.index("east_m"), COLUMNS.index("time_variance") + 1)


class ElementTable:
    """Open elements of all tracks, columns by slot.

    ``boundaries_s (capacity, lookahead + 2)`` holds the division points from the start of the open element to the end
    of its look-ahead; ``settled_s``, ``x``, ``P`` the settled state; ``index`` counts elements; ``places_m (capacity,
    4)`` holds where the last two were published, the older one first. Reports at or before ``late_s`` come too late:
    that is the settled time, or the one that a pass under way will settle.
    """

    def __init__(self, settings: EngineSettings, capacity: int) -> None:
        self._settings = settings
        self._fast = np.array([s.period_s < FAST_PERIOD_S for s in settings.sensors])
        sensors = len(settings.sensors)
        # How long closing waits behind the end of a look-ahead: the watermark, or what the feeds need. [s]
        self.wait_s = settings.fusion.watermark_s
        self.open: Bools = np.zeros(capacity, dtype=np.bool_)
        self.boundaries_s = np.full((capacity, settings.fusion.lookahead + 2), np.inf)
        self.settled_s, self.late_s = np.full(capacity, -np.inf), np.full(capacity, -np.inf)
        self.index: Ints = np.zeros(capacity, dtype=np.int64)
        self.states = np.zeros((capacity, 30))
        self.places_m = np.full((capacity, 4), np.nan)
        self.gates = GateMemory.empty(capacity, sensors)
        self.detector = ModeBank(capacity, sensors, manoeuvre.DETECTOR)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = ElementTable(self._settings, capacity - len(self.open))
        for name in ("open", "boundaries_s", "settled_s", "late_s", "index", "states", "places_m"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(more, name)]))
        self.gates = GateMemory(
            np.concatenate([self.gates.misses, more.gates.misses]),
            np.concatenate([self.gates.best_m2, more.gates.best_m2]),
        )
        self.detector.grow(capacity)

    def start(self, slots: Ints, first_s: Array, not_before_s: Array, x: Array, P: Array) -> None:
        """Begin the elements of confirmed tracks at their first report.

        Parameters
        ----------
        slots : (n,) int64
            Tracks.
        first_s : (n,) array
            Time of their first report, where ``x (6, n)`` and ``P (24, n)`` hold. [s since the epoch]
        not_before_s : (n,) array
            End of what was published before a restart; no element starts earlier. [s since the epoch]
        """
        start_s = np.maximum(first_s, not_before_s)
        self.open[slots] = True
        self.boundaries_s[slots] = start_s[:, None] + self._first_boundaries_s()
        self.settled_s[slots] = self.late_s[slots] = first_s
        self.index[slots] = 0
        self.places_m[slots] = np.nan
        self.states[slots] = np.concatenate([x, P]).T
        self.gates.put(slots, GateMemory.empty(len(slots), self.gates.misses.shape[1]))
        self.detector.start(slots, x, P, first_s)

    def _first_boundaries_s(self) -> Array:
        """Division points of a new track after its start, ``(lookahead + 2,)``: the odd series begins with a half."""
        fusion = self._settings.fusion
        n = fusion.lookahead + 2
        series = self._settings.patent.series if fusion.mode == "patent" else "natural"
        return n * fusion.element_s * element_boundaries(n, series)[:n]

    def stop(self, slots: Ints) -> None:
        """End the elements of terminated tracks."""
        self.open[slots] = False
        self.boundaries_s[slots] = np.inf
        self.settled_s[slots] = self.late_s[slots] = -np.inf

    @property
    def due_s(self) -> Array:
        """When each track's open element may close, inf where none is open. ``(capacity,)`` [s since the epoch]"""
        due: Array = self.boundaries_s[:, -1] + self.wait_s
        return due

    def close(self, slots: Ints, rings: Rings, give_way: Callable[[], None] = go_on) -> Closed:
        """Close the open element of each track and open the next.

        Parameters
        ----------
        slots : (n,) int64
            Tracks.
        rings : Rings
            The buffered reports of all tracks; what the detector finds is written beside them.
        give_way : callable
            Called between rounds; reports may be buffered meanwhile.
        """
        boundaries = self.boundaries_s[slots]
        centre = 0.5 * (boundaries[:, 0] + boundaries[:, 1])
        horizon = boundaries[:, -1]
        settled = self.settled_s[slots]
        next_settled = np.maximum(np.minimum(centre, horizon - REVISION_S), settled)
        self.late_s[slots] = next_settled
        window = gather(rings, slots, settled, horizon, centre, next_settled)
        order = window.lanes
        slots, boundaries, centre = slots[order], boundaries[order], centre[order]
        fresh = self._detect(slots, window, give_way)
        _keep_density(rings, slots, window, fresh)
        states = np.ascontiguousarray(self.states[slots].T)
        density, gates = _windowed_max(window), self.gates.take(slots)
        result = estimate(window, density, states[:6], states[6:], settled[order], gates, give_way)
        before = self.places_m[slots].T
        closed = Closed(slots, self.index[slots], boundaries[:, :2], centre, result, window, before)
        self._settle(slots, next_settled[order], result)
        self._divide(slots, boundaries, window, result)
        return closed

    def note_published(self, slots: Ints, position_m: Array) -> None:
        """Remember where the elements that were closed last ``(2, n)`` are shown."""
        self.places_m[slots] = np.concatenate([self.places_m[slots, 2:], position_m.T], axis=1)

    def _detect(self, slots: Ints, window: Window, give_way: Callable[[], None]) -> Bools:
        """Run the detector over reports it has not seen, and note the density of jerk that it finds at each.

        Every report is seen once, in order of time; one that comes after the detector has passed its time is not.
        Returns which were seen, ``(K, n)``.
        """
        fresh: Bools = (window.kind == REPORT) & (window.time_s > self.detector.time_s[slots])
        count = fresh.sum(axis=0)
        density = window.jerk_density
        lanes = np.argsort(-count, kind="stable")
        rounds = int(count.max(initial=0))
        if rounds == 0:
            return fresh
        work = self.detector.take(slots[lanes])
        active = [int(m) for m in (count[lanes][:, None] > np.arange(rounds)).sum(axis=0)]
        sensor, measured = window.sensor_index, window.columns[MEASURED]
        # Where the k-th fresh report of each lane stands; lanes with the most come first.
        places = np.argsort(np.where(fresh, 0, 1), axis=0, kind="stable")
        for k in range(rounds):
            give_way()
            m = active[k]
            lane = lanes[:m]
            event = places[k, lane]
            lag = work.predict(window.time_s[event, lane])
            work.update(measured[:, event, lane], sensor[event, lane], lag, np.ones(m, dtype=np.bool_))
            density[event, lane] = manoeuvre.jerk_density(work.mu[:, :m])
        self.detector.put(slots[lanes], work)
        return fresh

    def _settle(self, slots: Ints, settled_s: Array, result: Estimate) -> None:
        self.settled_s[slots] = settled_s
        self.states[slots] = np.concatenate([result.settled_x, result.settled_covariance]).T
        self.gates.put(slots, result.settled_memory)

    def _divide(self, slots: Ints, boundaries: Array, window: Window, result: Estimate) -> None:
        """Lay the next division point: as far ahead along the track as the aircraft flies in the set time.

        Equal times are equal lengths at the speed flown. A length kept constant while the speed changes would make
        every later division point hang on the noise of a speed, and with it on the order of arrival: late reports
        then moved elements by three metres (95 %), where now only their own weight counts.
        """
        accepted = (window.kind == REPORT) & (result.reason == 0) & (window.time_s >= boundaries[:, 0])
        fast = (accepted & self._fast[window.sensor_index]).any(axis=0)
        step = self._settings.fusion.element_s * np.where(fast, 1.0, 2.0)
        self.boundaries_s[slots, :-1] = boundaries[:, 1:]
        self.boundaries_s[slots, -1] = boundaries[:, -1] + step
        self.index[slots] += 1


def _keep_density(rings: Rings, slots: Ints, window: Window, fresh: Bools) -> None:
    """The detector passes each report once; later windows find here what it found."""
    event, lane = np.nonzero(fresh)
    rings.set_column("jerk_density", slots[lane], window.place[event, lane], window.jerk_density[event, lane])


def _windowed_max(window: Window) -> Array:
    """For each event the largest density from just before it until a manoeuvre must have shown, ``(K, n)``. [m²/s⁵]"""
    # What is no event is near nothing.
    time = np.where(window.kind == NOTHING, np.nan, window.time_s)
    density = np.where(window.kind == REPORT, window.jerk_density, 0.0)
    largest = np.maximum(density, manoeuvre.JERK_DENSITY[0])
    any_behind = True
    for shift in range(1, len(time)):
        apart = time[shift:] - time[:-shift]
        ahead = apart <= (AFTER_MOST_S if shift <= AFTER_REPORTS else AFTER_S)
        if not ahead.any():
            break
        np.maximum(largest[:-shift], density[shift:] * ahead, out=largest[:-shift])
        if any_behind:
            behind = apart <= BEFORE_S
            any_behind = bool(behind.any())
            np.maximum(largest[shift:], density[:-shift] * behind, out=largest[shift:])
    return np.asarray(largest)
