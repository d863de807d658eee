"""Heights of aircraft that nobody tells: what the slant ranges of two-dimensional radars say of them.

A radar without elevation measures how far, not how far over ground. Near it, that is kilometres: an aircraft at 10 km
that is taken to be at 5 km is drawn around the radar in a bow, faster the nearer it comes. Aircraft fly at a steady
speed, in turns too, so the height is the one at which the flight is even; and where a second radar sees the aircraft,
the one at which both agree. So each such flight is followed at some thirty heights at once, each by a plain Kalman
filter to which turns are cheap and changes of speed are dear; how well they predict says which heights are likely.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import geodesy
from aeroskein.plots import Array, Bools, Ints
from aeroskein.radar_geometry import radar_covariance, radar_to_geodetic

__all__ = ["HeightFinder"]

# The heights that are tried, all alike before anything is known: up to flight level 430. [m]
HEIGHTS_M: Final = np.arange(250.0, 13_250.0, 500.0)
# How much a flight's height wanders while it is taken to be level. [m]
HEIGHT_SIGMA_M: Final = 100.0
# Acceleration along the flight and across it, one sigma. [m/s²]
ALONG_SIGMA: Final = 0.3
ACROSS_SIGMA: Final = 6.0
# A flight begins at any velocity. [m/s]
VELOCITY_SIGMA: Final = 250.0
# Slower flight has no direction. [m/s]
SPEED_MIN_MPS: Final = 30.0
# Evidence fades: aircraft climb. [s]
MEMORY_S: Final = 90.0
# One plot says no more than this against a height: it may be another aircraft's.
EVIDENCE_MAX: Final = 8.0
# A gap after which the flight is not known any more. [s]
FORGET_S: Final = 120.0


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
        heights = len(HEIGHTS_M)
        self._x = np.zeros((0, heights, 4))
        self._P = np.zeros((0, heights, 4, 4))
        self._evidence = np.zeros((0, heights))
        self._time_s = np.zeros(0)
        self._frame = np.zeros((0, 12))

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
        evidence = self._evidence[row]
        weight = np.exp(evidence - evidence.max(axis=1, keepdims=True))
        weight /= weight.sum(axis=1, keepdims=True)
        height[known] = np.sqrt(weight @ HEIGHTS_M**2)
        off = HEIGHTS_M - height[known, None]
        sigma[known] = np.sqrt((weight * off**2).sum(axis=1) + (HEIGHTS_M[1] - HEIGHTS_M[0]) ** 2 / 12.0)
        return height, sigma

    def take(self, slots: Ints, time_s: Array, sites: Array, measured: Array, sigmas: Array) -> None:
        """Take plots in.

        Parameters
        ----------
        slots : (n,) int64
            Tracks; of several plots of one track in a call the newest counts.
        time_s : (n,) array
            [s since the epoch]
        sites : (n, 12) array
            Frames of the radars.
        measured, sigmas : (n, 2) array
            Slant range and azimuth, and one sigma of each. [m, deg]
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
        if begins.any():
            at = used[begins]
            middle = np.full(len(at), HEIGHTS_M.mean())
            fix = radar_to_geodetic(sites[at], measured[at, 0], measured[at, 1], middle)
            self._frame[row[begins]] = geodesy.frame_rows(fix.lat_deg, fix.lon_deg)
        z, R, possible = _at_all_heights(self._frame[row], sites[used], measured[used], sigmas[used])
        x, P, says = _filtered(self._x[row], self._P[row], np.where(begins, 0.0, step_s), z, R)
        says = np.where(possible, says, -np.inf)
        says = np.maximum(says - says.max(axis=1, keepdims=True), -EVIDENCE_MAX)
        first_x, first_P = _begun(z, R)
        new = begins[:, None]
        self._x[row] = np.where(new[..., None], first_x, x)
        self._P[row] = np.where(new[..., None, None], first_P, P)
        faded = np.exp(-np.where(begins, 0.0, step_s) / MEMORY_S)[:, None] * self._evidence[row]
        self._evidence[row] = np.where(new, np.where(possible, 0.0, -EVIDENCE_MAX), faded + says)
        self._time_s[row] = time_s[used]

    def _rows_of(self, slots: Ints) -> Ints:
        """Rows of distinct slots, made where there are none."""
        missing = slots[self._row[slots] < 0]
        if len(missing) > len(self._free):
            old = len(self._time_s)
            more = max(len(missing) - len(self._free), old // 2)
            for name in ("_x", "_P", "_evidence", "_time_s", "_frame"):
                column = getattr(self, name)
                setattr(self, name, np.concatenate([column, np.zeros((more, *column.shape[1:]))]))
            self._free.extend(range(old, old + more))
        made = np.array([self._free.pop() for _ in missing], dtype=np.int64)
        self._row[missing] = made
        self._time_s[made] = np.nan
        return self._row[slots]


def _begun(z: Array, R: Array) -> tuple[Array, Array]:
    """States ``(n, heights, 4)`` and covariances of flights of which one plot is known."""
    x = np.concatenate([z, np.zeros_like(z)], axis=-1)
    P = np.zeros((*z.shape[:-1], 4, 4))
    P[..., :2, :2] = R
    P[..., [2, 3], [2, 3]] = VELOCITY_SIGMA**2
    return x, P


def _filtered(x: Array, P: Array, step_s: Array, z: Array, R: Array) -> tuple[Array, Array, Array]:
    """Predict and update; the log likelihood of the plots at each height ``(n, heights)`` is the third."""
    x, P = _predicted(x, P, step_s)
    S = P[..., :2, :2] + R
    a, b, c = S[..., 0, 0], S[..., 0, 1], S[..., 1, 1]
    det = a * c - b * b
    y = z - x[..., :2]
    inverse = np.stack([np.stack([c, -b], -1), np.stack([-b, a], -1)], -2) / det[..., None, None]
    distance2 = np.einsum("nhi,nhij,nhj->nh", y, inverse, y)
    K = P[..., :, :2] @ inverse
    left = np.eye(4) - np.concatenate([K, np.zeros_like(K)], axis=-1)
    P = left @ P @ left.swapaxes(-1, -2) + K @ R @ K.swapaxes(-1, -2)
    return x + np.einsum("nhij,nhj->nhi", K, y), P, -0.5 * (distance2 + np.log(det))


def _at_all_heights(frame: Array, sites: Array, measured: Array, sigmas: Array) -> tuple[Array, Array, Bools]:
    """Positions ``(n, heights, 2)`` and covariances ``(n, heights, 2, 2)`` of plots in their tracks' planes.

    The third says which heights are possible, ``(n, heights)``: none is above the slant range.
    """
    n, heights = len(measured), len(HEIGHTS_M)
    frame, sites = np.repeat(frame, heights, axis=0), np.repeat(sites, heights, axis=0)
    range_m, azimuth_deg, range_sigma, azimuth_sigma = np.repeat(np.c_[measured, sigmas], heights, axis=0).T
    height = np.tile(HEIGHTS_M, n)
    fix = radar_to_geodetic(sites, range_m, azimuth_deg, height)
    covariance = radar_covariance(
        sites, range_m, azimuth_deg, fix,
        range_sigma_m=range_sigma, azimuth_sigma_deg=azimuth_sigma, height_sigma_m=HEIGHT_SIGMA_M,
    )  # fmt: skip
    axes = geodesy.local_axes(frame, fix.lat_deg, fix.lon_deg, height)
    ee, en, nn = geodesy.rotate_covariance(axes, covariance).T
    e, north = geodesy.to_plane(frame, fix.lat_deg, fix.lon_deg)
    z = np.stack([e, north], axis=-1).reshape(n, heights, 2)
    R = np.stack([np.stack([ee, en], -1), np.stack([en, nn], -1)], -2).reshape(n, heights, 2, 2)
    return z, R, fix.feasible.reshape(n, heights)


def _predicted(x: Array, P: Array, step_s: Array) -> tuple[Array, Array]:
    """Straight on, with an acceleration that is small along the flight and large across it."""
    F = np.tile(np.eye(4), (len(x), 1, 1, 1))
    F[..., 0, 2] = F[..., 1, 3] = step_s[:, None]
    speed = np.hypot(x[..., 2], x[..., 3])
    along = x[..., 2:4] / np.maximum(speed, 1.0)[..., None]
    # What is across at the beginning of the step is along by a little at its end.
    bent = ACROSS_SIGMA**2 * step_s[:, None] / (2.0 * np.maximum(speed, SPEED_MIN_MPS))
    less = np.maximum(ACROSS_SIGMA**2 - ALONG_SIGMA**2 - bent**2, 0.0)
    density = ACROSS_SIGMA**2 * np.eye(2) - less[..., None, None] * (along[..., :, None] * along[..., None, :])
    G = np.zeros((len(x), 1, 4, 2))
    G[..., 0, 0] = G[..., 1, 1] = 0.5 * step_s[:, None] ** 2
    G[..., 2, 0] = G[..., 3, 1] = step_s[:, None]
    P = F @ P @ F.swapaxes(-1, -2) + G @ density @ G.swapaxes(-1, -2)
    return np.einsum("nhij,nhj->nhi", F, x), P
