"""Registration of radars: systematic errors of range, azimuth, time and range gain, estimated and taken out.

comparisons.py   plots beside references, and the geometry between them
rows.py          what one comparison says about the biases
filter.py        the joint Kalman filter, with the aircraft's own errors as states
group.py         radars that can share aircraft: queue, filter, jumps, watch over aircraft
pairs.py         two radars on one aircraft, without ADS-B
jumps.py         has a bias changed at once?
consistency.py   which aircraft contradict the others?
places.py        which aircraft have states
estimator.py     all groups together
feedback.py      the published loop
handover.py      radars that apply their registration themselves
latency.py       latency of each aircraft's ADS-B
registration.py  the front: correct, update, states, control, snapshot
"""

from aeroskein.registration.comparisons import Comparisons
from aeroskein.registration.latency import LatencyEstimator
from aeroskein.registration.registration import Registration

__all__ = ["Comparisons", "LatencyEstimator", "Registration"]
