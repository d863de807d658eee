"""The parameters of the reference estimators, written down once: accuracy is claimed against exactly these.

The model is constant acceleration under white jerk whose density follows the flight. What the density is at each
moment a detector says: three linear models (steady, gentle and hard manoeuvre) that interact.
"""

from __future__ import annotations

from typing import Final

import numpy as np

__all__ = [
    "ACCELERATION_SIGMA_MPS2",
    "AHEAD_S",
    "BEHIND_S",
    "DETECTOR_JERK_DENSITY",
    "DETECTOR_START",
    "DETECTOR_STEADY_DENSITY",
    "GATE",
    "JERK_DENSITY",
    "RATES_PER_S",
    "REFUSALS_TO_BELIEVE",
    "UNKNOWN_VELOCITY_SIGMA_MPS",
]

# Detector, model 1: constant velocity, acceleration as white noise of (0.05 m/s²)² per hertz. [m²/s³]
DETECTOR_STEADY_DENSITY: Final = 0.05**2
# Models 2 and 3: constant acceleration, white jerk of (0.2 m/s³)² and (2 m/s³)² per hertz. [m²/s⁵]
DETECTOR_JERK_DENSITY: Final = (0.2**2, 2.0**2)
# Rates of change between them, from row to column. [1/s]
RATES_PER_S: Final = np.array([[0.0, 0.004, 0.012], [0.01, 0.0, 0.03], [0.05, 0.15, 0.0]])
# Their probabilities before the first report.
DETECTOR_START: Final = np.array([0.80, 0.15, 0.05])

# Density of jerk that the smoother allows for in each mode: less than the detector's, for it sees both sides. [m²/s⁵]
JERK_DENSITY: Final = np.array([0.02**2, 0.1**2, 1.0**2])
# At time t the largest density from t - 1 s to t + 4 s counts: a manoeuvre begins before it is found. [s]
BEHIND_S: Final = 1.0
AHEAD_S: Final = 4.0

# Squared statistical distance beyond which a position or velocity is an outlier: six sigma in the plane.
GATE: Final = 36.0
# A source refused so often in a row, while no other was accepted, is believed: the state is wrong, not the source.
REFUSALS_TO_BELIEVE: Final = 4

# What is not measured at the first report: any acceleration of a transport, any speed of a jet. [m/s², m/s]
ACCELERATION_SIGMA_MPS2: Final = 3.0
UNKNOWN_VELOCITY_SIGMA_MPS: Final = 150.0
