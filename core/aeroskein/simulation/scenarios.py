"""Scenarios: what kinds of flights there are, as scripts of legs with ranges from which each flight draws.

A family is a way of flying: its legs come first in the order of its script, then from its loop, drawn at random or in
turn. The families and their rates are those of the numerical study in docs/algorithm.md (cruise, en route, terminal,
hold, approach), with more for what a tracker finds hard: climb, acceleration, hover, crossing and formation.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from aeroskein.plots import Array, Ints
from aeroskein.units import KNOT_MPS

__all__ = [
    "FAMILIES",
    "FAMILY_NUMBER",
    "LEG_TABLE",
    "MIXTURE",
    "Family",
    "Leg",
    "LegColumn",
    "group_size",
    "leg_numbers",
]

Range = tuple[float, float]
_ANY: Final[Range] = (np.nan, np.nan)


class Leg(NamedTuple):
    """One leg: straight on for a while, then a change of course, speed and height at once (each may be absent)."""

    straight_s: Range
    """Straight flight first. [s]"""
    turn_deg: Range = (0.0, 0.0)
    """Amount of the turn, to either side, or home where the aircraft has left the area. [deg]"""
    turn_dps: Range = (1.0, 1.0)
    """Two rates of which one is drawn. [deg/s]"""
    right: bool = False
    """Whether the turn always goes to the right, as in a standard holding."""
    speed_mps: Range = _ANY
    """New speed. [m/s]"""
    acceleration_mps2: Range = (0.5, 0.5)
    """Greatest acceleration on the way to it. [m/s²]"""
    height_m: Range = _ANY
    """New height. [m]"""
    vertical_mps: Range = (8.0, 8.0)
    """Greatest vertical rate on the way to it. [m/s]"""


class LegColumn:
    """Columns of ``LEG_TABLE``; a range takes two."""

    STRAIGHT = slice(0, 2)
    TURN = slice(2, 4)
    TURN_RATE = slice(4, 6)
    RIGHT = 6
    SPEED = slice(7, 9)
    ACCELERATION = slice(9, 11)
    HEIGHT = slice(11, 13)
    VERTICAL = slice(13, 15)


class Family(NamedTuple):
    """A way of flying."""

    speed_mps: Range
    height_m: Range
    loop: tuple[Leg, ...]
    script: tuple[Leg, ...] = ()
    ordered: bool = False
    """Whether the loop is flown in turn; otherwise each next leg is drawn."""
    through: bool = False
    """Whether the flight passes the area from side to side; otherwise it starts inside and stays about there."""
    spread: float = 0.7
    """How much of the area's radius is used for starting points, or for passing by the middle."""
    shared: bool = False
    """Whether the aircraft of a group fly the same legs at the same time (formation)."""
    meeting: bool = False
    """Whether the aircraft of a group meet at one point at one time (crossing)."""


STRAIGHT = Leg((60.0, 60.0))
_GENTLE_TURN = Leg((15.0, 45.0), (15.0, 60.0), (0.5, 0.5))
_TURN = Leg((15.0, 45.0), (20.0, 90.0), (1.0, 1.0))
_CRUISE_SPEED = Leg((10.0, 40.0), speed_mps=(190.0, 250.0), acceleration_mps2=(0.5, 0.5))
_CRUISE_LEVEL = Leg((10.0, 40.0), height_m=(6500.0, 11500.0), vertical_mps=(6.0, 12.0))
_STANDARD_TURN = Leg((10.0, 30.0), (30.0, 180.0), (3.0, 1.5))
_CIRCUIT_SPEED = Leg((10.0, 30.0), speed_mps=(105.0, 155.0), acceleration_mps2=(0.6, 0.6))
_CIRCUIT_LEVEL = Leg((10.0, 30.0), height_m=(1500.0, 5000.0), vertical_mps=(5.0, 10.0))
_DESCENDING_TURN = Leg((10.0, 30.0), (30.0, 120.0), (3.0, 1.5), height_m=(1500.0, 4500.0), vertical_mps=(4.0, 8.0))
_HALF_LAP = Leg((60.0, 60.0), (180.0, 180.0), (3.0, 3.0), right=True)
_SLOW_TURN = Leg((15.0, 40.0), (60.0, 180.0), (3.0, 1.5), speed_mps=(60.0, 85.0), acceleration_mps2=(0.4, 0.6))

