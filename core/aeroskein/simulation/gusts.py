"""Gusts: how the air moves an aircraft off its planned speed and course.

The acceleration is an Ornstein-Uhlenbeck process of 10 s; its effect on the velocity fades within a minute, as a crew
or an autopilot would have it. Aircraft that belong together are in the same air and get the same gusts.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Ints
from aeroskein.simulation.block import STEP_S, STEPS
from aeroskein.simulation.draws import Keys, hashed_normal_pair
from aeroskein.simulation.traffic import BLOCK_S

__all__ = ["Gusts"]

# Correlation time of the acceleration, time in which its effect on the velocity is flown out. [s]
GUST_TIME_S: Final = 10.0
GUST_FADE_S: Final = 60.0
# The acceleration is drawn twice a second and linear between: 2 % less variance there than the exact process.
NODES: Final = 4
_DECAY: Final = float(np.exp(-BLOCK_S / NODES / GUST_TIME_S))
# Slow aircraft are held in place by their crews: gusts move them less below this speed. [m/s]
FULL_MPS: Final = 3.0
# Accelerations are drawn for so many aircraft times blocks at once: a feed that catches up with its traffic flies
# hundreds of blocks of a few aircraft, and small draws cost more than their numbers.
DRAWN_AT_ONCE: Final = 1024


def _response() -> Array:
    """How gust velocity at every step follows from its value at the start and the accelerations at the nodes.

    Shape (STEPS + 1, 1 + NODES + 1); made by stepping each unit input through the trapezoidal rule.
    """
    nodes = np.linspace(0.0, BLOCK_S, NODES + 1)
    steps = np.arange(STEPS + 1) * STEP_S
    response = np.zeros((STEPS + 1, NODES + 2))
    response[0, 0] = 1.0
    acceleration = np.stack([np.interp(steps, nodes, unit) for unit in np.eye(NODES + 1)], axis=1)
    for k in range(STEPS):
        response[k + 1] = response[k] * (1.0 - STEP_S / GUST_FADE_S)
        response[k + 1, 1:] += STEP_S / 2.0 * (acceleration[k] + acceleration[k + 1])
    return response


_RESPONSE: Final = _response()


class Gusts:
    """The gusts of a fleet of ``n`` aircraft, along both axes of their frames, from block to block."""

    def __init__(self, sigma_mps2: float, n: int) -> None:
        self._sigma_mps2 = sigma_mps2
        self._mps, self._mps2 = np.zeros((2, n)), np.zeros((2, n))
        self._drawn, self._drawn_from = np.zeros((0, NODES, 2, n)), 0

    def begin(self, rows: Ints, keys: Keys) -> None:
        """New flights: no velocity yet, an acceleration as the process has it on average."""
        self._mps[:, rows] = 0.0
        self._mps2[:, rows] = self._sigma_mps2 * np.stack(hashed_normal_pair(keys, 30))
        self._drawn = self._drawn[:0]  # they were those of other flights

    def blow(self, block: int, keys: Keys, speed_mps: Array, velocities_mps: tuple[Array, Array]) -> None:
        """Add the gusts of one block to velocities ``(STEPS + 1, n)``, as far as the planned speed lets them."""
        if self._sigma_mps2 == 0.0:
            return
        scatter = self._sigma_mps2 * np.sqrt(1.0 - _DECAY**2)
        inputs = np.empty((NODES + 2, *self._mps.shape))
        inputs[0], inputs[1] = self._mps, self._mps2
        for node, new in enumerate(self._new(block, keys)):
            inputs[node + 2] = _DECAY * inputs[node + 1] + scatter * new
        exposure = speed_mps / (speed_mps + FULL_MPS)
        for axis, velocity_mps in enumerate(velocities_mps):
            # No matrix product: its rounding depends on how many aircraft there are.
            gust_mps = np.einsum("kj,jn->kn", _RESPONSE, inputs[:, axis])
            self._mps[axis] = gust_mps[-1]
            velocity_mps += exposure * gust_mps
        self._mps2 = inputs[-1].copy()

    def _new(self, block: int, keys: Keys) -> Array:
        """Standard normal numbers of a block's nodes, ``(NODES, 2, n)``."""
        if not self._drawn_from <= block < self._drawn_from + len(self._drawn):
            nodes = block * NODES + np.arange(NODES * max(1, DRAWN_AT_ONCE // max(1, len(keys))))
            pairs = np.stack(hashed_normal_pair(keys, 32, nodes[:, None]), axis=1)
            self._drawn, self._drawn_from = pairs.reshape(-1, NODES, *pairs.shape[1:]), block
        return np.asarray(self._drawn[block - self._drawn_from])
