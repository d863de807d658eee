"""Sizes of errors: root mean square, percentiles, and how far they would move with other flights.

Errors of one flight hang together (the same bias, the same turn), so intervals are bootstrapped over flights, not over
points (Efron and Tibshirani 1993, ch. 8: resample the independent unit). Percentiles of a resample are read from
per-flight histograms with bins of half a percent, which costs memory by flights and not by points.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.evaluation.figures import Interval, SignedSpread, Spread
from aeroskein.plots import Array, Ints

__all__ = ["mean_square_root", "percentile_interval", "rms_interval", "signed_spread", "spread"]

# Histogram for resampled percentiles: a tenth of a millimetre to a thousand kilometres, half a percent a bin.
_LOWEST: Final = 1e-4
_BIN_RATIO: Final = 1.005
_BINS: Final = 4618
_CONFIDENCE: Final = (2.5, 97.5)


def spread(size: Array) -> Spread:
    """Summary of non-negative errors; NaN are left out, none left gives None throughout.

    Parameters
    ----------
    size : (n,) array
        Sizes of errors. [x]
    """
    known = size[np.isfinite(size)]
    if len(known) == 0:
        return Spread()
    p50, p95, p99 = np.percentile(known, (50.0, 95.0, 99.0))
    return Spread(
        count=len(known),
        rms=mean_square_root(known),
        p50=float(p50),
        p95=float(p95),
        p99=float(p99),
        max=float(known.max()),
    )


def signed_spread(error: Array) -> SignedSpread:
    """Summary of errors with a sign; NaN are left out, none left gives None throughout. [x]"""
    known = error[np.isfinite(error)]
    if len(known) == 0:
        return SignedSpread()
    size = np.abs(known)
    return SignedSpread(
        count=len(known),
        mean=float(known.mean()),
        rms=mean_square_root(known),
        p95=float(np.percentile(size, 95.0)),
        max=float(size.max()),
    )


def mean_square_root(error: Array) -> float:
    """Root of the mean square of finite errors. [x]"""
    return float(np.sqrt(np.mean(error * error)))


def rms_interval(size: Array, flight: Ints, *, resamples: int, seed: int) -> Interval | None:
    """95 % bootstrap interval of the RMS over flights; None with fewer than two flights.

    Parameters
    ----------
    size : (n,) array
        Errors, finite. [x]
    flight : (n,) int array
        Flight of each.
    resamples, seed : int
        How many resamples, and the seed of their generator.
    """
    index, count = _flight_index(flight)
    if count < 2:
        return None
    squares = np.bincount(index, weights=size * size, minlength=count)
    numbers = np.bincount(index, minlength=count).astype(np.float64)
    weights = _resamples(count, resamples, seed)
    drawn = np.sqrt((weights @ squares) / (weights @ numbers))
    low, high = np.percentile(drawn, _CONFIDENCE)
    return Interval(low=float(low), high=float(high))


def percentile_interval(size: Array, flight: Ints, percent: float, *, resamples: int, seed: int) -> Interval | None:
    """95 % bootstrap interval of a percentile over flights, to half a percent; None with fewer than two flights."""
    index, count = _flight_index(flight)
    if count < 2:
        return None
    floor = np.maximum(size, _LOWEST)
    column = np.clip(np.ceil(np.log(floor / _LOWEST) / np.log(_BIN_RATIO)).astype(np.int64), 0, _BINS - 1)
    used, column = np.unique(column, return_inverse=True)
    histogram = np.bincount(index * len(used) + column, minlength=count * len(used)).reshape(count, len(used))
    cumulative = np.cumsum(_resamples(count, resamples, seed) @ histogram, axis=1)
    reached = np.argmax(cumulative >= percent / 100.0 * cumulative[:, -1:], axis=1)
    low, high = np.percentile(_LOWEST * _BIN_RATIO ** used[reached].astype(np.float64), _CONFIDENCE)
    return Interval(low=float(low), high=float(high))


def _flight_index(flight: Ints) -> tuple[NDArray[Any], int]:
    names, index = np.unique(flight, return_inverse=True)
    return index, len(names)


def _resamples(count: int, resamples: int, seed: int) -> Array:
    """How often each flight is drawn in each resample, shape ``(resamples, count)``."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(count, np.full(count, 1.0 / count), size=resamples).astype(np.float64)
