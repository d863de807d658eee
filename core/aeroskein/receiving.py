"""Receiving: what happens to reports between their arrival and the live point, in order.

intake -> calibration -> place -> identity -> repeats -> buffers -> live filter -> track status -> live points
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aeroskein import ageing, conversion, dispositions
from aeroskein.anteroom import Anteroom
from aeroskein.applied_biases import AppliedBiases
from aeroskein.believing import LIVE_PERIODS, Believing
from aeroskein.blind_plots import steer
from aeroskein.engine_state import EngineState, StageClock
from aeroskein.events import Event, Rejections
from aeroskein.identity import INITIATED_SIGMA_MPS, Identity, Named
from aeroskein.intake import Batch, Intake, Verdicts
from aeroskein.lanes import by_flight_and_time, continues
from aeroskein.measurements import Measurements
from aeroskein.plots import ON_GROUND, Array, Bools, Ints, Plots, columns_of
from aeroskein.points import Flag
from aeroskein.publishing import live_points
from aeroskein.reasons import Reason
from aeroskein.repeats import is_implausible

__all__ = ["Receiver"]


class Receiver:
    """Takes reports in; the engine owns what it works on."""

    def __init__(self, state: EngineState, biases: AppliedBiases, clock: StageClock) -> None:
        self.anteroom = Anteroom(state.sensors.is_radar)
        self.intake = Intake(state.settings)
        self.biases = biases
        self.believing = Believing(state)
        self.identity = Identity(state, biases, self.believing.clear)
        self._state = state
        self._clock = clock
        self._is_adsb: Bools = np.array([s.kind == "adsb" for s in state.settings.sensors], dtype=np.bool_)

    def receive(self, plots: Plots, now_s: float, *, want_dispositions: bool) -> list[Event]:
        """Take reports in whose turn it is; returns live points, track changes, rejections and dispositions."""
        # Against the clock at its arrival: what a report waited for its turn since is not its fault.
        verdicts = self.intake.check(plots, np.fmin(plots.received_s, now_s))
        rows = (verdicts.reason == 0).nonzero()[0]
        self._clock.lap("intake", len(plots))
        events = self._take_in(plots, rows, verdicts, now_s) if len(rows) else []
        events.append(Rejections(verdicts.counts(plots.sensor, len(self._state.settings.sensors))))
        if want_dispositions:
            events.append(dispositions.of_batch(plots, verdicts, self._state.tracks))
        return events

    def _take_in(self, plots: Plots, rows: Ints, verdicts: Verdicts, now_s: float) -> list[Event]:
        """Give checked reports to their tracks, filter, and publish live."""
        state = self._state
        batch = self._placed(plots if len(rows) == len(plots) else plots.take(rows), rows)
        state.reports.add(now_s, batch.raw, batch.located.lat_deg, batch.located.lon_deg)
        batch = batch.without(~batch.located.feasible, Reason.IMPLAUSIBLE, verdicts)
        self._clock.lap("place", len(rows))
        batch, named = self.identity.assign(batch, verdicts, now_s)
        verdicts.slot[batch.rows] = batch.slot
        self._clock.lap("identity", len(rows))
        batch = batch.without(batch.plots.time_s <= state.elements.late_s[batch.slot], Reason.LATE, verdicts)
        reports = self._measured(batch)
        # Registration compares ranges: what may be another aircraft's has none.
        if len(named.unsure):
            reports.range_m[_among(batch.rows, named.unsure)] = np.nan
        kept = self._unrepeated(batch, reports, named.given, verdicts)
        kept = kept[by_flight_and_time(batch.slot[kept], batch.plots.time_s[kept])]
        if len(kept) < len(batch) or (kept[1:] < kept[:-1]).any():
            batch, reports = batch.take(kept), reports.take(kept)
        _give_velocity(reports, named)
        # Before any gate: what a gate refuses may be what contradicts the own positions.
        self.believing.note(batch, reports, _among(batch.rows, named.unsure), now_s)
        room = state.buffers.add(reports, state.elements.settled_s[batch.slot])
        if not room.all():
            batch, reports = batch.without(~room, Reason.OVERLOAD, verdicts), reports.take(room)
        self._clock.lap("buffer", len(rows))
        if not len(batch):
            return [*named.renamed]
        begins = self._begin_states(reports)
        accepted = state.live.receive(reports, begins)
        steer(state, reports.slot)
        self._clock.lap("live", len(rows))
        fresh = reports.slot[begins]
        if not accepted.all():
            batch, reports = batch.without(~accepted, Reason.OUTLIER, verdicts), reports.take(accepted)
        return [*named.renamed, *self._after(batch, reports, fresh, now_s)]

    def check(self, now_s: float) -> None:
        """What is worth doing once a second: judge own positions, and say which tracks rest on unsure radars."""
        self.believing.check(now_s)
        tracks, period_s = self._state.tracks, self._state.sensors.period_s
        active = tracks.active
        fresh = now_s - tracks.sensor_received_s[active] <= LIVE_PERIODS * period_s
        unsure = (fresh & self.biases.uncertain).any(axis=1)
        flag = np.uint16(Flag.BIAS_UNCERTAIN)
        tracks.flags[active] = np.where(unsure, tracks.flags[active] | flag, tracks.flags[active] & ~flag)

    def _placed(self, raw: Plots, rows: Ints) -> Batch:
        """Correct, look up and locate reports; a radar plot's height is its own altitude, else its track's."""
        state = self._state
        before = state.block.before(raw.time_s)
        is_radar = state.sensors.is_radar[raw.sensor]
        plots = self.biases.correct(raw, before, is_radar.nonzero()[0])
        slot = state.tracks.owner(plots.address)
        plots = self._without_latency(plots, slot, before)
        height, sigma = plots.height_m, np.zeros(len(plots))
        # Own positions with their own height need nobody else's.
        asks = (is_radar | np.isnan(height)).nonzero()[0]
        if len(asks):
            offset, sigma[asks] = state.offsets.applied(
                slot[asks], before[asks], lambda some: conversion.rough_place(plots, state.sensors, asks[some])
            )
            height = height.copy()
            height[asks] = np.where(np.isnan(height[asks]), plots.altitude_m[asks] + offset, height[asks])
            blind = asks[np.isnan(height[asks]) & (slot[asks] >= 0)]
            if len(blind):
                height[blind] = state.live.vertical.at(slot[blind], plots.time_s[blind])[1]
        located = conversion.locate(plots, state.sensors, height, sigma, self.biases.sigmas(raw.sensor, before))
        return Batch(rows, raw, plots, located, slot)

    def _without_latency(self, plots: Plots, slot: Ints, before: Bools) -> Plots:
        """Take out of the stamps of ADS-B what is known of each aircraft's latency."""
        late_s = np.where(self._is_adsb[plots.sensor], self._state.latencies.applied_s(slot, before), 0.0)
        return replace(plots, time_s=plots.time_s - late_s) if late_s.any() else plots

    def _measured(self, batch: Batch) -> Measurements:
        state, raw = self._state, batch.raw
        frames = state.frames.rows[state.tracks.frame[batch.slot]]
        left = self.biases.time_sigma_s(raw.sensor, state.block.before(raw.time_s))
        time_sigma_s = np.hypot(state.sensors.time_sigma_s[raw.sensor], left)
        return conversion.measure(raw, batch.plots, batch.located, batch.slot, frames, state.sensors, time_sigma_s)

    def _unrepeated(self, batch: Batch, reports: Measurements, given: Ints, verdicts: Verdicts) -> Ints:
        """Refuse implausible, duplicate and stale reports; returns the rows of the others.

        Of ``given`` places in the call nobody has asked yet whether their tracks can have been there.
        """
        state, slot, raw = self._state, batch.slot, batch.raw
        implausible = _among(batch.rows, given)
        at = implausible.nonzero()[0]
        if len(at):
            east, north, _, _ = state.live.bank.steady(slot[at])
            away = np.hypot(reports.east_m[at] - east, reports.north_m[at] - north)
            implausible[at] = is_implausible(away, reports.time_s[at] - state.live.bank.time_s[slot[at]])
        radar = state.sensors.is_radar[raw.sensor] & np.isfinite(raw.range_m)
        place = columns_of(np.where(radar, raw.range_m, raw.lat_deg), np.where(radar, raw.azimuth_deg, raw.lon_deg))
        duplicate, stale, behind = state.memory.compare(
            slot, raw.sensor, raw.time_s, place, lambda rows: self._speed(slot[rows], raw.ground_speed_mps[rows])
        )
        at = behind.nonzero()[0]
        if len(at):
            duplicate[at] |= state.buffers.holds(reports.take(at))
        refused = implausible | stale | duplicate
        if not refused.any():
            return np.arange(len(batch))
        for where, reason in ((implausible, Reason.IMPLAUSIBLE), (stale, Reason.STALE), (duplicate, Reason.DUPLICATE)):
            verdicts.reason[batch.rows[where]] = reason
        return (~refused).nonzero()[0]

    def _speed(self, slot: Ints, reported_mps: Array) -> Array:
        """How fast tracks ``(n,)`` move, or say that they move where nothing is known of them yet. [m/s]"""
        bank = self._state.live.bank
        _, _, v_east, v_north = bank.steady(slot)
        return np.where(np.isfinite(bank.time_s[slot]), np.hypot(v_east, v_north), reported_mps)

    def _begin_states(self, reports: Measurements) -> Bools:
        """Live states of tracks whose first usable report is here; returns which reports those are."""
        begins = np.isneginf(self._state.live.bank.time_s[reports.slot])
        if begins.any():
            first = np.zeros(len(reports), dtype=np.bool_)
            first[np.unique(reports.slot, return_index=True)[1]] = True
            begins &= first
            self._state.live.start(reports.take(begins))
        return begins

    def _after(self, batch: Batch, reports: Measurements, fresh: Ints, now_s: float) -> list[Event]:
        """Identity, status and flags of tracks that got reports; live points."""
        state, raw, slot = self._state, batch.raw, batch.slot
        state.tracks.note(slot, raw, reports.time_s)
        state.lateness.note(raw.sensor, raw.time_s, raw.received_s)
        _flag_ground(state, slot, raw)
        state.tracks.flags[slot[self.biases.uncertain[raw.sensor]]] |= np.uint16(Flag.BIAS_UNCERTAIN)
        slots = slot[~continues(slot)]
        events: list[Event] = [*ageing.confirm(state, slots, _among(slots, fresh), now_s)]
        self._clock.lap("tracks", len(batch))
        if state.settings.fusion.live:
            time = np.maximum(state.live.bank.time_s[slots], state.live.published_s[slots])
            ahead = time > state.live.published_s[slots] + state.live.every_s
            if ahead.any():
                events.append(live_points(state, slots[ahead], time[ahead]))
            self._clock.lap("live points", int(ahead.sum()))
        return events


