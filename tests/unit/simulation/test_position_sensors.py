"""ADS-B and WAM: the errors have the stated size, in the stated direction, and nothing else is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from tests.simulation_scenes import ADSB, ecef, local_axes, quiet, run, true_at

from aeroskein.errors import SettingsError
from aeroskein.plots import SIMULATED, Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation import SensorErrors, TruthStates

START_S = 1_790_000_000.0


def horizontal_errors(plots: Plots, truth: TruthStates) -> np.ndarray:
    """East and north error of each report against where the aircraft was at the stated time, ``(n, 2)``. [m]"""
    true = true_at(truth, plots.address, plots.time_s)
    step = ecef(plots.lat_deg, plots.lon_deg, true["height_m"]) - true["ecef"]
    east, north, _ = local_axes(plots.lat_deg, plots.lon_deg)
    errors = np.column_stack([(step * east).sum(axis=1), (step * north).sum(axis=1)])
    return errors[np.isfinite(errors).all(axis=1)]


def assert_chi_square(values: np.ndarray, sigma: float) -> None:
    """The sum of squares is what that many normal numbers of this sigma give, but once in 1,000 cases."""
    low, high = stats.chi2.ppf([0.0005, 0.9995], values.size)
    assert low < ((values / sigma) ** 2).sum() < high


def test_without_errors_reports_are_the_truth() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb"),), scenario="terminal", aircraft=6, duration_s=100.0, truth_period_s=0.05
    )

    assert np.abs(horizontal_errors(plots, truth)).max() < 0.01


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(48.0, 11.0), (90.0, 0.0), (-17.0, 180.0)])
def test_position_errors_have_the_stated_sigma_on_both_axes(lat_deg: float, lon_deg: float) -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb", position_sigma_m=10.0),), scenario="cruise", aircraft=30, duration_s=100.0,
        lat_deg=lat_deg, lon_deg=lon_deg,
    )  # fmt: skip

    errors = horizontal_errors(plots, truth)

    assert len(errors) > 2500
    assert_chi_square(errors[:, 0], 10.0)
    assert_chi_square(errors[:, 1], 10.0)
    assert abs(np.corrcoef(errors.T)[0, 1]) < 0.08
    assert np.abs(errors.mean(axis=0)).max() < 4.0 * 10.0 / np.sqrt(len(errors))


def test_time_stamp_errors_show_along_the_track_only() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb", time_sigma_s=0.2),), scenario="cruise", aircraft=30, duration_s=100.0,
        gust_mps2=0.0,
    )  # fmt: skip

    true = true_at(truth, plots.address, plots.time_s)
    step = ecef(plots.lat_deg, plots.lon_deg, true["height_m"]) - true["ecef"]
    speed = np.linalg.norm(true["velocity"], axis=1)
    along = (step * true["velocity"]).sum(axis=1) / speed
    known = np.isfinite(along)
    across = np.linalg.norm(step - along[:, None] * true["velocity"] / speed[:, None], axis=1)

    # A stamp that is late makes the aircraft seem behind where it was then.
    assert_chi_square(along[known] / speed[known], 0.2)
    assert np.abs(across[known]).max() < 0.2


def test_velocity_errors_have_the_stated_sigma() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb", velocity_sigma_mps=1.0),), scenario="terminal", aircraft=20, duration_s=100.0
    )

    true = true_at(truth, plots.address, plots.time_s)
    angle = np.radians(plots.track_angle_deg)
    east, north, _ = local_axes(plots.lat_deg, plots.lon_deg)
    errors = np.column_stack([
        plots.ground_speed_mps * np.sin(angle) - (true["velocity"] * east).sum(axis=1),
        plots.ground_speed_mps * np.cos(angle) - (true["velocity"] * north).sum(axis=1),
    ])  # fmt: skip

    assert_chi_square(errors[np.isfinite(errors)], 1.0)


def test_reports_come_once_a_period_with_jitter() -> None:
    plots, _ = run(ADSB, errors=(quiet("adsb"),), scenario="cruise", aircraft=10, duration_s=100.0)

    for address in np.unique(plots.address):
        steps = np.diff(np.sort(plots.time_s[plots.address == address]))
        assert steps.min() > 0.79
        assert steps.max() < 1.21
        assert steps.std() > 0.03


def test_pressure_altitude_comes_in_steps_of_25_feet() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb"),), scenario="climb", aircraft=10, duration_s=100.0, altimeter_sigma_m=0.0
    )

    steps = plots.altitude_m / 7.62
    true = true_at(truth, plots.address, plots.time_s)["altitude_m"]
    known = np.isfinite(true)

    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert np.abs(plots.altitude_m - true)[known].max() < 7.62 / 2.0 + 0.01


def test_each_encoder_has_its_own_constant_error() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb"),), scenario="cruise", aircraft=200, duration_s=20.0, altimeter_sigma_m=40.0,
        truth_period_s=2.0,
    )  # fmt: skip

    off = plots.altitude_m - true_at(truth, plots.address, plots.time_s)["altitude_m"]
    means = np.array([np.nanmean(off[plots.address == address]) for address in np.unique(plots.address)])
    within = max(np.nanstd(off[plots.address == address]) for address in np.unique(plots.address))

    assert_chi_square(means, 40.0)
    assert within < 5.0


def test_lost_reports_are_as_many_as_stated() -> None:
    everything, _ = run(ADSB, errors=(quiet("adsb"),), scenario="cruise", aircraft=40, duration_s=100.0)
    some, _ = run(ADSB, errors=(quiet("adsb", miss_probability=0.1),), scenario="cruise", aircraft=40, duration_s=100.0)

    low, high = stats.binom.ppf([0.0005, 0.9995], len(everything), 0.9)

    assert low <= len(some) <= high


def test_nothing_is_heard_in_a_gap() -> None:
    gaps = ((20.0, 40.0), (60.0, 65.0))
    plots, _ = run(ADSB, errors=(quiet("adsb", gaps_s=gaps),), scenario="cruise", aircraft=10, duration_s=100.0)

    elapsed = plots.time_s - START_S

    assert not ((elapsed >= 20.0) & (elapsed < 40.0)).any()
    assert not ((elapsed >= 60.0) & (elapsed < 65.0)).any()
    assert ((elapsed >= 40.0) & (elapsed < 60.0)).sum() > 150


def test_outliers_are_as_many_and_as_far_as_stated() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb", outlier_probability=0.05),), scenario="cruise", aircraft=40, duration_s=100.0
    )

    away = np.linalg.norm(horizontal_errors(plots, truth), axis=1)
    wild = away[away > 10.0]
    low, high = stats.binom.ppf([0.0005, 0.9995], len(away), 0.05)

    assert low <= len(wild) <= high
    assert wild.min() >= 149.0
    assert wild.max() <= 3005.0
    assert wild.mean() == pytest.approx(1575.0, rel=0.15)


def test_delays_are_log_normal_with_the_stated_median() -> None:
    plots, _ = run(ADSB, errors=(quiet("adsb"),), scenario="cruise", aircraft=40, duration_s=100.0)

    delay = plots.received_s - plots.time_s

    assert delay.min() > 0.0
    assert np.median(delay) == pytest.approx(0.35, rel=0.05)
    assert np.log(delay).std() == pytest.approx(0.5, rel=0.05)


def test_latency_is_constant_for_an_aircraft_and_differs_between_them() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb", latency_s=0.5, latency_sigma_s=0.1),), scenario="cruise", aircraft=40,
        duration_s=40.0, gust_mps2=0.0,
    )  # fmt: skip

    true = true_at(truth, plots.address, plots.time_s)
    step = true["ecef"] - ecef(plots.lat_deg, plots.lon_deg, true["height_m"])
    age_s = (step * true["velocity"]).sum(axis=1) / (true["velocity"] ** 2).sum(axis=1)
    ages = [age_s[(plots.address == address) & np.isfinite(age_s)] for address in np.unique(plots.address)]
    means = np.array([age.mean() for age in ages])

    assert max(np.ptp(age) for age in ages) < 1e-3
    assert means.mean() == pytest.approx(0.5, abs=0.06)
    assert means.std() == pytest.approx(0.1, rel=0.35)


def test_correlated_errors_have_their_size_and_fade_with_their_time() -> None:
    plots, truth = run(
        ADSB, errors=(quiet("adsb", correlated_sigma_m=8.0, correlated_time_s=20.0),), scenario="cruise", aircraft=60,
        duration_s=120.0, truth_period_s=1.0, gust_mps2=0.0,
    )  # fmt: skip

    order = np.lexsort((plots.time_s, plots.address))
    plots = plots.take(order)
    errors = horizontal_errors(plots, truth)[:, 0]
    lagged = errors[20:], errors[:-20]

    assert errors.std() == pytest.approx(8.0, rel=0.15)
    # Twenty reports later the correlation is 1/e, a little less where the pair belongs to two aircraft.
    assert np.corrcoef(*lagged)[0, 1] == pytest.approx(np.exp(-1.0) * 100.0 / 120.0, abs=0.12)
    assert np.corrcoef(errors[1:], errors[:-1])[0, 1] > 0.9


def test_stale_reports_repeat_the_last_position_with_a_new_time() -> None:
    plots, _ = run(
        ADSB, errors=(quiet("adsb", stale_probability=0.2),), scenario="cruise", aircraft=20, duration_s=100.0
    )

    plots = plots.take(np.lexsort((plots.time_s, plots.address)))
    same = np.diff(plots.address) == 0
    repeated = (np.diff(plots.lat_deg) == 0.0) & (np.diff(plots.altitude_m) == 0.0) & same

    assert repeated.sum() / same.sum() == pytest.approx(0.2, abs=0.03)
    assert (np.diff(plots.time_s)[same] > 0.0).all()


def test_frozen_positions_stay_for_their_time() -> None:
    plots, _ = run(
        ADSB, errors=(quiet("adsb", frozen_probability=0.01, frozen_s=20.0),), scenario="cruise", aircraft=40,
        duration_s=300.0, truth_period_s=10.0,
    )  # fmt: skip

    plots = plots.take(np.lexsort((plots.time_s, plots.address)))
    same = np.diff(plots.address) == 0
    repeated = (np.diff(plots.lat_deg) == 0.0) & same

    # Thawed for 100 s and frozen for 20 s on average: one report in six.
    assert repeated.sum() / same.sum() == pytest.approx(1.0 / 6.0, abs=0.06)


def test_duplicates_are_the_same_report_received_twice() -> None:
    plots, _ = run(
        ADSB, errors=(quiet("adsb", duplicate_probability=0.1),), scenario="cruise", aircraft=20, duration_s=100.0
    )

    _, first, many = np.unique(plots.time_s, return_index=True, return_counts=True)

    assert (many == 2).sum() / len(first) == pytest.approx(0.1, abs=0.03)
    assert many.max() == 2


@pytest.mark.parametrize(
    ("sigma_m", "sigma_mps", "nac_p", "nac_v"), [(10.0, 1.0, 9, 2), (4.0, 0.4, 10, 3), (30.0, 4.0, 8, 1)]
)
def test_quality_indicators_cover_the_true_errors(sigma_m: float, sigma_mps: float, nac_p: int, nac_v: int) -> None:
    errors = quiet("adsb", quality="indicators", position_sigma_m=sigma_m, velocity_sigma_mps=sigma_mps)

    plots, _ = run(ADSB, errors=(errors,), scenario="cruise", aircraft=2, duration_s=10.0)

    assert set(plots.nac_p.tolist()) == {nac_p}
    assert set(plots.nac_v.tolist()) == {nac_v}
    assert np.isnan(plots.position_sigma_m).all()


def test_quality_can_be_the_sigma_itself_or_absent() -> None:
    sigma, _ = run(ADSB, errors=(quiet("adsb", quality="sigma", position_sigma_m=7.0),), aircraft=2, duration_s=10.0)
    absent, _ = run(ADSB, errors=(quiet("adsb"),), aircraft=2, duration_s=10.0)

    assert set(sigma.position_sigma_m.tolist()) == {7.0}
    assert np.isnan(absent.position_sigma_m).all()
    assert set(absent.nac_p.tolist()) == {-1}


def test_velocity_and_geometric_height_can_be_absent() -> None:
    plots, _ = run(ADSB, errors=(quiet("adsb", velocity=False, geometric_height=False),), aircraft=4, duration_s=10.0)

    assert np.isnan(plots.ground_speed_mps).all()
    assert np.isnan(plots.height_m).all()
    assert np.isfinite(plots.altitude_m).all()


def test_reports_are_marked_as_simulated() -> None:
    plots, _ = run(ADSB, aircraft=4, duration_s=10.0)

    assert set(plots.flags.tolist()) == {SIMULATED}


def test_multilateration_reports_identity_but_no_velocity() -> None:
    wam = SensorSettings(id="wam", kind="wam", position_sigma_m=20.0)

    plots, truth = run(wam, errors=(quiet("wam", position_sigma_m=20.0),), scenario="cruise", aircraft=30)

    assert np.isnan(plots.ground_speed_mps).all()
    assert (plots.mode_a >= 0).all()
    assert (plots.address > 0).all()
    assert horizontal_errors(plots, truth).std() == pytest.approx(20.0, rel=0.03)


def test_a_receiver_with_a_range_hears_only_that_far() -> None:
    near = SensorSettings(id="adsb", kind="adsb", lat_deg=48.0, lon_deg=11.0, height_m=500.0)

    plots, _ = run(
        near, errors=(quiet("adsb", range_max_m=40_000.0),), aircraft=60, duration_s=20.0, lat_deg=48.0, lon_deg=11.0
    )

    away = np.linalg.norm(ecef(plots.lat_deg, plots.lon_deg, plots.height_m) - ecef(48.0, 11.0, 500.0), axis=1)
    assert len(plots) > 50
    assert away.max() < 40_000.0


def test_a_range_without_a_site_is_refused() -> None:
    with pytest.raises(SettingsError, match=r"sensors.adsb.lat_deg"):
        run(ADSB, errors=(SensorErrors(sensor="adsb", range_max_m=40_000.0),), aircraft=2, duration_s=4.0)
