"""Traffic: which flight is in which slot and when, who it is, and where it begins.

A slot is a place for one aircraft at a time. When a flight ends, the slot is empty for half a minute and then belongs
to another aircraft with another address. All of it follows from the seed, the slot and the number of its flight, so
processes that simulate one sensor each agree about the traffic without talking to each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints
from aeroskein.simulation.draws import Keys, hash_keys, hashed_uniform
from aeroskein.simulation.frames import Frames
from aeroskein.simulation.scenarios import FAMILIES, FAMILY_NUMBER, MIXTURE, group_size
from aeroskein.simulation.settings import FLIGHTS_PER_SLOT, SimulationSettings
from aeroskein.simulation.truth import Identity

__all__ = ["BLOCK_S", "Flights", "Placement", "Schedule", "identify", "place"]

# Everything is integrated in blocks of this length, and legs and flights end with one: short enough that the tangent
# plane is true to a micrometre, long enough that a block of 20,000 aircraft costs its arithmetic only. [s]
BLOCK_S: Final = 2.0

# A slot stays empty this long between two flights, so that the old track is seen to end. [blocks]
PAUSE_BLOCKS: Final = 15

# Aircraft that meet do so within ten minutes of their start, so that both are in the area until then. [s]
MEETING_WITHIN_S: Final = 600.0

# Distance of neighbours in a formation of three, so that all distances lie between 300 and 900 m. [m]
FORMATION_STEP_M: Final = (320.0, 440.0)

# Vertical separation of every second crossing pair: one flight level step. The others meet at one level. [m]
CROSSING_STEP_M: Final = 304.8

# First address handed out; 24 bits hold 200,000 slots of 16 flights from here.
FIRST_ADDRESS: Final = 0x400000

# Codes that mean something else: VFR, conspicuity, hijack, radio failure, emergency.
_RESERVED_CODES: Final = np.array([0o0000, 0o1000, 0o1200, 0o2000, 0o7000, 0o7500, 0o7600, 0o7700])

_SPEED: Final = np.array([family.speed_mps for family in FAMILIES.values()])
_HEIGHT: Final = np.array([family.height_m for family in FAMILIES.values()])
_SPREAD: Final = np.array([family.spread for family in FAMILIES.values()])
_THROUGH: Final = np.array([family.through for family in FAMILIES.values()])
_SHARED: Final = np.array([family.shared for family in FAMILIES.values()])
_MEETING: Final = np.array([family.meeting for family in FAMILIES.values()])
_MIXED_NUMBERS: Final = np.array([FAMILY_NUMBER[name] for name in MIXTURE])
_MIXED_LIMITS: Final = np.cumsum(list(MIXTURE.values()))


@dataclass(slots=True, eq=False)
class Flights:
    """Flights, one row each, with the keys that their choices are hashed from.

    Attributes
    ----------
    slot, number : (n,) int64
        Slot, and the how-many-th flight in it.
    family : (n,) int64
        Index into ``FAMILIES``.
    key, group_key : (n,) uint64
        Of this flight alone; of the group it belongs to.
    """

    slot: Ints
    number: Ints
    family: Ints
    key: Keys
    group_key: Keys
    member: Ints
    """Place in the group; 0 leads. (n,) int64"""

    @classmethod
    def of(cls, settings: SimulationSettings, slot: Ints, number: Ints) -> Flights:
        """The flights with the given numbers in the given slots."""
        size = group_size(settings.scenario)
        group, member = slot // size, slot % size
        key = hash_keys(settings.seed, 1, slot, number)
        group_key = hash_keys(settings.seed, 2, group, number)
        if settings.scenario == "mixed":
            draw = hashed_uniform(group_key, 3, high=_MIXED_LIMITS[-1])
            family = _MIXED_NUMBERS[np.searchsorted(_MIXED_LIMITS, draw, side="right")]
        else:
            family = np.full(len(slot), FAMILY_NUMBER[settings.scenario])
        return cls(slot, number, family, key, group_key, member)

    @property
    def plan_key(self) -> Keys:
        """What start and legs are hashed from: one key for a whole formation."""
        return np.where(_SHARED[self.family], self.group_key, self.key)

    @property
    def gust_key(self) -> Keys:
        """What gusts are hashed from: aircraft that belong together are in the same air."""
        return np.where(_SHARED[self.family] | _MEETING[self.family], self.group_key, self.key)


def identify(flights: Flights) -> Identity:
    """Who the flights are."""
    address = FIRST_ADDRESS + flights.slot * FLIGHTS_PER_SLOT + flights.number % FLIGHTS_PER_SLOT
    code = (hashed_uniform(flights.key, 10) * 4096).astype(np.int16)
    code = np.where(np.isin(code, _RESERVED_CODES), code + 1, code).astype(np.int16)
    # SKN and five digits, written digit by digit.
    flight_number = (flights.slot * 7 + flights.number * 4001) % 100_000
    letters = np.empty((len(flights.slot), 8), dtype=np.uint8)
    letters[:, :3] = np.frombuffer(b"SKN", dtype=np.uint8)
    letters[:, 3:] = ord("0") + flight_number[:, None] // 10 ** np.arange(4, -1, -1) % 10
    return Identity(flights.key, address.astype(np.int32), code, letters.view("S8")[:, 0])


class Schedule:
    """When the flights of a range of slots begin and end, in blocks since the anchor."""

    def __init__(self, settings: SimulationSettings, slots: Ints, begin_block: int) -> None:
        self._cycle = max(round(settings.flight_s / BLOCK_S), 4 * PAUSE_BLOCKS)
        if settings.scenario == "mixed":
            # The first flight of each slot is cut short, so that traffic comes and goes from the start.
            share = hashed_uniform(hash_keys(settings.seed, 4, slots // group_size(settings.scenario)))
            self._first_end = 1 + (share * (self._cycle - 1)).astype(np.int64)
        else:
            self._first_end = np.full(len(slots), self._cycle, dtype=np.int64)
        # A flight that is under way when the simulation begins is left out, for its past is not known.
        number = np.where(begin_block > 0, 1 + -(-(begin_block - self._first_end) // self._cycle), 0)
        self.number: Ints = np.maximum(number, 0)

    def begin_block(self) -> Ints:
        """First block of each slot's next flight."""
        return np.where(
            self.number == 0, 0, self._first_end + (self.number - 1) * self._cycle + PAUSE_BLOCKS * (self.number > 0)
        )

    def end_block(self) -> Ints:
        """First block after each slot's next flight."""
        return np.asarray(self._first_end + self.number * self._cycle)


