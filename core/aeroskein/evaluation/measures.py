"""The figures that requirement rows ask for, at the update interval of each column."""

from __future__ import annotations

from typing import Final

import numpy as np

from aeroskein.evaluation.columns import PointColumns
from aeroskein.evaluation.continuity import gaps_of, updates_of
from aeroskein.evaluation.figures import Continuity, Identity, Timing
from aeroskein.evaluation.grouping import run_lengths
from aeroskein.evaluation.requirements import COLUMNS
from aeroskein.evaluation.residuals import Residuals
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.evaluation.windows import Windows, is_update
from aeroskein.plots import Array, Bools, Ints
from aeroskein.units import FOOT_M, FOOT_PER_MINUTE_MPS

__all__ = ["common_measures", "interval_measures"]

# An altitude is correct within this (Mode C, 300 ft).
_ALTITUDE_LIMIT_M: Final = 300.0 * FOOT_M
# A large error (row R5) and a false position (ED-142), by column. [m]
_LARGE_M: Final = {"3 NM": 555.0, "5 NM": 926.0}
_FALSE_M: Final = {"3 NM": 1690.0, "5 NM": 2100.0}
# Gaps that ED-142 calls long, by column. [s]
_ED_GAP_S: Final = {"3 NM": 16.5, "5 NM": 16.4}


def common_measures(residuals: Residuals, timing: Timing, identity: Identity, hours: float) -> dict[str, float | None]:
    """Measures that are the same in every column.

    Parameters
    ----------
    residuals, timing, identity
        Of one product.
    hours : float
        How long the picture was judged. [h]
    """
    turning, climbing = residuals.is_turning, residuals.is_climbing
    right_altitude = np.abs(residuals.altitude_m) <= _ALTITUDE_LIMIT_M
    has_altitude = np.isfinite(residuals.altitude_m)
    rate_fpm = residuals.vertical_rate_mps / FOOT_PER_MINUTE_MPS
    return {
        "interval_s": timing.interval.p50_s,
        "rms_m": _rms(residuals.horizontal_m),
        "altitude_wrong": _percent(~right_altitude[has_altitude]),
        "altitude_level": _percent(right_altitude[has_altitude & ~climbing]),
        "altitude_climb": _percent(right_altitude[has_altitude & climbing]),
        "callsign_wrong": _complement(identity.callsign_correct),
        "address_wrong": _complement(identity.address_correct),
        "rate_level": _rms(rate_fpm[~climbing]),
        "rate_climb": _rms(rate_fpm[climbing]),
        "velocity_straight": _rms(residuals.velocity_mps[~turning]),
        "velocity_turn": _rms(residuals.velocity_mps[turning]),
        "angle_straight": _rms(residuals.track_angle_deg[~turning]),
        "angle_turn": _rms(residuals.track_angle_deg[turning]),
        "false_per_hour": identity.false_tracks / hours if hours > 0.0 else None,
    }


def interval_measures(
    points: PointColumns,
    flight: Ints,
    residuals: Residuals,
    continuity: tuple[Continuity, ...],
    windows: Windows,
    curve: TruthCurve,
) -> dict[str, dict[str, float | None]]:
    """Measures of every column.

    Parameters
    ----------
    points : PointColumns
        The points of one product.
    flight : (n,) int array
        Flight of each, -1 where none.
    residuals, continuity
        Of that product; ``continuity`` at the intervals of ``COLUMNS``, in that order.
    windows, curve
    """
    news = is_update(points) & windows.contain(flight, points.time_s)
    right = _right(points, flight, residuals, curve)
    _, _, gap_s = gaps_of(points.time_s[news], flight[news], windows, curve)
    found: dict[str, dict[str, float | None]] = {}
    for (column, interval_s), flow in zip(COLUMNS.items(), continuity, strict=True):
        lowest = flow.lowest_flight
        large = run_lengths(residuals.horizontal_m > _LARGE_M[column], residuals.flight) >= 3
        found[column] = {
            "update_lowest": 100.0 * lowest.value if lowest else None,
            "update_all": _times_100(flow.update_probability),
            "long_gap": _times_100(flow.long_gap_ratio),
            "correlated": _percent(large),
            "false_position": _percent(residuals.horizontal_m > _FALSE_M[column]),
            "ed_gap": 100.0 * int(np.sum(gap_s > _ED_GAP_S[column])) / flow.expected if flow.expected else None,
        }
        for key, is_right in right.items():
            updates = updates_of(points.time_s, np.where(news & is_right, flight, -1), windows, curve, interval_s)
            found[column][key] = _times_100(int(updates.updated.sum()) / flow.expected if flow.expected else None)
    return found


def _right(points: PointColumns, flight: Ints, residuals: Residuals, curve: TruthCurve) -> dict[str, Bools]:
    """Which points state the right altitude, callsign and address; only for what truth knows of any flight."""
    right: dict[str, Bools] = {}
    safe = np.maximum(flight, 0)
    if (curve.addresses >= 0).any():
        right["address_update"] = (points.address >= 0) & (points.address == curve.addresses[safe])
    if (curve.callsigns != b"").any():
        right["callsign_update"] = (points.callsign != b"") & (points.callsign == curve.callsigns[safe])
    if np.isfinite(curve.altitude_m).any():
        altitude = np.zeros(len(points), dtype=np.bool_)
        altitude[residuals.row[np.abs(residuals.altitude_m) <= _ALTITUDE_LIMIT_M]] = True
        right["altitude_update"] = altitude
    return right


def _rms(error: Array) -> float | None:
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known * known))) if len(known) else None


def _percent(share: Bools) -> float | None:
    return 100.0 * float(share.mean()) if len(share) else None


def _times_100(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def _complement(share: float | None) -> float | None:
    return None if share is None else 100.0 * (1.0 - share)
