"""Offline smoothing of whole tracks, and the reference estimators that accuracy is claimed against.

parameters ─► start ─► detector (three linear models) ─► variable_jerk (filter, RTS) ─► fixed_lag
                                                                 └──► tracks: reports ─► element points
"""

from aeroskein.smoothing.reference import ReferenceEstimates, reference_filter, reference_smoother
from aeroskein.smoothing.tracks import SmoothingSummary, smooth_reports

__all__ = [
    "ReferenceEstimates",
    "SmoothingSummary",
    "reference_filter",
    "reference_smoother",
    "smooth_reports",
]
