"""The reference with a horizon: the estimate at t from what was stamped no later than t + lag, for every t anew.

Up to four seconds before the horizon the density of jerk is settled: it looks four seconds ahead and no further. So the
forward filter's state there is the one that a filter with this horizon has, and only the rest is run again with the
shortened look: forwards to the horizon, with the wanted instant as a row of its own, and backwards to it. All instants
are run side by side, which costs a window of reports for each of them: plain, not fast.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from aeroskein import linear_gaussian, motion
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints
from aeroskein.smoothing import parameters
from aeroskein.smoothing.detector import allowed_density, rows_before
from aeroskein.smoothing.variable_jerk import Track, take_report

__all__ = ["estimate_with_lag"]

# Instants run side by side; each takes a few kilobytes per report of its window. [instants]
CHUNK: Final = 4000


def estimate_with_lag(
    measurements: Measurements, track: Track, density_m2ps5: Array, at_flight: Ints, at_s: Array, lag_s: float
) -> tuple[Array, Array]:
    """Estimate at given instants with a horizon.

    Parameters
    ----------
    measurements : Measurements
        Reports in the plane, ordered by flight and time, each flight beginning with a position.
    track : Track
        The forward filter over them, with the full look ahead.
    density_m2ps5 : (n,) array
        What the detector asks for after each report. [m²/s⁵]
    at_flight, at_s : (m,) arrays
        Flights and instants, none before its flight's first report. [s]
    lag_s : float
        How far the horizon lies behind each instant, 0 or more. [s]

    Returns
    -------
    x, P : (m, 6), (m, 6, 6) arrays
        States at the instants.
    """
    x, P = np.zeros((len(at_s), 6)), np.zeros((len(at_s), 6, 6))
    for start in range(0, len(at_s), CHUNK):
        part = slice(start, start + CHUNK)
        windows = _Windows(measurements, track, density_m2ps5, at_flight[part], at_s[part], lag_s)
        x[part], P[part] = windows.estimate()
    return x, P


class _Step(NamedTuple):
    """One step of all windows: state before it, transition, and what was predicted for after it."""

    x: Array
    P: Array
    F: Array
    prior_x: Array
    prior_cov: Array


class _Windows:
    """Windows of reports, one per instant, run side by side.

    Element 0 of a window is the settled row, the next ones are the rows up to the instant, then comes the instant
    itself without a report, then the rows up to the horizon.
    """

    def __init__(
        self, measurements: Measurements, track: Track, density: Array, at_flight: Ints, at_s: Array, lag_s: float
    ) -> None:
        self._measurements, self._track, self._density = measurements, track, density
        self._at_flight, self._at_s, self._horizon_s = at_flight, at_s, at_s + lag_s
        flight, time_s = measurements.slot, measurements.time_s
        settled_s = np.minimum(at_s, self._horizon_s - parameters.AHEAD_S)
        first = np.searchsorted(flight, at_flight, side="left")
        settled, known, last = (
            rows_before(time_s, flight, until_s, at_flight, inclusive=True) - 1
            for until_s in (settled_s, at_s, self._horizon_s)
        )
        self._settled = np.maximum(settled, first)
        self._instant = known - self._settled + 1
        self._elements = last - self._settled + 2
        # An instant does not change the density of the step it divides: that is the next report's, if one is known.
        self._ahead_s = np.where(last > known, time_s[np.minimum(known + 1, len(time_s) - 1)], at_s)

    def estimate(self) -> tuple[Array, Array]:
        """Forwards to the horizon and backwards to the instant."""
        x, P = self._track.x[self._settled], self._track.P[self._settled]
        time_s = self._measurements.time_s[self._settled]
        steps: list[_Step] = []
        for j in range(1, int(self._elements.max(initial=1))):
            row, inside, is_instant = self._element(j)
            until_s = np.where(is_instant, self._at_s, self._measurements.time_s[row])
            dt_s = np.where(inside, until_s - time_s, 0.0)
            density = np.where(inside, self._allowed(np.where(is_instant, self._ahead_s, until_s)), 0.0)
            F, Q = motion.acceleration_transition(dt_s), motion.white_jerk_noise(dt_s, density)
            prior_x, prior_P = linear_gaussian.predict(x, P, F, Q)
            steps.append(_Step(x, P, F, prior_x, prior_P))
            x, P = self._report(row, inside & ~is_instant, prior_x, prior_P)
            time_s = np.where(inside, until_s, time_s)
        return self._backwards(steps, x, P)

    def _element(self, j: int) -> tuple[Ints, Bools, Bools]:
        """Row of the j-th element of each window, whether the window has one, and whether it is the instant."""
        row = self._settled + j - (j > self._instant)
        inside, is_instant = j < self._elements, np.asarray(j == self._instant)
        # The instant has no row of its own, and after the last report of the table there is none at all.
        return np.where(inside & ~is_instant, row, self._settled), inside, is_instant

    def _allowed(self, at_s: Array) -> Array:
        m = self._measurements
        return allowed_density(m.time_s, m.slot, at_s, self._at_flight, self._density, self._horizon_s)

    def _report(self, rows: Ints, has_report: Bools, x: Array, P: Array) -> tuple[Array, Array]:
        # Which reports are outliers was settled by the filter that ran before.
        position = has_report & self._track.accepted[rows]
        velocity = has_report & self._track.velocity_accepted[rows]
        new_x, new_P, _ = take_report(self._measurements.take(rows), x, P, position, velocity)
        return np.where(has_report[:, None], new_x, x), np.where(has_report[:, None, None], new_P, P)

    def _backwards(self, steps: list[_Step], x: Array, P: Array) -> tuple[Array, Array]:
        """From the horizon back to the instant."""
        found_x, found_P = x.copy(), P.copy()
        for j in range(len(steps), 0, -1):
            step = steps[j - 1]
            inside = j < self._elements
            back_x, back_P = linear_gaussian.smooth(step.x, step.P, step.F, step.prior_x, step.prior_cov, x, P)
            x, P = np.where(inside[:, None], back_x, x), np.where(inside[:, None, None], back_P, P)
            arrived = np.asarray(j - 1 == self._instant)
            found_x, found_P = np.where(arrived[:, None], x, found_x), np.where(arrived[:, None, None], P, found_P)
        return found_x, found_P
