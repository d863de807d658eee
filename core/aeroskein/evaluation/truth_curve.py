"""Truth at any instant: a cubic through the samples of each flight, in Earth-centred coordinates.

Between two samples the position is the cubic Hermite polynomial through both positions and both velocities: on a
standard-rate turn sampled every second its error is below a millimetre. Where truth carries no velocity, the tangent
is that of the parabola through three neighbouring samples. All flights are searched at once: one sorted key per
sample, flight first, time second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.evaluation.columns import Truth
from aeroskein.evaluation.geometry import east_north, ecef, up_vector, velocity_ecef
from aeroskein.evaluation.hermite import hermite, parabola_tangents
from aeroskein.plots import Array, Bools, Ints

__all__ = ["CLIMB_RATE_MPS", "MAX_TRUTH_GAP_S", "TURN_RATE_DEGPS", "TruthCurve", "TruthStates"]

# A longer hole in truth is not bridged: on a standard-rate turn the cubic is 2.5 m off after 15 s, 40 m after 30 s.
MAX_TRUTH_GAP_S: Final = 15.0

# An instant this little outside the samples still belongs to them: rounding of times in files.
_TIME_TOLERANCE_S: Final = 1e-6

# Kinematic phases, for truth without phases and for requirement rows that ask "straight or turning?".
TURN_RATE_DEGPS: Final = 0.25  # below any deliberate turn (0.5 deg/s), above the wandering of a straight flight
CLIMB_RATE_MPS: Final = 1.5  # 300 ft/min
_DERIVED_PHASES: Final = ("straight", "acceleration", "climb", "turn", "hover")
_HOVER_SPEED_MPS: Final = 5.0  # 10 kt: below it wind drift, not navigation, sets the direction
_ACCELERATION_MPS2: Final = 0.25  # half of a gentle airliner speed change


@dataclass(slots=True, eq=False)
class TruthStates:
    """Truth at given instants, one row each; rows where truth says nothing are not ``valid`` and otherwise arbitrary.

    Attributes
    ----------
    valid : (n,) bool
    position, velocity : (n, 3) float64
        Earth-centred. [m, m/s]
    up : (n, 3) float64
        n-vector. [1]
    height_m, altitude_m, vertical_rate_mps : (n,) float64
        NaN where truth does not say. [m, m, m/s]
    turn_rate_degps : (n,) float64
        Positive to the right; 0 where nothing moves. [deg/s]
    phase : (n,) int16
        Index into ``TruthCurve.phases``.
    """

    valid: Bools
    position: Array
    velocity: Array
    up: Array
    height_m: Array
    altitude_m: Array
    vertical_rate_mps: Array
    turn_rate_degps: Array
    phase: NDArray[np.int16]


class TruthCurve:
    """Truth of all flights, ready to be asked for any instant.

    Parameters
    ----------
    truth : Truth
        The samples, in any order; repeated instants of one flight and samples without position are dropped.
    max_gap_s : float
        Longest time between two samples that is bridged. [s]
    """

    def __init__(self, truth: Truth, max_gap_s: float = MAX_TRUTH_GAP_S) -> None:
        self.names, self.addresses, self.callsigns = truth.names, truth.addresses, truth.callsigns
        self.max_gap_s = max_gap_s
        rows = _sorted_rows(truth)
        self.flight = truth.flight[rows].astype(np.int64)
        self.time_s = truth.time_s[rows]
        flights = np.arange(len(truth.names))
        self.first_row = np.searchsorted(self.flight, flights, side="left")
        self.end_row = np.searchsorted(self.flight, flights, side="right")
        self._set_key()
        self._set_motion(truth, rows)
        self.phases: tuple[str, ...] = ()
        self.phase = np.full(len(rows), -1, dtype=np.int16)
        self._set_phases(truth, rows)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def start_s(self) -> Array:
        """First instant of each flight, NaN for a flight without samples, shape ``(flights,)``. [s]"""
        return self._edge(self.first_row)

    @property
    def end_s(self) -> Array:
        """Last instant of each flight, NaN for a flight without samples, shape ``(flights,)``. [s]"""
        return self._edge(self.end_row - 1)

    def _edge(self, row: Ints) -> Array:
        if len(self.time_s) == 0:
            return np.full(len(self.names), np.nan)
        edge = self.time_s[np.clip(row, 0, len(self.time_s) - 1)]
        return np.where(self.end_row > self.first_row, edge, np.nan)

    def _set_key(self) -> None:
        empty = len(self.time_s) == 0
        self._origin_s = 0.0 if empty else float(self.time_s.min())
        self._stride_s = 2.0 if empty else float(self.time_s.max()) - self._origin_s + 2.0
        self._key = self.flight * self._stride_s + (self.time_s - self._origin_s)

    def _set_motion(self, truth: Truth, rows: NDArray[Any]) -> None:
        lat, lon = truth.lat_deg[rows], truth.lon_deg[rows]
        self.height_m, self.altitude_m = truth.height_m[rows], truth.altitude_m[rows]
        self.vertical_rate_mps = truth.vertical_rate_mps[rows]
        self.up = up_vector(lat, lon)
        self.position = ecef(self.up, np.nan_to_num(self.height_m))
        horizontal = east_north(truth.ground_speed_mps[rows], truth.track_angle_deg[rows])
        velocity = velocity_ecef(lat, lon, horizontal, np.nan_to_num(self.vertical_rate_mps))
        fallback = parabola_tangents(self.time_s, self.position, self.flight)
        self.velocity = np.where(np.isfinite(velocity).all(axis=1, keepdims=True), velocity, fallback)
        climb = parabola_tangents(self.time_s, self.height_m[:, None], self.flight)
        self._climb = np.where(np.isfinite(self.vertical_rate_mps)[:, None], self.vertical_rate_mps[:, None], climb)

    def _set_phases(self, truth: Truth, rows: NDArray[Any]) -> None:
        """Phase of each sample: as truth says, else from its own motion."""
        said = truth.phase[rows]
        if (said >= 0).all():
            self.phases, self.phase = truth.phases, said
            return
        self.phases = tuple(dict.fromkeys(truth.phases + _DERIVED_PHASES))
        lookup = np.array([self.phases.index(name) for name in _DERIVED_PHASES], dtype=np.int16)
        self.phase = np.where(said >= 0, said, lookup[self._derived_phase()]).astype(np.int16)

    def _derived_phase(self) -> Ints:
        """Index into ``_DERIVED_PHASES`` for every sample; the later name wins where several apply."""
        states = self.at(self.flight, self.time_s)
        speed = np.linalg.norm(self.velocity, axis=1)
        speed_rate = parabola_tangents(self.time_s, speed[:, None], self.flight)[:, 0]
        phase = np.zeros(len(speed), dtype=np.int64)
        phase[np.abs(speed_rate) > _ACCELERATION_MPS2] = 1
        phase[np.abs(self._climb[:, 0]) > CLIMB_RATE_MPS] = 2
        phase[np.abs(states.turn_rate_degps) > TURN_RATE_DEGPS] = 3
        phase[speed < _HOVER_SPEED_MPS] = 4
        return phase

    def at(self, flight: NDArray[Any], time_s: Array) -> TruthStates:
        """Truth of the given flights at the given instants.

        Parameters
        ----------
        flight : (n,) int array
            Index of the flight; -1 gives a row that is not valid.
        time_s : (n,) array
            [s since the epoch]

        Returns
        -------
        TruthStates
            Not valid outside the samples of the flight and in holes longer than ``max_gap_s``.
        """
        if len(self.time_s) < 2:
            return _nowhere(len(time_s))
        left = self._left(flight, time_s)
        i = np.where(left >= 0, left, 0)
        span_s = np.where(left >= 0, self.time_s[i + 1] - self.time_s[i], 1.0)
        tolerance = _TIME_TOLERANCE_S / span_s
        u = np.where(left >= 0, (time_s - self.time_s[i]) / span_s, 0.0)
        valid = (left >= 0) & (span_s <= self.max_gap_s) & (u >= -tolerance) & (u <= 1.0 + tolerance)
        u = np.where(valid, u, 0.0)
        position, velocity = hermite(self.position, self.velocity, i, u, span_s)
        height, climb = hermite(self.height_m[:, None], self._climb, i, u, span_s)
        up = _blend(self.up, i, u[:, None])
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        acceleration = (self.velocity[i + 1] - self.velocity[i]) / span_s[:, None]
        return TruthStates(
            valid=valid,
            position=position,
            velocity=velocity,
            up=up,
            height_m=height[:, 0],
            altitude_m=_blend(self.altitude_m, i, u),
            vertical_rate_mps=climb[:, 0],
            turn_rate_degps=_turn_rate_degps(up, velocity, acceleration),
            phase=self.phase[i + (u > 0.5)],
        )

    def _left(self, flight: NDArray[Any], time_s: Array) -> Ints:
        """Row of the sample before each instant, such that the next row is of the same flight; -1 where none."""
        flight = np.asarray(flight, dtype=np.int64)
        known = (flight >= 0) & np.isfinite(time_s)
        safe = np.where(known, flight, 0)
        # Instants outside the whole truth would fall among the keys of another flight; they stay beside their own.
        offset_s = np.clip(np.where(known, time_s, 0.0) - self._origin_s, -0.5, self._stride_s - 1.5)
        row = np.searchsorted(self._key, safe * self._stride_s + offset_s, side="right") - 1
        # The last sample before a hole ends the interval before it, else it would fall into the hole.
        inner = np.clip(row, 0, len(self.time_s) - 2)
        on_edge = (time_s - self.time_s[inner] <= _TIME_TOLERANCE_S) & (
            self.time_s[inner + 1] - self.time_s[inner] > self.max_gap_s
        )
        row = np.clip(row - on_edge, self.first_row[safe], self.end_row[safe] - 2)
        return np.where(known & (self.end_row[safe] - self.first_row[safe] >= 2), row, -1)


def _sorted_rows(truth: Truth) -> Ints:
    """Rows with a position, by flight then time, without repeated instants (the last one written counts)."""
    usable = np.isfinite(truth.time_s) & np.isfinite(truth.lat_deg) & np.isfinite(truth.lon_deg)
    rows = np.flatnonzero(usable)
    order = rows[np.lexsort((truth.time_s[rows], truth.flight[rows]))]
    if len(order) < 2:
        return order
    repeated = np.diff(truth.time_s[order]) <= _TIME_TOLERANCE_S
    repeated &= truth.flight[order][1:] == truth.flight[order][:-1]
    return np.asarray(order[np.append(~repeated, True)])


def _blend(value: Array, left: Ints, u: Array) -> Array:
    """Linear interpolation between samples ``left`` and ``left + 1``."""
    return np.asarray(value[left] + (value[left + 1] - value[left]) * u)


def _turn_rate_degps(up: Array, velocity: Array, acceleration: Array) -> Array:
    """Rate at which the track angle grows, seen from the great circle; 0 where nothing moves. [deg/s]"""
    speed_squared = np.sum(velocity * velocity, axis=1)
    # A turn to the right accelerates to the right: (acceleration x velocity) points up.
    lateral = np.sum(np.cross(acceleration, velocity) * up, axis=1)
    return np.asarray(
        np.degrees(np.divide(lateral, speed_squared, out=np.zeros_like(lateral), where=speed_squared > 1.0))
    )


def _nowhere(n: int) -> TruthStates:
    """Rows about which truth says nothing."""
    vector, scalar = np.zeros((n, 3)), np.full(n, np.nan)
    up = np.tile([1.0, 0.0, 0.0], (n, 1))
    return TruthStates(
        np.zeros(n, dtype=np.bool_), vector, vector.copy(), up, scalar, scalar.copy(), scalar.copy(),
        np.zeros(n), np.full(n, -1, dtype=np.int16),
    )  # fmt: skip
