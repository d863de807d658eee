"""References for registration: where an aircraft was at the time of a radar plot, without that radar.

Own positions (ADS-B, multilateration) around the plot are fitted with constant acceleration by weighted least squares.
The fit stands on those reports alone, so the radar cannot confirm its own error. Where there are too few, the element's
state serves for height and velocity only, and the plot is compared with other radars, not with the reference.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.closed import Closed
from aeroskein.engine_state import EngineState
from aeroskein.measurements import COLUMNS
from aeroskein.plots import Array, Bools, Ints
from aeroskein.publishing import Vertical
from aeroskein.registration import Comparisons
from aeroskein.windows import Window

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

    def some(self, sensor: Ints, number: Ints, now_s: float) -> Ints:
        """Which of the plots, given by sensor and track number ``(n,)``, are compared."""
        earned = COMPARISONS_PER_S * min(max(now_s - self._last_s, 0.0), 1.0)
        self._last_s = now_s
        self._allowance = np.minimum(self._allowance + earned, COMPARISONS_PER_S)
        self._turn += 1
        order = ((number + self._turn) * _SPREAD) & 0xFFFFFFFF
        chosen = []
        for k in np.unique(sensor):
            own = np.flatnonzero(sensor == k)
            own = own[np.argsort(order[own], kind="stable")][: int(self._allowance[k])]
            self._allowance[k] -= len(own)
            chosen.append(own)
        return np.sort(np.concatenate(chosen)) if chosen else np.zeros(0, dtype=np.int64)


def compare(
    state: EngineState, closed: Closed, vertical: Vertical, sampler: ReferenceSampler, now_s: float, trusted: Bools
) -> Comparisons | None:
    """Set the radar plots of closed elements beside references.

    Parameters
    ----------
    state : EngineState
        Tracks and frames.
    closed, vertical : Closed, Vertical
        The elements, with their vertical.
    sampler : ReferenceSampler
        Chooses among the plots.
    now_s : float
        The clock. [s since the epoch]
    trusted : (n,) bool array
        Elements whose own positions (ADS-B) may serve as a reference.

    Returns
    -------
    Comparisons or None
        None where there is nothing to compare.
    """
    window = closed.window
    sensor = window.sensor_index
    is_plot = closed.in_span() & state.sensors.is_radar[sensor] & np.isfinite(window.range_m)
    # Plots that the estimator refused are compared too: a radar whose bias has jumped is refused throughout.
    event, lane = np.nonzero(is_plot)
    chosen = sampler.some(sensor[event, lane], state.tracks.number[closed.slots[lane]], now_s)
    event, lane = event[chosen], lane[chosen]
    if not len(event):
        return None
    slot, time = closed.slots[lane], window.time_s[event, lane]
    fit, cov, anchored = _fit(state, window, lane, time, trusted)
    centre = closed.estimate.x[:, lane]
    x = np.where(anchored, fit, centre[:4])
    smoothed = closed.estimate.P[lane][:, [0, 0, 1], [0, 1, 1]]
    altitude, height, rate = (column[lane] for column in vertical)
    own = np.isfinite(height)
    frames = state.frames.rows[state.tracks.frame[slot]]
    lat, lon = geodesy.from_plane(frames, x[0], x[1])
    offset, sigma = state.offsets.applied(slot, lat, lon, np.zeros(len(slot), dtype=np.bool_))
    height = np.where(own, height, altitude + offset)
    reference_s = np.where(anchored, time, closed.centre_s[lane])
    climb = np.nan_to_num(rate) * (reference_s - closed.centre_s[lane])
    back = geodesy.invert_axes(geodesy.local_axes(frames, lat, lon, height))
    v_east, v_north = geodesy.rotate_vector(back, x[2], x[3])
    return Comparisons.of(
        sensor=sensor[event, lane], aircraft=state.tracks.number[slot],
        time_s=window.stamp_s[event, lane], range_m=window.range_m[event, lane],
        azimuth_deg=window.azimuth_deg[event, lane],
        reference_time_s=reference_s, lat_deg=lat, lon_deg=lon, height_m=height + climb,
        v_east_mps=v_east, v_north_mps=v_north, vertical_rate_mps=rate,
        position_cov_m2=geodesy.rotate_covariance(back, np.where(anchored[:, None], cov, smoothed)),
        height_sigma_m=np.where(own, OWN_OFFSET_SIGMA_M, np.hypot(OWN_OFFSET_SIGMA_M, sigma)), anchored=anchored,
    ).take(np.isfinite(height))  # fmt: skip


def _fit(state: EngineState, window: Window, lane: Ints, time_s: Array, trusted: Bools) -> tuple[Array, Array, Bools]:
    """Position and velocity ``(4, n)`` at the given times, position covariance ``(n, 3)``, where there is a fit."""
    dt = (window.time_s[:, lane] - time_s).T
    own = window.reported & ~state.sensors.is_radar[window.sensor_index] & trusted
    use = own[:, lane].T & (np.abs(dt) <= REACH_S)
    anchored = (use.sum(axis=1) >= FEWEST) & ((np.abs(dt) <= NEAREST_S) & use).any(axis=1)
    x = np.full((4, len(lane)), np.nan)
    cov = np.full((len(lane), 3), np.nan)
    at = np.flatnonzero(anchored)
    if len(at):
        rows = window.columns[:, :, lane[at]].transpose(2, 1, 0)
        x[:, at], cov[at], good = _least_squares(rows, dt[at], use[at])
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