@dataclass(slots=True, eq=False)
class Placement:
    """Where flights begin: frames, heading clockwise from ``ahead`` [rad], speed [m/s], height [m]."""

    frames: Frames
    heading_rad: Array
    speed_mps: Array
    height_m: Array


def place(
    flights: Flights, *, centre_deg: tuple[float, float], radius_m: float, lasting_s: NDArray[np.float64]
) -> Placement:
    """Find the starting points of flights that will last for ``lasting_s`` in an area.

    Flights ``through`` the area are half way when nearest to its middle; those that are ``meeting`` start from their
    common point backwards; members of a formation are set beside their leader; all others start inside.
    """
    plan, group, family = flights.plan_key, flights.group_key, flights.family
    n = len(family)
    speed_mps = hashed_uniform(plan, 20, low=_SPEED[family, 0], high=_SPEED[family, 1])
    height_m = hashed_uniform(plan, 21, low=_HEIGHT[family, 0], high=_HEIGHT[family, 1])
    meeting, shared = _MEETING[family], _SHARED[family]
    level_m = hashed_uniform(group, 21, low=_HEIGHT[family, 0], high=_HEIGHT[family, 1])
    above_m = CROSSING_STEP_M * (flights.member % 2) * (flights.slot // 2 % 2)
    height_m = np.where(meeting, level_m + above_m, height_m)
    heading = hashed_uniform(plan, 22, high=2.0 * np.pi)
    crossing = hashed_uniform(group, 22, high=2.0 * np.pi) + flights.member * np.radians(
        hashed_uniform(group, 23, low=30.0, high=150.0)
    )
    heading = np.where(meeting, crossing, heading)

    spot_key = np.where(meeting, group, plan)
    spread_m = _SPREAD[family] * radius_m
    aside_m = spread_m * hashed_uniform(spot_key, 24, low=-1.0)
    inside_m, bearing = spread_m * np.sqrt(np.abs(aside_m) / spread_m), hashed_uniform(spot_key, 25, high=2.0 * np.pi)
    sideways = _THROUGH[family]
    spot_m = np.where(sideways, aside_m, inside_m)
    towards = np.where(sideways, heading + np.pi / 2.0, bearing)
    centre = Frames.at(np.full(n, centre_deg[0]), np.full(n, centre_deg[1]), height_m)
    frames = centre.slid(spot_m * np.sin(towards), spot_m * np.cos(towards), height_m)

    meet_s = np.minimum(lasting_s, MEETING_WITHIN_S) * hashed_uniform(group, 26, low=0.3, high=0.7)
    back_m = speed_mps * np.where(meeting, meet_s, np.where(sideways, lasting_s / 2.0, 0.0))
    right_m, ahead_m = -back_m * np.sin(heading), -back_m * np.cos(heading)
    # Echelon: each member a step behind and beside the one before, to the left or to the right.
    step_m = flights.member * shared * hashed_uniform(group, 27, low=FORMATION_STEP_M[0], high=FORMATION_STEP_M[1])
    side = heading + np.pi + np.pi / 4.0 * np.sign(hashed_uniform(group, 28, low=-1.0))
    frames = frames.slid(right_m + step_m * np.sin(side), ahead_m + step_m * np.cos(side), height_m)
    return Placement(frames, heading, speed_mps, height_m)
