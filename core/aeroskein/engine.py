"""FusionEngine: reports in, fused points out, without clock, I/O or logging.

The only file that knows the order of the stages:

    receive   intake -> registration -> identity -> place -> repeats -> buffers -> live filter -> live points
    advance   start of elements -> closing -> fusion -> element points -> coasting -> termination

Time is an argument; what happened comes back as events, in columns.
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from aeroskein import conversion, fusion
from aeroskein.assembly import PlaneState, assemble
from aeroskein.buffers import ReportBuffers, ring_depth
from aeroskein.closed import Closed
from aeroskein.closing import ElementTable
from aeroskein.events import Dispositions, Event, RegistrationState, Rejections, TrackChanges
from aeroskein.frames import FrameTable
from aeroskein.intake import Intake, Verdicts
from aeroskein.live import LiveProduct, first_state
from aeroskein.master_track import MasterChoice
from aeroskein.measurements import COLUMNS, Measurements
from aeroskein.plots import Array, Bools, Ints, Plots
from aeroskein.points import Flag, FusedPoints, Product, Status
from aeroskein.reasons import Reason
from aeroskein.repeats import SensorMemory, is_implausible
from aeroskein.selection import Selection
from aeroskein.settings import EngineSettings
from aeroskein.tracks import TrackTable
from aeroskein.vertical import fit_at

__all__ = ["FusionEngine"]

# Elements are closed together, not one aircraft at a time: a pass costs milliseconds however few it closes. [s]
TICK_S: Final = 0.1
# Elements closed in one pass; more would keep input waiting.
LANES: Final = 512
# Terminated tracks stay visible to queries for this long. [s]
KEEP_TERMINATED_S: Final = 60.0
# A coasting track is published this often. [s]
COAST_PERIOD_S: Final = 1.0


class FusionEngine:
    """Reports in, fused points out. Time is an argument (seconds since the epoch, UTC)."""

    def __init__(self, settings: EngineSettings, *, epoch_ms: int, first_track_number: int = 1) -> None:
        self.settings = settings
        self.epoch_ms = epoch_ms
        self.want_dispositions = False
        self._table = conversion.SensorTable(settings)
        self._intake = Intake(settings)
        self._frames = FrameTable()
        self._tracks = TrackTable(settings, first_track_number)
        capacity, sensors = self._tracks.capacity, len(settings.sensors)
        self._memory = SensorMemory(capacity, sensors)
        self._buffers = ReportBuffers(capacity, ring_depth(settings))
        self._live = LiveProduct(capacity, self._table.altitude_sigma_m)
        self._elements = ElementTable(settings, capacity)
        self._masters = MasterChoice(capacity, self._table.period_s)
        self._seq = np.zeros((len(Product), capacity), dtype=np.int64)
        self._coasted_s = np.full(capacity, -np.inf)

    # -- input ---------------------------------------------------------------------------------
    def receive(self, plots: Plots, *, now_s: float) -> list[Event]:
        """Take any number of reports in any order; returns live points, rejections and track changes."""
        if not len(plots):
            return []
        verdicts = self._intake.check(plots, now_s)
        rows = np.flatnonzero(verdicts.reason == 0)
        events: list[Event] = []
        if len(rows):
            events += self._take_in(plots.take(rows), rows, verdicts, now_s)
        events.append(Rejections(verdicts.counts(plots.sensor, len(self.settings.sensors))))
        if self.want_dispositions:
            events.append(self._dispositions(plots, verdicts))
        return events

    def _take_in(self, plots: Plots, rows: Ints, verdicts: Verdicts, now_s: float) -> list[Event]:
        """Give checked reports to their tracks, filter, and publish live."""
        known = plots.address >= 0
        verdicts.refuse(rows, ~known, Reason.UNASSOCIATED)
        plots, rows = plots.take(known), rows[known]
        if not len(plots):
            return []
        slot = self._tracks.owner(plots.address)
        located = self._locate(plots, slot)
        feasible = located.feasible
        rows = verdicts.refuse(rows, ~feasible, Reason.IMPLAUSIBLE)
        plots, located, slot = plots.take(feasible), located.take(feasible), slot[feasible]
        self._open_tracks(plots, located, slot)
        verdicts.slot[rows] = slot
        frames = self._frames.rows[self._tracks.frame[slot]]
        reports = conversion.measure(plots, located, slot, frames, self._table, self._table.time_sigma_s)
        order = np.flatnonzero(self._usable(plots, reports, rows, verdicts))
        order = order[np.lexsort((reports.time_s[order], reports.slot[order]))]
        reports, plots, rows = reports.take(order), plots.take(order), rows[order]
        room = self._buffers.add(reports, self._elements.settled_s[reports.slot])
        rows = verdicts.refuse(rows, ~room, Reason.OVERLOAD)
        reports, plots = reports.take(room), plots.take(room)
        if not len(reports):
            return []
        accepted = self._live.receive(reports, self._begin_states(reports))
        verdicts.refuse(rows, ~accepted, Reason.OUTLIER)
        return self._after_receive(plots.take(accepted), reports.take(accepted), now_s)

    def _locate(self, plots: Plots, slot: Ints) -> conversion.Located:
        """Positions of reports; a radar plot's height is its own altitude, else its track's."""
        known = slot >= 0
        at = np.where(known, slot, 0)
        altitude, height, _, _ = self._live.vertical.at(at, plots.time_s)
        frame = self._tracks.frame[at]
        have_frames = len(self._frames.rows) > 0
        offset = np.where(known, self._frames.offset_m[frame], 0.0) if have_frames else np.zeros(len(plots))
        own_offset = np.where(known, height - altitude, np.nan)
        offset = np.where(np.isnan(own_offset), offset, own_offset)
        sigma = self._frames.offset_sigma_m(frame) if have_frames else np.full(len(plots), 100.0)
        geometric = np.where(np.isnan(plots.height_m), plots.altitude_m + offset, plots.height_m)
        geometric = np.where(np.isnan(geometric) & known, height, geometric)
        nothing = np.zeros(len(self.settings.sensors))
        return conversion.locate(plots, self._table, geometric, sigma, (nothing, nothing))

    def _open_tracks(self, plots: Plots, located: conversion.Located, slot: Ints) -> None:
        """Begin a track for every address that has none; fills in ``slot``."""
        fresh = np.flatnonzero(slot < 0)
        if not len(fresh):
            return
        # The earliest report of each new address places its track.
        fresh = fresh[np.lexsort((plots.time_s[fresh], plots.address[fresh]))]
        address, first = np.unique(plots.address[fresh], return_index=True)
        capacity = self._tracks.room_for(len(address))
        if capacity > self._tracks.capacity:
            self._grow(capacity)
        new = self._tracks.open(address, np.ones(len(address), dtype=np.bool_))
        began = fresh[first]
        self._tracks.frame[new] = self._frames.near(located.lat_deg[began], located.lon_deg[began])
        for part in (self._memory, self._masters, self._live):
            part.clear(new)
        self._buffers.clear(new)
        self._seq[:, new] = 0
        self._coasted_s[new] = -np.inf
        slot[fresh] = new[np.searchsorted(address, plots.address[fresh])]

    def _grow(self, capacity: int) -> None:
        for part in (self._tracks, self._memory, self._buffers, self._live, self._elements, self._masters):
            part.grow(capacity)
        more = capacity - self._seq.shape[1]
        self._seq = np.concatenate([self._seq, np.zeros((len(Product), more), dtype=np.int64)], axis=1)
        self._coasted_s = np.concatenate([self._coasted_s, np.full(more, -np.inf)])

    def _usable(self, plots: Plots, reports: Measurements, rows: Ints, verdicts: Verdicts) -> Bools:
        """Refuse implausible, duplicate, stale and late reports; returns which remain."""
        slot = reports.slot
        bank = self._live.bank
        known = np.isfinite(bank.time_s[slot])
        x = bank.rows[slot][:, [0, 3, 6, 9]]  # the steady model's position and velocity
        elapsed = np.where(known, reports.time_s - bank.time_s[slot], 0.0)
        away = np.hypot(reports.east_m - x[:, 0], reports.north_m - x[:, 1])
        refused = {Reason.IMPLAUSIBLE: known & is_implausible(away, elapsed)}
        radar = self._table.is_radar[plots.sensor] & np.isfinite(plots.range_m)
        place = np.stack(
            [np.where(radar, plots.range_m, plots.lat_deg), np.where(radar, plots.azimuth_deg, plots.lon_deg)], axis=1
        )
        speed = np.where(known, np.hypot(x[:, 2], x[:, 3]), plots.ground_speed_mps)
        duplicate, stale, behind = self._memory.compare(slot, plots.sensor, plots.time_s, place, speed)
        if behind.any():
            at = np.flatnonzero(behind)
            duplicate[at] |= self._buffers.holds(reports.take(at))
        refused[Reason.DUPLICATE] = duplicate
        refused[Reason.STALE] = stale
        refused[Reason.LATE] = reports.time_s <= self._elements.settled_s[slot]
        usable = np.ones(len(rows), dtype=np.bool_)
        for reason, where in refused.items():
            verdicts.reason[rows[where & usable & (verdicts.reason[rows] == 0)]] = reason
            usable &= ~where
        return usable

    def _begin_states(self, reports: Measurements) -> Bools:
        """Live states of tracks whose first usable report is here; returns which reports those are."""
        begins = np.isneginf(self._live.bank.time_s[reports.slot])
        if begins.any():
            first = np.zeros(len(reports), dtype=np.bool_)
            first[np.unique(reports.slot, return_index=True)[1]] = True
            begins &= first
            self._live.start(reports.take(begins))
        return begins

    def _after_receive(self, plots: Plots, reports: Measurements, now_s: float) -> list[Event]:
        """Identity, status and counts of tracks that got reports; their live points."""
        tracks, slot = self._tracks, reports.slot
        sensor = plots.sensor.astype(np.int64)
        np.add.at(tracks.reports, slot, 1)
        np.maximum.at(tracks.received_s, slot, plots.received_s)
        np.maximum.at(tracks.newest_s, slot, reports.time_s)
        np.maximum.at(tracks.sensor_received_s, (slot, sensor), plots.received_s)
        said = plots.mode_a >= 0
        tracks.mode_a[slot[said]] = plots.mode_a[said]
        said = plots.callsign != b""
        tracks.callsign[slot[said]] = plots.callsign[said]
        both = np.isfinite(plots.altitude_m) & np.isfinite(plots.height_m)
        if both.any():
            self._frames.learn_offset(tracks.frame[slot[both]], (plots.height_m - plots.altitude_m)[both])
        slots = np.unique(slot)
        changed = self._confirm(slots, now_s)
        events: list[Event] = [changed] if changed is not None else []
        if self.settings.fusion.live:
            time = np.maximum(self._live.bank.time_s[slots], self._live.published_s[slots])
            ahead = time > self._live.published_s[slots]
            if ahead.any():
                events.append(self._live_points(slots[ahead], time[ahead]))
        return events

    def _confirm(self, slots: Ints, now_s: float) -> TrackChanges | None:
        """Tracks with enough reports are confirmed; coasting ones are back. Also announces new ones."""
        tracks = self._tracks
        before = tracks.status[slots]
        new = tracks.reports[slots] > 0
        enough = tracks.reports[slots] >= self.settings.tracks.confirm_reports
        now = np.where(enough, Status.CONFIRMED, Status.TENTATIVE).astype(np.uint8)
        tracks.status[slots] = now
        changed = new & (now != before)
        return self._changes(slots[changed], now_s) if changed.any() else None

    def _changes(self, slots: Ints, now_s: float) -> TrackChanges:
        t = self._tracks
        return TrackChanges(t.number[slots], t.address[slots], t.status[slots], np.full(len(slots), now_s))

    # -- products ------------------------------------------------------------------------------
    def _live_points(self, slots: Ints, time_s: Array) -> FusedPoints:
        """One live point per track at the given times; counts since the last one begin anew."""
        live, tracks = self._live, self._tracks
        live.published_s[slots] = time_s
        points = self._live_state(slots, time_s, self._next_seq(Product.LIVE, slots))
        live.sources[slots] = 0
        live.rejected[slots] = 0
        coasting = tracks.status[slots] == Status.COASTING
        points.flags[coasting] |= np.uint16(Flag.COASTED)
        return points

    def _live_state(self, slots: Ints, time_s: Array, seq: Ints) -> FusedPoints:
        live, tracks = self._live, self._tracks
        n = len(slots)
        x, P = live.state_at(slots, time_s)
        altitude, height, rate, _ = live.vertical.at(slots, time_s)
        state = PlaneState(time_s, x[:4], P[[0, 1, 7]], P[[12, 13, 17]], altitude, height, rate)
        return assemble(
            Product.LIVE, slots, state, tracks, self._frames,
            seq=seq,
            element=np.full(n, -1, dtype=np.int64),
            span_s=np.full((n, 2), np.nan),
            master=self._masters.master[slots],
            sources=live.sources[slots],
            rejected=live.rejected[slots],
            input_received_s=tracks.received_s[slots],
            status=tracks.status[slots],
            flags=tracks.flags[slots],
        )  # fmt: skip

    def _next_seq(self, product: Product, slots: Ints) -> Ints:
        seq = self._seq[product, slots]
        self._seq[product, slots] += 1
        return seq

    def advance(self, *, now_s: float) -> list[Event]:
        """Let time pass: start and close elements behind the watermark, coast, terminate."""
        events: list[Event] = []
        self._start_elements(now_s)
        while True:
            due = np.flatnonzero(self._elements.open & (self._elements.due_s <= now_s))
            if not len(due):
                break
            for part in np.array_split(due, math.ceil(len(due) / LANES)):
                events += self._close(part)
        events += self._coast(now_s)
        events += self._terminate(now_s)
        return events

    def finish(self, *, now_s: float) -> list[Event]:
        """The input has ended: close open elements with what there is."""
        events = self.advance(now_s=now_s)
        self._start_elements(np.inf)
        events += self._close_rest(np.flatnonzero(self._elements.open))
        return events

    def _close_rest(self, slots: Ints) -> list[Event]:
        """Close every element of these tracks that begins before their newest report."""
        events: list[Event] = []
        while True:
            slots = slots[self._elements.boundaries_s[slots, 0] < self._tracks.newest_s[slots]]
            if not len(slots):
                return events
            for part in np.array_split(slots, math.ceil(len(slots) / LANES)):
                events += self._close(part)

    def _start_elements(self, now_s: float) -> None:
        """Confirmed tracks get their first element once everything due in it so far has arrived."""
        tracks, fusion_settings = self._tracks, self.settings.fusion
        waiting = np.flatnonzero(tracks.used & (tracks.status == Status.CONFIRMED) & ~self._elements.open)
        if not len(waiting):
            return
        first = self._buffers.earliest_s(waiting)
        ready = first + fusion_settings.watermark_s + fusion_settings.element_s <= now_s
        waiting, first = waiting[ready], first[ready]
        if not len(waiting):
            return
        rings = self._buffers.rows[waiting]
        at = np.where(np.isneginf(rings[:, :, 0]), np.inf, rings[:, :, 0]).argmin(axis=1)
        packed = rings[np.arange(len(waiting)), at]
        report = Measurements(slot=waiting, **{name: packed[:, i] for i, name in enumerate(COLUMNS[:-1])})
        x, P = first_state(report)
        self._elements.start(waiting, report.time_s, np.full(len(waiting), -np.inf), x, P)

    def _close(self, slots: Ints) -> list[Event]:
        """Close one element of each track and publish it."""
        closed = self._elements.close(slots, self._buffers.rows)
        fused = fusion.fuse(closed, self.settings)
        window = closed.window
        upto = (window.kind == 1) & (window.time_s < closed.span_s[:, 1])
        master = self._masters.choose(
            closed.slots, closed.span_s[:, 1], window.time_s, window.sensor_index, window.r_ee + window.r_nn,
            upto & (closed.estimate.reason == 0),
        )  # fmt: skip
        points = self._element_points(closed, fused, master)
        events: list[Event] = [points]
        if self.want_dispositions:
            events.append(self._element_dispositions(closed, fused))
        return events

    def _element_points(self, closed: Closed, fused: fusion.Fused, master: NDArray[np.int16]) -> FusedPoints:
        slots, window = closed.slots, closed.window
        n = len(slots)
        sensor = window.sensor_index
        sources = np.stack(
            [(fused.accepted & (sensor == s)).sum(axis=0) for s in range(len(self.settings.sensors))], axis=1
        ).astype(np.int32)
        x = np.empty((4, n))
        x[:2] = fused.position_m
        if fused.velocity_mps is not None and fused.velocity_cov is not None:
            x[2:], velocity_cov = fused.velocity_mps, fused.velocity_cov
        else:
            live_x, live_P = self._live.state_at(slots, fused.time_s)
            x[2:], velocity_cov = live_x[2:4], live_P[[12, 13, 17]]
            if self.settings.fusion.mode == "patent":
                velocity_cov = np.full((3, n), np.nan)
        altitude, height, rate = self._vertical(closed)
        state = PlaneState(fused.time_s, x, fused.position_cov, velocity_cov, altitude, height, rate)
        flags = self._tracks.flags[slots].copy()
        flags[sources.sum(axis=1) == 0] |= np.uint16(Flag.COASTED)
        return assemble(
            Product.ELEMENT, slots, state, self._tracks, self._frames,
            seq=self._next_seq(Product.ELEMENT, slots),
            element=closed.index,
            span_s=closed.span_s,
            master=master,
            sources=sources,
            rejected=(fused.reason > 0).sum(axis=0).astype(np.int32),
            input_received_s=np.full(n, np.nan),
            status=self._tracks.status[slots],
            flags=flags,
        )  # fmt: skip

    def _vertical(self, closed: Closed) -> tuple[Array, Array, Array]:
        """Altitude, height and vertical rate at the centres, from the reports around them."""
        window, vertical = closed.window, self._live.vertical
        value = vertical.channel(closed.slots, window.altitude_m, window.height_m)
        value = np.where(window.kind == 1, value, np.nan)
        rate = np.where(window.kind == 1, window.vertical_rate_mps, np.nan)
        sigma = self._table.altitude_sigma_m[window.sensor_index]
        fitted, slope, _ = fit_at(closed.centre_s, window.time_s, value, rate, sigma)
        altitude, height = vertical.split(closed.slots, fitted)
        unknown = np.isnan(fitted)
        if unknown.any():
            a, h, r, _ = vertical.at(closed.slots[unknown], closed.centre_s[unknown])
            altitude[unknown], height[unknown], slope[unknown] = a, h, r
        return altitude, height, slope

    def _dispositions(self, plots: Plots, verdicts: Verdicts) -> Dispositions:
        given = verdicts.slot >= 0
        at = np.where(given, verdicts.slot, 0)
        return Dispositions(
            plots.sensor, plots.time_s, plots.received_s, plots.address,
            np.where(given, self._tracks.number[at], -1),
            np.where(given, self._tracks.label[at], -1).astype(np.int32),
            np.full(len(plots), -1, dtype=np.int64), verdicts.reason,
        )  # fmt: skip

    def _element_dispositions(self, closed: Closed, fused: fusion.Fused) -> Dispositions:
        event, lane = np.nonzero(closed.in_span())
        slots, w = closed.slots[lane], closed.window
        return Dispositions(
            w.sensor_index[event, lane].astype(np.int16), w.time_s[event, lane], w.received_s[event, lane],
            self._tracks.address[slots], self._tracks.number[slots], self._tracks.label[slots],
            closed.index[lane], fused.reason[event, lane],
        )  # fmt: skip

    # -- life cycle ----------------------------------------------------------------------------
    def _coast(self, now_s: float) -> list[Event]:
        """Tracks that miss their reports coast: flagged, and published every second at the predicted time."""
        tracks = self._tracks
        active = tracks.active
        confirmed = active[tracks.status[active] >= Status.CONFIRMED]
        if not len(confirmed):
            return []
        silent = now_s - tracks.received_s[confirmed]
        coasting = confirmed[silent > tracks.expected_wait_s(confirmed, now_s)]
        fresh = coasting[tracks.status[coasting] != Status.COASTING]
        events: list[Event] = []
        if len(fresh):
            tracks.status[fresh] = Status.COASTING
            events.append(self._changes(fresh, now_s))
        again = coasting[now_s - self._coasted_s[coasting] >= COAST_PERIOD_S]
        if len(again) and self.settings.fusion.live:
            self._coasted_s[again] = now_s
            predicted = self._live.bank.time_s[again] + now_s - tracks.received_s[again]
            ahead = predicted > self._live.published_s[again]
            if ahead.any():
                events.append(self._live_points(again[ahead], predicted[ahead]))
        return events

    def _terminate(self, now_s: float) -> list[Event]:
        """Tracks without reports for long end with one last point; old ended ones give their slots back."""
        tracks = self._tracks
        active = tracks.active
        ended = active[now_s - tracks.received_s[active] > self.settings.tracks.terminate_s]
        events: list[Event] = []
        if len(ended):
            events += self._close_rest(ended[self._elements.open[ended]])
            self._elements.stop(ended)
            tracks.terminate(ended, now_s)
            events.append(self._changes(ended, now_s))
            if self.settings.fusion.live:
                last = np.maximum(self._live.bank.time_s[ended], self._live.published_s[ended])
                events.append(self._live_points(ended, last))
        old = np.flatnonzero(tracks.used & (now_s - tracks.terminated_s > KEEP_TERMINATED_S))
        if len(old):
            tracks.release(old)
        return events

    def next_deadline_s(self) -> float | None:
        """When ``advance`` has something to do next; None while there is no track."""
        if not self._tracks.used.any():
            return None
        due = float(self._elements.due_s.min(initial=math.inf))
        active = self._tracks.active
        if len(active):
            due = min(due, float(self._tracks.received_s[active].min()) + COAST_PERIOD_S)
        return due

    @property
    def next_track_number(self) -> int:
        """The first number that has not been used; reserve ahead of it on disk."""
        return self._tracks.next_number

    # -- queries -------------------------------------------------------------------------------
    def tracks(self, selection: Selection) -> FusedPoints:
        """Latest live state of every matching track, terminated ones for 60 s."""
        slots = np.flatnonzero(self._tracks.used & np.isfinite(self._live.bank.time_s))
        time = np.maximum(self._live.bank.time_s[slots], self._live.published_s[slots])
        points = self._live_state(slots, time, np.maximum(self._seq[Product.LIVE, slots] - 1, 0))
        points.sources = np.isfinite(self._tracks.sensor_received_s[slots]).astype(np.int32)
        return points.take(selection.of_points(points))

    def track_counts(self) -> dict[str, int]:
        """How many tracks are tentative, confirmed, coasting."""
        status = self._tracks.status[self._tracks.active]
        return {s.name.lower(): int((status == s).sum()) for s in Status if s != Status.TERMINATED}

    def alarms(self) -> list[str]:
        """What an operator should know now, one sentence each."""
        return []

    def registration(self) -> list[RegistrationState]:
        """The registration state of every radar."""
        return []

    def control_sensor(self, sensor_id: str, on: bool) -> bool:
        """Switch a sensor's reports on or off; returns what is now in force."""
        index = self.settings.sensor_index(sensor_id)
        self._intake.sensor_on[index] = on
        return bool(self._intake.sensor_on[index])

    def control_registration(
        self, sensor_id: str, action: Literal["freeze", "release", "reset", "set"], **values: float
    ) -> RegistrationState:
        """Freeze, release, reset or set a radar's biases; returns what is now in force."""
        raise NotImplementedError
