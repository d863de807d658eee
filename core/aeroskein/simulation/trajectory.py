"""Trajectories: the aircraft of a range of slots, integrated at 20 Hz in blocks of two seconds.

Course, speed and height follow the legs (``manoeuvres``); gusts are an Ornstein-Uhlenbeck acceleration of 10 s whose
effect on the velocity fades within a minute, as a crew or an autopilot would have it. Between two steps positions
follow the cubic that agrees with both positions and velocities, so every instant has a truth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.ellipsoid import normal_and_height
from aeroskein.plots import Array, Bools, Ints
from aeroskein.simulation.draws import hashed_normal_pair, hashed_uniform
from aeroskein.simulation.frames import Frames, east_north, latitude_longitude_deg, track_angle_deg
from aeroskein.simulation.manoeuvres import (
    ACCELERATION_RAMP_MPS3,
    TURN_RAMP_RADPS2,
    VERTICAL_RAMP_MPS2,
    Legs,
    ramped,
    trapezoid,
)
from aeroskein.simulation.scenarios import LEG_TABLE, LegColumn, leg_numbers
from aeroskein.simulation.settings import SimulationSettings
from aeroskein.simulation.traffic import BLOCK_S, Flights, Schedule, identify, place
from aeroskein.simulation.truth import Identity, Phase, States, TruthStates

__all__ = ["Block", "Fleet"]

STEPS: Final = 40
STEP_S: Final = BLOCK_S / STEPS

# Gusts: correlation time of the acceleration, time in which its effect on the velocity is flown out. [s]
GUST_TIME_S: Final = 10.0
GUST_FADE_S: Final = 60.0
# The acceleration is drawn twice a second and linear between: 2 % less variance there than the exact process.
GUST_NODES: Final = 4
_GUST_DECAY: Final = float(np.exp(-BLOCK_S / GUST_NODES / GUST_TIME_S))
# Slow aircraft are held in place by their crews: gusts move them less below this speed. [m/s]
GUST_FULL_MPS: Final = 3.0

# A vertical or standing aircraft keeps a direction: this speed along its heading remains. [m/s]
STANDSTILL_MPS: Final = 1e-6
# Below this an aircraft hovers. [m/s]
HOVER_MPS: Final = 1.0

# The geometric-minus-pressure difference is a wave over the globe of about this length that passes in this time.
PRESSURE_WAVE_M: Final = 1.0e6
PRESSURE_WAVE_S: Final = 21_600.0
_WAVE_DIRECTION: Final = np.array([0.48, 0.60, 0.64]) * 6.371e6 / PRESSURE_WAVE_M


def _gust_response() -> Array:
    """How gust velocity at every step follows from its value at the start and the accelerations at the nodes.

    Shape (STEPS + 1, 1 + GUST_NODES + 1); made by stepping each unit input through the trapezoidal rule.
    """
    nodes = np.linspace(0.0, BLOCK_S, GUST_NODES + 1)
    steps = np.arange(STEPS + 1) * STEP_S
    response = np.zeros((STEPS + 1, GUST_NODES + 2))
    response[0, 0] = 1.0
    acceleration = np.stack([np.interp(steps, nodes, unit) for unit in np.eye(GUST_NODES + 1)], axis=1)
    for k in range(STEPS):
        response[k + 1] = response[k] * (1.0 - STEP_S / GUST_FADE_S)
        response[k + 1, 1:] += STEP_S / 2.0 * (acceleration[k] + acceleration[k + 1])
    return response


_GUST_RESPONSE: Final = _gust_response()


def _integral(rate: Array, start: Array | float = 0.0) -> Array:
    """Trapezoidal integral over the steps, first axis, same shape."""
    total = np.empty_like(rate)
    total[0] = start
    np.add(rate[1:], rate[:-1], out=total[1:])
    total[1:] *= STEP_S / 2.0
    return np.cumsum(total, axis=0, out=total)


@dataclass(slots=True, eq=False)
class Block:
    """Two seconds of a fleet: implements ``Motion``. Valid until the fleet advances again.

    Arrays over steps and aircraft have shape ``(STEPS + 1, n)``: plane coordinates, height, velocity.
    """

    index: int
    anchor_s: float
    rows: Ints
    slots: Ints
    identity: Identity
    settings: SimulationSettings
    frames: Frames
    legs: Legs
    encoder_m: Array
    right_m: Array
    ahead_m: Array
    height_m: Array
    right_mps: Array
    ahead_mps: Array
    vertical_mps: Array

    @property
    def start_s(self) -> float:
        """Start of the block. [s since the epoch]"""
        return self.anchor_s + self.index * BLOCK_S

    @property
    def end_s(self) -> float:
        """End of the block, not included. [s since the epoch]"""
        return self.anchor_s + (self.index + 1) * BLOCK_S

    def at(self, rows: Ints, time_s: Array) -> States:
        """States of rows at times inside the block, in pairs."""
        steps = (time_s - self.start_s) / STEP_S
        first = np.clip(steps.astype(np.int64), 0, STEPS - 1)
        u = steps - first
        n = self.right_m.shape[1]
        before = first * n + rows
        pair = (before, before + n)

        def cubic(position: Array, velocity: Array) -> Array:
            p0, p1 = (position.ravel()[i] for i in pair)
            v0, v1 = (velocity.ravel()[i] * STEP_S for i in pair)
            return np.asarray(p0 + u * (v0 + u * (3.0 * (p1 - p0) - 2.0 * v0 - v1 + u * (v0 + v1 - 2.0 * (p1 - p0)))))

        def linear(value: Array) -> Array:
            v0, v1 = (value.ravel()[i] for i in pair)
            return np.asarray(v0 + u * (v1 - v0))

        frames = self.frames.take(rows)
        plane_m = frames.point(cubic(self.right_m, self.right_mps), cubic(self.ahead_m, self.ahead_mps))
        up, _ = normal_and_height(plane_m)
        velocity = linear(self.right_mps)[:, None] * frames.right + linear(self.ahead_mps)[:, None] * frames.ahead
        height_m = cubic(self.height_m, self.vertical_mps)
        altitude_m = height_m - self._geometric_minus_pressure_m(up, time_s) + self.encoder_m[rows]
        return States(up, plane_m, height_m, altitude_m, velocity, linear(self.vertical_mps))

    def _geometric_minus_pressure_m(self, up: Array, time_s: Array) -> Array:
        wave = up @ _WAVE_DIRECTION + (time_s - self.anchor_s) / PRESSURE_WAVE_S
        swing = self.settings.geometric_minus_pressure_variation_m * np.sin(2.0 * np.pi * wave)
        return np.asarray(self.settings.geometric_minus_pressure_m + swing)

    def truth(self, time_s: Array) -> TruthStates:
        """Truth of all aircraft in the air at the given times inside the block, ordered by time, then slot."""
        rows, times = np.tile(self.rows, len(time_s)), np.repeat(time_s, len(self.rows))
        states = self.at(rows, times)
        lat_deg, lon_deg = latitude_longitude_deg(states.up)
        east, north = east_north(states.up, states.velocity_mps)
        speed_mps = np.hypot(east, north)
        return TruthStates(
            time_s=times,
            slot=self.slots[rows],
            address=self.identity.address[rows],
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            height_m=states.height_m,
            altitude_m=states.altitude_m - self.encoder_m[rows],
            ground_speed_mps=speed_mps,
            track_angle_deg=track_angle_deg(east, north),
            vertical_rate_mps=states.vertical_rate_mps,
            phase=self._phase(rows, times, speed_mps),
        )

    def _phase(self, rows: Ints, time_s: Array, speed_mps: Array) -> np.ndarray:
        turn, acceleration, vertical = self.legs.rates(rows, time_s - self.anchor_s)
        conditions = {
            Phase.HOVER: speed_mps < HOVER_MPS,
            Phase.TURN: turn != 0.0,
            Phase.ACCELERATION: acceleration > 0.0,
            Phase.DECELERATION: acceleration < 0.0,
            Phase.CLIMB: vertical > 0.0,
            Phase.DESCENT: vertical < 0.0,
        }
        phase = np.select(list(conditions.values()), [int(p) for p in conditions], default=int(Phase.STRAIGHT))
        return phase.astype(np.uint8)


class Fleet:
    """The aircraft of a range of slots, from one block to the next.

    Parameters
    ----------
    settings : SimulationSettings
        What is flown.
    centre_deg : (float, float)
        Latitude and longitude of the middle of the area. [deg]
    anchor_s : float
        When block 0 begins. [s since the epoch]
    span_s : float
        How long the simulation is going to last, for placing flights that cross the area. [s]
    begin_block : int
        First block that will be asked for.
    slots : range
        Which slots; groups must be complete, so the range begins at a multiple of 6.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        *,
        centre_deg: tuple[float, float],
        anchor_s: float,
        span_s: float,
        begin_block: int = 0,
        slots: range | None = None,
    ) -> None:
        slots = range(settings.aircraft) if slots is None else slots
        n = len(slots)
        self._settings, self._centre_deg, self._anchor_s, self._span_s = settings, centre_deg, anchor_s, span_s
        self._slots = np.arange(slots.start, slots.stop, dtype=np.int64)
        self._next_block = begin_block
        self._schedule = Schedule(settings, self._slots, begin_block)
        self._flights = Flights.of(settings, self._slots, self._schedule.number)
        self._identity = identify(self._flights)
        centre = Frames.at(np.full(n, centre_deg[0]), np.full(n, centre_deg[1]), np.zeros(n))
        self._middle_m = centre.origin_m[:1]
        self._frames = centre
        self._in_the_air: Bools = np.zeros(n, dtype=np.bool_)
        self._end_block = np.zeros(n, dtype=np.int64)
        self._legs, self._step = Legs.none(n), np.zeros(n, dtype=np.int64)
        self._heading, self._speed, self._height = np.zeros(n), np.full(n, STANDSTILL_MPS), np.zeros(n)
        self._gust_mps, self._gust_mps2, self._encoder_m = np.zeros((2, n)), np.zeros((2, n)), np.zeros(n)

    def advance(self) -> Block:
        """Fly the next block."""
        block = self._next_block
        self._next_block += 1
        self._in_the_air &= self._end_block > block
        born = np.flatnonzero(~self._in_the_air & (self._schedule.begin_block() == block))
        if len(born):
            self._begin_flights(born)
        due = np.flatnonzero(self._in_the_air & (self._legs.end_block <= block))
        if len(due):
            self._begin_legs(due, block)
        return self._fly(block)

    def _begin_flights(self, rows: Ints) -> None:
        settings, schedule = self._settings, self._schedule
        flights = Flights.of(settings, self._slots[rows], schedule.number[rows])
        end_block = schedule.end_block()[rows]
        lasting_s = np.minimum((end_block - schedule.begin_block()[rows]) * BLOCK_S, self._span_s)
        placement = place(
            flights, centre_deg=self._centre_deg, radius_m=settings.effective_radius_m(), lasting_s=lasting_s
        )
        self._frames.put(rows, placement.frames)
        self._heading[rows], self._speed[rows] = placement.heading_rad, placement.speed_mps
        self._height[rows], self._end_block[rows] = placement.height_m, end_block
        self._step[rows], self._in_the_air[rows] = 0, True
        self._legs.end_block[rows] = self._next_block - 1
        self._gust_mps[:, rows] = 0.0
        self._gust_mps2[:, rows] = settings.gust_mps2 * np.stack(hashed_normal_pair(flights.gust_key, 30))
        self._encoder_m[rows] = settings.altimeter_sigma_m * hashed_normal_pair(flights.key, 31)[0]
        for mine, new in (
            (self._flights.number, flights.number),
            (self._flights.family, flights.family),
            (self._flights.key, flights.key),
            (self._flights.group_key, flights.group_key),
        ):
            mine[rows] = new
        identity = identify(flights)
        self._identity.address[rows], self._identity.mode_a[rows] = identity.address, identity.mode_a
        self._identity.callsign[rows], self._identity.key[rows] = identity.callsign, identity.key
        schedule.number[rows] += 1

    def _begin_legs(self, rows: Ints, block: int) -> None:
        key, step = self._flights.plan_key[rows], self._step[rows]

        def drawn(question: int, column: slice) -> Array:
            low, high = leg[:, column].T
            return hashed_uniform(key, 40 + question, step, low=low, high=high)

        leg = LEG_TABLE[leg_numbers(self._flights.family[rows], step, hashed_uniform(key, 40, step))]
        rate_dps = leg[:, LegColumn.TURN_RATE][np.arange(len(rows)), (hashed_uniform(key, 41, step) < 0.5) * 1]
        turn = np.radians(drawn(2, LegColumn.TURN)) * np.where(leg[:, LegColumn.RIGHT] > 0.0, 1.0, self._side(rows))
        speed, height = drawn(3, LegColumn.SPEED), drawn(4, LegColumn.HEIGHT)
        faster = np.where(np.isnan(speed), 0.0, speed - self._speed[rows])
        higher = np.where(np.isnan(height), 0.0, height - self._height[rows])
        legs = self._legs
        legs.turn_radps[rows], legs.turn_s[rows] = ramped(turn, np.radians(rate_dps), TURN_RAMP_RADPS2)
        legs.acceleration_mps2[rows], legs.acceleration_s[rows] = ramped(
            faster, drawn(5, LegColumn.ACCELERATION), ACCELERATION_RAMP_MPS3
        )
        legs.vertical_mps[rows], legs.vertical_s[rows] = ramped(
            higher, drawn(6, LegColumn.VERTICAL), VERTICAL_RAMP_MPS2
        )
        straight_s = drawn(7, LegColumn.STRAIGHT)
        longest_s = np.maximum(np.maximum(legs.turn_s[rows], legs.acceleration_s[rows]), legs.vertical_s[rows])
        legs.begin_s[rows] = block * BLOCK_S + straight_s
        legs.end_block[rows] = block + np.ceil((straight_s + longest_s) / BLOCK_S).astype(np.int64)
        self._step[rows] += 1

    def _side(self, rows: Ints) -> Array:
        """Side to which free turns go (1: right): drawn inside the area, towards its middle outside."""
        # Members of a formation turn as their leader does.
        lead = np.where(self._flights.plan_key[rows] == self._flights.key[rows], 0, self._flights.member[rows])
        leader = rows - lead
        home = self._middle_m - self._frames.origin_m[leader]
        right_m = np.einsum("ij,ij->i", home, self._frames.right[leader])
        ahead_m = np.einsum("ij,ij->i", home, self._frames.ahead[leader])
        off = np.mod(np.arctan2(right_m, ahead_m) - self._heading[leader] + np.pi, 2.0 * np.pi) - np.pi
        drawn = hashed_uniform(self._flights.plan_key[rows], 48, self._step[rows], low=-1.0)
        outside = np.hypot(right_m, ahead_m) > self._settings.effective_radius_m()
        return np.where(np.where(outside, off, drawn) < 0.0, -1.0, 1.0)

    def _fly(self, block: int) -> Block:
        start_s, n = block * BLOCK_S, len(self._slots)
        legs, heading, speed = self._legs, self._heading, self._speed
        right_mps = np.broadcast_to(speed * np.sin(heading), (STEPS + 1, n)).copy()
        ahead_mps = np.broadcast_to(speed * np.cos(heading), (STEPS + 1, n)).copy()
        vertical_mps = np.zeros((STEPS + 1, n))
        exposure = np.broadcast_to(speed / (speed + GUST_FULL_MPS), (STEPS + 1, n)).copy()
        active = np.flatnonzero(legs.active(start_s, start_s + BLOCK_S))
        if len(active):
            since_s = (start_s - legs.begin_s[active]) + (np.arange(STEPS + 1) * STEP_S)[:, None]
            turn = trapezoid(since_s, legs.turn_s[active], legs.turn_radps[active], TURN_RAMP_RADPS2)
            pull = trapezoid(
                since_s, legs.acceleration_s[active], legs.acceleration_mps2[active], ACCELERATION_RAMP_MPS3
            )
            angle = _integral(turn, heading[active])
            fast = np.maximum(_integral(pull, speed[active]), STANDSTILL_MPS)
            right_mps[:, active], ahead_mps[:, active] = fast * np.sin(angle), fast * np.cos(angle)
            exposure[:, active] = fast / (fast + GUST_FULL_MPS)
            vertical_mps[:, active] = trapezoid(
                since_s, legs.vertical_s[active], legs.vertical_mps[active], VERTICAL_RAMP_MPS2
            )
            heading[active], speed[active] = np.mod(angle[-1], 2.0 * np.pi), fast[-1]
        self._blow(block, exposure, right_mps, ahead_mps)
        right_m, ahead_m = _integral(right_mps), _integral(ahead_mps)
        height_m = _integral(vertical_mps, self._height)
        frames = self._frames
        self._frames, self._height = frames.moved(right_m[-1], ahead_m[-1], height_m[-1]), height_m[-1].copy()
        return Block(
            block, self._anchor_s, np.flatnonzero(self._in_the_air), self._slots, self._identity, self._settings,
            frames, legs, self._encoder_m, right_m, ahead_m, height_m, right_mps, ahead_mps, vertical_mps,
        )  # fmt: skip

    def _blow(self, block: int, exposure: Array, right_mps: Array, ahead_mps: Array) -> None:
        """Add the gusts of one block to the velocities."""
        if self._settings.gust_mps2 == 0.0:
            return
        scatter = self._settings.gust_mps2 * np.sqrt(1.0 - _GUST_DECAY**2)
        inputs = np.empty((GUST_NODES + 2, 2, len(self._slots)))
        inputs[0], inputs[1] = self._gust_mps, self._gust_mps2
        for node in range(GUST_NODES):
            new = np.stack(hashed_normal_pair(self._flights.gust_key, 32, block * GUST_NODES + node))
            inputs[node + 2] = _GUST_DECAY * inputs[node + 1] + scatter * new
        for axis, velocity_mps in enumerate((right_mps, ahead_mps)):
            gust_mps = np.einsum("kj,jn->kn", _GUST_RESPONSE, inputs[:, axis])
            self._gust_mps[axis] = gust_mps[-1]
            velocity_mps += exposure * gust_mps
        self._gust_mps2 = inputs[-1].copy()