FAMILIES: Final[dict[str, Family]] = {
    "cruise": Family((225.0, 255.0), (9000.0, 12000.0), (STRAIGHT,), through=True),
    "enroute": Family(
        (195.0, 245.0),
        (6500.0, 11500.0),
        (_GENTLE_TURN, _TURN, _TURN, _CRUISE_SPEED, _CRUISE_LEVEL, _TURN._replace(height_m=(6500.0, 11500.0))),
    ),
    "terminal": Family(
        (115.0, 145.0),
        (1500.0, 5000.0),
        (_STANDARD_TURN, _STANDARD_TURN, _CIRCUIT_SPEED, _CIRCUIT_LEVEL, _DESCENDING_TURN),
    ),
    "hold": Family(
        (105.0, 120.0),
        (2500.0, 5000.0),
        (_GENTLE_TURN._replace(turn_dps=(1.5, 1.0)), STRAIGHT),
        (_HALF_LAP._replace(straight_s=(20.0, 60.0)), *(_HALF_LAP,) * 5),
    ),
    "approach": Family(
        (240.0 * KNOT_MPS, 240.0 * KNOT_MPS),
        (1800.0, 2500.0),
        (_SLOW_TURN, _SLOW_TURN, Leg((15.0, 40.0), height_m=(1000.0, 2000.0), vertical_mps=(3.0, 5.0))),
        (
            Leg((20.0, 40.0), speed_mps=(80.0, 90.0), height_m=(1200.0, 1500.0), vertical_mps=(4.0, 6.0)),
            Leg((10.0, 20.0), (60.0, 100.0), (3.0, 1.5)),
            Leg((10.0, 25.0), (60.0, 100.0), (3.0, 3.0), speed_mps=(60.0, 72.0)),
            Leg((5.0, 10.0), speed_mps=(40 * KNOT_MPS, 40 * KNOT_MPS), height_m=(700, 850), vertical_mps=(3.0, 4.0)),
            Leg((20.0, 40.0), speed_mps=(65.0, 80.0), acceleration_mps2=(0.8, 1.0), height_m=(1200.0, 2000.0)),
        ),
    ),
    "climb": Family(
        (150.0, 180.0),
        (1500.0, 3000.0),
        (
            Leg((15.0, 30.0), height_m=(6000.0, 10500.0), vertical_mps=(10.0, 15.0), speed_mps=(195.0, 230.0)),
            Leg((20.0, 40.0), height_m=(2500.0, 5000.0), vertical_mps=(7.0, 12.0), speed_mps=(150.0, 180.0)),
        ),
        ordered=True,
        through=True,
    ),
    "acceleration": Family(
        (130.0, 150.0),
        (4000.0, 9000.0),
        (
            Leg((15.0, 30.0), speed_mps=(215.0, 245.0), acceleration_mps2=(0.5, 1.2)),
            Leg((15.0, 30.0), speed_mps=(120.0, 150.0), acceleration_mps2=(0.5, 1.0)),
        ),
        ordered=True,
        through=True,
    ),
    "hover": Family(
        (45.0, 65.0),
        (800.0, 1200.0),
        (
            Leg((15.0, 40.0), speed_mps=(0.0, 0.0), acceleration_mps2=(0.6, 1.0)),
            Leg((20.0, 40.0), height_m=(1250.0, 1500.0), vertical_mps=(2.0, 4.0)),
            Leg((15.0, 30.0), height_m=(800.0, 1100.0), vertical_mps=(2.0, 4.0)),
            Leg((15.0, 30.0), speed_mps=(40.0, 65.0), acceleration_mps2=(0.6, 1.2)),
            Leg((20.0, 50.0), (60.0, 180.0), (3.0, 3.0)),
        ),
        ordered=True,
        spread=0.4,
    ),
    "crossing": Family((200.0, 250.0), (8000.0, 11000.0), (STRAIGHT,), spread=0.6, meeting=True),
    "formation": Family(
        (150.0, 220.0),
        (4000.0, 8000.0),
        (_TURN, _GENTLE_TURN, STRAIGHT, _CRUISE_LEVEL._replace(height_m=(4000.0, 8000.0))),
        shared=True,
    ),
}

FAMILY_NUMBER: Final = {name: number for number, name in enumerate(FAMILIES)}

# Share of each family in scenario ``mixed``: a terminal area with the traffic that passes over it.
MIXTURE: Final[dict[str, float]] = {
    "cruise": 0.24,
    "enroute": 0.26,
    "terminal": 0.16,
    "hold": 0.06,
    "approach": 0.06,
    "climb": 0.10,
    "acceleration": 0.02,
    "hover": 0.04,
    "crossing": 0.04,
    "formation": 0.02,
}

# Aircraft of a formation; in ``mixed`` and ``crossing`` groups are pairs.
FORMATION_SIZE: Final = 3


def group_size(scenario: str) -> int:
    """How many neighbouring slots belong together."""
    return FORMATION_SIZE if scenario == "formation" else 2


def _flatten(leg: Leg) -> list[float]:
    pairs = (leg.straight_s, leg.turn_deg, leg.turn_dps, (float(leg.right),))
    rest = (leg.speed_mps, leg.acceleration_mps2, leg.height_m, leg.vertical_mps)
    return [value for pair in (*pairs, *rest) for value in pair]


_SCRIPTS: Final = [family.script for family in FAMILIES.values()]
_LOOPS: Final = [family.loop for family in FAMILIES.values()]
_SCRIPT_LENGTH: Final = np.array([len(script) for script in _SCRIPTS])
_LOOP_LENGTH: Final = np.array([len(loop) for loop in _LOOPS])
_ORDERED: Final = np.array([family.ordered for family in FAMILIES.values()])
# All legs of all families stand in one table: script, then loop, family by family.
_FIRST_LEG: Final = np.concatenate([[0], np.cumsum(_SCRIPT_LENGTH + _LOOP_LENGTH)])[:-1]

LEG_TABLE: Final[Array] = np.array(
    [_flatten(leg) for script, loop in zip(_SCRIPTS, _LOOPS, strict=True) for leg in (*script, *loop)]
)
"""Every leg as a row of numbers, see ``LegColumn``."""


def leg_numbers(family: Ints, step: Ints, draw: Array) -> Ints:
    """Which leg (row of ``LEG_TABLE``) a flight flies as its ``step``-th, given a number drawn from [0, 1)."""
    in_loop = step - _SCRIPT_LENGTH[family]
    length = _LOOP_LENGTH[family]
    looped = np.where(_ORDERED[family], in_loop % length, (draw * length).astype(np.int64))
    return np.asarray(_FIRST_LEG[family] + np.where(in_loop < 0, step, _SCRIPT_LENGTH[family] + looped))
