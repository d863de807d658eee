"""Delivery: which measurements become reports, and when each of them arrives.

Sensors lose reports, fall silent, send some twice, and deliver late and in another order than they measured; the delays
are those of the numerical study in docs/algorithm.md, which took them from recorded feeds.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array, Bools, Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation.settings import SensorErrors

__all__ = ["FEET_STEP_M", "delay_s", "mode_c", "survives", "with_duplicates"]

# Pressure altitude is sent in steps of 25 ft. [m]
FEET_STEP_M: Final = 25.0 * 0.3048

# The second copy of a report comes by another way, at most this much later. [s]
DUPLICATE_WITHIN_S: Final = 1.0


def mode_c(altitude_m: Array) -> Array:
    """Round pressure altitudes to the steps in which they are sent. [m]"""
    return np.asarray(np.round(altitude_m / FEET_STEP_M) * FEET_STEP_M)


def survives(errors: SensorErrors, elapsed_s: Array, rng: np.random.Generator) -> Bools:
    """Which measurements, ``elapsed_s`` after the scenario's start, are neither missed nor in a gap."""
    kept = rng.random(len(elapsed_s)) >= errors.miss_probability
    for begin_s, end_s in errors.gaps_s:
        kept &= (elapsed_s < begin_s) | (elapsed_s >= end_s)
    return np.asarray(kept, dtype=np.bool_)


def delay_s(sensor: SensorSettings, errors: SensorErrors, n: int, rng: np.random.Generator) -> Array:
    """Time from measurement to arrival of ``n`` reports. [s]"""
    if not sensor.is_radar:
        return errors.delay_median_s * np.exp(errors.delay_spread * rng.standard_normal(n))
    usual = rng.uniform(errors.delay_min_s, errors.delay_max_s, n)
    late = rng.uniform(errors.delay_max_s, errors.late_max_s, n)
    return np.where(rng.random(n) < errors.late_probability, late, usual)


def with_duplicates(plots: Plots, errors: SensorErrors, rng: np.random.Generator) -> Plots:
    """The reports and, for some of them, a later copy."""
    if errors.duplicate_probability == 0.0:
        return plots
    twice = np.flatnonzero(rng.random(len(plots)) < errors.duplicate_probability)
    copies = plots.take(twice)
    copies.received_s = copies.received_s + rng.uniform(0.0, DUPLICATE_WITHIN_S, len(twice))
    return Plots.concatenate([plots, copies])
