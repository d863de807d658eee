"""How far the published forms are off on simulated flights: the figures of docs/algorithm.md, measured again."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.simulation_scenes import ADSB, RADAR1, RADAR2, run

from aeroskein import geodesy, radar_geometry
from aeroskein.axis import axis_stations, interpolate_on_axis, project_on_axis
from aeroskein.conversion import SensorTable, locate
from aeroskein.elements import PUBLISHED_DEVICE_OFFSETS_M, PUBLISHED_PATH_DEVIATION_M
from aeroskein.enclosing_circle import smallest_circles
from aeroskein.plots import Plots
from aeroskein.settings import EngineSettings
from aeroskein.simulation import TruthStates
from aeroskein.units import FOOT_M

Array = NDArray[np.float64]

SENSORS = (ADSB, RADAR1, replace(RADAR2, kind="ssr"))
HALF_WIDTH_M = PUBLISHED_PATH_DEVIATION_M + max(PUBLISHED_DEVICE_OFFSETS_M)
ELEMENT_S = 4.0


# -- slant range -----------------------------------------------------------------------------------------------------
def _ground_range_m(slant_range_m: float, height_m: float) -> float:
    site = geodesy.frame_rows(np.array([48.0]), np.array([11.0]))
    fix = radar_geometry.radar_to_geodetic(site, np.array([slant_range_m]), np.zeros(1), np.array([height_m]))
    return float(np.hypot(*geodesy.to_plane(site, fix.lat_deg, fix.lon_deg))[0])


def test_slant_range_taken_for_ground_range_is_a_kilometre_off_at_60_km_and_35_000_feet() -> None:
    height_m = 35_000 * FOOT_M

    error_m = 60e3 - _ground_range_m(60e3, height_m)

    assert error_m == pytest.approx(1006.0, abs=1.0)


def test_a_height_wrong_by_300_m_moves_that_ground_range_by_56_m() -> None:
    height_m = 35_000 * FOOT_M

    moved_m = _ground_range_m(60e3, height_m) - _ground_range_m(60e3, height_m + 300.0)

    assert moved_m == pytest.approx(56.3, abs=0.5)


# -- circles ---------------------------------------------------------------------------------------------------------
def _triples(n: int) -> tuple[Array, Array]:
    """One report each of ADS-B and two radars about an aircraft at the origin, and their variances."""
    rng = np.random.default_rng(1)
    jitter_m = 0.2 * 230.0
    points, variances = np.zeros((n, 3, 2)), np.full((n, 3), 10.0**2 + jitter_m**2 / 2.0)
    flight = rng.uniform(0.0, 2.0 * np.pi, n)
    ahead = np.stack([np.cos(flight), np.sin(flight)], axis=1)
    points[:, 0] = rng.normal(0.0, 10.0, (n, 2)) + rng.normal(0.0, jitter_m, n)[:, None] * ahead
    for k, (range_sigma_m, azimuth_sigma_deg) in enumerate(((50.0, 0.07), (100.0, 0.15)), 1):
        beam, ground_m = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(30e3, 200e3, n)
        across_sigma_m = ground_m * np.radians(azimuth_sigma_deg)
        radial = np.stack([np.cos(beam), np.sin(beam)], axis=1)
        across = np.stack([-np.sin(beam), np.cos(beam)], axis=1)
        points[:, k] = radial * rng.normal(0.0, range_sigma_m, n)[:, None]
        points[:, k] += across * (rng.normal(0.0, 1.0, n) * across_sigma_m)[:, None]
        variances[:, k] = 0.5 * (range_sigma_m**2 + across_sigma_m**2)
    return points, variances


def _circumcenters(p: Array) -> Array:
    square = (p**2).sum(axis=2)
    x, y = p[:, :, 0], p[:, :, 1]
    twice_area = 2.0 * (x * (np.roll(y, -1, axis=1) - np.roll(y, 1, axis=1))).sum(axis=1)
    return np.stack(
        [
            (square * (np.roll(y, -1, axis=1) - np.roll(y, 1, axis=1))).sum(axis=1),
            (square * (np.roll(x, 1, axis=1) - np.roll(x, -1, axis=1))).sum(axis=1),
        ],
        axis=1,
    ) / twice_area[:, None]  # fmt: skip


def test_five_of_six_triangles_of_three_sensors_are_obtuse_and_their_circumcircle_is_no_smallest_circle() -> None:
    points, _ = _triples(50_000)
    sides = np.sort(((points - np.roll(points, 1, axis=1)) ** 2).sum(axis=2), axis=1)
    obtuse = sides[:, 2] > sides[:, 0] + sides[:, 1]

    published_m = np.hypot(*_circumcenters(points).T)
    smallest_m = np.hypot(*smallest_circles(points)[0].T)

    assert obtuse.mean() == pytest.approx(0.83, abs=0.01)
    assert np.median(published_m) == pytest.approx(198.0, abs=6.0)
    assert np.quantile(published_m, 0.99) > 7_000.0
    assert np.median(smallest_m) == pytest.approx(108.0, abs=3.0)


def test_weights_by_accuracy_are_three_times_as_near_as_the_smallest_circle() -> None:
    points, variances = _triples(50_000)
    weights = 1.0 / variances / (1.0 / variances).sum(axis=1, keepdims=True)

    weighted_m = np.hypot(*(weights[:, :, None] * points).sum(axis=1).T)

    smallest_m = np.hypot(*smallest_circles(points)[0].T)
    assert np.median(smallest_m) > 3.0 * np.median(weighted_m)


# -- the axis --------------------------------------------------------------------------------------------------------
@cache
def _flown(scenario: str) -> tuple[Plots, TruthStates]:
    return run(*SENSORS, scenario=scenario, aircraft=6, duration_s=600.0, seed=1)


def _plane(truth: TruthStates, address: int) -> tuple[Array, Array, Array]:
    """The frame of a flight, its true path ``(1, P, 2)`` in it, and the times of its points."""
    mine = truth.address == address
    frame = geodesy.frame_rows(truth.lat_deg[mine][:1], truth.lon_deg[mine][:1])
    path = np.stack(geodesy.to_plane(frame, truth.lat_deg[mine], truth.lon_deg[mine]), axis=1)
    return frame, path[None], truth.time_s[mine]


@pytest.mark.parametrize(
    ("scenario", "lowest", "highest"),
    [("cruise", 0.99, 1.0), ("enroute", 0.02, 0.35), ("terminal", 0.02, 0.35), ("hold", 0.0, 0.2)],
)
def test_one_chord_for_a_whole_flight_keeps_only_straight_flights_in_its_strip(
    scenario: str, lowest: float, highest: float
) -> None:
    _, truth = _flown(scenario)
    inside = []

    for address in np.unique(truth.address):
        _, path, _ = _plane(truth, address)
        s, c, _ = project_on_axis(path, path[:, [0, -1]])
        inside.append((np.abs(c[0]) <= HALF_WIDTH_M) & (s[0] >= 0.0) & (s[0] <= s[0, -1]))

    assert lowest <= np.concatenate(inside).mean() <= highest


def _located(plots: Plots) -> tuple[Array, Array]:
    table = SensorTable(EngineSettings(sensors=SENSORS))
    n = len(plots)
    height_m = np.where(np.isnan(plots.height_m), plots.altitude_m + 90.0, plots.height_m)
    located = locate(plots, table, height_m, np.full(n, 20.0), np.zeros((n, 4)))
    return located.lat_deg, located.lon_deg


def _reports_of(plots: Plots, frame: Array, address: int) -> tuple[Array, Array]:
    mine = plots.address == address
    lat_deg, lon_deg = _located(plots.take(mine))
    rows = np.repeat(frame, int(mine.sum()), axis=0)
    return np.stack(geodesy.to_plane(rows, lat_deg, lon_deg), axis=1), plots.time_s[mine]


def test_without_regard_to_time_a_seventh_of_the_reports_of_a_holding_fall_on_another_lap() -> None:
    plots, truth = _flown("hold")
    wrong, wrong_with_gate = [], []

    for address in np.unique(truth.address):
        frame, path, path_s = _plane(truth, address)
        points, time_s = _reports_of(plots, frame, address)
        about_then = np.abs(path_s[None, :-1] - time_s[:, None]) <= 8.0
        for allowed, found in ((None, wrong), (about_then[None], wrong_with_gate)):
            s, _, _ = project_on_axis(points[None], path, allowed)
            at_s = interpolate_on_axis(axis_stations(path), path_s[None], s)[0]
            found.append(np.abs(at_s - time_s) > 60.0)

    assert np.concatenate(wrong).mean() > 0.05
    assert not np.concatenate(wrong_with_gate).any()


def test_the_time_where_the_circles_centre_lies_on_the_axis_is_better_than_the_mean_time() -> None:
    plots, truth = _flown("enroute")
    squares = np.zeros((0, 2))

    for address in np.unique(truth.address):
        frame, path, path_s = _plane(truth, address)
        points, time_s = _reports_of(plots, frame, address)
        element = np.floor((time_s - path_s[0]) / ELEMENT_S).astype(np.int64)
        members = element == np.arange(1, int((path_s[-1] - path_s[0]) / ELEMENT_S) - 1)[:, None]
        members = members[members.sum(axis=1) >= 3]
        centers, _ = smallest_circles(np.broadcast_to(points, (len(members), *points.shape)), members)
        mean_s = (members * (time_s - path_s[0])).sum(axis=1) / members.sum(axis=1) + path_s[0]
        about_then = np.abs(path_s[None, :-1] - mean_s[:, None]) <= ELEMENT_S
        s, _, _ = project_on_axis(centers[None], path, about_then[None])
        axis_s = interpolate_on_axis(axis_stations(path), path_s[None], s)[0]
        off = [
            ((centers - interpolate_on_axis(path_s[None], path, at[None])[0]) ** 2).sum(1) for at in (mean_s, axis_s)
        ]
        squares = np.concatenate([squares, np.stack(off, axis=1)])

    by_mean_time, by_axis_time = np.sqrt(squares.mean(axis=0))
    assert by_axis_time < 0.85 * by_mean_time
