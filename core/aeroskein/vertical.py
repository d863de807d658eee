"""The vertical channel: altitude and its rate, live by a two-state filter, and for elements by a fit around the centre.

Altitude is pressure altitude where anyone reports it, geometric height otherwise; the difference of the two is learned
per track from reports that carry both. Nothing is ever mixed without that difference.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["VerticalFilter", "fit_at"]

# White vertical acceleration: 1 m/s² for a second when a climb begins. [m²/s³]
ACCELERATION_DENSITY: Final = 0.5
# One sigma of a reported vertical rate: 64 ft/min steps and the air data computer's lag. [m/s]
RATE_SIGMA_MPS: Final = 1.0
START_RATE_SIGMA_MPS: Final = 15.0
# Squared distance beyond which an altitude is an outlier, and how many in a row are believed again.
GATE: Final = 36.0
MISSES_TO_RESTART: Final = 4
# Altitudes of one element that may be outliers.
MOST_OUTLIERS: Final = 3
# A vertical state without any report for this long says nothing any more. [s]
FORGET_S: Final = 60.0
# Share of a new difference height minus altitude that is taken over once ten are known.
OFFSET_SHARE: Final = 0.1

_ALTITUDE, _RATE, _P00, _P01, _P11, _TIME, _MISSES, _OFFSET, _OFFSETS, _BAROMETRIC = range(10)


class VerticalFilter:
    """Altitude states of all tracks: one row of ten numbers a track."""

    def __init__(self, capacity: int) -> None:
        self.rows = np.full((capacity, 10), np.nan)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = np.full((capacity - len(self.rows), self.rows.shape[1]), np.nan)
        self.rows = np.concatenate([self.rows, more])

    def start(self, slots: Ints) -> None:
        """Begin tracks whose altitude is unknown."""
        self.rows[slots] = np.nan
        self.rows[slots, _MISSES] = 0.0
        self.rows[slots, _OFFSETS] = 0.0
        self.rows[slots, _BAROMETRIC] = 0.0

    def update(
        self,
        slots: Ints,
        time_s: Array,
        altitude_m: Array,
        height_m: Array,
        rate_mps: Array,
        sigma_m: Array,
    ) -> None:
        """Take one report per track; slots ``(n,)`` are distinct, missing values NaN."""
        w = np.ascontiguousarray(self.rows.take(slots, axis=0).T)
        has_altitude, has_height = np.isfinite(altitude_m), np.isfinite(height_m)
        first_altitude = has_altitude & (w[_BAROMETRIC] == 0)
        w[_BAROMETRIC, first_altitude] = 1.0
        # What was a height so far is not an altitude: begin again.
        w[_TIME, first_altitude] = np.nan
        both = has_altitude & has_height
        if both.any():
            _learn_offset(w, both, np.where(both, height_m - altitude_m, 0.0))
        z = altitude_m
        if not has_altitude.all():
            # A height counts as the altitude that it stands for, where any has been reported.
            offset = np.where(w[_OFFSETS] > 0, w[_OFFSET], np.nan)
            z = np.where(np.isnan(altitude_m), height_m - np.where(w[_BAROMETRIC] > 0, offset, 0.0), altitude_m)
        _filter(w, time_s, z, rate_mps, sigma_m)
        self.rows[slots] = w.T

    def at(self, slots: Ints, time_s: Array) -> tuple[Array, Array, Array]:
        """Altitude, height and rate of each track at the given times, each NaN where nothing gave it. [m, m, m/s]"""
        rows = self.rows.take(slots, axis=0).T
        age = np.maximum(time_s - rows[_TIME], 0.0)
        known = age <= FORGET_S  # not of tracks without a time
        value = np.where(known, rows[_ALTITUDE] + age * rows[_RATE], np.nan)
        barometric = rows[_BAROMETRIC] > 0
        altitude = np.where(barometric, value, np.nan)
        height = np.where(barometric, value + rows[_OFFSET], value)
        return altitude, height, np.where(known, rows[_RATE], np.nan)

    def sigma_at(self, slots: Ints, time_s: Array) -> Array:
        """One sigma of the altitude of each track at the given times, NaN where nothing is known. [m]"""
        rows = self.rows.take(slots, axis=0).T
        age = np.maximum(time_s - rows[_TIME], 0.0)
        variance = rows[_P00] + 2 * age * rows[_P01] + age**2 * rows[_P11]
        variance += ACCELERATION_DENSITY * age**3 / 3.0
        return np.asarray(np.sqrt(variance))


def _learn_offset(w: Array, both: Bools, difference_m: Array) -> None:
    """Take differences of height and altitude in, where a report carries both; rows ``(10, n)`` in place."""
    w[_OFFSETS] += both
    share = np.where(both, np.maximum(1.0 / np.maximum(w[_OFFSETS], 1.0), OFFSET_SHARE), 0.0)
    w[_OFFSET] = np.where(np.isnan(w[_OFFSET]) & both, difference_m, w[_OFFSET])
    w[_OFFSET] += np.where(both, share * (difference_m - w[_OFFSET]), 0.0)


def _filter(w: Array, time_s: Array, z: Array, rate_mps: Array, sigma_m: Array) -> None:
    """One predict and update of the two-state filter on rows ``(10, n)``, in place."""
    r = sigma_m**2
    has_z, rate_known = np.isfinite(z), np.isfinite(rate_mps)
    step = time_s - w[_TIME]  # NaN where nothing is known yet
    begin = has_z & ~((w[_MISSES] < MISSES_TO_RESTART) & (step <= FORGET_S))
    if begin.any():
        w[_ALTITUDE, begin] = z[begin]
        w[_RATE, begin] = np.where(rate_known, rate_mps, 0.0)[begin]
        w[_P00, begin] = r[begin]
        w[_P01, begin] = 0.0
        w[_P11, begin] = np.where(rate_known, RATE_SIGMA_MPS, START_RATE_SIGMA_MPS)[begin] ** 2
        w[_TIME, begin] = time_s[begin]
        w[_MISSES, begin] = 0.0
        step = time_s - w[_TIME]
    h = np.fmax(step, 0.0)  # NaN becomes 0
    w[_ALTITUDE] += h * w[_RATE]
    w[_P00] += h * (2.0 * w[_P01] + h * w[_P11]) + ACCELERATION_DENSITY * (h * h * h) / 3.0
    w[_P01] += h * w[_P11] + ACCELERATION_DENSITY * h**2 / 2.0
    w[_P11] += ACCELERATION_DENSITY * h
    w[_TIME] += h
    goes_on = ~begin & np.isfinite(w[_TIME])
    _update(w, has_z & goes_on & (time_s >= w[_TIME]), z, r, 0)
    if rate_known.any():
        _update(w, rate_known & goes_on, rate_mps, RATE_SIGMA_MPS**2, 1)


def _update(w: Array, usable: Bools, z: Array, r: Array | float, state: int) -> None:
    """Scalar update of altitude (state 0) or rate (state 1) where usable, gated."""
    c0, c1 = (w[_P00], w[_P01]) if state == 0 else (w[_P01], w[_P11])
    s = (c0, c1)[state] + r
    innovation = np.where(usable, z - w[_ALTITUDE + state], 0.0)
    inside = innovation**2 <= GATE * s
    if state == 0:
        w[_MISSES] = np.where(usable, np.where(inside, 0.0, w[_MISSES] + 1.0), w[_MISSES])
    used = usable & inside
    k0, k1 = np.where(used, c0 / s, 0.0), np.where(used, c1 / s, 0.0)
    w[_ALTITUDE] += k0 * innovation
    w[_RATE] += k1 * innovation
    p00, p01, p11 = w[_P00] - k0 * c0, w[_P01] - k0 * c1, w[_P11] - k1 * c1
    w[_P00], w[_P01], w[_P11] = p00, p01, p11


def fit_at(
    centre_s: Array, time_s: Array, value_m: Array, rate_mps: Array, sigma_m: Array
) -> tuple[Array, Array, Array]:
    """Fit altitude and rate at the centres of elements to the reports around them.

    Each report counts with its own variance plus what the altitude may have wandered between it and the centre, so
    that near reports decide and far ones support. The worst outlier is left out and the rest fitted again, three times
    at most: left out all at once, those that a gross error has drawn the fit away from would go as well.

    Parameters
    ----------
    centre_s : (n,) array
        Instants to fit at. [s]
    time_s, value_m, rate_mps, sigma_m : (K, n) arrays
        Reports; NaN where there is none. [s, m, m/s, m]

    Returns
    -------
    value_m, rate_mps, sigma_m : (n,) arrays
        NaN where no report carries an altitude. [m, m/s, m]
    """
    dt = time_s - centre_s
    apart = np.abs(dt)
    has_value, has_rate = np.isfinite(value_m), np.isfinite(rate_mps)
    w = np.where(has_value, 1.0 / (sigma_m**2 + ACCELERATION_DENSITY / 3.0 * apart * apart * apart), 0.0)
    u = np.where(has_rate, 1.0 / (RATE_SIGMA_MPS**2 + ACCELERATION_DENSITY * apart), 0.0)
    z, rate = np.where(has_value, value_m, 0.0), np.where(has_rate, rate_mps, 0.0)
    # Around a first guess, so that the sums keep their digits.
    middle = (w * z).sum(axis=0) / np.maximum(w.sum(axis=0), 1e-12)
    z -= middle
    lanes, fit = np.arange(len(centre_s)), _line(dt, w, z, u, rate)
    found = fit
    for _ in range(MOST_OUTLIERS):
        distance = (z - fit[0] - fit[1] * dt) ** 2 * w
        far = np.flatnonzero(distance.max(axis=0) > GATE)
        if not len(far):
            break
        # Only these are fitted again.
        lanes, worst = lanes[far], distance[:, far].argmax(axis=0)
        dt, w, z, u, rate = dt[:, far], w[:, far], z[:, far], u[:, far], rate[:, far]
        w[worst, np.arange(len(far))] = 0.0
        fit = _line(dt, w, z, u, rate)
        found[:, lanes] = fit
    return middle + found[0], found[1], np.sqrt(found[2])


def _line(dt: Array, w: Array, z: Array, u: Array, rate: Array) -> Array:
    """Value, slope and variance of the value ``(3, n)`` of lines through values ``z`` with weights ``w`` and slopes
    ``rate`` with weights ``u``, ``(K, n)`` each; NaN where no value counts."""
    w_dt = w * dt
    a, b = w.sum(axis=0), w_dt.sum(axis=0)
    c = (w_dt * dt).sum(axis=0) + u.sum(axis=0) + 1.0 / START_RATE_SIGMA_MPS**2
    y0, y1 = (w * z).sum(axis=0), (w_dt * z).sum(axis=0) + (u * rate).sum(axis=0)
    determinant = np.where(a > 0.0, a * c - b * b, np.nan)
    return np.stack([c * y0 - b * y1, a * y1 - b * y0, c]) / determinant
