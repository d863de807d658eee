"""References for registration: where an aircraft was at the time of a radar plot, without that radar.

Own positions (ADS-B, multilateration) around the plot are fitted with constant acceleration by weighted least squares.
The fit stands on those reports alone, so the radar cannot confirm its own error. Where there are too few, the element's
state serves for height and velocity only, and the plot is compared with other radars, not with the reference.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from aeroskein import geodesy
from aeroskein.closed import Closed
from aeroskein.engine_state import EngineState
from aeroskein.plots import Array, Bools, Ints, columns_of
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

    def open(self, now_s: float) -> Bools:
        """Of which sensors a plot may be compared now, ``(sensors,)``; once for every call of ``some``."""
        earned = COMPARISONS_PER_S * min(max(now_s - self._last_s, 0.0), 1.0)
        self._last_s = now_s
        self._allowance = np.minimum(self._allowance + earned, COMPARISONS_PER_S)
        self._turn += 1
        return np.asarray(self._allowance >= 1.0)

    def some(self, sensor: Ints, number: Ints) -> Ints:
        """Which of the plots, given by sensor and track number ``(n,)``, are compared."""
        count = np.bincount(sensor, minlength=len(self._allowance))
        if (count <= self._allowance).all():
            self._allowance -= count
            return np.arange(len(sensor))
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
    window, wanted = closed.window, sampler.open(now_s) & state.sensors.is_radar
    if not wanted.any():
        return None
    # Plots that the estimator refused are compared too: a radar whose bias has jumped is refused throughout.
    at = np.flatnonzero(closed.inside & wanted[window.sensor_index] & np.isfinite(window.range_m))
    event, lane = np.divmod(at, len(closed.slots))
    sensor, number = window.sensor_index[event, lane], state.tracks.number[closed.slots[lane]]
    chosen = sampler.some(sensor, number)
    if not len(chosen):
        return None
    event, lane, sensor, number = event[chosen], lane[chosen], sensor[chosen], number[chosen]
    slot, time, centre_s = closed.slots[lane], window.time_s[event, lane], closed.centre_s[lane]
    x, cov, anchored = _fit(state, window, lane, time, trusted)
    if not anchored.all():
        x = np.where(anchored, x, closed.estimate.x[:4, lane])
        cov = np.where(anchored[:, None], cov, closed.estimate.P[lane][:, [0, 0, 1], [0, 1, 1]])
    altitude, height, rate = (column[lane] for column in vertical)
    frames = state.frames.rows[state.tracks.frame[slot]]
    lat, lon = geodesy.from_plane(frames, x[0], x[1])
    height_sigma = _fill_heights(state, slot, (lat, lon), altitude, height)
    reference_s = np.where(anchored, time, centre_s)
    climb = np.where(np.isnan(rate), 0.0, rate) * (reference_s - centre_s)
    back = geodesy.invert_axes(geodesy.local_axes(frames, lat, lon, height))
    v_east, v_north = geodesy.rotate_vector(back, x[2], x[3])
    rows = Comparisons(
        sensor=sensor, aircraft=number, time_s=window.stamp_s[event, lane], range_m=window.range_m[event, lane],
        azimuth_deg=window.azimuth_deg[event, lane], reference_time_s=reference_s,
        lat_deg=lat, lon_deg=lon, height_m=height + climb, v_east_mps=v_east, v_north_mps=v_north,
        vertical_rate_mps=rate, position_cov_m2=geodesy.rotate_covariance(back, cov), height_sigma_m=height_sigma,
        anchored=anchored,
    )  # fmt: skip
    known = np.isfinite(height)
    return rows if known.all() else rows.take(known)


def _fill_heights(state: EngineState, slot: Ints, place: tuple[Array, Array], altitude: Array, height: Array) -> Array:
    """Put what altitudes ``(n,)`` stand for where no height is known, in place; gives the sigma of every height. [m]"""
    height_sigma, unknown = np.full(len(slot), OWN_OFFSET_SIGMA_M), np.flatnonzero(np.isnan(height))
    if len(unknown):
        present, (lat, lon) = np.zeros(len(unknown), dtype=np.bool_), place
        offset, sigma = state.offsets.applied(slot[unknown], present, lambda k: (lat[unknown[k]], lon[unknown[k]]))
        height[unknown] = altitude[unknown] + offset
        height_sigma[unknown] = np.hypot(OWN_OFFSET_SIGMA_M, sigma)
    return height_sigma


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
    own = window.reported[:, lane] & ~state.sensors.is_radar[window.sensor_index[:, lane]] & trusted[lane]
    away = np.abs(dt)
    use = own.T & (away <= REACH_S)
    anchored = (use.sum(axis=1) >= FEWEST) & ((away <= NEAREST_S) & use).any(axis=1)
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
    reports of products of powers of time with the inverse of a two by two covariance, so one product of matrices gives
    all of its parts.
    """
    n, depth = dt.shape
    dt = np.where(use, dt, 0.0)
    powers = np.ones((n, depth, 3))
    powers[:, :, 1], powers[:, :, 2] = dt, 0.5 * dt * dt
    # Powers of time and what was seen, side by side: place (3 + 2) with the powers, velocity (2 + 2) with the slopes.
    place, velocity = np.empty((n, depth, 5)), np.empty((n, depth, 4))
    place[:, :, :3], velocity[:, :, :2] = powers, powers[:, :, :2]
    v_var = reports["velocity_variance"]
    has_v = use & np.isfinite(v_var)
    v_var = np.where(has_v, v_var, 1.0) + 0.1 * dt * dt
    first = np.empty((n, 2))
    for k, (z, v) in enumerate((("east_m", "v_east_mps"), ("north_m", "v_north_mps"))):
        first[:, k] = reports[z][np.arange(n), use.argmax(axis=1)]
        place[:, :, 3 + k] = np.where(use, reports[z] - first[:, k, None], 0.0)
        velocity[:, :, 2 + k] = np.where(has_v, reports[v], 0.0)
    rough = velocity[:, :, 2:].sum(axis=1) / np.maximum(has_v.sum(axis=1), 1)[:, None]
    noise = _Noise.of(reports, dt, use)
    for _ in range(2):
        W = noise.weights(rough, use)
        weighted = (place[:, :, :, None] * W[:, :, None, :]).reshape(n, depth, -1)
        # Sums over the reports for [power, power or what was seen, ee or en or nn].
        sums = (powers.swapaxes(1, 2) @ weighted).reshape(n, 3, 5, 3)
        slopes = powers[:, :, :2].swapaxes(1, 2) @ (velocity * (has_v / v_var)[:, :, None])
        Y = sums[:, :, :3][..., [[0, 1], [1, 2]]].transpose(0, 1, 3, 2, 4)
        y = sums[:, :, 3, :2] + sums[:, :, 4, 1:]
        y[:, 1:] += slopes[:, :, 2:]
        for a in (0, 1):
            Y[:, 1:, a, 1:, a] += slopes[:, :, :2]
        normal = Y.reshape(n, 6, 6)
        normal[:, [4, 5], [4, 5]] += 1.0 / ACCELERATION_SIGMA**2
        # Keeps fits regular that have lost all their reports; ``good`` sorts them out.
        normal[:, range(4), range(4)] += 1e-9
        P = np.linalg.inv(normal)
        s = (P @ y.reshape(n, 6, 1))[:, :, 0]
        rest = place[:, :, 3:] - powers @ s.reshape(n, 3, 2)
        east, north = rest[:, :, 0], rest[:, :, 1]
        use = use & (W[:, :, 0] * east**2 + 2.0 * W[:, :, 1] * east * north + W[:, :, 2] * north**2 <= OUTLIER)
        has_v = has_v & use
        rough = s[:, 2:4]
    x = np.empty((4, n))
    x[:2], x[2:] = (s[:, :2] + first).T, s[:, 2:4].T
    return x, np.asarray(P[:, [0, 0, 1], [0, 1, 1]], np.float64), np.asarray(use.sum(axis=1) >= FEWEST)


class _Noise(NamedTuple):
    """Covariance of reports without what the time stamp adds, and the stamp's variance, ``(n, depth)`` each."""

    ee: Array
    en: Array
    nn: Array
    time_variance: Array

    @classmethod
    def of(cls, reports: dict[str, Array], dt: Array, use: Bools) -> _Noise:
        """Noise and distance in time of the reports to be used; harmless numbers for the others."""
        far = JERK_DENSITY * np.abs(dt) ** 5 / 20.0
        return cls(
            np.where(use, reports["r_ee"], 1.0) + far,
            np.where(use, reports["r_en"], 0.0),
            np.where(use, reports["r_nn"], 1.0) + far,
            np.where(use, reports["time_variance"], 0.0),
        )

    def weights(self, velocity: Array, use: Bools) -> Array:
        """Inverse covariance ``[ee, en, nn]`` of each report ``(n, depth, 3)`` at a velocity ``(n, 2)``."""
        ve, vn = velocity[:, :1], velocity[:, 1:]
        late_e = self.time_variance * ve
        ee, en, nn = self.ee + late_e * ve, self.en + late_e * vn, self.nn + self.time_variance * vn * vn
        share = use / (ee * nn - en * en)
        return columns_of(nn * share, -en * share, ee * share)
