"""References for registration: where an aircraft was at the time of a radar plot, without that radar.

Own positions (ADS-B, multilateration) around the plot are fitted with constant acceleration by weighted least squares.
The fit stands on those reports alone, so the radar cannot confirm its own error. Where there are too few, the live
state serves for height and velocity only, and the plot is compared with other radars, not with the reference.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein import geodesy
from aeroskein.engine_state import EngineState
from aeroskein.measurements import COLUMNS, Measurements
from aeroskein.plots import Array, Bools, Ints, Plots
from aeroskein.registration import Comparisons

__all__ = ["ReferenceSampler", "compare"]

# Reports further from the plot than this say little about where the aircraft was. [s]
REACH_S: Final = 6.0
# A fit needs this many, one of them this near. [reports], [s]
FEWEST: Final = 4
NEAREST_S: Final = 2.0
# Unmodelled jerk: what three seconds of it do to a position limits the weight of far reports. [m²/s⁵]
JERK_DENSITY: Final = 0.1
# An aircraft does not accelerate harder than this in ordinary flight. [m/s²]
ACCELERATION_SIGMA: Final = 3.0
# Squared residual beyond which a report is left out of a second fit.
OUTLIER: Final = 16.0

# How well an aircraft's own difference of height and altitude is known. [m]
OWN_OFFSET_SIGMA_M: Final = 5.0
# Comparisons per radar and second; more would teach nothing new, for errors of references last for seconds. [1/s]
COMPARISONS_PER_S: Final = 100.0
# Spreads track numbers evenly (Knuth's multiplicative hash).
_SPREAD: Final = 2654435761

_COLUMN: Final = {name: i for i, name in enumerate(COLUMNS)}


class ReferenceSampler:
    """Chooses which radar plots are compared: all of them, until a radar has more than registration can use."""

    def __init__(self, sensors: int) -> None:
        self._allowance = np.full(sensors, COMPARISONS_PER_S)
        self._last_s = -np.inf
        self._turn = 0

    def some(self, rows: Ints, sensor: NDArray[np.int16], number: Ints, now_s: float) -> Ints:
        """Of the given rows those to compare; ``sensor`` and ``number`` are columns of the whole batch."""
        earned = COMPARISONS_PER_S * min(max(now_s - self._last_s, 0.0), 1.0)
        self._last_s = now_s
        self._allowance = np.minimum(self._allowance + earned, COMPARISONS_PER_S)
        self._turn += 1
        order = ((number[rows] + self._turn) * _SPREAD) & 0xFFFFFFFF
        chosen = []
        for k in np.unique(sensor[rows]):
            own = np.flatnonzero(sensor[rows] == k)
            own = own[np.argsort(order[own], kind="stable")][: int(self._allowance[k])]
            self._allowance[k] -= len(own)
            chosen.append(rows[own])
        return np.sort(np.concatenate(chosen)) if chosen else rows[:0]


def compare(state: EngineState, plots: Plots, reports: Measurements, trusted: Bools) -> Comparisons | None:
    """Set radar plots beside references.

    Parameters
    ----------
    state : EngineState
        Tracks and buffers.
    plots : Plots
        Radar plots as reported, one row each.
    reports : Measurements
        The same plots in their tracks' planes, corrected.
    trusted : (capacity,) bool array
        Tracks whose own positions may serve as a reference.

    Returns
    -------
    Comparisons or None
        None where there is nothing to compare.
    """
    slot = reports.slot
    n = len(slot)
    if n == 0:
        return None
    fit, cov, anchored = _fit(state, slot, reports.time_s, trusted)
    live_x, live_P = state.live.state_at(slot, state.live.bank.time_s[slot])
    time = np.where(anchored, reports.time_s, state.live.bank.time_s[slot])
    x = np.where(anchored, fit, live_x[:4])
    packed = np.where(anchored[:, None], cov, live_P[[0, 1, 7]].T)
    frames = state.frames.rows[state.tracks.frame[slot]]
    lat, lon = geodesy.from_plane(frames, x[0], x[1])
    altitude, height, rate, sigma = state.live.vertical.at(slot, time)
    own_offset = np.isfinite(height)
    offset, offset_sigma = state.frames.offset_near(state.tracks.frame[slot], np.ones(n, dtype=np.bool_))
    height = np.where(own_offset, height, altitude + offset)
    height_sigma = np.hypot(sigma, np.where(own_offset, OWN_OFFSET_SIGMA_M, offset_sigma))
    back = geodesy.invert_axes(geodesy.local_axes(frames, lat, lon, height))
    v_east, v_north = geodesy.rotate_vector(back, x[2], x[3])
    known = np.isfinite(height) & (state.live.bank.time_s[slot] > -np.inf)
    if not known.any():
        return None
    return Comparisons.of(
        sensor=plots.sensor, aircraft=state.tracks.number[slot],
        time_s=plots.time_s, range_m=plots.range_m, azimuth_deg=plots.azimuth_deg,
        reference_time_s=time, lat_deg=lat, lon_deg=lon, height_m=height,
        v_east_mps=v_east, v_north_mps=v_north, vertical_rate_mps=rate,
        position_cov_m2=geodesy.rotate_covariance(back, packed), height_sigma_m=height_sigma, anchored=anchored,
    ).take(known)  # fmt: skip


def _fit(state: EngineState, slot: Ints, time_s: Array, trusted: Bools) -> tuple[Array, Array, Bools]:
    """Position and velocity ``(4, n)`` at the given times, position covariance ``(n, 3)``, where there is a fit."""
    rows = state.buffers.rows[slot]
    dt = rows[:, :, _COLUMN["time_s"]] - time_s[:, None]
    sensor = np.nan_to_num(rows[:, :, _COLUMN["sensor"]]).astype(np.int64)
    use = ~state.sensors.is_radar[sensor] & (np.abs(dt) <= REACH_S) & trusted[slot][:, None]
    anchored = (use.sum(axis=1) >= FEWEST) & ((np.abs(dt) <= NEAREST_S) & use).any(axis=1)
    x = np.full((4, len(slot)), np.nan)
    cov = np.full((len(slot), 3), np.nan)
    at = np.flatnonzero(anchored)
    if len(at):
        x[:, at], cov[at], good = _least_squares(rows[at], dt[at], use[at])
        anchored[at[~good]] = False
    return x, cov, anchored


def _least_squares(rows: Array, dt: Array, use: Bools) -> tuple[Array, Array, Bools]:
    """Constant acceleration through reports ``(n, depth, columns)`` around ``dt = 0``, twice, without outliers."""
    use = use.copy()
    dt = np.where(use, dt, 0.0)
    h = np.stack([np.ones_like(dt), dt, 0.5 * dt * dt], axis=2)
    z = np.nan_to_num(rows[:, :, [_COLUMN["east_m"], _COLUMN["north_m"]]])
    v = rows[:, :, [_COLUMN["v_east_mps"], _COLUMN["v_north_mps"]]]
    v_var = rows[:, :, _COLUMN["velocity_variance"]]
    has_v = use & np.isfinite(v_var)
    rough = np.nan_to_num(v).sum(axis=1) / np.maximum(has_v.sum(axis=1), 1)[:, None]
    for _ in range(2):
        R = _covariances(rows, dt, rough)
        W = np.where(use[:, :, None, None], np.linalg.inv(R), 0.0)
        Y = np.einsum("nki,nkab,nkj->niajb", h, W, h).reshape(len(dt), 6, 6)
        y = np.einsum("nki,nkab,nkb->nia", h, W, z - z[:, :1]).reshape(len(dt), 6)
        g = np.stack([np.zeros_like(dt), np.ones_like(dt), dt], axis=2)
        w = np.where(has_v, 1.0 / np.where(has_v, v_var + 0.1 * dt * dt, 1.0), 0.0)
        Y += np.einsum("nki,nk,nkj,ab->niajb", g, w, g, np.eye(2)).reshape(len(dt), 6, 6)
        y += np.einsum("nki,nk,nka->nia", g, w, np.nan_to_num(v)).reshape(len(dt), 6)
        Y[:, [4, 5], [4, 5]] += 1.0 / ACCELERATION_SIGMA**2
        # Keeps fits regular that have lost all their reports; ``good`` sorts them out.
        Y[:, range(4), range(4)] += 1e-9
        P = np.linalg.inv(Y)
        s = np.einsum("nij,nj->ni", P, y)
        residual = z - z[:, :1] - np.einsum("nki,nia->nka", h, s.reshape(-1, 3, 2))
        d2 = np.einsum("nka,nkab,nkb->nk", residual, W, residual)
        use &= d2 <= OUTLIER
        has_v &= use
        rough = s[:, 2:4]
    x = np.concatenate([s[:, :2] + z[:, 0], s[:, 2:4]], axis=1).T
    good = use.sum(axis=1) >= FEWEST
    return x, np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], axis=1), good


def _covariances(rows: Array, dt: Array, velocity: Array) -> Array:
    """Covariance of each report ``(n, depth, 2, 2)``: noise, time stamp along the flight, and distance in time."""
    tv = np.nan_to_num(rows[:, :, _COLUMN["time_variance"]])
    along = tv[:, :, None, None] * (velocity[:, None, :, None] * velocity[:, None, None, :])
    R = np.empty((*dt.shape, 2, 2))
    R[:, :, 0, 0] = np.nan_to_num(rows[:, :, _COLUMN["r_ee"]], nan=1.0)
    R[:, :, 1, 1] = np.nan_to_num(rows[:, :, _COLUMN["r_nn"]], nan=1.0)
    R[:, :, 0, 1] = R[:, :, 1, 0] = np.nan_to_num(rows[:, :, _COLUMN["r_en"]])
    return R + along + (JERK_DENSITY * np.abs(dt) ** 5 / 20.0)[:, :, None, None] * np.eye(2)