def _give_velocity(reports: Measurements, named: Named) -> None:
    """First reports of tracks that initiation made carry the velocity of the plots that made them."""
    if not len(named.slots):
        return
    order = np.argsort(named.slots)
    place = np.minimum(np.searchsorted(named.slots[order], reports.slot), len(order) - 1)
    made = named.slots[order][place] == reports.slot
    velocity = named.velocity_mps[order][place[made]]
    reports.v_east_mps[made], reports.v_north_mps[made] = velocity.T
    reports.velocity_variance[made] = INITIATED_SIGMA_MPS**2


def _among(rows: Ints, some: Ints) -> Bools:
    """Which rows are among some, of which there mostly are none."""
    return np.isin(rows, some) if len(some) else np.zeros(len(rows), dtype=np.bool_)


def _flag_ground(state: EngineState, slot: Ints, raw: Plots) -> None:
    """On the ground or not, as the newest report with an own position says; rows sorted by slot, then time."""
    own = (~state.sensors.is_radar[raw.sensor]).nonzero()[0]
    on_ground = np.where(raw.flags[own] & ON_GROUND, np.uint16(Flag.ON_GROUND), np.uint16(0))
    state.tracks.flags[slot[own]] = (state.tracks.flags[slot[own]] & ~np.uint16(Flag.ON_GROUND)) | on_ground
