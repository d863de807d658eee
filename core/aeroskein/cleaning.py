"""Checks of single reports: whether the values can be true at all, and whether the time fits the clock.

They look at one report and nothing else, so the service and file commands use the same two functions before any track
is known. The limits are those of the message formats the values come from (ICAO Doc 9871 registers, the quality
indicators of DO-260B) or of physics; what is implausible for one particular flight is decided elsewhere.

Markers let a decoder say that something was sent which its column cannot hold: ``BAD_ADDRESS_MARK``,
``BAD_INTEGER_MARK``, and an infinite number. No check accepts them.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Array, Bools, Plots
from aeroskein.reasons import Reason

__all__ = ["BAD_ADDRESS_MARK", "BAD_INTEGER_MARK", "LIMITS", "QUALITY_LIMITS", "check_times", "check_values"]

# Stands in the address column for "sent, but not six hex digits".
BAD_ADDRESS_MARK: Final = -2
# Stands in a quality column for "sent, but outside the column's range".
BAD_INTEGER_MARK: Final = -2

_HIGHEST_ADDRESS: Final = 0xFFFFFF
# 7777 octal.
_HIGHEST_MODE_A: Final = 0o7777
# An angle of 360 degrees is written 0.
_BELOW_360: Final = float(np.nextafter(360.0, 0.0))

# Lowest and highest accepted value of every number, both included.
LIMITS: Final[dict[str, tuple[float, float]]] = {
    # Until the year 5138; a time in milliseconds falls outside. [s]
    "time_s": (0.0, 1.0e11),
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-180.0, 180.0),
    # Line of sight to 20 km altitude ends near 600 km; over-the-horizon radars do not send slant ranges. [m]
    "range_m": (0.0, 1.0e6),
    "azimuth_deg": (0.0, _BELOW_360),
    "elevation_deg": (-90.0, 90.0),
    # Lowest airfields with high pressure lie near -600 m; Gillham code ends at 126,700 ft = 38.6 km. [m]
    "altitude_m": (-2000.0, 50_000.0),
    "height_m": (-2000.0, 50_000.0),
    # The supersonic velocity subtype ends at 4,084 kt = 2,101 m/s. [m/s]
    "ground_speed_mps": (0.0, 2200.0),
    "track_angle_deg": (0.0, _BELOW_360),
    # The message ends at 32,640 ft/min = 166 m/s; twice that for other sources. [m/s]
    "vertical_rate_mps": (-350.0, 350.0),
    "heading_deg": (0.0, _BELOW_360),
    # A sigma of zero would claim a perfect sensor; NACp ends at 18.5 km. [m]
    "position_sigma_m": (float(np.nextafter(0.0, 1.0)), 1.0e5),
    "velocity_sigma_mps": (float(np.nextafter(0.0, 1.0)), 1.0e3),
}

# Highest defined category of each quality indicator; the values above are reserved.
QUALITY_LIMITS: Final[dict[str, int]] = {"nac_p": 11, "nac_v": 4, "nic": 11, "sil": 3}

_FINITE: Final = float(np.finfo(np.float64).max)
# All that is compared with limits, in one table: first what may not be missing (the time, and one of two positions),
# the address last, for it has a reason of its own.
_BOUNDS: Final[dict[str, tuple[float, float]]] = {
    **LIMITS,
    "received_s": (-_FINITE, _FINITE),
    "mode_a": (-1, _HIGHEST_MODE_A),
    "local_track": (-1, _FINITE),
    **{name: (-1, highest) for name, highest in QUALITY_LIMITS.items()},
    "address": (-1, _HIGHEST_ADDRESS),
}
_LOWEST, _HIGHEST = np.array(list(_BOUNDS.values())).T[:, :, None]


def check_values(plots: Plots) -> NDArray[np.uint8]:
    """Find reports whose values cannot be true, each by itself.

    ``BAD_ADDRESS``: an address that is no 24-bit number. ``BAD_VALUE``: a number that is infinite or outside its range,
    no time, half a position, or two positions. ``NO_POSITION``: no position at all. Where several hold, the first of
    these three is given.

    Parameters
    ----------
    plots : Plots
        Reports as decoded, with markers where something unreadable was sent.

    Returns
    -------
    (n,) uint8
        ``Reason``, 0 where nothing is wrong.
    """
    values = np.array([getattr(plots, name) for name in _BOUNDS], dtype=np.float64)  # (columns, n)
    outside = (values < _LOWEST) | (values > _HIGHEST)  # false for nan: absent
    timed, lat, lon, slant, azimuth = ~np.isnan(values[:5])
    geographic, polar = lat | lon, slant | azimuth
    bad = outside[:-1].any(axis=0) | ~timed | (lat != lon) | (slant != azimuth) | (geographic & polar)
    reasons = np.zeros(len(plots), dtype=np.uint8)
    reasons[~(geographic | polar)] = Reason.NO_POSITION
    reasons[bad] = Reason.BAD_VALUE
    reasons[outside[-1]] = Reason.BAD_ADDRESS
    return reasons


def check_times(plots: Plots, now_s: float | Array, max_age_s: float, max_future_s: float) -> NDArray[np.uint8]:
    """Find reports whose time of applicability does not fit the clock.

    Parameters
    ----------
    plots : Plots
        Reports.
    now_s : float or (n,) array
        The clock; one value, or one for each report. [s since the epoch]
    max_age_s, max_future_s : float
        How far a report may lie behind and ahead of the clock; exactly that far is still accepted. [s]

    Returns
    -------
    (n,) uint8
        ``TOO_OLD``, ``FUTURE``, or 0.
    """
    age_s = now_s - plots.time_s
    old: Bools = age_s > max_age_s
    ahead: Bools = age_s < -max_future_s
    reasons = np.zeros(len(plots), dtype=np.uint8)
    reasons[old] = Reason.TOO_OLD
    reasons[ahead] = Reason.FUTURE
    return reasons
