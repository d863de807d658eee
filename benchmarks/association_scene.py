"""Traffic for the association study: one radar scan after another over tracks that are known with an error.

A radar in the middle of a disc of 50 NM, range sigma 100 m, azimuth sigma 0.15 degrees, detection 0.9, ten false plots
a scan. Where the radar gives a velocity its sigma is 8 m/s per axis. Tracks are known to 20 m and 1 m/s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aeroskein.association import Candidates, PointGrid, velocity_factors
from aeroskein.plots import Array, Ints

HALF_M = 92_600.0
RANGE_SIGMA_M, AZIMUTH_SIGMA_DEG = 100.0, 0.15
VELOCITY_SIGMA_MPS = 8.0
TRACK_SIGMA_M, TRACK_VELOCITY_SIGMA_MPS = 20.0, 1.0
DETECTION, FALSE_PLOTS, SCAN_S = 0.9, 10, 4.0


@dataclass
class Scan:
    """Plots of one scan with what they truly are (-1: false), beside the tracks."""

    truth: Ints
    plots_m: Array
    plots_v: Array
    plot_cov: Array
    tracks_m: Array
    tracks_v: Array


def in_disc(n: int, rng: np.random.Generator) -> Array:
    """Points ``(n, 2)``, evenly over the disc."""
    radius, angle = HALF_M * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
    return radius[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def positions(kind: str, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions and velocities ``(n, 2)``: random, crossing pairs, or formations of two."""
    speed = rng.uniform(120.0, 250.0, n)
    course = rng.uniform(0.0, 2.0 * np.pi, n)
    place = in_disc(n, rng)
    if kind == "crossing":
        # Pairs meet within 600 m, on courses at least 30 degrees apart.
        second = np.arange(1, n, 2)
        place[second] = place[second - 1] + rng.uniform(-600.0, 600.0, (len(second), 2))
        course[second] = course[second - 1] + rng.uniform(np.radians(30), np.radians(330), len(second))
    elif kind == "formation":
        second = np.arange(1, n, 2)
        angle, distance = rng.uniform(0, 2 * np.pi, len(second)), rng.uniform(300.0, 900.0, len(second))
        place[second] = place[second - 1] + distance[:, None] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        course[second], speed[second] = course[second - 1], speed[second - 1]
    return place, speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=-1)


def scan(place: Array, velocity: Array, rng: np.random.Generator) -> Scan:
    """One scan over aircraft at ``place`` with ``velocity``, ``(n, 2)`` each."""
    seen = np.flatnonzero(rng.random(len(place)) < DETECTION)
    truth = np.concatenate([seen, np.full(FALSE_PLOTS, -1)])
    clean = np.concatenate([place[seen], in_disc(FALSE_PLOTS, rng)])
    v = np.concatenate([velocity[seen], rng.normal(size=(FALSE_PLOTS, 2)) * 150.0])
    ground = np.linalg.norm(clean, axis=1)
    u = clean / ground[:, None]
    across = np.stack([u[:, 1], -u[:, 0]], axis=-1)
    sigma_across = ground * np.radians(AZIMUTH_SIGMA_DEG)
    noise = (
        u * rng.normal(size=(len(u), 1)) * RANGE_SIGMA_M + across * (rng.normal(size=len(u)) * sigma_across)[:, None]
    )
    full = RANGE_SIGMA_M**2 * u[:, :, None] * u[:, None, :]
    full += sigma_across[:, None, None] ** 2 * across[:, :, None] * across[:, None, :]
    order = rng.permutation(len(truth))
    return Scan(
        truth=truth[order], plots_m=(clean + noise)[order],
        plots_v=(v + rng.normal(size=v.shape) * VELOCITY_SIGMA_MPS)[order],
        plot_cov=full[order][:, [0, 0, 1], [0, 1, 1]],
        tracks_m=place + rng.normal(size=place.shape) * TRACK_SIGMA_M,
        tracks_v=velocity + rng.normal(size=place.shape) * TRACK_VELOCITY_SIGMA_MPS,
    )  # fmt: skip


def flat(points_m: Array) -> Array:
    """Plane points as three columns, for the grid."""
    return np.pad(points_m, ((0, 0), (0, 1)))


def candidates(s: Scan, with_velocity: bool, reach_m: float = 5000.0) -> Candidates:
    """Pairs within the coarse gate."""
    plot, track = PointGrid(flat(s.tracks_m), reach_m).near(flat(s.plots_m), reach_m)
    cov = s.plot_cov[plot] + np.array([TRACK_SIGMA_M**2, 0.0, TRACK_SIGMA_M**2])
    factors = {}
    if with_velocity:
        v, sigma = s.plots_v[plot], np.full(len(plot), VELOCITY_SIGMA_MPS)
        factors = velocity_factors(
            np.hypot(v[:, 0], v[:, 1]), np.degrees(np.arctan2(v[:, 0], v[:, 1])), sigma,
            s.tracks_v[track], np.tile(np.array([1.0, 0.0, 1.0]) * TRACK_VELOCITY_SIGMA_MPS**2, (len(plot), 1)),
        )  # fmt: skip
    return Candidates.of(plot, track, s.plots_m[plot] - s.tracks_m[track], cov, **factors)
