"""Radars: range, azimuth and time are wrong by what was asked for, once a turn of the antenna."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest
from scipy import stats
from tests.simulation_scenes import RADAR1, RADAR2, SENSORS, quiet, run, true_at

from aeroskein.plots import Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation import SensorErrors, TruthStates


def polar_errors(plots: Plots, truth: TruthStates, radar: SensorSettings) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Range error [m], azimuth error [deg] and true range [m] at the stated times, by pymap3d."""
    plots = plots.take(plots.address >= 0)
    at = true_at(truth, plots.address, plots.time_s)
    known = np.isfinite(at["height_m"])
    lat, lon, height = pymap3d.ecef2geodetic(*at["ecef"][known].T)
    azimuth, _, slant = pymap3d.geodetic2aer(lat, lon, height, radar.lat_deg, radar.lon_deg, radar.height_m)
    turn = np.mod(plots.azimuth_deg[known] - azimuth + 180.0, 360.0) - 180.0
    return plots.range_m[known] - slant, turn, slant


def assert_chi_square(values: np.ndarray, sigma: float) -> None:
    low, high = stats.chi2.ppf([0.0005, 0.9995], values.size)
    assert low < ((values / sigma) ** 2).sum() < high


def test_without_errors_plots_are_the_geometry() -> None:
    plots, truth = run(
        RADAR1, errors=(quiet("radar1"),), scenario="terminal", aircraft=8, duration_s=100.0, truth_period_s=0.05
    )

    range_m, azimuth_deg, slant_m = polar_errors(plots, truth, RADAR1)

    assert len(range_m) > 150
    assert np.abs(range_m).max() < 0.01
    assert np.abs(np.radians(azimuth_deg) * slant_m).max() < 0.02


def test_range_and_azimuth_errors_have_the_stated_sigmas() -> None:
    plots, truth = run(
        RADAR1, errors=(quiet("radar1", range_sigma_m=50.0, azimuth_sigma_deg=0.07),), scenario="enroute", aircraft=60,
        duration_s=100.0,
    )  # fmt: skip

    range_m, azimuth_deg, _ = polar_errors(plots, truth, RADAR1)

    assert len(range_m) > 1000
    assert_chi_square(range_m, 50.0)
    assert_chi_square(azimuth_deg, 0.07)


def test_biases_are_what_the_radar_measures_too_much() -> None:
    errors = quiet("radar1", range_bias_m=80.0, range_gain=1e-3, azimuth_bias_deg=0.15)

    plots, truth = run(RADAR1, errors=(errors,), scenario="enroute", aircraft=10, duration_s=60.0, truth_period_s=0.05)

    range_m, azimuth_deg, slant_m = polar_errors(plots, truth, RADAR1)
    assert np.abs(range_m - 80.0 - 1e-3 * slant_m).max() < 0.02
    assert np.abs(azimuth_deg - 0.15).max() < 1e-4


def test_time_bias_is_added_to_the_true_time() -> None:
    exact, _ = run(RADAR1, errors=(quiet("radar1"),), scenario="enroute", aircraft=10, duration_s=60.0)
    late, _ = run(RADAR1, errors=(quiet("radar1", time_bias_s=0.3),), scenario="enroute", aircraft=10, duration_s=60.0)

    assert (late.range_m == exact.range_m).all()
    assert late.time_s - exact.time_s == pytest.approx(0.3, abs=1e-6)


def test_every_aircraft_is_seen_once_a_turn() -> None:
    plots, _ = run(RADAR1, errors=(quiet("radar1"),), scenario="terminal", aircraft=20, duration_s=200.0)

    for address in np.unique(plots.address):
        mine = np.sort(plots.time_s[plots.address == address])
        # The azimuth moves on between two turns, by a degree or two at these distances.
        assert np.abs(np.diff(mine) - 4.0).max() < 0.35
        assert len(mine) >= 48


def test_the_antenna_points_where_it_sees() -> None:
    plots, _ = run(RADAR1, errors=(quiet("radar1"),), scenario="mixed", aircraft=40, duration_s=60.0)

    antenna_deg = np.mod(plots.time_s, 4.0) / 4.0 * 360.0
    off = np.mod(antenna_deg - plots.azimuth_deg, 360.0)
    centre = np.degrees(np.angle(np.exp(1j * np.radians(off)).mean()))
    spread = np.mod(off - centre + 180.0, 360.0) - 180.0

    assert np.abs(spread).max() < 1.0


def test_missed_plots_are_as_many_as_stated() -> None:
    everything, _ = run(RADAR1, errors=(quiet("radar1"),), scenario="enroute", aircraft=60, duration_s=200.0)
    usual, _ = run(RADAR1, scenario="enroute", aircraft=60, duration_s=200.0)

    low, high = stats.binom.ppf([0.0005, 0.9995], len(everything), 0.97)

    assert low - 20 <= len(usual) <= high + 20  # some are still under way at the end


def test_delays_lie_between_their_limits_and_a_few_are_late() -> None:
    plots, _ = run(RADAR1, errors=(quiet("radar1"),), scenario="enroute", aircraft=100, duration_s=200.0)

    delay = plots.received_s - plots.time_s
    usual = delay[delay <= 2.0]

    assert delay.min() >= 0.3
    assert delay.max() <= 6.0
    assert (delay > 2.0).mean() == pytest.approx(0.02, abs=0.01)
    assert usual.mean() == pytest.approx(1.15, abs=0.05)


