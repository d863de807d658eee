"""Accuracy of a set of points: over all of them, by phase of flight, by flight."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from aeroskein.evaluation.figures import Accuracy, Consistency, FlightResult, PhaseAccuracy, Worst
from aeroskein.evaluation.residuals import MIN_ANGLE_SPEED_MPS, Residuals
from aeroskein.evaluation.spread import signed_spread, spread
from aeroskein.plots import Array

__all__ = ["COVERAGE_NEES", "accuracy_of", "by_flight", "by_phase", "consistency_of", "worst_flight", "worst_point"]

# 95 % quantile of chi-square with two degrees of freedom, in closed form.
COVERAGE_NEES: Final = -2.0 * math.log(0.05)


def consistency_of(nees: Array) -> Consistency:
    """Mean NEES and share inside the 95 % ellipse; NaN are left out."""
    known = nees[np.isfinite(nees)]
    if len(known) == 0:
        return Consistency()
    return Consistency(
        count=len(known), mean_nees=float(known.mean()), coverage_95=float(np.mean(known <= COVERAGE_NEES))
    )


def accuracy_of(residuals: Residuals) -> Accuracy:
    """All figures of a set of points."""
    return Accuracy(
        horizontal_m=spread(residuals.horizontal_m),
        along_m=signed_spread(residuals.along_m),
        across_m=signed_spread(residuals.across_m),
        position_latency_s=signed_spread(_latency_s(residuals)),
        height_m=signed_spread(residuals.height_m),
        altitude_m=signed_spread(residuals.altitude_m),
        velocity_mps=spread(residuals.velocity_mps),
        ground_speed_mps=signed_spread(residuals.ground_speed_mps),
        track_angle_deg=signed_spread(residuals.track_angle_deg),
        vertical_rate_mps=signed_spread(residuals.vertical_rate_mps),
        position_consistency=consistency_of(residuals.position_nees),
        velocity_consistency=consistency_of(residuals.velocity_nees),
    )


def _latency_s(residuals: Residuals) -> Array:
    """How late the position is: the distance it lags behind the truth, over the truth's speed. [s]"""
    fast = residuals.truth_speed_mps >= MIN_ANGLE_SPEED_MPS
    return -residuals.along_m[fast] / residuals.truth_speed_mps[fast]


def by_phase(residuals: Residuals, phases: tuple[str, ...]) -> tuple[PhaseAccuracy, ...]:
    """The same, for each phase that occurs, the most frequent first."""
    counts = np.bincount(residuals.phase[residuals.phase >= 0], minlength=len(phases))
    order = [int(i) for i in np.argsort(-counts, kind="stable") if counts[i] > 0]
    return tuple(
        PhaseAccuracy(phase=phases[i], accuracy=accuracy_of(residuals.take(residuals.phase == i))) for i in order
    )


def by_flight(residuals: Residuals, names: tuple[str, ...]) -> tuple[FlightResult, ...]:
    """Horizontal errors of each flight that has points, in the order of truth."""
    results = []
    edges = np.searchsorted(residuals.flight, np.arange(len(names) + 1))
    for name, start, end in zip(names, edges[:-1], edges[1:], strict=True):
        if start == end:
            continue
        size = residuals.horizontal_m[start:end]
        largest = int(start + np.argmax(size))
        results.append(
            FlightResult(
                flight=name,
                points=int(end - start),
                horizontal_m=spread(size),
                max_time_s=float(residuals.time_s[largest]),
            )
        )
    return tuple(results)


def worst_flight(flights: tuple[FlightResult, ...]) -> Worst | None:
    """The flight with the largest RMS, and the instant of its largest error; None without flights."""
    if not flights:
        return None
    worst = max(flights, key=lambda flight: flight.horizontal_m.rms or 0.0)
    return Worst(flight=worst.flight, value=worst.horizontal_m.rms or 0.0, time_s=worst.max_time_s)


def worst_point(flights: tuple[FlightResult, ...]) -> Worst | None:
    """The largest error of all, with its flight and instant; None without flights."""
    if not flights:
        return None
    worst = max(flights, key=lambda flight: flight.horizontal_m.max or 0.0)
    return Worst(flight=worst.flight, value=worst.horizontal_m.max or 0.0, time_s=worst.max_time_s)
