"""Where a smoothed track is published: elements of equal time along each flight, as ``fuse`` makes them.

A whole-track smoother has an estimate for every instant. It is published at the centres of elements, the odd division
points, because that is what consumers of fused files read: spans are contiguous and half-open, and say which reports
stand behind them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from aeroskein.lanes import continues
from aeroskein.plots import Array, Ints

__all__ = ["Elements", "cut_elements"]

# The last element of a track reaches this far beyond the last report, because spans are half-open. [s]
LAST_SPAN_S: Final = 1e-3
# A remainder of up to this share of an element belongs to the last one: no element has next to no reports.
LONGEST_LAST: Final = 0.25
# Elements are twice as long while no source is faster than this. [s]
FAST_PERIOD_S: Final = 4.0


@dataclass(slots=True, eq=False)
class Elements:
    """Elements of all flights, ordered by flight and time.

    Attributes
    ----------
    flight, index : (m,) int64
        Flight, and number of the element along it.
    span_s : (m, 2) float64
        ``[start, end)``. [s]
    of_report : (n,) int64
        Which element each report lies in.
    """

    flight: Ints
    index: Ints
    span_s: Array
    of_report: Ints

    def __len__(self) -> int:
        return len(self.flight)

    @property
    def centre_s(self) -> Array:
        """Instant that is published. [s]"""
        return np.asarray(self.span_s.mean(axis=1))


def cut_elements(flight: Ints, time_s: Array, period_s: Array, element_s: float) -> Elements:
    """Cut flights into elements.

    Parameters
    ----------
    flight, time_s : (n,) arrays
        Reports, ordered by flight and time. [s]
    period_s : (n,) array
        Usual period of each report's sensor. [s]
    element_s : float
        Length of an element; twice that for flights that no sensor faster than 4 s reports. [s]
    """
    first = np.flatnonzero(~continues(flight))
    start_s, end_s = time_s[first], np.append(time_s[first[1:] - 1], time_s[-1:]) + LAST_SPAN_S
    length_s = np.where(np.minimum.reduceat(period_s, first) < FAST_PERIOD_S, element_s, 2.0 * element_s)
    count = np.maximum(np.ceil((end_s - start_s) / length_s - LONGEST_LAST), 1.0).astype(np.int64)
    offset = np.cumsum(count) - count
    of_flight = np.repeat(np.arange(len(first)), count)
    index = np.arange(len(of_flight)) - offset[of_flight]
    span_s = start_s[of_flight, None] + length_s[of_flight, None] * (index[:, None] + np.array([0.0, 1.0]))
    span_s[:, 1] = np.where(index == count[of_flight] - 1, end_s[of_flight], span_s[:, 1])
    place = np.floor((time_s - start_s[flight]) / length_s[flight]).astype(np.int64)
    element = offset[flight] + np.clip(place, 0, count[flight] - 1)
    # By the bounds themselves, so that rounding cannot put a report beside its span.
    element = element - (time_s < span_s[element, 0])
    element = element + (time_s >= span_s[element, 1])
    return Elements(of_flight, index, span_s, element)