def test_plots_of_one_scan_arrive_out_of_order() -> None:
    plots, _ = run(RADAR1, scenario="enroute", aircraft=60, duration_s=60.0)

    assert (np.diff(plots.time_s) < 0.0).mean() > 0.1


def test_secondary_radar_reads_identity_and_altitude_in_25_feet() -> None:
    plots, _ = run(RADAR1, scenario="enroute", aircraft=20, duration_s=40.0)

    steps = plots.altitude_m / 7.62
    assert (plots.address >= 0x400000).all()
    assert ((plots.mode_a >= 0) & (plots.mode_a < 0o10000)).all()
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert len(np.unique(plots.local_track)) == len(np.unique(plots.address))


def test_radar_without_mode_s_reads_no_address() -> None:
    plots, _ = run(RADAR1, errors=(SensorErrors(sensor="radar1", mode_s=False),), aircraft=10, duration_s=20.0)

    assert len(plots) > 20
    assert (plots.address == -1).all()
    assert (plots.mode_a >= 0).all()


def test_primary_radar_sees_neither_identity_nor_altitude() -> None:
    plots, _ = run(RADAR2, scenario="enroute", aircraft=20, duration_s=60.0)

    assert len(plots) > 80
    assert (plots.address == -1).all()
    assert (plots.mode_a == -1).all()
    assert (plots.callsign == b"").all()
    assert (plots.local_track == -1).all()
    assert np.isnan(plots.altitude_m).all()
    assert np.isnan(plots.height_m).all()


def test_false_plots_are_as_many_as_stated_and_lie_under_the_antenna() -> None:
    clean, _ = run(RADAR2, errors=(quiet("radar2"),), aircraft=2, duration_s=800.0, scenario="terminal")
    noisy, _ = run(
        RADAR2, errors=(quiet("radar2", false_plots=20.0),), aircraft=2, duration_s=800.0, scenario="terminal"
    )

    low, high = stats.poisson.ppf([0.0005, 0.9995], 100 * 20.0)
    antenna_deg = np.mod(noisy.time_s, 8.0) / 8.0 * 360.0
    off = np.exp(1j * np.radians(antenna_deg - noisy.azimuth_deg))

    assert low - 30 <= len(noisy) - len(clean) <= high
    assert np.abs(off.mean()) > 0.999
    assert noisy.range_m.max() > 300_000.0


def test_targets_too_far_too_near_and_overhead_are_not_seen() -> None:
    limits = quiet("radar1", range_max_m=50_000.0, range_min_m=20_000.0, elevation_max_deg=10.0)

    plots, truth = run(RADAR1, errors=(limits,), aircraft=100, duration_s=60.0, lat_deg=48.35, lon_deg=11.78)

    _, _, slant_m = polar_errors(plots, truth, RADAR1)
    at = true_at(truth, plots.address, plots.time_s)
    lat, lon, height = pymap3d.ecef2geodetic(*at["ecef"].T)
    _, elevation, _ = pymap3d.geodetic2aer(lat, lon, height, RADAR1.lat_deg, RADAR1.lon_deg, RADAR1.height_m)
    assert len(plots) > 50
    assert slant_m.min() > 20_000.0 - 1.0
    assert slant_m.max() < 50_000.0 + 1.0
    assert np.nanmax(elevation) < 10.01


def test_radar_outliers_are_as_many_as_stated() -> None:
    plots, truth = run(
        RADAR1, errors=(quiet("radar1", outlier_probability=0.1),), scenario="enroute", aircraft=60, duration_s=100.0
    )

    range_m, azimuth_deg, slant_m = polar_errors(plots, truth, RADAR1)
    away = np.hypot(range_m, np.radians(azimuth_deg) * slant_m)

    assert (away > 140.0).mean() == pytest.approx(0.1, abs=0.03)
    assert away.max() < 3_010.0


def test_radars_on_the_antimeridian_and_at_the_pole_see_what_they_see_elsewhere() -> None:
    counts = []
    for lat_deg, lon_deg in ((48.0, 11.0), (5.0, 179.9), (89.95, -120.0)):
        radar = SensorSettings(id="radar1", kind="ssr", lat_deg=lat_deg, lon_deg=lon_deg, height_m=10.0, period_s=4.0)
        plots, truth = run(
            radar, errors=(quiet("radar1"),), scenario="terminal", aircraft=10, duration_s=100.0, truth_period_s=0.05
        )
        range_m, azimuth_deg, slant_m = polar_errors(plots, truth, radar)
        counts.append(len(plots))
        assert np.abs(range_m).max() < 0.01
        assert np.abs(np.radians(azimuth_deg) * slant_m).max() < 0.02

    assert max(counts) - min(counts) <= 25


def test_all_sensors_come_in_order_of_arrival() -> None:
    plots, _ = run(*SENSORS, scenario="mixed", aircraft=30, duration_s=100.0)

    assert (np.diff(plots.received_s) >= 0.0).all()
    assert set(plots.sensor.tolist()) == {0, 1, 2}
