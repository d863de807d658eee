"""Heights found from slant ranges alone."""

import numpy as np
import pytest

from aeroskein import geodesy
from aeroskein.height_finding import HeightFinder
from aeroskein.plots import Array
from aeroskein.radar_geometry import geodetic_to_radar

SITES = geodesy.frame_rows(np.array([48.0, 48.5]), np.array([11.0, 11.2]), np.array([500.0, 400.0]))
SIGMAS = np.array([[50.0, 0.07]])
NOTHING = np.zeros((1, 2))
PERIOD_S = 4.0
SPEED_MPS = 220.0


def flown(
    height_m: float,
    aside_m: float,
    seconds: float,
    seed: int,
    radars: tuple[int, ...] = (0,),
    left: Array = NOTHING,
    speed_mps: float = SPEED_MPS,
) -> tuple[Array, Array]:
    """Estimate and sigma after a straight flight past radar 0, towards its nearest point."""
    rng = np.random.default_rng(seed)
    finder, slot = HeightFinder(4), np.array([2])
    for k in np.arange(0.0, seconds, PERIOD_S):
        for radar in radars:
            t = k + 0.5 * radar
            lat, lon = geodesy.from_plane(SITES[:1], np.array([aside_m]), np.array([speed_mps * (t - seconds)]))
            site = SITES[radar : radar + 1]
            range_m, azimuth_deg, _ = geodetic_to_radar(site, lat, lon, height_m)
            measured = np.stack([range_m, azimuth_deg], axis=1) + SIGMAS * rng.normal(size=(1, 2))
            finder.take(slot, np.array([t]), np.array([radar]), site, measured, SIGMAS, left)
    return finder.at(slot, np.array([seconds]))


@pytest.mark.parametrize("height_m", [3000.0, 10_000.0])
def test_an_even_flight_past_one_radar_tells_its_height(height_m: float) -> None:
    errors = [flown(height_m, 9000.0, 120.0, seed)[0][0] - height_m for seed in range(5)]

    assert np.sqrt(np.mean(np.square(errors))) < 1000.0


def test_two_radars_tell_it_far_away_too() -> None:
    height, sigma = flown(10_000.0, 30_000.0, 60.0, 1, radars=(0, 1))

    assert height[0] == pytest.approx(10_000.0, abs=600.0)
    assert sigma[0] < 600.0


def test_far_from_one_radar_nothing_is_claimed() -> None:
    _, sigma = flown(10_000.0, 80_000.0, 60.0, 1)

    assert sigma[0] > 3000.0


def test_a_bias_of_the_only_radar_is_no_noise_and_that_of_a_second_one_is() -> None:
    left = np.array([[300.0, 0.5]])

    clear, blurred = flown(10_000.0, 9000.0, 120.0, 1), flown(10_000.0, 9000.0, 120.0, 1, left=left)
    both = [flown(10_000.0, 30_000.0, 60.0, 1, radars=(0, 1), left=of) for of in (NOTHING, left)]

    assert blurred[1] == pytest.approx(clear[1])
    assert both[1][1][0] > 2.0 * both[0][1][0]


def test_an_airliner_that_is_far_away_is_not_taken_for_low() -> None:
    fast, _ = flown(10_000.0, 80_000.0, 60.0, 1, speed_mps=250.0)
    slow, _ = flown(2000.0, 80_000.0, 60.0, 1, speed_mps=80.0)

    assert fast[0] > 8000.0
    assert slow[0] < 6000.0


def test_a_height_above_the_slant_range_is_not_believed() -> None:
    height, _ = flown(2000.0, 3000.0, 8.0, 1)

    assert height[0] < 5000.0


def test_a_slot_given_to_a_new_track_knows_nothing() -> None:
    finder, slot, t = HeightFinder(4), np.array([1]), np.array([0.0])
    finder.take(slot, t, slot, SITES[:1], np.array([[20_000.0, 90.0]]), SIGMAS, NOTHING)
    finder.grow(8)
    assert np.isfinite(finder.at(slot, t)[0][0])

    finder.clear(slot)

    assert np.isnan(finder.at(slot, t)[0][0])
    assert np.isnan(finder.at(np.array([7]), t)[0][0])
