"""References for registration: where an aircraft was at the time of a plot, without the radar that made it."""

from __future__ import annotations

import numpy as np
import pytest
from tests.builders import ADSB, RADAR1, START_S, Drive, Flight, adsb, distance_m, engine_settings, radar

from aeroskein.plots import Plots
from aeroskein.references import ReferenceSampler
from aeroskein.registration import Comparisons

FLIGHT = Flight(lat_deg=48.6, lon_deg=11.9, track_deg=100.0)
SECONDS = np.arange(0.5, 60.0)
SCANS = np.arange(2.2, 56.0, 4.0)


def compared(*plots: Plots) -> Comparisons:
    """Everything that registration is given for these reports."""
    drive, given = Drive.of(engine_settings(ADSB, RADAR1, registration=True)), []
    drive.engine._registration.update = given.append  # type: ignore[method-assign]
    drive.feed(plots).finish()
    return Comparisons.concatenate(given)


def off_m(rows: Comparisons) -> np.ndarray:
    """How far the references lie from the truth at their own times."""
    lat, lon, _ = FLIGHT.at(rows.reference_time_s - START_S)
    return distance_m(rows.lat_deg, rows.lon_deg, lat, lon)


def test_every_plot_is_compared_once_with_what_the_radar_said() -> None:
    plots = radar(FLIGHT, SCANS)

    rows = compared(adsb(FLIGHT, SECONDS), plots)

    order = np.argsort(rows.time_s)
    assert np.array_equal(rows.time_s[order], plots.time_s)
    # Rings keep what is measured in single precision.
    np.testing.assert_allclose(rows.range_m[order], plots.range_m, rtol=1e-7)
    np.testing.assert_allclose(rows.azimuth_deg[order], plots.azimuth_deg, rtol=1e-7)
    assert (rows.sensor == 1).all()
    assert set(rows.aircraft.tolist()) == {1}


def test_references_are_where_the_aircraft_was() -> None:
    rows = compared(adsb(FLIGHT, SECONDS, sigma_m=5.0), radar(FLIGHT, SCANS))

    assert rows.anchored[1:].all()
    assert off_m(rows)[1:].max() < 20.0
    assert np.abs(rows.height_m - 9000.0).max() < 20.0
    v = np.hypot(rows.v_east_mps, rows.v_north_mps)
    assert np.abs(v - 200.0)[1:].max() < 3.0
    assert (rows.reference_time_s == rows.time_s)[rows.anchored].all()


def test_references_know_how_accurate_they_are() -> None:
    d2 = []
    for seed in range(5):
        # Noise of 10 m, and stamps that jitter by 0.2 s, as the settings say of ADS-B.
        jitter = np.random.default_rng(seed).normal(0.0, 0.2, len(SECONDS))
        own = adsb(FLIGHT, SECONDS, sigma_m=10.0, seed=seed, time_s=START_S + SECONDS + jitter, delay_s=0.7)
        rows = compared(own, radar(FLIGHT, SCANS))
        rows = rows.take(rows.anchored)
        lat, lon, _ = FLIGHT.at(rows.reference_time_s - START_S)
        north = np.radians(rows.lat_deg - lat) * 6.38e6
        east = np.radians(rows.lon_deg - lon) * 6.38e6 * np.cos(np.radians(lat))
        ee, en, nn = rows.position_cov_m2.T
        d2.append((nn * east**2 - 2.0 * en * east * north + ee * north**2) / (ee * nn - en**2))

    # Two degrees of freedom.
    assert 1.0 < np.concatenate(d2).mean() < 3.0


def test_a_radar_cannot_confirm_its_own_error() -> None:
    own = adsb(FLIGHT, SECONDS, sigma_m=5.0)
    wrong = radar(FLIGHT, SCANS)
    wrong.range_m += 400.0

    one, other = compared(own, radar(FLIGHT, SCANS)), compared(own, wrong)

    assert np.array_equal(one.lat_deg[1:], other.lat_deg[1:])
    assert np.array_equal(one.lon_deg[1:], other.lon_deg[1:])


