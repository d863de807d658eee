"""Identity: which track each report belongs to. Address first, then Mode A with position, then position.

An address has one owner. A second aircraft with the same address is found when its reports, more than one of them, lie
where the owner cannot be; it gets a track of its own, named by number. Reports without an address go through
association, those that nobody wants through initiation; a report without identity never takes a track that has a
better claimant. A track that has no address yet takes the address of reports that fit it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.applied_biases import AppliedBiases
from aeroskein.association import Associator, FreePlots, Initiator
from aeroskein.blind_plots import learn_heights, located_as, sharpen
from aeroskein.candidates import TrackGrid, candidates
from aeroskein.engine_state import EngineState
from aeroskein.intake import Batch, Verdicts
from aeroskein.plots import Array, Bools, Ints
from aeroskein.points import Flag, FusedPoints
from aeroskein.publishing import live_points
from aeroskein.reasons import Reason
from aeroskein.repeats import FASTEST_MPS, LEEWAY_M, is_implausible

__all__ = ["Identity", "Named"]

# Velocity of a track that initiation made of plots. [m/s]
INITIATED_SIGMA_MPS: Final = 30.0
# A report where the owner of its address cannot be must be borne out by another one within this time. [s]
STRANGER_S: Final = 15.0


@dataclass(slots=True, eq=False)
class Named:
    """What identity found in one call.

    Attributes
    ----------
    renamed : list of FusedPoints
        Last points under the old key, of tracks that learned their address.
    velocity : (k, 2) float64, slots : (k,) int64
        Tracks that initiation made in this call, with the velocity of their plots. [m/s]
    unsure : (m,) int64
        Places in the call of plots that may belong to another track: nothing must be learned from them.
    given : (k,) int64
        Places in the call of reports that did not come with the address of a track that can be where they are.
    """

    renamed: list[FusedPoints] = field(default_factory=list)
    slots: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    velocity_mps: Array = field(default_factory=lambda: np.zeros((0, 2)))
    unsure: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    given: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


class Identity:
    """Gives reports to tracks, and begins tracks."""

    def __init__(self, state: EngineState, biases: AppliedBiases, on_open: Callable[[Ints], None]) -> None:
        settings = state.settings
        self._state = state
        self._biases = biases
        self._on_open = on_open
        self._associator = Associator(settings, state.tracks.capacity)
        self._initiator = Initiator(settings)
        self._grid = TrackGrid(settings.association.coarse_gate_m)
        self._next_name = 0
        # By owner's slot: time, latitude and longitude of the last report that cannot be the owner's.
        self._strangers: dict[int, tuple[float, float, float]] = {}

    def grow(self, capacity: int) -> None:
        """Keep step with the number of slots."""
        self._associator.claims.grow(capacity)

    def clear(self, slots: Ints) -> None:
        """These slots belong to new tracks."""
        self._associator.claims.reset(slots)

    def assign(self, batch: Batch, verdicts: Verdicts, now_s: float) -> tuple[Batch, Named]:
        """Fill in the slots of all reports; those that belong nowhere are refused."""
        named = Named()
        self._resolve(batch, now_s, named)
        batch = batch.without((batch.plots.address >= 0) & (batch.slot < 0), Reason.IMPLAUSIBLE, verdicts)
        given = batch.slot >= 0
        sensor, time_s = batch.plots.sensor.astype(np.int64), batch.plots.time_s
        if given.all():
            self._associator.claims.note(sensor, batch.slot, time_s)
            return batch, named
        self._associator.claims.note(sensor[given], batch.slot[given], time_s[given])
        self._associate(batch, np.flatnonzero(~given), now_s, named)
        return batch.without(batch.slot < 0, Reason.UNASSOCIATED, verdicts), named

    # -- with an address -----------------------------------------------------------------------
    def _resolve(self, batch: Batch, now_s: float, named: Named) -> None:
        """Reports with an address: their owner, its double, a track without a name, or a new track."""
        owned = batch.slot >= 0
        rows, others = owned.nonzero()[0], (~owned).nonzero()[0]
        far = rows[self._cannot_be(batch, rows, batch.slot[rows])]
        for row in far:  # strangers are rare: one turn each
            batch.slot[row] = self._double(batch, int(row))
        if len(far) or len(others):
            named.given = batch.rows[np.concatenate([far, others])]
        fresh = others[batch.plots.address[others] >= 0]
        if len(fresh):
            self._adopt(batch, fresh, now_s, named)
            self._open_addressed(batch, fresh[batch.slot[fresh] < 0])

    def _cannot_be(self, batch: Batch, rows: Ints, slot: Ints) -> Bools:
        """Reports that lie further from a track than any aircraft could have flown since."""
        state = self._state
        east, north, _, _ = state.live.bank.steady(slot)
        frames = state.frames.rows[state.tracks.frame[slot]]
        e, n = geodesy.to_plane(frames, batch.located.lat_deg[rows], batch.located.lon_deg[rows])
        # Of a track without a state nothing is known, for any length of time.
        return is_implausible(np.hypot(e - east, n - north), batch.plots.time_s[rows] - state.live.bank.time_s[slot])

    def _double(self, batch: Batch, row: int) -> int:
        """The track of another aircraft with the same address; made when two reports speak for it. -1: none yet."""
        state, tracks = self._state, self._state.tracks
        owner, address = int(batch.slot[row]), batch.plots.address[row]
        others = np.flatnonzero(tracks.used & (tracks.address == address) & (tracks.label < 0))
        others = others[tracks.terminated_s[others] == np.inf]
        if len(others):
            fits = others[~self._cannot_be(batch, np.full(len(others), row), others)]
            if len(fits):
                return int(fits[0])
        time_s = float(batch.plots.time_s[row])
        lat, lon = float(batch.located.lat_deg[row]), float(batch.located.lon_deg[row])
        last = self._strangers.get(owner)
        self._strangers[owner] = (time_s, lat, lon)
        if last is None or not 0.0 < abs(time_s - last[0]) <= STRANGER_S:
            return -1
        places = geodesy.to_ecef(np.array([lat, last[1]]), np.array([lon, last[2]]))
        if np.linalg.norm(places[0] - places[1]) > FASTEST_MPS * abs(time_s - last[0]) + 0.1 * LEEWAY_M:
            return -1
        slot = self._open(batch, np.array([row]), np.array([address], dtype=np.int32), owns=False)[0]
        for of_two in (owner, slot):
            state.tracks.flags[of_two] |= np.uint16(Flag.DUPLICATE_ADDRESS)
        return int(slot)

    def _adopt(self, batch: Batch, fresh: Ints, now_s: float, named: Named) -> None:
        """Tracks without an address take that of reports that fit them."""
        state, tracks = self._state, self._state.tracks
        nameless = tracks.used & (tracks.address < 0) & np.isinf(tracks.terminated_s)
        if not nameless.any():
            return
        _, first = np.unique(batch.plots.address[fresh], return_index=True)
        rows = fresh[first]
        asked = batch.take(rows)
        plot, slot = self._grid.near(state, asked.located, now_s)
        plot, slot = plot[nameless[slot]], slot[nameless[slot]]
        if not len(plot):
            return
        pairs = candidates(state, asked, plot, slot, asked.located.take(plot))
        taken = self._associator.claims.taken(asked.plots.sensor[plot].astype(np.int64), slot, asked.plots.time_s[plot])
        none = np.full(len(asked), -1, dtype=np.int64)
        decision = self._associator.decide(asked.plots.sensor.astype(np.int64), none, asked.plots.time_s, pairs, taken)
        won = np.flatnonzero(decision.pair >= 0)
        if not len(won):
            return
        slots = slot[decision.pair[won]]
        address = asked.plots.address[won]
        if state.settings.fusion.live:
            last = np.maximum(state.live.bank.time_s[slots], state.live.published_s[slots])
            point = live_points(state, slots, last)
            point.renamed_to = address.astype(np.int32)
            named.renamed.append(point)
        tracks.name(slots, address)
        batch.slot[fresh] = tracks.owner(batch.plots.address[fresh])

    def _open_addressed(self, batch: Batch, fresh: Ints) -> None:
        """A track for every address that has none."""
        if not len(fresh):
            return
        address = batch.plots.address
        # The earliest report of each new address places its track.
        fresh = fresh[np.lexsort((batch.plots.time_s[fresh], address[fresh]))]
        addresses, first = np.unique(address[fresh], return_index=True)
        new = self._open(batch, fresh[first], addresses, owns=True)
        batch.slot[fresh] = new[np.searchsorted(addresses, address[fresh])]

    def _open(self, batch: Batch, rows: Ints, address: np.ndarray, *, owns: bool) -> Ints:
        """Begin tracks where the given reports are."""
        state = self._state
        if state.make_room(len(rows)):
            self.grow(state.tracks.capacity)
        new = state.tracks.open(address, np.full(len(rows), owns, dtype=np.bool_))
        state.tracks.frame[new] = state.frames.near(batch.located.lat_deg[rows], batch.located.lon_deg[rows])
        state.clear(new)
        self.clear(new)
        self._on_open(new)
        for slot in new.tolist():
            self._strangers.pop(slot, None)
        return new

    # -- without an address --------------------------------------------------------------------
    def _associate(self, batch: Batch, rows: Ints, now_s: float, named: Named) -> None:
        """Reports without an address: a track near them, or one more plot that may begin a track."""
        state = self._state
        asked = batch.take(rows)
        sensor, time_s = asked.plots.sensor.astype(np.int64), asked.plots.time_s
        plot, slot = self._grid.near(state, asked.located, now_s)
        located = located_as(state, self._biases, asked, plot, slot)
        pairs = candidates(state, asked, plot, slot, located)
        taken = self._associator.claims.taken(sensor[plot], slot, time_s[plot])
        spared = state.tracks.reported_by_others(slot, sensor[plot], now_s)
        sharpen(state, asked, slot, located, pairs, spared)
        decision = self._associator.decide(sensor, asked.plots.local_track, time_s, pairs, taken, spared)
        won = decision.pair >= 0
        given = slot[decision.pair[won]]
        batch.slot[rows[won]] = given
        batch.located.put(rows[won], located.take(decision.pair[won]))
        named.unsure = batch.rows[rows[won & ~decision.sure]]
        self._associator.claims.note(sensor[won], given, time_s[won])
        free = np.flatnonzero(~won & ~decision.withheld)
        if len(free):
            self._initiate(batch, rows[free], decision.contested[free], named)
        sigma = np.full((len(named.slots), 1), INITIATED_SIGMA_MPS)
        velocity = np.concatenate([named.velocity_mps, sigma], axis=1)
        learn_heights(state, self._biases, batch.take(rows), named.slots, velocity)

    def _initiate(self, batch: Batch, rows: Ints, contested: Bools, named: Named) -> None:
        plots, located = batch.plots, batch.located
        names = self._next_name + np.arange(len(rows))
        self._next_name += len(rows)
        made = self._initiator.add(
            FreePlots(
                names, plots.sensor[rows].astype(np.int64), plots.time_s[rows],
                located.lat_deg[rows], located.lon_deg[rows],
                plots.mode_a[rows].astype(np.int64), plots.local_track[rows], contested,
            )
        )  # fmt: skip
        # The newest plot of each new track is among these; the earlier ones have been refused already.
        newest = made.plots[:, 0] - names[0]
        here = (newest >= 0) & (newest < len(rows))
        if not here.any():
            return
        began = rows[newest[here]]
        new = self._open(batch, began, np.full(len(began), -1, dtype=np.int32), owns=False)
        batch.slot[began] = new
        self._state.tracks.reports[new] = self._state.settings.tracks.confirm_reports - 1
        self._associator.claims.note(plots.sensor[began].astype(np.int64), new, plots.time_s[began])
        named.slots = new
        named.velocity_mps = np.stack([made.v_east_mps[here], made.v_north_mps[here]], axis=1)
