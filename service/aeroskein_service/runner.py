"""The one thread that runs the engine: takes what has arrived, fuses, publishes, answers questions, counts.

Micro-batches by arrival: whatever is queued is worked on at once, so light traffic has no delay; under load the worker
lingers a little before it takes the next batch, because a larger batch costs less per report. Elements are closed a few
hundred at a time with input taken in between, so that neither waits for the other. Nothing else touches the engine.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from math import inf
from time import monotonic, perf_counter_ns
from typing import Any, Final

import numpy as np
import structlog

from aeroskein.engine import FusionEngine
from aeroskein.events import Dispositions, Event, RegistrationState, Rejections, TrackChanges
from aeroskein.plots import Plots
from aeroskein.points import FusedPoints, Product, Status
from aeroskein.reasons import Reason
from aeroskein_service.codec import OpenBatch, gather, open_batch
from aeroskein_service.complaints import Complaints
from aeroskein_service.inbox import Arrival, Inbox
from aeroskein_service.messages import VERSION
from aeroskein_service.pace import TURN_BYTES, Pace
from aeroskein_service.publisher import Outlet
from aeroskein_service.queries import Desk
from aeroskein_service.stage_clock import StageClock
from aeroskein_service.state_store import StateStore
from aeroskein_service.status import Counters, is_fresh, sensor_alarms

__all__ = ["Runner"]

# Elements of many aircraft close together, which costs a fraction of closing them one by one: once in so long, so many
# at a time, more where the worker is busy. Input is taken between two of these and, where it has waited, in the midst
# of one; a handful waits a little longer.
TICK_S: Final = 0.25
ELEMENTS, ELEMENTS_WHEN_BUSY = 1024, 2048
FEW_WAIT_S: Final = 0.5
STATUS_S: Final = 1.0
REGISTRATION_S: Final = 5.0  # every radar's state goes out at least every ten seconds, so twice as often
SNAPSHOT_S: Final = 10.0
LOGGED_CHANGES: Final = 20  # more track changes than this in one turn become one line
NO_PLOTS: Final = Plots.of(0)
GATHER_S: Final = 1.0  # sensors repeat what is in their caches within this; elements begun earlier would lack some
DRAIN_S: Final = 1.0  # what is queued at the end is worked on for this long, the rest counts as overload
FINISH_S: Final = 2.5  # and then open elements are closed for this long


class Runner:
    """The worker thread.

    Parameters
    ----------
    engine, inbox, outlet, desk, store, counters, stages
        What it works with.
    instance : str
        This service's name.
    patience_s : float
        Input that waits longer is an overload. [s]
    alarms : callable
        Sentences from outside the worker: router, other instances, unknown sensors.
    clock : callable
        Gives the time. [s since the epoch]
    """

    def __init__(
        self,
        engine: FusionEngine,
        inbox: Inbox,
        outlet: Outlet,
        desk: Desk,
        store: StateStore,
        counters: Counters,
        stages: StageClock,
        *,
        instance: str,
        patience_s: float,
        alarms: Callable[[], Iterable[str]],
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._engine, self._inbox, self._outlet, self._desk = engine, inbox, outlet, desk
        self._store, self._counters, self._stages = store, counters, stages
        self._instance, self._alarms, self._clock = instance, alarms, clock
        self._sensors = engine.settings.sensors
        self._started_s = clock()
        # When something is due, on a clock that is never set.
        start_s = monotonic()
        self._next_status_s = self._next_registration_s = self._next_snapshot_s = start_s
        self._advance_from_s = self._next_advance_s = self._take_from_s = start_s
        self._pace = Pace(patience_s)
        self._delay_s = self._thinning_s = 0.0
        # What input has taken in the midst of a pass [s], and bytes of input in this turn.
        self._given_s, self._taken = 0.0, 0
        self._log = structlog.get_logger("aeroskein.runner")
        self._complaints = Complaints(self._log)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._dropped = list(inbox.dropped)
        # When the engine had something to do next, after the last turn.
        self._deadline_s = inf
        self.status: dict[str, Any] | None = None
        self.turned_s = start_s
        self.failure: BaseException | None = None
        self.ended = threading.Event()

    def start(self) -> None:
        """Begin to work; the first elements wait until sensors have repeated what went before."""
        self._advance_from_s = self._next_advance_s = monotonic() + GATHER_S
        self._thread.start()

    def stop(self) -> None:
        """Take nothing new, finish what is there, publish the last points and the last status; waits for it."""
        self._inbox.close()
        self._stopping.set()
        self._inbox.wake()
        self._thread.join()

    @property
    def hears(self) -> bool:
        """Whether any sensor has sent lately, as the last status says; for other threads."""
        status, now_s = self.status, self._clock()
        return status is not None and any(
            is_fresh(sensor, status["sensors"][sensor.id]["last_report_s"], now_s) for sensor in self._sensors
        )

    @property
    def _elements(self) -> int:
        """How many element points have been published."""
        return self._counters.points[Product.ELEMENT]

    # -- the thread ----------------------------------------------------------------------------------------------
    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                self._wait()
                self._relieve()
                self._turn(self._inbox.take(TURN_BYTES))
            self._drain()
        except BaseException as error:
            self.failure = error
            self._log.exception("worker_failed")
        finally:
            self.ended.set()

    def _wait(self) -> None:
        due_s = min(self._next_advance_s, self._next_status_s) - monotonic()
        news = self._inbox.wait(min(max(due_s, 0.0), STATUS_S))
        # Rest while input gathers, but not when elements or the status are due.
        linger_s = min(self._take_from_s, self._next_advance_s, self._next_status_s) - monotonic()
        if news and linger_s > 0.0:
            self._stopping.wait(linger_s)

    def _relieve(self) -> None:
        """Give up what cannot be done in time: live points first, then the oldest input of the loudest sensor."""
        waited_s = self._waited_s()
        thinning_s = self._pace.thinning_s(waited_s, monotonic())
        if thinning_s != self._thinning_s:
            self._thinning_s = thinning_s
            self._engine.thin_live(thinning_s)
            self._log.warning("live_points_thinned", every_s=thinning_s, waited_s=round(waited_s, 3))
        keep = self._pace.excess(waited_s)
        if keep is not None:
            self._inbox.shed(keep)
        dropped = list(self._inbox.dropped)
        for sensor, now, before in zip(self._sensors, dropped, self._dropped, strict=True):
            if now > before:
                self._engine.lost_input(sensor.id)
        self._dropped = dropped

    def _waited_s(self) -> float:
        """How long the oldest input that is not worked on yet has waited. [s]"""
        oldest_s = self._inbox.oldest_s()
        return 0.0 if oldest_s is None else self._clock() - oldest_s

    def _turn(self, arrivals: Sequence[Arrival]) -> None:
        self.turned_s = began_s = monotonic()
        now_s = self._clock()
        self._engine.want_dispositions = self._outlet.dispositions_wanted
        self._receive(arrivals, now_s)
        self._pace.took_in(monotonic() - began_s, now_s - self._deadline_s)
        if monotonic() >= self._next_advance_s:
            self._advance()
        # The engine's deadline moves with its input, so only its absence counts: without tracks nothing is due.
        deadline_s = self._engine.next_deadline_s()
        self._deadline_s = inf if deadline_s is None else deadline_s
        self._next_advance_s = inf if deadline_s is None else self._advance_from_s
        for question in self._inbox.questions():
            self._desk.answer(question, now_s=now_s)
        if monotonic() >= self._next_status_s:
            self._every_second(now_s)
        ended_s = monotonic()
        self._pace.worked(began_s, ended_s, self._taken)
        self._taken = 0
        self._take_from_s = ended_s + self._pace.linger_s

    def _receive(self, arrivals: Sequence[Arrival], now_s: float) -> None:
        plots = self._decode(arrivals)
        if len(plots):
            with self._stages.measure("engine", len(plots)):
                events = self._engine.receive(plots, now_s=now_s)
            self._publish(events)
        if arrivals:
            self._delay_s = max(self._delay_s, self._clock() - arrivals[0].received_s)
        self._taken += sum(len(arrival.payload) for arrival in arrivals)

    def _advance(self) -> None:
        """Let time pass while elements may come before input, for a tick at most; what is then still due comes next."""
        began_s = monotonic()
        most = ELEMENTS_WHEN_BUSY if self._pace.busy else ELEMENTS
        more = True
        while more and monotonic() - began_s < TICK_S and self._pace.may_close(self._waited_s()):
            start_s, before, self._given_s = monotonic(), self._elements, 0.0
            self._publish(
                self._engine.advance(now_s=self._clock(), most=most, few_wait_s=FEW_WAIT_S, give_way=self._give_way)
            )
            closed = self._elements - before
            spent_s = monotonic() - start_s - self._given_s
            self._stages.add("advance", int(1e9 * spent_s), closed)
            self._pace.closed(spent_s)
            more = closed >= most
        self._advance_from_s = began_s if more else began_s + TICK_S

    def _give_way(self, events: list[Event]) -> None:
        """Between the rounds of closing elements: input that has waited long enough, after what came out before it."""
        if self._given_s > TICK_S or self._waited_s() <= self._pace.patience_while_closing_s:
            return
        began_s = monotonic()
        self._publish(events)
        events.clear()
        now_s = self._clock()
        self._receive(self._inbox.take(TURN_BYTES), now_s)
        spent_s = monotonic() - began_s
        self._given_s += spent_s
        self._pace.took_in(spent_s, now_s - self._deadline_s)

    def _drain(self) -> None:
        ends_s = monotonic() + DRAIN_S
        while (arrivals := self._inbox.take(TURN_BYTES)) and monotonic() < ends_s:
            self._turn(arrivals)
        for arrival in arrivals:
            self._counters.reject(arrival.sensor, Reason.OVERLOAD)
        for question in self._inbox.questions():
            question.refuse("the service is stopping")
        self._finish()
        self._every_second(self._clock(), last=True)

    def _finish(self) -> None:
        """Close what is open, as far as time allows: an end that takes longer is ended by force."""
        ends_s = monotonic() + FINISH_S
        before = -1
        while before != self._elements and monotonic() < ends_s:
            before = self._elements
            self._publish(self._engine.finish(now_s=self._clock(), most=ELEMENTS))
        if before != self._elements:
            self._log.warning("elements_left_open", why=f"closing them all takes more than {FINISH_S:g} s")

    # -- in ------------------------------------------------------------------------------------------------------
    def _decode(self, arrivals: Sequence[Arrival]) -> Plots:
        if not arrivals:
            return NO_PLOTS
        start_ns = perf_counter_ns()
        opened = [(arrival, batch) for arrival in arrivals if (batch := self._open(arrival)) is not None]
        gathered = gather(
            [batch for _, batch in opened],
            sensors=[arrival.sensor for arrival, _ in opened],
            received_s=[arrival.received_s for arrival, _ in opened],
        )
        for (sensor, reason), many in gathered.rejected.items():
            self._counters.reject(sensor, reason, many)
        plots = gathered.plots
        self._stages.add("decode", perf_counter_ns() - start_ns, len(plots))
        if len(plots):
            self._counters.see(plots)
        return plots

    def _open(self, arrival: Arrival) -> OpenBatch | None:
        """One batch, whose faults are counted; None where it came before."""
        sensor, counters = arrival.sensor, self._counters
        counters.batches[sensor] += 1
        batch = open_batch(arrival.payload, arrival.encoding, sensor_id=self._sensors[sensor].id, packed=True)
        epoch, seq = batch.epoch, batch.seq
        # A batch that is rejected for its content still came: it leaves no hole.
        if epoch is not None and seq is not None and not counters.sequences[sensor].take(arrival.key, epoch, seq):
            counters.reject(sensor, Reason.DUPLICATE_BATCH)
            return None
        for reason, many in batch.rejected.items():
            counters.reject(sensor, reason, many)
        if batch.error is not None:
            self._complaints.warn("batch_rejected", sensor=self._sensors[sensor].id, why=batch.error)
        return batch

    # -- out -----------------------------------------------------------------------------------------------------
    def _publish(self, events: Iterable[Event]) -> None:
        if not self._store.covers(self._engine.next_track_number):
            self._store.reserve_now(self._engine.next_track_number)
        for event in events:
            if isinstance(event, FusedPoints):
                if event.product is Product.ELEMENT:
                    self._store.note_published(event)
                self._outlet.points(event, published_s=self._clock())
                self._counters.points[event.product] += len(event)
            elif isinstance(event, Rejections):
                self._counters.reports += event.counts
            elif isinstance(event, Dispositions):
                self._outlet.dispositions(event)
            elif isinstance(event, RegistrationState):
                self._outlet.registration(event)
            else:
                self._log_changes(event)

    def _log_changes(self, changes: TrackChanges) -> None:
        if len(changes.status) > LOGGED_CHANGES:
            counts = np.bincount(changes.status, minlength=len(Status)).tolist()
            self._log.info("tracks_changed", **{s.name.lower(): counts[s] for s in Status if counts[s]})
            return
        for number, address, status in zip(
            changes.track_number.tolist(), changes.address.tolist(), changes.status.tolist(), strict=True
        ):
            self._log.info(
                f"track_{Status(status).name.lower()}",
                track_number=number,
                address=f"{address:06X}" if address >= 0 else None,
            )

    # -- every second --------------------------------------------------------------------------------------------
    def _every_second(self, now_s: float, *, last: bool = False) -> None:
        self._next_status_s = monotonic() + STATUS_S
        if last or monotonic() >= self._next_registration_s:
            self._next_registration_s = monotonic() + REGISTRATION_S
            for state in self._engine.registration():
                self._outlet.registration(state)
        self._keep()
        self.status = self._make_status(now_s)
        self._outlet.status(self.status)
        self._delay_s = 0.0

    def _keep(self) -> None:
        """Reserve numbers ahead every second; a snapshot now and then, the journal covers the time between."""
        snapshot = None
        if monotonic() >= self._next_snapshot_s and self._store.wants_snapshot():
            self._next_snapshot_s = monotonic() + SNAPSHOT_S
            snapshot = self._engine.snapshot()
        self._store.keep(self._engine.next_track_number, snapshot)

    def _make_status(self, now_s: float) -> dict[str, Any]:
        before = {} if self.status is None else self.status["sensors"]
        self._counters.drop(self._inbox.dropped)
        sensors = self._counters.per_sensor(self._inbox.depths(), self._inbox.dropped)
        alarms = [*self._engine.alarms(), *self._alarms()]
        if self._thinning_s:
            alarms.append(f"overloaded: live points of one track come {self._thinning_s:g} s apart at least")
        alarms += sensor_alarms(self._sensors, sensors, before, now_s=now_s, started_s=self._started_s)
        return {
            "version": VERSION,
            "instance": self._instance,
            "time_s": now_s,
            "started_s": self._started_s,
            "sensors": sensors,
            "tracks": self._engine.track_counts(),
            "points": {product.name.lower(): count for product, count in self._counters.points.items()},
            "stages_us": self._engine.stages_us() | self._stages.take_us(),
            "publish_delay_s": self._delay_s,
            "alarms": alarms,
        }
