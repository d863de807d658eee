"""Step 7 of the published ADS-B filter: has the filter diverged? Three checks that reject a flight's result.

The mean correction must stay below a limit *in sigmas of the reports*: the published limit in metres rejects good
results where time jitter times speed is large, and passes bad ones where it is small. No estimate may lie too far
across from the original track. And filtering must not make spikes.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.adsb_filter.indicators import spikes
from aeroskein.adsb_filter.record import Filtered
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.adsb_filter.start import position_covariance
from aeroskein.lanes import continues
from aeroskein.measurements import Measurements
from aeroskein.plots import Array, Bools, Ints

__all__ = ["ACROSS", "CORRECTION", "SPIKES", "across_m", "diverged"]

# Bits of the verdict.
CORRECTION: Final = 1
ACROSS: Final = 2
SPIKES: Final = 4


def diverged(
    result: Filtered, original: Measurements, excluded: Bools, settings: AdsbFilterSettings
) -> NDArray[np.uint8]:
    """Judge the result of each flight.

    Parameters
    ----------
    result : Filtered
        Estimates; ``correction`` is filled in here.
    original : Measurements
        The reports as they came, before any repair.
    excluded : (n,) bool
        Reports that are no part of the original track.
    settings : AdsbFilterSettings
        The limits.

    Returns
    -------
    (flights,) uint8
        ``CORRECTION | ACROSS | SPIKES``, 0 where the result stands.
    """
    flight = original.slot
    reported = np.stack([original.east_m, original.north_m], axis=1)
    R = position_covariance(original, result.velocity_mps)
    result.correct(reported, R, settings.outlier_sigmas)
    first = np.flatnonzero(~continues(flight))
    counted = np.isfinite(result.correction) & ~excluded
    total = np.add.reduceat(np.where(counted, result.correction, 0.0), first)
    mean = total / np.maximum(np.add.reduceat(counted.astype(np.int64), first), 1)
    # An outlier is no part of the track it lies beside; those that are too many raise the mean correction.
    track = np.isfinite(reported[:, 0]) & ~excluded & result.accepted
    sigma = np.sqrt(0.5 * (original.r_ee + original.r_nn))
    limit = np.maximum(settings.max_across_sigmas * sigma, settings.max_across_m)
    outside = np.logical_or.reduceat(across_m(flight, reported, track, result.position_m) > limit, first)
    before = _spike_counts(flight, reported, np.isfinite(reported[:, 0]), settings)
    # What was refused or missing is a prediction, and steps back where the flight is found again.
    after = _spike_counts(flight, result.position_m, result.accepted & np.isfinite(reported[:, 0]), settings)
    verdict = np.where(mean > settings.max_mean_correction, CORRECTION, 0)
    return (verdict + np.where(outside, ACROSS, 0) + np.where(after > before, SPIKES, 0)).astype(np.uint8)


def _spike_counts(flight: Ints, position_m: Array, seen: Bools, settings: AdsbFilterSettings) -> Ints:
    """Spikes of each flight's line through some of its rows."""
    at = np.flatnonzero(seen)
    spike = spikes(flight[at], position_m[at], settings.spike_angle_deg, settings.spike_leg_m)
    return np.bincount(flight[at[spike]], minlength=int(flight[-1]) + 1)


def across_m(flight: Ints, reported_m: Array, track: Bools, position_m: Array) -> Array:
    """Distance of estimates from their reports across the original track.

    The direction of the track at a point is that from the point before to the point after it (at the ends, from or to
    the point itself).

    Parameters
    ----------
    flight : (n,) int64
        Flight of each row, ascending.
    reported_m : (n, 2) array
        Reported positions. [m]
    track : (n,) bool
        Which of them make the original track.
    position_m : (n, 2) array
        Estimates at the same times. [m]

    Returns
    -------
    (n,) array
        NaN where the original track has no point. [m]
    """
    across = np.full(len(flight), np.nan)
    at = np.flatnonzero(track)
    joined = continues(flight[at])
    before = np.where(joined, np.roll(at, 1), at)
    after = np.where(np.roll(joined, -1), np.roll(at, -1), at)
    chord = reported_m[after] - reported_m[before]
    offset = position_m[at] - reported_m[at]
    length = np.hypot(*chord.T)
    cross = np.abs(offset[:, 0] * chord[:, 1] - offset[:, 1] * chord[:, 0])
    # Standing still there is no across: any distance counts.
    across[at] = np.where(length > 1.0, cross / np.maximum(length, 1.0), np.hypot(*offset.T))
    return across
