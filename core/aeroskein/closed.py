"""Closed elements: what the estimator found out about them, as values that the fusion and the queries read."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from aeroskein.gating import GateMemory
from aeroskein.plots import Array, Bools, Ints
from aeroskein.windows import Window

__all__ = ["Closed", "Estimate"]


@dataclass(slots=True, eq=False)
class Estimate:
    """Result of both passes for n lanes, in the window's order of lanes.

    Attributes
    ----------
    x, P : (6, n), (n, 6, 6)
        Smoothed state at the centre. [m, m/s, m/s²]
    filtered_x, filtered_covariance : (6, n), (24, n)
        The forward pass's own state at the centre.
    settled_x, settled_covariance : (6, n), (24, n)
        Forward state at the settled time: where the next element begins.
    settled_memory : GateMemory
        Gates at the settled time.
    reason : (K, n) uint8
        What became of each report, 0 where accepted (and where there is no report).
    half_width_m : (K, n)
        Half distance of the boundary lines for each report. [m]
    distance2 : (K, n)
        Squared statistical distance of each report from its prediction.
    """

    x: Array
    P: Array
    filtered_x: Array
    filtered_covariance: Array
    settled_x: Array
    settled_covariance: Array
    settled_memory: GateMemory
    reason: NDArray[np.uint8]
    half_width_m: Array
    distance2: Array


@dataclass(slots=True, eq=False)
class Closed:
    """Closed elements of n tracks.

    Attributes
    ----------
    slots : (n,) int64
        Tracks.
    index : (n,) int64
        Index of the element along its track.
    span_s : (n, 2) float64
        Start and end. [s since the epoch]
    centre_s : (n,) float64
        Instant of the estimate. [s since the epoch]
    estimate : Estimate
        State at the centre, and what became of each report.
    window : Window
        The reports, lanes in the order of ``slots``.
    before : (4, n)
        The places of the two elements before, the older one first; NaN where there is none. [m]
    inside : (K, n) bool
        Which reports lie in the element itself.
    """

    slots: Ints
    index: Ints
    span_s: Array
    centre_s: Array
    estimate: Estimate
    window: Window
    before: Array
    inside: Bools = field(init=False)

    def __post_init__(self) -> None:
        time = self.window.time_s
        self.inside = self.window.reported & (time >= self.span_s[:, 0]) & (time < self.span_s[:, 1])
