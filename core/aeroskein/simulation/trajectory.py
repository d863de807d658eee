"""Trajectories: the aircraft of a range of slots, integrated at 20 Hz in blocks of two seconds.

Course, speed and height follow the legs (``manoeuvres``), moved by gusts; each aircraft is integrated in the tangent
plane it carries along (``frames``). What is flown depends on the seed and the slot only, so any range of slots can be
flown by itself.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints
from aeroskein.simulation.block import STEP_S, STEPS, Block
from aeroskein.simulation.draws import hashed_normal_pair, hashed_uniform
from aeroskein.simulation.frames import Frames
from aeroskein.simulation.gusts import Gusts
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

__all__ = ["Fleet"]

# A vertical or standing aircraft keeps a direction: this speed along its heading remains. [m/s]
STANDSTILL_MPS: Final = 1e-6


def _integral(rate: Array, start: Array | float = 0.0) -> Array:
    """Trapezoidal integral over the steps, first axis, same shape."""
    total = np.empty_like(rate)
    total[0] = start
    np.add(rate[1:], rate[:-1], out=total[1:])
    total[1:] *= STEP_S / 2.0
    return np.cumsum(total, axis=0, out=total)


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
        self._gusts, self._encoder_m = Gusts(settings.gust_mps2, n), np.zeros(n)

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
        self._gusts.begin(rows, flights.gust_key)
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
        speed_mps = np.broadcast_to(speed, (STEPS + 1, n)).copy()
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
            speed_mps[:, active] = fast
            vertical_mps[:, active] = trapezoid(
                since_s, legs.vertical_s[active], legs.vertical_mps[active], VERTICAL_RAMP_MPS2
            )
            heading[active], speed[active] = np.mod(angle[-1], 2.0 * np.pi), fast[-1]
        self._gusts.blow(block, self._flights.gust_key, speed_mps, (right_mps, ahead_mps))
        right_m, ahead_m = _integral(right_mps), _integral(ahead_mps)
        height_m = _integral(vertical_mps, self._height)
        frames = self._frames
        self._frames, self._height = frames.moved(right_m[-1], ahead_m[-1], height_m[-1]), height_m[-1].copy()
        return Block(
            block, self._anchor_s, np.flatnonzero(self._in_the_air), self._slots, self._identity, self._settings,
            frames, legs, self._encoder_m, right_m, ahead_m, height_m, right_mps, ahead_mps, vertical_mps,
        )  # fmt: skip
