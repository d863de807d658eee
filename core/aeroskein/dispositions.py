"""Dispositions: what became of each report, told to whoever asks: at arrival, and again when its element closes."""

from __future__ import annotations

import numpy as np

from aeroskein.closed import Closed
from aeroskein.events import Dispositions
from aeroskein.fusion import Fused
from aeroskein.intake import Verdicts
from aeroskein.plots import Plots
from aeroskein.tracks import TrackTable

__all__ = ["of_batch", "of_elements"]


def of_batch(plots: Plots, verdicts: Verdicts, tracks: TrackTable) -> Dispositions:
    """One row per report of a call, in the order in which they came."""
    given = verdicts.slot >= 0
    at = np.where(given, verdicts.slot, 0)
    return Dispositions(
        sensor=plots.sensor,
        time_s=plots.time_s,
        received_s=plots.received_s,
        address=plots.address,
        track_number=np.where(given, tracks.number[at], -1),
        label=np.where(given, tracks.label[at], -1).astype(np.int32),
        element=np.full(len(plots), -1, dtype=np.int64),
        reason=verdicts.reason,
    )


def of_elements(closed: Closed, fused: Fused, tracks: TrackTable) -> Dispositions:
    """One row per report in the span of a closed element; times are corrected for registration."""
    event, lane = np.nonzero(closed.inside)
    slots, window = closed.slots[lane], closed.window
    return Dispositions(
        sensor=window.sensor_index[event, lane].astype(np.int16),
        time_s=window.time_s[event, lane],
        received_s=window.received_s[event, lane],
        address=tracks.address[slots],
        track_number=tracks.number[slots],
        label=tracks.label[slots],
        element=closed.index[lane],
        reason=fused.reason[event, lane],
    )
