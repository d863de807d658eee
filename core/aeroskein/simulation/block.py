"""One block of motion: two seconds of every aircraft of a fleet at 20 Hz, and its state at any instant between.

Between two steps positions follow the cubic that agrees with both positions and velocities, so every instant has a
truth; latitude and longitude are made only for the instants that are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.ellipsoid import normal_and_height
from aeroskein.plots import Array, Ints
from aeroskein.simulation.frames import Frames, east_north, latitude_longitude_deg, track_angle_deg
from aeroskein.simulation.manoeuvres import Legs
from aeroskein.simulation.settings import SimulationSettings
from aeroskein.simulation.traffic import BLOCK_S
from aeroskein.simulation.truth import Identity, Phase, States, TruthStates

__all__ = ["STEPS", "STEP_S", "Block"]

STEPS: Final = 40
STEP_S: Final = BLOCK_S / STEPS

# Below this an aircraft hovers. [m/s]
HOVER_MPS: Final = 1.0

# The geometric-minus-pressure difference is a wave over the globe of about this length that passes in this time.
PRESSURE_WAVE_M: Final = 1.0e6
PRESSURE_WAVE_S: Final = 21_600.0
_WAVE_DIRECTION: Final = np.array([0.48, 0.60, 0.64]) * 6.371e6 / PRESSURE_WAVE_M


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
