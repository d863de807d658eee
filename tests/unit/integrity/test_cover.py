"""Cover of a radar, learned from its plots."""

import numpy as np
import pymap3d
import pytest

from aeroskein.geodesy import frame_rows, to_ecef
from aeroskein.integrity.cover import CoverMap, polar_of


def seen(cover: CoverMap, range_m: float, azimuth_deg: float, elevation_deg: float, count: int = 6) -> None:
    one = np.ones(count)
    cover.seen(one * range_m, one * azimuth_deg, one * elevation_deg, 0.0)


def detection(cover: CoverMap, range_m: float, azimuth_deg: float, elevation_deg: float) -> float:
    return float(cover.detection(np.array([range_m]), np.array([azimuth_deg]), np.array([elevation_deg]), 1000.0)[0])


def test_polar_coordinates_are_those_of_pymap3d() -> None:
    site = frame_rows(np.array([48.0]), np.array([11.0]), 400.0)[0]
    lat, lon, height = np.array([49.0, 47.5]), np.array([12.0, 11.1]), np.array([9000.0, 3000.0])

    range_m, azimuth_deg, elevation_deg = polar_of(site, to_ecef(lat, lon, height))

    azimuth, elevation, slant = pymap3d.geodetic2aer(lat, lon, height, 48.0, 11.0, 400.0)
    assert range_m == pytest.approx(slant, abs=1e-3)
    assert azimuth_deg == pytest.approx(azimuth, abs=1e-7)
    assert elevation_deg == pytest.approx(elevation, abs=1e-7)


def test_nothing_is_cover_before_anything_was_seen() -> None:
    assert detection(CoverMap(None), 50e3, 90.0, 3.0) == 0.0


def test_what_is_nearer_and_higher_than_plots_is_cover() -> None:
    cover = CoverMap(None)
    seen(cover, 120e3, 90.0, 1.2)

    assert detection(cover, 80e3, 95.0, 3.0) == pytest.approx(0.95)
    assert detection(cover, 200e3, 95.0, 3.0) == 0.0
    assert detection(cover, 80e3, 95.0, 0.3) == 0.0


def test_another_direction_is_not_proved_by_a_few_plots() -> None:
    cover = CoverMap(None)
    seen(cover, 120e3, 90.0, 1.2)

    assert detection(cover, 80e3, 270.0, 1.6) == 0.0


def test_high_above_the_horizon_many_plots_prove_every_direction() -> None:
    cover = CoverMap(None)
    seen(cover, 120e3, 90.0, 1.2, count=60)

    assert detection(cover, 80e3, 270.0, 3.5) > 0.9
    assert detection(cover, 80e3, 270.0, 1.6) == 0.0


def test_an_instrumented_range_is_cover_above_the_horizon() -> None:
    cover = CoverMap(200e3)

    assert detection(cover, 150e3, 10.0, 1.0) > 0.9
    assert detection(cover, 150e3, 10.0, -0.5) == 0.0
    assert detection(cover, 210e3, 10.0, 1.0) == 0.0


def test_the_cone_of_silence_is_no_cover() -> None:
    assert detection(CoverMap(200e3), 12e3, 10.0, 50.0) == 0.0


def test_misses_of_known_aircraft_take_the_credit_away() -> None:
    cover = CoverMap(200e3)
    where = (np.full(8, 150e3), np.full(8, 10.0), np.full(8, 1.1))

    cover.looked(*where, np.zeros(8, dtype=np.bool_))

    assert detection(cover, 150e3, 10.0, 1.1) == 0.0
    assert detection(cover, 150e3, 100.0, 1.1) > 0.9


def test_detection_is_the_share_of_looks_that_found_something() -> None:
    cover = CoverMap(200e3)
    where = (np.full(400, 150e3), np.full(400, 10.0), np.full(400, 1.1))

    cover.looked(*where, np.arange(400) % 10 > 0)

    assert detection(cover, 150e3, 10.0, 1.1) == pytest.approx(0.9, abs=0.01)
