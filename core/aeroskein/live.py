"""The live product: the state of every track at the time of its newest report, without lag.

Reports are taken in order of arrival. Several reports of one aircraft in a batch are handled in rounds: the first of
every aircraft together, then the second, and so on. A report a few seconds behind the state still improves it; an
older one is left to the elements, which treat it exactly.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein import kalman, manoeuvre, spikes
from aeroskein.lanes import continues, even_parts, lengths_of_runs
from aeroskein.measurements import Measurements
from aeroskein.mode_bank import ModeBank
from aeroskein.plots import Array, Bools, Ints, apply_at
from aeroskein.vertical import VerticalFilter

__all__ = ["LiveProduct", "first_state"]

# Older reports than this behind the state are not used live: the noise of the flight in between, which the look back
# neglects, would then matter. [s]
LATEST_LAG_S: Final = 4.0
# Tracks worked on together: more would not fit into the processor's cache.
LANES: Final = 1024
# The columns of reports that the filters use, in their order.
USED: Final = (
    "time_s", "east_m", "north_m", "r_ee", "r_en", "r_nn", "v_east_mps", "v_north_mps", "velocity_variance",
    "time_variance", "altitude_m", "height_m", "vertical_rate_mps",
)  # fmt: skip
# Points further apart in time do not make a spike. [s]
NEIGHBOUR_S: Final = 10.0
# Where a flight begins nothing is known of its velocity and acceleration. [m/s], [m/s²]
START_VELOCITY_SIGMA: Final = 250.0
START_ACCELERATION_SIGMA: Final = 3.0


def first_state(reports: Measurements) -> tuple[Array, Array]:
    """State ``(6, n)`` and covariance ``(24, n)`` from one report per track."""
    n = len(reports)
    has_velocity = np.isfinite(reports.velocity_variance)
    x = np.zeros((6, n))
    x[0], x[1] = reports.east_m, reports.north_m
    x[2] = np.where(has_velocity, reports.v_east_mps, 0.0)
    x[3] = np.where(has_velocity, reports.v_north_mps, 0.0)
    P = np.zeros((kalman.COVARIANCE_ROWS, n))
    P[12] = P[17] = np.where(has_velocity, reports.velocity_variance, START_VELOCITY_SIGMA**2)
    base = (reports.r_ee, reports.r_en, reports.r_nn)
    P[0], P[1], P[7] = kalman.stamp_noise(base, reports.time_variance, x[2:4], P[12:18])
    P[6] = P[1]
    P[20] = P[23] = START_ACCELERATION_SIGMA**2
    return x, P


class LiveProduct:
    """Live states of all tracks; columns by slot."""

    def __init__(self, capacity: int, altitude_sigma_m: Array) -> None:
        sensors = len(altitude_sigma_m)
        self._altitude_sigma_m = altitude_sigma_m
        self.bank = ModeBank(capacity, sensors, manoeuvre.LIVE)
        self.vertical = VerticalFilter(capacity)
        # Since the last live point: accepted reports per sensor, and refused ones.
        self.sources = np.zeros((capacity, sensors), dtype=np.int32)
        self.rejected = np.zeros(capacity, dtype=np.int32)
        # Time of the last live point; the product never goes back behind it. [s since the epoch]
        self.published_s = np.full(capacity, -np.inf)
        # East and north of the last two live points, the older one first. [m]
        self.places_m = np.full((capacity, 4), np.nan)
        # Points of one track are at least this far apart. [s]
        self.every_s = 0.0

    def grow(self, capacity: int) -> None:
        """Make room for more tracks."""
        more = capacity - len(self.rejected)
        self.bank.grow(capacity)
        self.vertical.grow(capacity)
        self.sources = np.concatenate([self.sources, np.zeros((more, self.sources.shape[1]), dtype=np.int32)])
        self.rejected = np.concatenate([self.rejected, np.zeros(more, dtype=np.int32)])
        self.published_s = np.concatenate([self.published_s, np.full(more, -np.inf)])
        self.places_m = np.concatenate([self.places_m, np.full((more, 4), np.nan)])

    def clear(self, slots: Ints) -> None:
        """Make the slots of new tracks blank."""
        self.bank.time_s[slots] = -np.inf
        self.vertical.start(slots)
        self.sources[slots] = 0
        self.rejected[slots] = 0
        self.published_s[slots] = -np.inf
        self.places_m[slots] = np.nan

    def start(self, reports: Measurements) -> None:
        """Begin tracks with their first report, one row each."""
        x, P = first_state(reports)
        self.bank.start(reports.slot, x, P, reports.time_s)

    def receive(self, reports: Measurements, started: Bools) -> Bools:
        """Update the states by reports sorted by slot, then time.

        Parameters
        ----------
        reports : Measurements
            Reports of known tracks.
        started : (n,) bool array
            Reports that began their track just now, whose position is therefore in the state already.

        Returns
        -------
        (n,) bool array
            False for outliers. Reports too late for this product are left out without a verdict (true).
        """
        n = len(reports)
        accepted = np.ones(n, dtype=np.bool_)
        if n == 0:
            return accepted
        first = np.flatnonzero(~continues(reports.slot))
        count = lengths_of_runs(first, n)
        order = np.argsort(-count, kind="stable")
        first, count = first[order], count[order]
        columns = np.empty((len(USED), n))
        for row, name in enumerate(USED):
            columns[row] = getattr(reports, name)
        sensor = reports.sensor.astype(np.int64)
        # Even parts, for a small last one would cost as much as a large one.
        for part in even_parts(len(first), LANES):
            self._rounds(first[part], count[part], reports.slot, columns, sensor, started, accepted)
        apply_at(np.add, self.sources, reports.slot[accepted], sensor[accepted], 1)
        if not accepted.all():
            np.add.at(self.rejected, reports.slot[~accepted], 1)
        return accepted

    def _rounds(
        self, first: Ints, count: Ints, slot: Ints, columns: Array, sensor: Ints, started: Bools, accepted: Bools
    ) -> None:
        """The reports of some tracks, the first of each together, then the second; ``first`` by falling count."""
        slots = slot[first]
        work = self.bank.take(slots)
        for k in range(int(count[0])):
            rows = first[: int((count > k).sum())] + k
            of_round = columns[:, rows]
            time_s, measured, (altitude_m, height_m, rate_mps) = of_round[0], of_round[1:10], of_round[10:]
            lag = work.predict(time_s)
            usable = (lag <= LATEST_LAG_S) & ~started[rows]
            ok = work.update(measured, sensor[rows], lag, usable)
            accepted[rows] = ok | ~usable
            self.vertical.update(
                slots[: len(rows)], time_s, altitude_m, height_m, rate_mps, self._altitude_sigma_m[sensor[rows]]
            )
        self.bank.put(slots, work)

    def place(self, slots: Ints, time_s: Array, place: Array) -> Array:
        """Note places ``(2, n)`` that are published; returns what must be added so that no track turns back. [m]"""
        before = self.places_m[slots].T
        # Behind a gap a track may come back anywhere.
        before[:2, time_s - self.published_s[slots] > NEIGHBOUR_S] = np.nan
        shift = spikes.held(before, place)
        self.places_m[slots, :2], self.places_m[slots, 2:] = before[2:].T, (place + shift).T
        self.published_s[slots] = time_s
        return shift

    def state_at(self, slots: Ints, time_s: Array) -> tuple[Array, Array]:
        """Mixed state ``(6, n)`` and covariance ``(24, n)`` at times not before the newest report."""
        return self.bank.mixture_at(slots, time_s)
