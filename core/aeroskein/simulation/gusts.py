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

    def begin(self, rows: Ints, keys: Keys) -> None:
        """New flights: no velocity yet, an acceleration as the process has it on average."""
        self._mps[:, rows] = 0.0
        self._mps2[:, rows] = self._sigma_mps2 * np.stack(hashed_normal_pair(keys, 30))

    def blow(self, block: int, keys: Keys, speed_mps: Array, velocities_mps: tuple[Array, Array]) -> None:
        """Add the gusts of one block to velocities ``(STEPS + 1, n)``, as far as the planned speed lets them."""
        if self._sigma_mps2 == 0.0:
            return
        scatter = self._sigma_mps2 * np.sqrt(1.0 - _DECAY**2)
        inputs = np.empty((NODES + 2, *self._mps.shape))
        inputs[0], inputs[1] = self._mps, self._mps2
        for node in range(NODES):
            new = np.stack(hashed_normal_pair(keys, 32, block * NODES + node))
            inputs[node + 2] = _DECAY * inputs[node + 1] + scatter * new
        exposure = speed_mps / (speed_mps + FULL_MPS)
        for axis, velocity_mps in enumerate(velocities_mps):
            # No matrix product: its rounding depends on how many aircraft there are.
            gust_mps = np.einsum("kj,jn->kn", _RESPONSE, inputs[:, axis])
            self._mps[axis] = gust_mps[-1]
            velocity_mps += exposure * gust_mps
        self._mps2 = inputs[-1].copy()
