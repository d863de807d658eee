"""Units outside the SI, and angles brought into range.

Everything inside is in metres, seconds and degrees or radians; these factors are for the edges where feet and knots
come in. Values: ICAO Annex 5, Table 3-3 (units in civil aviation) and Table 3-4 (their definitions in the SI).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.plots import Array

__all__ = ["FOOT_M", "FOOT_PER_MINUTE_MPS", "KNOT_MPS", "NAUTICAL_MILE_M", "wrap_angle_deg", "wrap_azimuth_deg"]

# International foot, exact since 1959. [m]
FOOT_M: Final = 0.3048

# International nautical mile, exact. [m]
NAUTICAL_MILE_M: Final = 1852.0

# One nautical mile an hour. [m/s]
KNOT_MPS: Final = NAUTICAL_MILE_M / 3600.0

# Unit of reported vertical rates. [m/s]
FOOT_PER_MINUTE_MPS: Final = FOOT_M / 60.0


def wrap_azimuth_deg(angle_deg: Array) -> Array:
    """Bring an angle into 0 <= angle < 360. [deg]"""
    wrapped = np.array(angle_deg, dtype=np.float64)
    # Few are outside, and the remainder of a division costs more than finding them.
    outside = (wrapped < 0.0) | (wrapped >= 360.0)
    if outside.any():
        rest = np.mod(wrapped[outside], 360.0)
        # A tiny negative angle plus 360 rounds to 360 itself, which is outside.
        wrapped[outside] = np.where(rest >= 360.0, 0.0, rest)
    return wrapped


def wrap_angle_deg(angle_deg: Array) -> Array:
    """Bring a longitude or a difference of angles into -180 <= angle < 180. [deg]"""
    wrapped = np.array(angle_deg, dtype=np.float64)
    # What is in range stays bit for bit; adding and taking away 180 would round it.
    outside = (wrapped < -180.0) | (wrapped >= 180.0)
    if outside.any():
        wrapped[outside] = wrap_azimuth_deg(wrapped[outside] + 180.0) - 180.0
    return wrapped
