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
from aeroskein.plots import Array, Bools, Ints
from aeroskein.publishing import Vertical
from aeroskein.registration import Comparisons, Registration
from aeroskein.windows import Window

__all__ = ["ReferenceSampler", "compare", "learn_latencies"]

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

_FITTED: Final = (
    "east_m", "north_m", "r_ee", "r_en", "r_nn", "v_east_mps", "v_north_mps", "velocity_variance", "time_variance",
)  # fmt: skip


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
    is_plot = closed.inside & state.sensors.is_radar[sensor] & np.isfinite(window.range_m)
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


def learn_latencies(state: EngineState, slots: Ints, rows: Comparisons, registration: Registration) -> None:
    """Let comparisons of the tracks in ``slots`` say how late each one's ADS-B is."""
    number = state.tracks.number[slots]
    order = np.argsort(number)
    slot = slots[order[np.searchsorted(number[order], rows.aircraft)]]
    state.latencies.learn(slot, rows.time_s, *registration.lateness(rows))


def _fit(state: EngineState, window: Window, lane: Ints, time_s: Array, trusted: Bools) -> tuple[Array, Array, Bools]:
    """Position and velocity ``(4, n)`` at the given times, position covariance ``(n, 3)``, where there is a fit."""
    # Stamps as reported: the latency that is taken out of them is found against this very fit.
    dt = (window.stamp_s[:, lane] - time_s).T
    own = window.reported & ~state.sensors.is_radar[window.sensor_index] & trusted
    use = own[:, lane].T & (np.abs(dt) <= REACH_S)
    anchored = (use.sum(axis=1) >= FEWEST) & ((np.abs(dt) <= NEAREST_S) & use).any(axis=1)
    x = np.full((4, len(lane)), np.nan)
    cov = np.full((len(lane), 3), np.nan)
    at = np.flatnonzero(anchored)
    if len(at):
        reports = {name: getattr(window, name)[:, lane[at]].T for name in _FITTED}
        x[:, at], cov[at], good = _least_squares(reports, dt[at], use[at])
        anchored[at[~good]] = False
    return x, cov, anchored


def _least_squares(reports: dict[str, Array], dt: Array, use: Bools) -> tuple[Array, Array, Bools]:
    """Constant acceleration through reports, columns ``(n, depth)``, around ``dt = 0``, twice, without outliers.

    Unknown are position, velocity and acceleration, east and north: six numbers. Every normal matrix is a sum over the
    reports of products of powers of time with the inverse of a two by two covariance, so sums of columns make it.
    """
    n = len(dt)
    use = use.copy()
    dt = np.where(use, dt, 0.0)
    powers = np.stack([np.ones_like(dt), dt, 0.5 * dt * dt], axis=2)
    slopes = np.stack([np.ones_like(dt), dt], axis=2)
    z = np.stack([np.nan_to_num(reports[name]) for name in ("east_m", "north_m")], axis=2)
    first = z[:, :1]
    z = z - first
    v = np.stack([np.nan_to_num(reports[name]) for name in ("v_east_mps", "v_north_mps")], axis=2)
    v_var = reports["velocity_variance"]
    has_v = use & np.isfinite(v_var)
    v_var = np.where(has_v, v_var, 1.0) + 0.1 * dt * dt
    rough = v.sum(axis=1) / np.maximum(has_v.sum(axis=1), 1)[:, None]
    for _ in range(2):
        W = _weights(reports, dt, rough, use)
        Wz = np.stack([W[0] * z[:, :, 0] + W[1] * z[:, :, 1], W[1] * z[:, :, 0] + W[2] * z[:, :, 1]], axis=2)
        Y = np.empty((n, 3, 2, 3, 2))
        for (a, b), w in zip(((0, 0), (0, 1), (1, 1)), W, strict=True):
            Y[:, :, a, :, b] = Y[:, :, b, :, a] = powers.swapaxes(1, 2) @ (powers * w[:, :, None])
        y = powers.swapaxes(1, 2) @ Wz
        w = np.where(has_v, 1.0 / v_var, 0.0)[:, :, None]
        of_velocity = slopes.swapaxes(1, 2) @ (slopes * w)
        for a in (0, 1):
            Y[:, 1:, a, 1:, a] += of_velocity
        y[:, 1:] += slopes.swapaxes(1, 2) @ (v * w)
        normal = Y.reshape(n, 6, 6)
        normal[:, [4, 5], [4, 5]] += 1.0 / ACCELERATION_SIGMA**2
        # Keeps fits regular that have lost all their reports; ``good`` sorts them out.
        normal[:, range(4), range(4)] += 1e-9
        P = np.linalg.inv(normal)
        s = np.einsum("nij,nj->ni", P, y.reshape(n, 6))
        e, north = np.moveaxis(z - powers @ s.reshape(n, 3, 2), 2, 0)
        use &= W[0] * e * e + 2.0 * W[1] * e * north + W[2] * north * north <= OUTLIER
        has_v &= use
        rough = s[:, 2:4]
    x = np.concatenate([s[:, :2] + first[:, 0], s[:, 2:4]], axis=1).T
    good = use.sum(axis=1) >= FEWEST
    return x, np.stack([P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]], axis=1), good


def _weights(reports: dict[str, Array], dt: Array, velocity: Array, use: Bools) -> tuple[Array, Array, Array]:
    """Inverse covariance ``ee, en, nn`` of each report, ``(n, depth)``: noise, time stamp, and distance in time."""
    tv = np.nan_to_num(reports["time_variance"])
    ve, vn = velocity[:, :1], velocity[:, 1:]
    far = JERK_DENSITY * np.abs(dt) ** 5 / 20.0
    ee = np.nan_to_num(reports["r_ee"], nan=1.0) + tv * ve * ve + far
    en = np.nan_to_num(reports["r_en"]) + tv * ve * vn
    nn = np.nan_to_num(reports["r_nn"], nan=1.0) + tv * vn * vn + far
    share = use / (ee * nn - en * en)
    return nn * share, -en * share, ee * share
