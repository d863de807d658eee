"""FusionEngine: reports in, fused points out, without clock, I/O or logging.

The only file that knows the order of the stages:

    receive   anteroom, then (receiving.py) intake -> calibration -> place -> identity -> repeats -> buffers -> live
    advance   start of elements -> closing -> master -> fusion -> element points -> registration -> ageing

Time is an argument; what happened comes back as events, in columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, Literal

import numpy as np

from aeroskein import ageing, dispositions, fusion, silence, snapshots
from aeroskein.applied_biases import AppliedBiases
from aeroskein.beginnings import first_believable
from aeroskein.engine_state import EngineState, StageClock
from aeroskein.estimator import go_on
from aeroskein.events import Event, RegistrationState
from aeroskein.lanes import even_parts
from aeroskein.live import first_state
from aeroskein.measurements import COLUMNS, Measurements
from aeroskein.plots import Array, Ints, Plots
from aeroskein.points import FusedPoints, Product, Status
from aeroskein.publishing import element_points, element_vertical, live_points, live_state
from aeroskein.receiving import Receiver
from aeroskein.recentring import recentre
from aeroskein.references import ReferenceSampler, compare, learn_latencies
from aeroskein.registration import Registration
from aeroskein.selection import Selection
from aeroskein.settings import EngineSettings

__all__ = ["ElementRecord", "FusionEngine"]

# Elements closed in one pass: more would leave the cache, fewer would pay the fixed cost of a pass more often.
LANES: Final = 2048
# Where so many aircraft fly, elements wait so long for others, until a pass is full. [s]
MANY: Final = 1024
GATHER_S: Final = 0.5
# A pass for fewer elements than this takes no less time.
FEW: Final = 64
# Biases drift and aircraft leave their planes slowly; once a second is often enough. [s]
SLOW_PERIOD_S: Final = 1.0


@dataclass(slots=True)
class ElementRecord:
    """One closed element as the engineer's query shows it: plain numbers, see docs/messages.md."""

    content: dict[str, Any]


