"""Gathering the reports of a file into flights, and what makes a measurement of a report."""

from typing import Any

import numpy as np
import pytest

from aeroskein.conversion import SensorTable
from aeroskein.flights import gather, heights, interpolated, locate_flights, measure, split_at_holes, stale_rows
from aeroskein.planes import planes_of
from aeroskein.plots import Plots
from aeroskein.settings import EngineSettings, SensorSettings

RADAR = SensorSettings(id="radar1", kind="ssr", lat_deg=48.35, lon_deg=11.78, height_m=460.0)
ENGINE = EngineSettings(sensors=(SensorSettings(id="adsb", kind="adsb"), RADAR))


def plots(n: int, **columns: Any) -> Plots:
    usual: dict[str, Any] = {
        "time_s": np.arange(float(n)), "received_s": np.arange(float(n)) + 0.4, "address": 0x3C6444,
        "lat_deg": 48.0 + 0.002 * np.arange(n), "lon_deg": 11.0,
    }  # fmt: skip
    return Plots.of(n, **(usual | columns))


def test_reports_are_ordered_by_aircraft_and_time() -> None:
    flights = gather(plots(4, address=[2, 1, 2, 1], time_s=[9.0, 5.0, 8.0, 4.0]), 120.0)

    assert flights.flight.tolist() == [0, 0, 1, 1]
    assert flights.plots.time_s.tolist() == [4.0, 5.0, 8.0, 9.0]


def test_a_long_gap_starts_a_new_flight() -> None:
    flights = gather(plots(4, time_s=[0.0, 1.0, 122.0, 123.0]), 120.0)

    assert flights.flight.tolist() == [0, 0, 1, 1]


def test_the_same_time_twice_from_one_sensor_counts_once() -> None:
    flights = gather(plots(3, time_s=[0.0, 0.0, 1.0]), 120.0)

    assert (len(flights.plots), flights.duplicates) == (2, 1)


def test_the_same_time_from_two_sensors_counts_twice() -> None:
    flights = gather(plots(3, time_s=[0.0, 0.0, 1.0], sensor=[0, 1, 0]), 120.0)

    assert (len(flights.plots), flights.duplicates) == (3, 0)


def test_reports_without_identity_are_left_out_and_counted() -> None:
    flights = gather(plots(3, address=[-1, 1, 1]), 120.0)

    assert (len(flights.plots), flights.unidentified) == (2, 1)


def test_local_tracks_tell_reports_without_address_apart_where_asked() -> None:
    flights = gather(plots(4, address=-1, local_track=[7, 8, 7, 8]), 120.0, by_local_track=True)

    assert flights.plots.local_track.tolist() == [7, 7, 8, 8]
    assert flights.flight.tolist() == [0, 0, 1, 1]


def test_a_repeated_position_of_a_moving_target_is_stale() -> None:
    lat = np.array([48.0, 48.002, 48.002, 48.006])

    stale = stale_rows(gather(plots(4, lat_deg=lat, ground_speed_mps=220.0), 120.0))

    assert stale.tolist() == [False, False, True, False]


def test_a_standing_aircraft_may_repeat_its_position() -> None:
    stale = stale_rows(gather(plots(3, lat_deg=48.0, ground_speed_mps=0.0), 120.0))

    assert not stale.any()


def test_another_sensor_between_does_not_hide_a_stale_position() -> None:
    lat = np.array([48.0, 48.001, 48.0])

    stale = stale_rows(gather(plots(3, lat_deg=lat, sensor=[0, 1, 0], ground_speed_mps=220.0), 120.0))

    assert stale.tolist() == [False, False, True]


def test_a_hole_between_usable_reports_starts_a_new_flight() -> None:
    flights = gather(plots(8, time_s=[0.0, 1.0, 50.0, 100.0, 149.0, 150.0, 151.0, 200.0]), 120.0)
    usable = np.array([True, True, False, False, False, True, True, True])

    cut = split_at_holes(flights, usable, 120.0)

    assert flights.flight.tolist() == [0] * 8
    assert cut.flight.tolist() == [0] * 5 + [1] * 3


def test_missing_values_are_filled_linearly_and_held_at_the_ends() -> None:
    flight, time_s = np.array([0, 0, 0, 0, 1]), np.array([0.0, 1.0, 3.0, 4.0, 0.0])

    filled = interpolated(flight, time_s, np.array([np.nan, 10.0, np.nan, 40.0, np.nan]))

    np.testing.assert_allclose(filled, [10.0, 10.0, 30.0, 40.0, np.nan])


def test_height_of_a_radar_plot_comes_from_the_flights_own_difference() -> None:
    mixed = plots(
        4, sensor=[0, 1, 0, 1], altitude_m=[1000.0, 1010.0, 1020.0, 1030.0], height_m=[1090.0, np.nan, 1110.0, np.nan]
    )

    height_m, _ = heights(gather(mixed, 120.0), np.array([8.0, 8.0]))

    np.testing.assert_allclose(height_m, [1090.0, 1100.0, 1110.0, 1120.0])


def test_a_reported_velocity_is_measured_over_ground_at_the_aircrafts_height() -> None:
    flights = gather(plots(3, height_m=11_000.0, ground_speed_mps=230.0, track_angle_deg=90.0), 120.0)
    table = SensorTable(ENGINE)
    located = locate_flights(flights, table, np.zeros((3, 4)))
    planes = planes_of("local", flights.flight, located.lat_deg, located.lon_deg)

    seen = measure(flights, located, planes, table, table.time_sigma_s)

    assert np.hypot(seen.v_east_mps, seen.v_north_mps) == pytest.approx(230.0 / (1.0 + 11_000.0 / 6.389e6), rel=1e-6)
    assert seen.velocity_variance == pytest.approx(1.0)
    assert seen.time_variance == pytest.approx(0.04)


def test_a_radar_plot_becomes_a_position_with_the_radars_covariance() -> None:
    polar = plots(
        3, sensor=1, lat_deg=np.nan, lon_deg=np.nan, range_m=60_000.0, azimuth_deg=90.0, altitude_m=9000.0,
        ground_speed_mps=200.0, track_angle_deg=0.0,
    )  # fmt: skip
    flights, table = gather(polar, 120.0), SensorTable(ENGINE)
    located = locate_flights(flights, table, np.zeros((3, 4)))

    seen = measure(
        flights,
        located,
        planes_of("local", flights.flight, located.lat_deg, located.lon_deg),
        table,
        table.time_sigma_s,
    )

    # Across the beam: 60 km times 0.07 degrees; along it 50 m and what the unknown height adds.
    assert np.sqrt(seen.r_nn) == pytest.approx(60_000.0 * np.radians(0.07), rel=0.02)
    assert np.all(np.sqrt(seen.r_ee) > 49.0)
    # A radar's own tracked velocity is no measurement.
    assert np.isnan(seen.v_east_mps).all()
