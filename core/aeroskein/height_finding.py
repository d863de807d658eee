"""Heights of aircraft that nobody tells: what the slant ranges of two-dimensional radars say of them.

A radar without elevation measures how far, not how far over ground. Near it, that is kilometres: an aircraft at 10 km
that is taken to be at 5 km is drawn around the radar in a bow, faster the nearer it comes. Aircraft fly straight at a
steady speed most of the time, and in turns at a steady speed still, so the height is the one at which the flight is
even; and where a second radar sees the aircraft, the one at which both agree. Before any of that the speed tells a
little: airliners are fast where the air is thin, and light aircraft are not there. So each such flight is followed at
some thirty heights at once (``height_bank``); how well they predict says which heights are likely.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy, height_bank
from aeroskein.ellipsoid import EARTH_M, from_ecef, normal_and_height
from aeroskein.plots import Array, Bools, Ints, columns_of
from aeroskein.radar_geometry import radar_to_geodetic, turned_covariance

__all__ = ["HeightFinder"]

# The heights that are tried, all alike before anything is known: up to flight level 430. [m]
HEIGHTS_M: Final = np.arange(250.0, 13_250.0, 500.0)
# How far off the nearest of them is. [m]
GRID_SIGMA_M: Final = float((HEIGHTS_M[1] - HEIGHTS_M[0]) / np.sqrt(12.0))
# How much a flight's height wanders while it is taken to be level. [m]
HEIGHT_SIGMA_M: Final = 100.0
# A flight begins at any velocity, and of either kind. [m/s]
VELOCITY_SIGMA: Final = 250.0
STRAIGHT_SHARE: Final = height_bank.STRAIGHT_S / (height_bank.STRAIGHT_S + height_bank.TURNING_S)
# Speeds flown at a height: airframes bear a calibrated airspeed of 350 knots and Mach 0.9, and nobody is slow in thin
# air. Wind adds to it, and there are others: nothing is ruled out by more than the last, in the logarithm. [m/s]
FASTEST_MPS: Final = np.minimum(180.0 * np.exp(HEIGHTS_M / 18_000.0), 265.0)
SLOWEST_MPS: Final = HEIGHTS_M / 80.0
WIND_SIGMA_MPS: Final = 25.0
UNUSUAL_MAX: Final = 4.0
# Evidence fades: aircraft climb. [s]
MEMORY_S: Final = 90.0
# One plot says no more than this against a height: it may be another aircraft's.
EVIDENCE_MAX: Final = 8.0
# A gap after which the flight is not known any more. [s]
FORGET_S: Final = 120.0

_COLUMNS: Final = ("_x", "_P", "_kind", "_evidence", "_time_s", "_frame", "_sensor")


class HeightFinder:
    """Filters of tracks that need one, at all heights; a row each, found by slot.

    Parameters
    ----------
    capacity : int
        Track slots.
    """

    def __init__(self, capacity: int) -> None:
        self._row: Ints = np.full(capacity, -1, dtype=np.int64)
        self._free: list[int] = []
        shape = (height_bank.KINDS, len(HEIGHTS_M))
        self._x = np.zeros((0, 4, *shape))
        self._P = np.zeros((0, height_bank.COVARIANCE_ROWS, *shape))
        self._kind = np.zeros((0, *shape))
        self._evidence = np.zeros((0, len(HEIGHTS_M)))
        self._time_s = np.zeros(0)
        self._frame = np.zeros((0, 12))
        # The radar that saw the first plot.
        self._sensor: Ints = np.zeros(0, dtype=np.int64)

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        self._row = np.concatenate([self._row, np.full(capacity - len(self._row), -1, dtype=np.int64)])

    def clear(self, slots: Ints) -> None:
        """These slots belong to new tracks."""
        rows = self._row[slots]
        self._free.extend(rows[rows >= 0].tolist())
        self._row[slots] = -1

    def at(self, slots: Ints, time_s: Array) -> tuple[Array, Array]:
        """Height and one sigma ``(n,)`` at some times, NaN where nothing is known. [m]

        How far off a plot is drawn goes with the square of the height, so it is the mean square that counts.
        """
        row = self._row[slots]
        height, sigma = np.full(len(slots), np.nan), np.full(len(slots), np.nan)
        known = np.flatnonzero(row >= 0)
        row = row[known]
        recent = np.abs(time_s[known] - self._time_s[row]) < FORGET_S
        known, row = known[recent], row[recent]
        weight = self._weights(row)
        height[known] = np.sqrt(weight @ HEIGHTS_M**2)
        off = HEIGHTS_M - height[known, None]
        sigma[known] = np.sqrt((weight * off**2).sum(axis=1) + GRID_SIGMA_M**2)
        return height, sigma

    def motion(self, slots: Ints) -> tuple[Array, Array, Array, Array]:
        """Where tracks are at their newest plots, over all heights that are likely.

        Parameters
        ----------
        slots : (n,) int64
            Tracks that are followed here.

        Returns
        -------
        time_s : (n,) array
            [s since the epoch]
        frame : (n, 12) array
        x : (n, 5) array
            East, north and their velocities in that frame, and how likely the flight is to be turning. [m, m/s, 1]
        P : (n, 4, 4) array
            Covariance, with what the heights that are likely differ by.
        """
        row = self._row[slots]
        weight = self._kind[row] * self._weights(row)[:, None]
        mean, covariance = height_bank.moments(self._x[row], self._P[row], weight)
        turning = weight[:, 1].sum(axis=1, keepdims=True)
        return self._time_s[row], self._frame[row], np.concatenate([mean, turning], axis=1), covariance

    def follows(self, slots: Ints) -> Bools:
        """Which tracks are followed here, ``(n,)``."""
        followed: Bools = self._row[slots] >= 0
        return followed

    def may_turn(self, slots: Ints, within_s: Array) -> Array:
        """How likely flights are to be turning or to begin to within a time, ``(n,)``; 1 where nothing is known."""
        row = self._row[slots]
        chance = np.ones(len(slots))
        known = np.flatnonzero(row >= 0)
        if not len(known):
            return chance
        row = row[known]
        turning = (self._kind[row, 1] * self._weights(row)).sum(axis=1)
        chance[known] = 1.0 - (1.0 - turning) * np.exp(-within_s[known] / height_bank.STRAIGHT_S)
        return chance

    def leaning(self, slots: Ints) -> tuple[Array, Array, Ints, Array, Array]:
        """How states hang on the height: what they differ by where its square is one sigma more.

        Parameters
        ----------
        slots : (n,) int64
            Tracks that are followed here.

        Returns
        -------
        time_s : (n,) array
            Of the newest plots. [s since the epoch]
        squared_sigma_m : (n,) array
            That sigma, as a step of a height whose square is the mean one. [m]
        sensor : (n,) int64
            The radar that saw the first plot.
        frame : (n, 12) array
        x : (n, 4) array
            East, north and their velocities in that frame. [m, m/s]
        """
        row = self._row[slots]
        weight = self._weights(row)
        square = HEIGHTS_M**2
        mean = weight @ square
        off = square - mean[:, None]
        sigma = np.sqrt((weight * off**2).sum(axis=1) + (GRID_SIGMA_M * 2.0) ** 2 * mean)
        x = np.einsum("nckh,nkh,nh->nc", self._x[row], self._kind[row], weight * off, optimize=True) / sigma[:, None]
        return self._time_s[row], sigma / (2.0 * np.sqrt(mean)), self._sensor[row], self._frame[row], x

    def _weights(self, row: Ints) -> Array:
        """How likely each height is, ``(n, heights)``."""
        velocity = np.einsum("nckh,nkh->nch", self._x[row, 2:], self._kind[row])
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        off = speed - np.clip(speed, SLOWEST_MPS, FASTEST_MPS)
        variance = WIND_SIGMA_MPS**2 + self._P[row, 7, 0] + self._P[row, 9, 0]
        evidence = self._evidence[row] - np.minimum(0.5 * off**2 / variance, UNUSUAL_MAX)
        weight = np.exp(evidence - evidence.max(axis=1, keepdims=True))
        normal: Array = weight / weight.sum(axis=1, keepdims=True)
        return normal

    def take(
        self, slots: Ints, time_s: Array, sensor: Ints, sites: Array, measured: Array, sigmas: Array, left: Array,
        velocity: Array | None = None,
    ) -> None:  # fmt: skip
        """Take plots in.

        What registration has left of a radar's bias moves all of a flight and says nothing of its height, as long as
        no other radar sees it; then it counts like noise.

        Parameters
        ----------
        slots : (n,) int64
            Tracks; of several plots of one track in a call the newest counts.
        time_s : (n,) array
            [s since the epoch]
        sensor : (n,) int64
        sites : (n, 12) array
            The radars and their frames.
        measured, sigmas, left : (n, 2) arrays
            Slant range and azimuth, one sigma of each, and of what registration has left in each. [m, deg]
        velocity : (n, 3) array, optional
            East and north velocity and one sigma of them, for flights that begin here; NaN where not known. [m/s]
        """
        order = np.argsort(-time_s, kind="stable")
        used = order[np.unique(slots[order], return_index=True)[1]]
        row = self._rows_of(slots[used])
        step_s = time_s[used] - self._time_s[row]
        begins = ~(np.abs(step_s) < FORGET_S)
        some = begins | (step_s > 0.0)
        used, row, step_s, begins = used[some], row[some], step_s[some], begins[some]
        if not len(used):
            return
        self._sensor[row[begins]] = sensor[used[begins]]
        other = (sensor[used] != self._sensor[row])[:, None]
        sigmas = np.hypot(sigmas[used], other * left[used])
        fix = radar_to_geodetic(
            sites[used], measured[used, 0], measured[used, 1], normal_and_height(sites[used, 0:3])[1]
        )
        self._frame[row[begins]] = geodesy.frame_rows(fix.lat_deg[begins], fix.lon_deg[begins])
        place = geodesy.to_plane(self._frame[row], fix.lat_deg, fix.lon_deg)
        z, R, possible = _at_all_heights(self._frame[row], sites[used], columns_of(*place), measured[used], sigmas)
        first = np.flatnonzero(begins)
        unknown = np.full((len(used), 3), np.nan)
        begun_at = unknown if velocity is None else velocity[used]
        self._begin(row[first], z[first], R[first], possible[first], begun_at[first])
        on = np.flatnonzero(~begins)
        if len(on):
            self._go_on(row[on], step_s[on], z[on], R[on], possible[on])
        self._time_s[row] = time_s[used]

    def _begin(self, row: Ints, z: Array, R: Array, possible: Bools, velocity: Array) -> None:
        """Flights of which one plot is known, and perhaps the velocity."""
        velocity = np.where(np.isnan(velocity), (0.0, 0.0, VELOCITY_SIGMA), velocity)[:, :, None, None]
        self._x[row, :2] = z[:, :, None]
        self._x[row, 2:] = velocity[:, :2]
        self._P[row] = 0.0
        self._P[row, :3] = R[:, :, None]
        self._P[row, 7] = self._P[row, 9] = velocity[:, 2] ** 2
        self._kind[row, 0], self._kind[row, 1] = STRAIGHT_SHARE, 1.0 - STRAIGHT_SHARE
        self._evidence[row] = np.where(possible, 0.0, -EVIDENCE_MAX)

    def _go_on(self, row: Ints, step_s: Array, z: Array, R: Array, possible: Bools) -> None:
        """One more plot of each."""
        x, P, kind = height_bank.mix(self._x[row], self._P[row], self._kind[row], step_s)
        x, P = height_bank.predict(x, P, step_s)
        self._x[row], self._P[row], self._kind[row], says = height_bank.update(x, P, kind, z, R)
        says = np.where(possible, says, -np.inf)
        says = np.maximum(says - says.max(axis=1, keepdims=True), -EVIDENCE_MAX)
        self._evidence[row] = np.exp(-step_s / MEMORY_S)[:, None] * self._evidence[row] + says

    def _rows_of(self, slots: Ints) -> Ints:
        """Rows of distinct slots, made where there are none."""
        missing = slots[self._row[slots] < 0]
        if len(missing) > len(self._free):
            old = len(self._time_s)
            more = max(len(missing) - len(self._free), old // 2)
            for name in _COLUMNS:
                column = getattr(self, name)
                setattr(self, name, np.concatenate([column, np.zeros((more, *column.shape[1:]), dtype=column.dtype)]))
            self._free.extend(range(old, old + more))
        made = np.array([self._free.pop() for _ in missing], dtype=np.int64)
        self._row[missing] = made
        self._time_s[made] = np.nan
        return self._row[slots]


def _at_all_heights(
    frame: Array, sites: Array, place: Array, measured: Array, sigmas: Array
) -> tuple[Array, Array, Bools]:
    """Positions ``(n, 2, heights)`` and covariances ``(n, 3, heights)`` of plots in their tracks' planes.

    ``place`` ``(n, 2)`` is where each is if it is as high as its radar. At another height it is on the same line from
    there to the radar, nearer by what the sphere says. The third says which heights are possible, ``(n, heights)``:
    none is above the slant range.
    """
    lat, lon, site_m = from_ecef(sites[:, 0:3])
    line = place - columns_of(*geodesy.to_plane(frame, lat, lon))
    line /= np.hypot(line[:, 0], line[:, 1])[:, None]
    slant_m, site_m = measured[:, :1], site_m[:, None]
    radii_m2 = (EARTH_M + site_m) * (EARTH_M + HEIGHTS_M)
    level_m = slant_m**2 - (HEIGHTS_M - site_m) ** 2
    half = np.sqrt(np.clip(level_m / (4.0 * radii_m2), 0.0, 1.0))
    ground_m = 2.0 * EARTH_M * np.arcsin(half)
    nearer_m = ground_m - 2.0 * EARTH_M * np.arcsin(0.5 * slant_m / (EARTH_M + site_m))
    # As in ``radar_covariance``: no steeper than the ground range that can be told from none.
    blur_m = np.hypot(sigmas[:, :1], HEIGHT_SIGMA_M)
    cos_el = np.clip(ground_m / slant_m, np.minimum(np.sqrt(2.0 * blur_m / slant_m), 1.0), 1.0)
    radial = (sigmas[:, :1] ** 2 + (1.0 - cos_el**2) * HEIGHT_SIGMA_M**2) / cos_el**2
    across = (np.radians(sigmas[:, 1:]) * np.maximum(ground_m, slant_m * cos_el)) ** 2
    z = place[:, :, None] + nearer_m[:, None] * line[:, :, None]
    R = np.stack(turned_covariance(radial, across, line[:, 0, None], line[:, 1, None]), axis=1)
    return z, R, level_m > 0.0