def test_plots_that_the_estimator_refuses_are_compared_too() -> None:
    jumped = radar(FLIGHT, SCANS)
    jumped.range_m[6:] += 3_000.0

    rows = compared(adsb(FLIGHT, SECONDS), jumped)

    assert len(rows) == len(SCANS)


def test_an_outlier_among_own_positions_is_left_out() -> None:
    own = adsb(FLIGHT, SECONDS, sigma_m=3.0)
    own.lat_deg[22] += 0.01

    rows = compared(own, radar(FLIGHT, SCANS))

    assert off_m(rows)[1:].max() < 20.0


def test_in_a_gap_of_own_positions_nothing_is_anchored() -> None:
    own = adsb(FLIGHT, SECONDS[(SECONDS < 20.0) | (SECONDS > 45.0)])

    rows = compared(own, radar(FLIGHT, SCANS, range_sigma_m=20.0))

    stamps = rows.time_s - START_S
    assert not rows.anchored[(stamps > 25.0) & (stamps < 40.0)].any()
    assert rows.anchored[(stamps > 5.0) & (stamps < 18.0)].all()


def test_without_any_height_there_is_no_comparison() -> None:
    own = adsb(FLIGHT, SECONDS, altitude_m=np.nan, height_m=np.nan, vertical_rate_mps=np.nan)
    plots = radar(FLIGHT, SCANS, altitude_m=np.nan)
    drive, given = Drive.of(engine_settings(ADSB, RADAR1, registration=True)), []
    drive.engine._registration.update = given.append  # type: ignore[method-assign]

    drive.feed([own, plots]).finish()

    assert sum(len(rows) for rows in given) == 0


def test_an_aircraft_that_reports_only_altitude_is_compared_with_less_trust() -> None:
    both = compared(adsb(FLIGHT, SECONDS), radar(FLIGHT, SCANS))
    altitude_only = compared(adsb(FLIGHT, SECONDS, height_m=np.nan), radar(FLIGHT, SCANS))

    assert both.height_sigma_m.max() < 10.0
    assert altitude_only.height_sigma_m.min() >= 100.0


# -- the choice -------------------------------------------------------------------------------------------------------
def test_few_plots_are_all_compared() -> None:
    sampler = ReferenceSampler(3)

    assert sampler.open(10.0).all()
    assert sampler.some(np.array([1, 2, 1]), np.array([5, 6, 7])).tolist() == [0, 1, 2]
    assert sampler.some(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)).tolist() == []


@pytest.mark.parametrize("parts", [1, 7])
def test_of_many_plots_a_hundred_a_second_are_compared(parts: int) -> None:
    sampler, chosen = ReferenceSampler(2), 0
    for second in range(20):
        for part in np.array_split(np.arange(900), parts):
            sampler.open(100.0 + second)
            chosen += len(sampler.some(np.full(len(part), 1), part))
        assert sampler.open(100.0 + second).tolist() == [True, False]

    assert chosen == pytest.approx(2000, abs=1)


def test_one_busy_radar_does_not_silence_another() -> None:
    sampler = ReferenceSampler(2)
    sensor = np.concatenate([np.zeros(500, dtype=np.int64), np.ones(20, dtype=np.int64)])

    sampler.open(1.0)
    chosen = sampler.some(sensor, np.arange(520))

    assert (sensor[chosen] == 0).sum() == 100
    assert (sensor[chosen] == 1).sum() == 20


def test_aircraft_take_turns() -> None:
    sampler, number = ReferenceSampler(1), np.arange(1000)

    seen = list[set[int]]()
    for second in range(30):
        sampler.open(100.0 + second)
        seen.append(set(sampler.some(np.zeros(1000, dtype=np.int64), number).tolist()))

    assert len(set().union(*seen)) > 900