class FusionEngine:
    """Reports in, fused points out. Time is an argument (seconds since the epoch, UTC).

    Parameters
    ----------
    settings : EngineSettings
        Sensors and methods.
    epoch_ms : int
        Start of this service; stands in every fused point. [ms since the epoch]
    first_track_number : int
        Numbers below this have been used before.
    stopwatch_s : callable, optional
        Any running clock, read between stages for ``stages_us``; absent: nothing is measured. [s]
    """

    def __init__(
        self,
        settings: EngineSettings,
        *,
        epoch_ms: int,
        first_track_number: int = 1,
        stopwatch_s: Callable[[], float] | None = None,
    ) -> None:
        self.settings = settings
        self.epoch_ms = epoch_ms
        self.want_dispositions = False
        self._state = EngineState(settings, first_track_number)
        self._registration = Registration(settings)
        self._sampler = ReferenceSampler(len(settings.sensors))
        self._slow_s = -math.inf
        # End of the last element that was published before a restart, by address. [s since the epoch]
        self._published_until_s: dict[int, float] = {}
        self._now_s = 0.0
        self._advanced_s = -math.inf
        self._clock = StageClock(stopwatch_s)
        self._receiver = Receiver(self._state, AppliedBiases(*self._registration.table()), self._clock)

    # -- input ---------------------------------------------------------------------------------
    def receive(self, plots: Plots, *, now_s: float) -> list[Event]:
        """Take any number of reports in any order; returns live points, rejections and track changes."""
        if not len(plots):
            return []
        self._now_s = now_s
        self._clock.start()
        self._begin_block()
        plots = self._receiver.anteroom.let_in(plots, now_s)
        if not len(plots):
            return []
        return self._receiver.receive(plots, now_s, want_dispositions=self.want_dispositions)

    def _begin_block(self) -> None:
        """What has been learned is applied to reports stamped from the next full ten seconds on.

        Called first thing by whatever happens first then, so that what closes in the same moment never counts already.
        """
        state = self._state
        if state.block.begins(self._now_s):
            state.offsets.begin_block()
            state.latencies.begin_block()
            self._receiver.biases.begin_block(*self._registration.table())

    def thin_live(self, every_s: float) -> None:
        """Publish live points of one track at least this far apart, for a machine that is too slow; 0: all. [s]"""
        self._state.live.every_s = every_s

    # -- time ----------------------------------------------------------------------------------
    def advance(
        self,
        *,
        now_s: float,
        most: int | None = None,
        few_wait_s: float = 0.0,
        give_way: Callable[[list[Event]], None] | None = None,
    ) -> list[Event]:
        """Let time pass: start and close elements behind the watermark, coast, terminate.

        With ``most``, no more elements than this are closed, those that are due longest first; what is left is due at
        once, see ``next_deadline_s``. With ``few_wait_s`` a handful of elements waits so long for others: for whoever
        must not be kept from live points by closing elements all the time. [s]

        ``give_way`` is called every few milliseconds, so that live points need not wait for elements. It is given what
        has happened so far; when it has taken that out of the list and published it, it may call ``receive``. Elements
        that are being closed take no notice of what comes.
        """
        state, events = self._state, list[Event]()
        pause = go_on if give_way is None else partial(self._pause, give_way, events)
        self._now_s = self._advanced_s = now_s
        self._clock.start()
        self._begin_block()
        events += self._receive_due(now_s)
        self._start_elements(now_s)
        left = 2**62 if most is None else most
        while left > 0 and len(due := self._due(now_s, few_wait_s)):
            if len(due) > left:
                due = np.sort(due[np.argpartition(state.elements.due_s[due], left)[:left]])
            left -= len(due)
            events += self._close_all(due, pause)
        events += ageing.coast(state, now_s)
        events += self._terminate(now_s, pause)
        self._clock.lap("ageing", 1)
        if now_s - self._slow_s >= SLOW_PERIOD_S:
            self._slow_s = now_s
            pause()
            self._registration.advance(now_s=now_s)
            self._receiver.believing.moved(recentre(state))
            self._receiver.check(now_s)
            pause()
            silence.excuse(state, now_s)
            state.elements.wait_s = state.lateness.follow()
        return events

    def _pause(self, give_way: Callable[[list[Event]], None], events: list[Event]) -> None:
        """Give way, which is no part of the stage that it interrupts."""
        spent_s = self._clock.since_s()
        give_way(events)
        self._clock.start(spent_s)

    def _due(self, now_s: float, few_wait_s: float) -> Ints:
        """Slots of the elements to close now; they wait a moment for others, which makes them cheaper."""
        elements, due_s = self._state.elements, self._state.elements.due_s
        due = np.flatnonzero(elements.open & (due_s <= now_s))
        # A track that has ended meanwhile has no elements after its end, however long ago that was.
        due = due[due_s[due] <= self._state.tracks.ends_s()[due]]
        if not len(due):
            return due
        wait_s = few_wait_s if len(due) < FEW else 0.0
        if len(due) < LANES and np.count_nonzero(elements.open) >= MANY:
            wait_s = max(wait_s, GATHER_S)
        waits = now_s - due_s[due].min() < wait_s
        return due[:0] if waits else due

    def finish(self, *, now_s: float, most: int | None = None) -> list[Event]:
        """The input has ended: close open elements with what there is.

        With ``most``, those of so many tracks: to be called again until it returns no element point.
        """
        events = self._receive_due(now_s, math.inf)
        events += self.advance(now_s=now_s, most=most)
        self._start_elements(math.inf)
        elements, tracks = self._state.elements, self._state.tracks
        left = np.flatnonzero(elements.open & (elements.boundaries_s[:, 0] < tracks.newest_s))
        return events + self._close_rest(left if most is None else left[:most])

    def _receive_due(self, now_s: float, until_s: float | None = None) -> list[Event]:
        """Take in plots that have waited for the others of their scan."""
        waited = self._receiver.anteroom.due(now_s if until_s is None else until_s)
        if not len(waited):
            return []
        return self._receiver.receive(waited, now_s, want_dispositions=self.want_dispositions)

    def _terminate(self, now_s: float, pause: Callable[[], None]) -> list[Event]:
        state = self._state
        slots = ageing.ended(state, now_s)
        events: list[Event] = []
        if len(slots):
            events += self._close_rest(slots[state.elements.open[slots]], pause)
            state.elements.stop(slots)
            state.tracks.terminate(slots, now_s)
            events.append(ageing.changes(state, slots, now_s))
            if self.settings.fusion.live:
                last = np.maximum(state.live.bank.time_s[slots], state.live.published_s[slots])
                events.append(live_points(state, slots, last))
        ageing.release(state, now_s)
        return events

    def _start_elements(self, now_s: float) -> None:
        """Confirmed tracks get their first element once everything due in it so far has arrived."""
        state, settings = self._state, self.settings.fusion
        status = state.tracks.status
        known = (status == Status.CONFIRMED) | (status == Status.COASTING)  # only confirmed tracks coast
        waiting = np.flatnonzero(state.tracks.used & known & ~state.elements.open)
        if not len(waiting):
            return
        first_s = state.buffers.earliest_s(waiting)
        waiting = waiting[first_s + settings.watermark_s + settings.element_s <= now_s]
        if not len(waiting):
            return
        rings = state.buffers.rows[waiting]
        # What is younger may be here or still under way: it has no say, or the beginning would hang on the arrival.
        rings[rings[:, :, 0] > now_s - settings.watermark_s, 0] = -np.inf
        begin = first_believable(rings)
        packed = rings[np.arange(len(waiting)), begin]
        report = Measurements(slot=waiting, **{name: packed[:, i] for i, name in enumerate(COLUMNS[:-1])})
        until = self._published_until_s
        published = [until.pop(int(a), -math.inf) for a in state.tracks.label[waiting]] if until else -math.inf
        x, P = first_state(report)
        state.elements.start(waiting, report.time_s, np.broadcast_to(published, len(waiting)), x, P)
        self._restart_live(waiting[report.time_s > state.buffers.earliest_s(waiting)])

    def _restart_live(self, slots: Ints) -> None:
        """Live states of tracks that began with an outlier are made anew from what is buffered."""
        if not len(slots):
            return
        state = self._state
        reports = state.buffers.reports(slots, state.elements.settled_s[slots])
        first = np.unique(reports.slot, return_index=True)[1]
        begins = np.zeros(len(reports), dtype=np.bool_)
        begins[first] = True
        state.live.bank.time_s[slots] = -np.inf
        state.live.start(reports.take(begins))
        state.live.receive(reports, begins)

    def _close_rest(self, slots: Ints, pause: Callable[[], None] = go_on) -> list[Event]:
        """Close every element of these tracks that begins before their newest report."""
        state, events = self._state, list[Event]()
        while True:
            slots = slots[state.elements.boundaries_s[slots, 0] < state.tracks.newest_s[slots]]
            if not len(slots):
                return events
            events += self._close_all(slots, pause)

    def _close_all(self, slots: Ints, pause: Callable[[], None]) -> list[Event]:
        passes = [self._close(slots[part], pause) for part in even_parts(len(slots), LANES)]
        return [event for events in passes for event in events]

    def _close(self, slots: Ints, pause: Callable[[], None]) -> list[Event]:
        """Close one element of each track and publish it."""
        state = self._state
        self._clock.lap("elements due", 1)
        closed = state.elements.close(slots, state.buffers.rows, pause)
        self._clock.lap("estimate", len(slots))
        fused = fusion.fuse(closed, self.settings)
        state.elements.note_published(closed.slots, fused.position_m)
        window = closed.window
        accepted = window.reported & (window.time_s < closed.span_s[:, 1:].T) & (closed.estimate.reason == 0)
        master = state.masters.choose(
            closed.slots, closed.span_s[:, 1], window.time_s, window.sensor_index, window.r_ee + window.r_nn, accepted
        )
        vertical = element_vertical(state, closed)
        points = element_points(state, closed, fused, vertical, master)
        number, frame = state.tracks.number[closed.slots], state.tracks.frame[closed.slots]
        state.element_log.add(closed, number, frame, points, fused.half_width_m, fused.reason)
        self._clock.lap("element points", len(slots))
        pause()
        if self._registration.radars.any():
            trusted = self._receiver.believing.trusted(closed.slots)
            comparisons = compare(state, closed, vertical, self._sampler, self._now_s, trusted)
            if comparisons is not None:
                self._registration.update(comparisons)
                pause()
                learn_latencies(state, closed.slots, comparisons, self._registration)
            self._clock.lap("bias estimate", len(slots))
        events: list[Event] = [points]
        if self.want_dispositions:
            events.append(dispositions.of_elements(closed, fused, state.tracks))
        return events

    def next_deadline_s(self) -> float | None:
        """When ``advance`` has something to do next; None while there is no track and no plot waits."""
        state, waiting_s = self._state, self._receiver.anteroom.next_s
        active = state.tracks.active
        if not len(active):
            return waiting_s if math.isfinite(waiting_s) else None
        due = min(float(state.elements.due_s.min(initial=math.inf)), waiting_s)
        return min(due, self._advanced_s + ageing.COAST_PERIOD_S)

    @property
    def next_track_number(self) -> int:
        """The first number that has not been used; reserve ahead of it on disk."""
        return self._state.tracks.next_number

    # -- queries -------------------------------------------------------------------------------
    def tracks(self, selection: Selection) -> FusedPoints:
        """Latest live state of every matching track, terminated ones for 60 s."""
        state = self._state
        slots = np.flatnonzero(state.tracks.used & np.isfinite(state.live.bank.time_s))
        time: Array = np.maximum(state.live.bank.time_s[slots], state.live.published_s[slots])
        points = live_state(state, slots, time, np.maximum(state.seq[Product.LIVE, slots] - 1, 0))
        points.sources = np.isfinite(state.tracks.sensor_received_s[slots]).astype(np.int32)
        return points.take(selection.of_points(points))

    def reports(self, selection: Selection) -> Plots:
        """Buffered reports (at least the last 30 s) that match."""
        return self._state.reports.select(selection)

    def elements(self, label: str) -> list[ElementRecord] | None:
        """The last 20 elements of the track with this key chunk (address or ``T000123``); None: no such track."""
        state = self._state
        slot = state.tracks.find(label)
        if slot is None:
            return None
        return self.elements_until(int(state.tracks.number[slot]), math.inf)

    def elements_until(self, track_number: int, until_s: float) -> list[ElementRecord]:
        """The last 20 elements of a track, ended or not, that end by a time; see ``keep_elements``."""
        state, ids = self._state, [s.id for s in self.settings.sensors]
        log = state.element_log
        return [ElementRecord(content) for content in log.of_track(track_number, state.frames, ids, until_s)]

    def keep_elements(self) -> None:
        """Forget no element from now on: for a file that is replayed. The usual log is the last 20 of every track."""
        self._state.element_log.keep_all()

    def track_counts(self) -> dict[str, int]:
        """How many tracks are tentative, confirmed, coasting."""
        status = self._state.tracks.status[self._state.tracks.active]
        return {s.name.lower(): int((status == s).sum()) for s in Status if s != Status.TERMINATED}

    def alarms(self) -> list[str]:
        """What an operator should know now, one sentence each."""
        return [*self._registration.alarms(), *self._receiver.believing.alarms()]

    def stages_us(self) -> dict[str, float]:
        """Microseconds per report or element of every stage since the last call."""
        return self._clock.take_us()

    # -- control -------------------------------------------------------------------------------
    def registration(self) -> list[RegistrationState]:
        """The registration state of every radar."""
        return self._registration.states(self._now_s)

    def control_registration(
        self, sensor_id: str, action: Literal["freeze", "release", "reset", "set"], **values: float
    ) -> RegistrationState:
        """Freeze, release, reset or set a radar's biases; returns what is now in force."""
        return self._registration.control(sensor_id, action, now_s=self._now_s, **values)

    def control_sensor(self, sensor_id: str, on: bool) -> bool:
        """Switch a sensor's reports on or off; returns what is now in force."""
        index = self.settings.sensor_index(sensor_id)
        self._receiver.intake.sensor_on[index] = on
        return bool(self._receiver.intake.sensor_on[index])

    def lost_input(self, sensor_id: str) -> None:
        """Reports of this sensor were dropped before they came here; nobody is suspect for not being in them."""
        self._receiver.believing.lost(self.settings.sensor_index(sensor_id))

    # -- state that survives a restart ---------------------------------------------------------
    def snapshot(self) -> bytes:
        """Registration state and end of the last published element per track, as bytes."""
        state = self._state
        slots = np.flatnonzero(state.elements.open & (state.tracks.label >= 0))
        ends = state.elements.boundaries_s[slots, 0]
        until = dict(zip(state.tracks.label[slots].tolist(), ends.tolist(), strict=True))
        return snapshots.pack(self._registration.snapshot(), self._published_until_s | until)

    def restore(self, data: bytes) -> None:
        """Take a snapshot over. Raises ``SnapshotError``."""
        registration, self._published_until_s = snapshots.unpack(data)
        self._registration.restore(registration)
        self._receiver.biases.replace(*self._registration.table())
