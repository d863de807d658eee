"""Recentring: a track that has flown far from the origin of its plane gets a new plane, and everything moves with it.

Any point of the track may be the origin (the element method says so too); what matters is that the plane stays small,
where straight flight is straight. States, covariances and buffered reports go through the exact change of frame.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy, kalman
from aeroskein.closing import ElementTable
from aeroskein.engine_state import EngineState
from aeroskein.manoeuvre import MODELS
from aeroskein.measurements import COLUMNS
from aeroskein.mode_bank import ModeBank
from aeroskein.plots import Array, Ints
from aeroskein.rings import Rings

__all__ = ["recentre"]

# At 50 km the plane's metres are 3e-5 short and a straight flight bends by less than 0.001 m/s². [m]
FAR_M: Final = 50_000.0

_COLUMN: Final = {name: i for i, name in enumerate(COLUMNS)}


def recentre(state: EngineState) -> Ints:
    """Give tracks that are far from their origin the frame nearest to where they are; returns their slots."""
    active = state.tracks.active
    active = active[np.isfinite(state.live.bank.time_s[active])]
    east, north, _, _ = state.live.bank.steady(active)
    far = np.maximum(np.abs(east), np.abs(north)) > FAR_M
    slots: Ints = active[far]
    if not len(slots):
        return slots
    old = state.frames.rows[state.tracks.frame[slots]]
    lat, lon = geodesy.from_plane(old, east[far], north[far])
    state.tracks.frame[slots] = state.frames.near(lat, lon)
    new = state.frames.rows[state.tracks.frame[slots]]
    _, _, turn = geodesy.move_frame(old, new, east[far], north[far])
    for bank in (state.live.bank, state.elements.detector):
        _move_bank(bank, slots, old, new, turn)
    _move_elements(state.elements, slots, old, new, turn)
    _move_places(state.live.places_m, slots, old, new)
    _move_reports(state.buffers.rows, slots, old, new, turn)
    return slots


def _turned(turn: Array, P: Array) -> Array:
    """Covariances in block-upper rows ``(24, n)`` through the Jacobians ``(n, 2, 2)`` of a change of frame."""
    T = np.zeros((len(turn), 6, 6))
    for k in (0, 2, 4):
        T[:, k : k + 2, k : k + 2] = turn
    turned = T @ kalman.to_matrix(P) @ T.swapaxes(1, 2)
    # The kernels keep the symmetry that they are given, to the last bit.
    return kalman.from_matrix(0.5 * (turned + turned.swapaxes(1, 2)))


def _move_state(x: Array, old: Array, new: Array, turn: Array) -> None:
    """States ``(6, n)`` in place."""
    x[0], x[1], _ = geodesy.move_frame(old, new, x[0], x[1])
    for k in (2, 4):
        x[k], x[k + 1] = geodesy.rotate_vector(turn, x[k].copy(), x[k + 1].copy())


def _move_bank(bank: ModeBank, slots: Ints, old: Array, new: Array, turn: Array) -> None:
    work = bank.take(slots)
    for model in range(MODELS):
        x = work.x[:, model].copy()
        _move_state(x, old, new, turn)
        work.x[:, model] = x
        work.P[:, model] = _turned(turn, work.P[:, model])
    bank.put(slots, work)


def _move_elements(elements: ElementTable, slots: Ints, old: Array, new: Array, turn: Array) -> None:
    states = elements.states[slots].T.copy()
    _move_state(states[:6], old, new, turn)
    states[6:] = _turned(turn, states[6:])
    elements.states[slots] = states.T
    _move_places(elements.places_m, slots, old, new)


def _move_places(places_m: Array, slots: Ints, old: Array, new: Array) -> None:
    """The last two published places ``(capacity, 4)`` of some tracks, in place."""
    places = places_m[slots]
    for k in (0, 2):
        places[:, k], places[:, k + 1], _ = geodesy.move_frame(old, new, places[:, k], places[:, k + 1])
    places_m[slots] = places


def _move_reports(rings: Rings, slots: Ints, old: Array, new: Array, turn: Array) -> None:
    rows = rings[slots]
    depth = rows.shape[1]
    old, new, turn = (np.repeat(a, depth, axis=0) for a in (old, new, turn))

    def column(*names: str) -> list[Array]:
        return [rows[:, :, _COLUMN[name]].ravel() for name in names]

    def keep(names: tuple[str, ...], values: tuple[Array, ...]) -> None:
        for name, value in zip(names, values, strict=True):
            rows[:, :, _COLUMN[name]] = value.reshape(-1, depth)

    place, speed, noise = ("east_m", "north_m"), ("v_east_mps", "v_north_mps"), ("r_ee", "r_en", "r_nn")
    keep(place, geodesy.move_frame(old, new, *column(*place))[:2])
    keep(speed, geodesy.rotate_vector(turn, *column(*speed)))
    keep(noise, tuple(geodesy.rotate_covariance(turn, np.stack(column(*noise), axis=1)).T))
    rings[slots] = rows
