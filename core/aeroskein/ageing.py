"""Ageing: tracks that miss their reports coast, those that miss them for long end, ended ones give their slot back."""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.engine_state import EngineState
from aeroskein.events import TrackChanges
from aeroskein.plots import Array, Ints
from aeroskein.points import FusedPoints, Status
from aeroskein.publishing import live_points

__all__ = ["changes", "coast", "confirm", "ended", "release"]

# Ended tracks stay visible to queries for this long. [s]
KEEP_TERMINATED_S: Final = 60.0
# A coasting track is published this often. [s]
COAST_PERIOD_S: Final = 1.0
# So many tracks coast visibly or end at a time, those whose turn it is longest first: when a whole feed falls silent,
# the tracks of the others must not wait for all of it.
MOST: Final = 2_000


def changes(state: EngineState, slots: Ints, now_s: float) -> TrackChanges:
    """The event that tells the present status of tracks."""
    t = state.tracks
    return TrackChanges(t.number[slots], t.address[slots], t.status[slots], np.full(len(slots), now_s))


def confirm(state: EngineState, slots: Ints, fresh: np.ndarray, now_s: float) -> list[TrackChanges]:
    """Tracks that just got reports: announce those that are ``fresh``, confirm those with enough, end coasting."""
    tracks = state.tracks
    enough = tracks.reports[slots] >= state.settings.tracks.confirm_reports
    now = np.where(enough, np.uint8(Status.CONFIRMED), np.uint8(Status.TENTATIVE))
    changed = fresh | (now != tracks.status[slots])
    tracks.status[slots] = now
    return [changes(state, slots[changed], now_s)] if changed.any() else []


def coast(state: EngineState, now_s: float) -> list[TrackChanges | FusedPoints]:
    """Mark tracks that miss their reports, and publish them every second where they should be by now.

    Less often while live points are thinned.
    """
    tracks = state.tracks
    active = tracks.active
    # Nothing is expected back sooner than this, so that most tracks need no further look.
    late = now_s - tracks.received_s[active] > state.settings.tracks.coast_min_s
    silent = active[late & (tracks.status[active] >= Status.CONFIRMED)]
    if not len(silent):
        return []
    coasting = silent[now_s - tracks.received_s[silent] > tracks.expected_wait_s(silent, now_s)]
    events: list[TrackChanges | FusedPoints] = []
    fresh = coasting[tracks.status[coasting] != Status.COASTING]
    if len(fresh):
        tracks.status[fresh] = Status.COASTING
        events.append(changes(state, fresh, now_s))
    again = coasting[now_s - state.coasted_s[coasting] >= max(COAST_PERIOD_S, state.live.every_s)]
    again = _longest_first(again, state.coasted_s)
    if len(again) and state.settings.fusion.live:
        state.coasted_s[again] = now_s
        predicted = state.live.bank.time_s[again] + now_s - tracks.received_s[again]
        ahead = predicted > state.live.published_s[again]
        if ahead.any():
            events.append(live_points(state, again[ahead], predicted[ahead]))
    return events


def ended(state: EngineState, now_s: float) -> Ints:
    """Tracks that have been without a report for too long, ``(n,)`` slots; of very many some."""
    active, ends_s = state.tracks.active, state.tracks.ends_s()
    return _longest_first(active[now_s > ends_s[active]], ends_s)


def _longest_first(slots: Ints, since_s: Array) -> Ints:
    """Those that have waited longest since a time by slot, in order of slots; all where there are not too many."""
    if len(slots) <= MOST:
        return slots
    return np.sort(slots[np.argpartition(since_s[slots], MOST)[:MOST]])


def release(state: EngineState, now_s: float) -> None:
    """Give back the slots of tracks that ended long enough ago."""
    tracks = state.tracks
    old = np.flatnonzero(tracks.used & (now_s - tracks.terminated_s > KEEP_TERMINATED_S))
    if len(old):
        tracks.release(old)
