"""Tracks: slots, numbers, identities, status. Everything about a track that is not its motion, as columns by slot.

A slot is a place in every array of the engine and is used again; a track number never is. An address belongs to one
track, its owner; a second track that carries the same address is a duplicate and stays on its number.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.lanes import continues, lengths_of_runs
from aeroskein.plots import Array, Bools, Ints, Plots, apply_at
from aeroskein.points import Status
from aeroskein.settings import EngineSettings

__all__ = ["TrackTable"]

# A sensor counts as live on a track while its last report is younger than this many of its periods, and a track
# coasts when it has missed its fastest live sensor by half a period more than one. [periods]
LIVE_PERIODS: Final = 2.5
COAST_PERIODS: Final = 1.5
# Key chunks of tracks: ``T`` and the number, or the address.
NUMBER_LABEL: Final = re.compile("T[0-9]{6,18}")
ADDRESS_LABEL: Final = re.compile("[0-9A-Fa-f]{6}")


class TrackTable:
    """Columns by slot; see the attributes set in ``__init__``. Slots in use have ``used`` true."""

    def __init__(self, settings: EngineSettings, first_number: int) -> None:
        capacity = settings.tracks.capacity
        sensors = len(settings.sensors)
        self._settings = settings
        self._periods = np.array([s.period_s for s in settings.sensors])
        self.next_number = first_number
        self.used: Bools = np.zeros(capacity, dtype=np.bool_)
        self.number: Ints = np.full(capacity, -1, dtype=np.int64)
        self.address = np.full(capacity, -1, dtype=np.int32)
        self.label = np.full(capacity, -1, dtype=np.int32)
        self.mode_a = np.full(capacity, -1, dtype=np.int16)
        # How often in a row the code was heard; a plot that came to the wrong track must not make it its own.
        self.mode_a_heard = np.zeros(capacity, dtype=np.uint8)
        self.callsign: NDArray[np.bytes_] = np.zeros(capacity, dtype="S8")
        self.status = np.zeros(capacity, dtype=np.uint8)
        self.flags = np.zeros(capacity, dtype=np.uint16)
        self.frame: Ints = np.zeros(capacity, dtype=np.int64)
        self.reports: Ints = np.zeros(capacity, dtype=np.int64)
        # When the newest report arrived, and the newest report's own time. [s since the epoch]
        self.received_s: Array = np.full(capacity, -np.inf)
        self.newest_s: Array = np.full(capacity, -np.inf)
        self.terminated_s: Array = np.full(capacity, np.inf)
        # When the track was last where no radar could see it. [s since the epoch]
        self.excused_s: Array = np.full(capacity, -np.inf)
        # Per sensor: arrival of its newest accepted report. [s since the epoch]
        self.sensor_received_s: Array = np.full((capacity, sensors), -np.inf)
        self._free = list(range(capacity - 1, -1, -1))
        self._owned = np.zeros(0, dtype=np.int32)
        self._owner: Ints = np.zeros(0, dtype=np.int64)

    @property
    def capacity(self) -> int:
        """Slots allocated."""
        return len(self.used)

    @property
    def active(self) -> Ints:
        """Slots in use that are not terminated."""
        return np.flatnonzero(self.used & (self.status != Status.TERMINATED))

    def room_for(self, n: int) -> int:
        """The capacity needed for ``n`` more tracks: today's, a quarter more as often as necessary.

        Doubling would leave up to half of the memory unused; a quarter costs little more copying, and that once.
        """
        capacity = self.capacity
        while capacity - (self.capacity - len(self._free)) < n:
            capacity += max(capacity // 4, 1)
        return capacity

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        old = self.capacity
        for name, column in vars(self).items():
            if isinstance(column, np.ndarray) and len(column) == old and not name.startswith("_"):
                missing = column[:1].copy()
                fresh = np.repeat(self._blank(name, missing), capacity - old, axis=0)
                setattr(self, name, np.concatenate([column, fresh]))
        self._free = list(range(capacity - 1, old - 1, -1)) + self._free

    def _blank(self, name: str, like: NDArray[np.generic]) -> NDArray[np.generic]:
        blanks = {
            "number": -1, "address": -1, "label": -1, "mode_a": -1,
            "received_s": -np.inf, "newest_s": -np.inf, "sensor_received_s": -np.inf, "terminated_s": np.inf,
            "excused_s": -np.inf,
        }  # fmt: skip
        like[...] = blanks.get(name, b"" if name == "callsign" else 0)
        return like

    def open(self, address: NDArray[np.int32], owns: Bools) -> Ints:
        """Begin tracks and return their slots ``(n,)``; there must be room.

        Parameters
        ----------
        address : (n,) int32
            ICAO addresses, -1 where unknown.
        owns : (n,) bool array
            Where the track is the owner of its address and takes its key's name from it.
        """
        n = len(address)
        left = len(self._free) - n
        slots = np.array(self._free[left:][::-1], dtype=np.int64)
        del self._free[left:]
        for name, column in vars(self).items():
            if isinstance(column, np.ndarray) and not name.startswith("_"):
                column[slots] = self._blank(name, column[:1].copy())
        self.used[slots] = True
        self.number[slots] = np.arange(self.next_number, self.next_number + n)
        self.next_number += n
        self.address[slots] = address
        self.label[slots] = np.where(owns, address, -1)
        self._own(address[owns], slots[owns])
        return slots

    def _own(self, address: NDArray[np.int32], slots: Ints) -> None:
        at = np.searchsorted(self._owned, address)
        order = np.argsort(address, kind="stable")
        self._owned = np.insert(self._owned, at[order], address[order])
        self._owner = np.insert(self._owner, at[order], slots[order])

    def name(self, slots: Ints, address: NDArray[np.int32]) -> None:
        """Give tracks an address that nobody owns; number and sequence go on."""
        self.address[slots] = address
        self.label[slots] = address
        self._own(address, slots)

    def terminate(self, slots: Ints, now_s: float) -> None:
        """End tracks: their address is free again, their slot is kept until ``release``."""
        self.status[slots] = Status.TERMINATED
        self.terminated_s[slots] = now_s
        keep = ~np.isin(self._owner, slots)
        self._owned, self._owner = self._owned[keep], self._owner[keep]

    def release(self, slots: Ints) -> None:
        """Give the slots of terminated tracks back."""
        self.used[slots] = False
        self._free.extend(slots.tolist())

    def owner(self, address: NDArray[np.int32]) -> Ints:
        """Slot of the track that owns each address ``(n,)``, -1 where none does."""
        if not len(self._owned):
            return np.full(len(address), -1, dtype=np.int64)
        # Looked up one after the other, neighbours are found in the same lines of memory: half the time.
        order = np.argsort(address)
        at = np.empty(len(address), dtype=np.int64)
        at[order] = np.minimum(np.searchsorted(self._owned, address[order]), len(self._owned) - 1)
        return np.where(self._owned[at] == address, self._owner[at], -1)

    def find(self, label: str) -> int | None:
        """Slot of the track with this key chunk, an address or ``T`` and the number; None where there is none."""
        if NUMBER_LABEL.fullmatch(label):
            at = np.flatnonzero(self.used & (self.label < 0) & (self.number == int(label[1:])))
        elif ADDRESS_LABEL.fullmatch(label):
            at = np.flatnonzero(self.used & (self.label == int(label, 16)))
        else:
            return None
        # An ended track keeps its slot for a while; the newest one of that name is meant.
        return int(at[self.number[at].argmax()]) if len(at) else None

    def note(self, slots: Ints, raw: Plots, time_s: Array) -> None:
        """Remember what accepted reports ``(n,)`` say of identity, and when they came; sorted by slot, then time."""
        if not len(slots):
            return
        first = (~continues(slots)).nonzero()[0]
        own = slots[first]
        self.reports[own] += lengths_of_runs(first, len(slots))
        self.received_s[own] = np.maximum(self.received_s[own], np.maximum.reduceat(raw.received_s, first))
        self.newest_s[own] = np.maximum(self.newest_s[own], np.maximum.reduceat(time_s, first))
        apply_at(np.maximum, self.sensor_received_s, slots, raw.sensor, raw.received_s)
        said = (raw.mode_a >= 0).nonzero()[0]
        at, code = slots[said], raw.mode_a[said]
        heard = np.where(self.mode_a[at] == code, np.minimum(self.mode_a_heard[at], 254) + 1, 1)
        self.mode_a_heard[at] = np.where(raw.address[said] >= 0, 255, heard)
        self.mode_a[at] = code
        said = (raw.callsign != b"").nonzero()[0]
        self.callsign[slots[said]] = raw.callsign[said]

    def ends_s(self) -> Array:
        """When each track ends unless a report comes, ``(capacity,)``. [s since the epoch]"""
        return np.maximum(self.received_s, self.excused_s) + self._settings.tracks.terminate_s

    def reported_by_others(self, slots: Ints, sensor: Ints, now_s: float) -> Bools:
        """Whether another sensor than the given one is live on each track, ``(n,)``."""
        silent_s = now_s - self.sensor_received_s[slots]
        live = silent_s <= LIVE_PERIODS * self._periods
        live[np.arange(len(slots)), sensor] = False
        return np.asarray(live.any(axis=1))

    def expected_wait_s(self, slots: Ints, now_s: float) -> Array:
        """How long each track may be without a report before it coasts, by its fastest live sensor. [s]"""
        coast_min = self._settings.tracks.coast_min_s
        live_for = np.maximum(coast_min, LIVE_PERIODS * self._periods)
        live = now_s - self.sensor_received_s[slots] <= live_for
        fastest = np.where(live, self._periods, np.inf).min(axis=1)
        return np.where(np.isfinite(fastest), np.maximum(coast_min, COAST_PERIODS * fastest), 0.0)
