"""What the engine says happened: values in columns, for the service to publish, log and count.

``FusedPoints`` (``points.py``) is an event too; the others are here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Ints
from aeroskein.points import FusedPoints

__all__ = ["Dispositions", "Event", "RegistrationState", "Rejections", "TrackChanges"]


@dataclass(slots=True, eq=False)
class Rejections:
    """Reports that were not used, counted: ``counts[sensor, reason]``.

    Attributes
    ----------
    counts : (sensors, len(Reason)) int64
        How many, by sensor index and ``Reason``; column 0 (``ACCEPTED``) counts the accepted ones.
    """

    counts: Ints


@dataclass(slots=True, eq=False)
class Dispositions:
    """What became of each report, one row each; only made while somebody asks for them.

    Attributes
    ----------
    sensor : (n,) int16
        Sensor index.
    time_s, received_s : (n,) float64
        As in ``Plots``. [s since the epoch]
    address : (n,) int32
        As in ``Plots``.
    track_number : (n,) int64
        The track it was given to, -1 where none.
    label : (n,) int32
        That track's naming address, -1 where its key is ``T<number>``.
    element : (n,) int64
        Index of the element it fell in, -1 while it is only buffered or was rejected before.
    reason : (n,) uint8
        ``Reason``; 0 where accepted.
    """

    sensor: NDArray[np.int16]
    time_s: Array
    received_s: Array
    address: NDArray[np.int32]
    track_number: Ints
    label: NDArray[np.int32]
    element: Ints
    reason: NDArray[np.uint8]


@dataclass(slots=True, eq=False)
class TrackChanges:
    """Tracks whose status changed in this call, one row each: for the log.

    Attributes
    ----------
    track_number, address, status : (n,)
        Which track, and what it now is (``Status``).
    time_s : (n,) float64
        When. [s since the epoch]
    """

    track_number: Ints
    address: NDArray[np.int32]
    status: NDArray[np.uint8]
    time_s: Array


@dataclass(frozen=True, slots=True)
class RegistrationState:
    """Systematic errors of one radar: what it reports too much.

    Attributes
    ----------
    sensor : str
        Sensor id.
    time_s : float
        When the state was valid. [s since the epoch]
    state : str
        ``converging``, ``converged``, ``frozen`` or ``off``.
    range_bias_m, azimuth_bias_deg, time_bias_s, range_gain : float
        The biases. [m, deg, s, 1]
    range_bias_sigma_m, azimuth_bias_sigma_deg, time_bias_sigma_s, range_gain_sigma : float
        One sigma of each.
    samples, aircraft : int
        Plots used, and how many aircraft they came from.
    """

    sensor: str
    time_s: float
    state: str
    range_bias_m: float
    azimuth_bias_deg: float
    time_bias_s: float
    range_gain: float
    range_bias_sigma_m: float
    azimuth_bias_sigma_deg: float
    time_bias_sigma_s: float
    range_gain_sigma: float
    samples: int
    aircraft: int


Event = FusedPoints | Rejections | Dispositions | TrackChanges | RegistrationState
