"""Fine score: how well a plot fits a track, over all factors that both have.

``mahalanobis`` (default): squared statistical distance plus the logarithm of the determinant of its covariance, over
distance, ground speed, track angle and altitude, and what a Mode A code says. It is minus twice the log likelihood, so
factors add up without weights. ``ahp``: the published weighted sum of factor distances (a radar-AIS patent application
of 2023), mended where it does not work as published: each factor is divided by its sigma, angles are wrapped, and the
weights of missing factors are shared out among the others.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray

from aeroskein.ahp import pairwise_weights, renormalise
from aeroskein.plots import Array, Bools, Ints, taken
from aeroskein.settings import AssociationSettings
from aeroskein.units import wrap_angle_deg

__all__ = ["GATE_AHP", "GATE_BY_DOF", "Candidates", "Score", "Scorer", "mode_a_cost", "velocity_factors"]

# Chi-square, 99.9 %, by degrees of freedom 0 to 6.
GATE_BY_DOF: Final = np.array([0.0, 10.828, 13.816, 16.266, 18.467, 20.515, 22.458])
# The same for a weighted mean of scaled distances: 99.9 % of a distance alone (two components).
GATE_AHP: Final = 3.717
# What a missing factor counts: the mean of a normal error's magnitude, in sigmas.
MEAN_MAGNITUDE: Final = 0.798

# Spread of a factor that only the plot has: the track could be anything. [m/s, deg, m, deg]
VAGUE_SIGMA: Final = np.array([150.0, 100.0, 3500.0, 100.0])
# A course says nothing at walking pace. [m/s]
COURSE_SPEED_MIN_MPS: Final = 15.0

# A transponder answers with its own code in all but this share of replies (garbled, or being changed).
MODE_A_WRONG: Final = 0.03
FACTORS: Final = 4


@dataclass(slots=True, eq=False)
class Candidates:
    """Pairs of a plot and a track near it, one row each; NaN where one of the two lacks the factor.

    Attributes
    ----------
    plot, track : (p,) int64
        Row of the plot, slot of the track; ordered by plot.
    step_m : (p, 2) float64
        Plot minus expected position at the plot's time, in one plane. [m]
    step_cov_m2 : (p, 3) float64
        ``[ee, en, nn]``: track and plot together. [m²]
    speed_step_mps, speed_sigma_mps : (p,) float64
        Ground speed. [m/s]
    course_step_deg, course_sigma_deg : (p,) float64
        Track angle. [deg]
    altitude_step_m, altitude_sigma_m : (p,) float64
        Pressure altitude. [m]
    heading_step_deg, heading_sigma_deg : (p,) float64
        Heading; method ahp takes it where there is no altitude. [deg]
    mode_a_cost : (p,) float64
        From ``mode_a_cost``; 0 where one has no code.
    """

    plot: Ints
    track: Ints
    step_m: Array
    step_cov_m2: Array
    speed_step_mps: Array
    speed_sigma_mps: Array
    course_step_deg: Array
    course_sigma_deg: Array
    altitude_step_m: Array
    altitude_sigma_m: Array
    heading_step_deg: Array
    heading_sigma_deg: Array
    mode_a_cost: Array

    def __len__(self) -> int:
        return len(self.plot)

    @classmethod
    def of(cls, plot: Ints, track: Ints, step_m: Array, step_cov_m2: Array, **factors: Array) -> Self:
        """Make rows; factors not given are missing throughout."""
        n = len(plot)
        columns = {
            f.name: np.asarray(
                factors.pop(f.name, np.zeros(n) if f.name == "mode_a_cost" else np.full(n, np.nan)), dtype=np.float64
            )
            for f in fields(cls)[4:]
        }
        if factors:
            raise TypeError(f"Candidates has no column {sorted(factors)[0]!r}")
        return cls(plot=plot, track=track, step_m=step_m, step_cov_m2=step_cov_m2, **columns)

    def take(self, rows: NDArray[Any]) -> Self:
        """The given rows (an index array or a boolean mask), in that order."""
        return taken(self, rows)

    def factors(self) -> tuple[Array, Array]:
        """Differences and sigmas of speed, course, altitude and heading, ``(p, 4)`` each."""
        steps = (self.speed_step_mps, self.course_step_deg, self.altitude_step_m, self.heading_step_deg)
        sigmas = (self.speed_sigma_mps, self.course_sigma_deg, self.altitude_sigma_m, self.heading_sigma_deg)
        difference = np.stack(steps, axis=-1)
        difference[:, [1, 3]] = wrap_angle_deg(difference[:, [1, 3]])
        return difference, np.stack(sigmas, axis=-1)

    def distance2(self) -> tuple[Array, Array]:
        """Squared statistical distance in the plane, and the determinant of its covariance, ``(p,)`` each."""
        a, b, c = self.step_cov_m2.T
        x, y = self.step_m.T
        determinant = a * c - b * b
        return (c * x**2 - 2.0 * b * x * y + a * y**2) / determinant, determinant


@dataclass(slots=True, eq=False)
class Score:
    """What the pairs are worth.

    Attributes
    ----------
    cost : (p,) float64
        Smaller is better; comparable among the tracks of one plot and among plots.
    inside : (p,) bool
        In the gate.
    limit : (p,) float64
        Cost from which a plot is better left alone.
    evidence, evidence_limit : (p,) float64
        Minus twice the log likelihood, whatever the method; and that of a plot that is left alone.
    """

    cost: Array
    inside: Bools
    limit: Array
    evidence: Array
    evidence_limit: Array


class Scorer:
    """Scores candidates by the configured method.

    Raises
    ------
    SettingsError
        The pairwise matrix contradicts itself or is not four by four.
    """

    def __init__(self, settings: AssociationSettings) -> None:
        self.method: Literal["mahalanobis", "ahp"] = settings.method
        self.weights = pairwise_weights(settings.pairwise).weights

    def score(self, pairs: Candidates) -> Score:
        """Score every pair."""
        return _score_ahp(pairs, self.weights) if self.method == "ahp" else _score_mahalanobis(pairs)


def _score_mahalanobis(pairs: Candidates) -> Score:
    position2, determinant = pairs.distance2()
    difference, sigma = pairs.factors()
    difference, sigma = difference[:, :3], sigma[:, :3]
    present = np.isfinite(difference) & np.isfinite(sigma)
    scaled2 = np.where(present, (difference / np.where(present, sigma, 1.0)) ** 2, 0.0)
    dof = 2 + present.sum(axis=1)
    distance2 = position2 + scaled2.sum(axis=1)
    # A factor that the plot has and only some of its tracks have must not favour those that lack it: there the track
    # counts as vague.
    vague = ~present & _any_by(pairs.plot, present)
    spread = np.log(determinant) + 2.0 * np.where(present, np.log(np.where(present, sigma, 1.0)), 0.0).sum(axis=1)
    spread += np.where(vague, 1.0 + 2.0 * np.log(VAGUE_SIGMA[:3]), 0.0).sum(axis=1)
    inside = distance2 <= GATE_BY_DOF[dof]
    # Only differences between the tracks that the plot may be of matter; the best known of them sets the zero.
    spread -= np.minimum(_least_by(pairs.plot, np.where(inside, spread, np.inf)), spread)
    limit = GATE_BY_DOF[_most_by(pairs.plot, dof)]
    cost = distance2 + spread + pairs.mode_a_cost
    return Score(cost, inside, limit, cost, limit)


def _score_ahp(pairs: Candidates, weights: Array) -> Score:
    position2, _ = pairs.distance2()
    difference, sigma = pairs.factors()
    scaled = np.empty((len(pairs), FACTORS))
    scaled[:, 0] = np.sqrt(position2)
    scaled[:, 1:3] = np.abs(difference[:, :2]) / sigma[:, :2]
    # The fourth factor is altitude; heading stands in where a sensor gives that instead.
    altitude, heading = np.abs(difference[:, 2:4].T) / sigma[:, 2:4].T
    scaled[:, 3] = np.where(np.isfinite(altitude), altitude, heading)
    present = np.isfinite(scaled)
    asked = _any_by(pairs.plot, present)
    filled = np.where(present, scaled, MEAN_MAGNITUDE)
    distance = (renormalise(weights, asked) * filled).sum(axis=1)
    inside = (position2 <= GATE_BY_DOF[2]) & (distance <= GATE_AHP)
    # A code moves the distance as its likelihood would move a squared distance.
    cost = np.sqrt(np.maximum(distance**2 + pairs.mode_a_cost, 0.0))
    likely = _score_mahalanobis(pairs)
    return Score(cost, inside, np.full(len(pairs), GATE_AHP), likely.evidence, likely.evidence_limit)


def velocity_factors(
    plot_speed_mps: Array, plot_track_deg: Array, plot_sigma_mps: Array, v_mps: Array, v_cov_m2ps2: Array
) -> dict[str, Array]:
    """Speed and course of pairs, as columns for ``Candidates.of``.

    Parameters
    ----------
    plot_speed_mps, plot_track_deg : (p,) array
        As the plot reports them; NaN where it does not. [m/s, deg]
    plot_sigma_mps : (p,) array
        One sigma per axis of the plot's velocity. [m/s]
    v_mps : (p, 2) array
        Velocity of the track, east and north. [m/s]
    v_cov_m2ps2 : (p, 3) array
        ``[ee, en, nn]`` of it. [m²/s²]

    Returns
    -------
    dict
        ``speed_step_mps``, ``speed_sigma_mps``, ``course_step_deg``, ``course_sigma_deg``.
    """
    speed = np.hypot(v_mps[:, 0], v_mps[:, 1])
    e, n = v_mps.T / np.maximum(speed, 1e-9)
    ee, en, nn = v_cov_m2ps2.T
    along = ee * e**2 + 2.0 * en * e * n + nn * n**2
    across = ee * n**2 - 2.0 * en * e * n + nn * e**2
    slower = np.minimum(speed, plot_speed_mps)
    with np.errstate(invalid="ignore"):
        moving = slower > COURSE_SPEED_MIN_MPS
    course_sigma = np.degrees(np.sqrt(across + plot_sigma_mps**2) / np.where(moving, slower, 1.0))
    course_step = plot_track_deg - np.degrees(np.arctan2(v_mps[:, 0], v_mps[:, 1]))
    return {
        "speed_step_mps": plot_speed_mps - speed,
        "speed_sigma_mps": np.sqrt(along + plot_sigma_mps**2),
        "course_step_deg": np.where(moving, course_step, np.nan),
        # Flat enough beyond 100 degrees to say nothing.
        "course_sigma_deg": np.where(moving, np.minimum(course_sigma, 100.0), np.nan),
    }


def mode_a_cost(
    plot_code: NDArray[np.integer[Any]], track_code: NDArray[np.integer[Any]], codes_in_use: NDArray[np.integer[Any]]
) -> Array:
    """Minus twice the log likelihood ratio of a pair's Mode A codes, ``(p,)``.

    A code is evidence, not identity: many aircraft share one, and codes change in flight. What agreement is worth
    depends on how many of the tracks use the code.

    Parameters
    ----------
    plot_code, track_code : (p,) int array
        Codes of the pairs, -1 where absent.
    codes_in_use : (m,) int array
        Codes of all tracks, -1 where absent.
    """
    known = codes_in_use[codes_in_use >= 0]
    count = np.bincount(known.astype(np.int64), minlength=4096)
    share = np.clip((count + 1.0) / (len(known) + 20.0), 1e-3, 0.9)[np.maximum(plot_code, 0)]
    agree = -2.0 * np.log((1.0 - MODE_A_WRONG) / share)
    differ = -2.0 * np.log(MODE_A_WRONG / (1.0 - share))
    both = (plot_code >= 0) & (track_code >= 0)
    return np.where(both, np.where(plot_code == track_code, agree, differ), 0.0)


def _starts(key: Ints) -> Ints:
    return np.flatnonzero(np.r_[True, key[1:] != key[:-1]]) if len(key) else np.empty(0, dtype=np.int64)


def _spread_back(key: Ints, starts: Ints, values: NDArray[Any]) -> NDArray[Any]:
    return np.repeat(values, np.diff(np.r_[starts, len(key)]), axis=0)


def _any_by(key: Ints, mask: Bools) -> Bools:
    """For each row, whether any row of the same plot has it; rows of a plot stand together."""
    if not len(key):
        return mask
    starts = _starts(key)
    return _spread_back(key, starts, np.logical_or.reduceat(mask, starts, axis=0))


def _least_by(key: Ints, value: Array) -> Array:
    if not len(key):
        return value
    starts = _starts(key)
    return _spread_back(key, starts, np.minimum.reduceat(value, starts))


def _most_by(key: Ints, value: Ints) -> Ints:
    if not len(key):
        return value
    starts = _starts(key)
    return _spread_back(key, starts, np.maximum.reduceat(value, starts))
