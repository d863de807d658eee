"""GOSPA: one distance between the picture and the truth, split into where, missed and false.

Definition: Rahmathullah, García-Fernández, Svensson 2017 (FUSION), equation 1 with alpha = 2, p = 2: the square of the
metric is the sum of squared distances of assigned pairs plus c²/2 for every missed aircraft and every false track.
"""

from __future__ import annotations

import numpy as np

from aeroskein.evaluation.figures import Gospa
from aeroskein.evaluation.instants import Picture
from aeroskein.plots import Array, Ints

__all__ = ["gospa_of", "gospa_terms"]


def gospa_terms(picture: Picture, cutoff_m: float) -> tuple[Ints, Array, Ints, Ints]:
    """The terms of every step.

    Returns
    -------
    (k,) int array
        The steps at which something is judged.
    (k,) array
        Sum of squared distances of assigned pairs. [m²]
    (k,) int array, (k,) int array
        Missed aircraft; false tracks.

    Notes
    -----
    A track on a flight that is still settling, or no longer judged, counts neither way; nor does one that goes on after
    the truth of its flight has ended.
    """
    steps = np.unique(picture.truth_step)
    if len(steps) == 0:
        return steps, np.zeros(0), steps, steps
    hit = picture.truth_track >= 0
    missed = np.bincount(np.searchsorted(steps, picture.truth_step[~hit]), minlength=len(steps))
    on_judged = np.isin(picture.step * _width(picture) + picture.flight, _judged_keys(picture)) & (picture.flight >= 0)
    place = np.minimum(np.searchsorted(steps, picture.step), len(steps) - 1)
    known = steps[place] == picture.step
    weight = np.where(on_judged & known, np.nan_to_num(picture.distance_m) ** 2, 0.0)
    square = np.bincount(place, weights=weight, minlength=len(steps))
    is_false = known & (picture.flight < 0) & ~picture.is_beyond
    false = np.bincount(place[is_false], minlength=len(steps))
    return steps, square.astype(np.float64), missed.astype(np.int64), false.astype(np.int64)


def gospa_of(picture: Picture, cutoff_m: float) -> Gospa:
    """Mean over all steps of the metric and of its three parts."""
    steps, square, missed, false = gospa_terms(picture, cutoff_m)
    if len(steps) == 0:
        return Gospa(cutoff_m=cutoff_m)
    half = 0.5 * cutoff_m**2
    pairs = int(np.sum(picture.truth_track >= 0))
    return Gospa(
        cutoff_m=cutoff_m,
        steps=len(steps),
        mean_m=float(np.mean(np.sqrt(square + half * (missed + false)))),
        localisation_m=float(np.mean(np.sqrt(square))),
        missed_m=float(np.mean(np.sqrt(half * missed))),
        false_m=float(np.mean(np.sqrt(half * false))),
        aircraft_per_step=float(len(picture.truth_step) / len(steps)),
        missed_per_step=float(missed.mean()),
        false_per_step=float(false.mean()),
        pair_rms_m=float(np.sqrt(square.sum() / pairs)) if pairs else None,
    )


def _width(picture: Picture) -> int:
    return int(max(picture.truth_flight.max(initial=0), picture.flight.max(initial=0))) + 1


def _judged_keys(picture: Picture) -> Ints:
    return picture.truth_step * _width(picture) + picture.truth_flight
