"""The whole filter over simulated ADS-B, and the points it publishes."""

import functools
from typing import Any

import numpy as np
import pyproj
import pytest
from tests.simulation_scenes import ADSB, GEOD, RADAR1, run, true_at

from aeroskein.adsb_filter import AdsbFilterSettings, FilterSummary, filter_reports
from aeroskein.plots import Plots
from aeroskein.points import Flag, FusedPoints, Product
from aeroskein.settings import EngineSettings
from aeroskein.simulation import SensorErrors, TruthStates

ENGINE = EngineSettings(sensors=(ADSB,))
SETTINGS = AdsbFilterSettings()
TO_GEODETIC = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


@functools.cache
def _simulated(scenario: str, errors: SensorErrors) -> tuple[Plots, TruthStates]:
    return run(ADSB, errors=(errors,), scenario=scenario, aircraft=2, duration_s=160.0)


def scene(scenario: str, **errors: Any) -> tuple[Plots, TruthStates]:
    """Two aircraft for 160 s; the reports are a copy that may be changed."""
    plots, truth = _simulated(scenario, SensorErrors(sensor="adsb", **errors))
    return plots.take(np.arange(len(plots))), truth


def filtered(plots: Plots, settings: AdsbFilterSettings = SETTINGS, **how: Any) -> tuple[FusedPoints, FilterSummary]:
    points, summary = filter_reports(plots, ENGINE, settings, **({"model": "imm", "smooth": False} | how))
    assert points is not None
    return points, summary


def rms_m(lat_deg: Any, lon_deg: Any, address: Any, time_s: Any, truth: TruthStates) -> float:
    """Horizontal error by PROJ's geodesics."""
    true = true_at(truth, address, time_s)["ecef"]
    lon, lat, _ = TO_GEODETIC.transform(*true.T)
    known = np.isfinite(true[:, 0])
    distance = GEOD.inv(lon[known], lat[known], np.asarray(lon_deg)[known], np.asarray(lat_deg)[known])[2]
    return float(np.sqrt(np.mean(distance**2)))


def rms_of(points: FusedPoints, truth: TruthStates, skip_s: float = 20.0) -> float:
    late = points.time_s > points.time_s.min() + skip_s
    p = points.take(late)
    return rms_m(p.lat_deg, p.lon_deg, p.address, p.time_s, truth)


@pytest.fixture(scope="module")
def terminal() -> tuple[Plots, TruthStates]:
    return scene("terminal")


@pytest.mark.parametrize("model", ["linear", "ukf", "imm"])
def test_filters_cut_the_error_of_raw_reports(model: Any) -> None:
    clean, truth = scene("terminal", outlier_probability=0.0)
    raw = rms_m(clean.lat_deg, clean.lon_deg, clean.address, clean.time_s, truth)

    points, _ = filtered(clean, model=model)
    smoothed, _ = filtered(clean, model=model, smooth=True)

    assert rms_of(points, truth) < 0.4 * raw
    assert rms_of(smoothed, truth) < 0.9 * rms_of(points, truth)


@pytest.mark.parametrize("model", ["linear", "ukf", "imm"])
def test_positions_alone_are_enough(model: Any) -> None:
    clean, truth = scene("hold", outlier_probability=0.0)
    raw = rms_m(clean.lat_deg, clean.lon_deg, clean.address, clean.time_s, truth)
    settings = AdsbFilterSettings(use_velocity=False)

    smoothed, summary = filtered(clean, settings, model=model, smooth=True)

    assert not summary.fallbacks
    assert rms_of(smoothed, truth) < 0.5 * raw


def test_outliers_are_refused_and_counted() -> None:
    plots, truth = scene("enroute", outlier_probability=0.05)

    points, summary = filtered(plots)

    assert 0.03 * len(plots) < summary.outliers < 0.07 * len(plots)
    assert rms_of(points, truth) < 15.0
    assert points.rejected.sum() == summary.outliers


def test_published_indicators_repair_before_the_filter() -> None:
    # Exact time stamps and a metre of noise: what the published limits were made for.
    plots, truth = scene("terminal", outlier_probability=0.02, position_sigma_m=0.5, time_sigma_s=0.0)

    points, summary = filtered(plots, AdsbFilterSettings(indicators="published", max_acceleration_mps2=8.0))

    assert 0.02 * len(plots) < summary.repaired < 0.2 * len(plots)
    assert not summary.fallbacks
    assert rms_of(points, truth) < 10.0


def test_published_indicators_that_leave_too_little_are_found_out() -> None:
    plots, truth = scene("hold", outlier_probability=0.0)

    points, summary = filtered(plots, AdsbFilterSettings(indicators="published"))

    # With jitter of 0.2 s nearly every position breaks a limit; interpolating between the rest cuts the turns.
    assert summary.repaired > 0.9 * len(plots)
    assert summary.fallbacks == {"original": summary.flights}
    assert (points.flags & Flag.GUARDED > 0).all()
    raw = rms_m(plots.lat_deg, plots.lon_deg, plots.address, plots.time_s, truth)
    assert rms_of(points, truth) < 3.0 * raw


def test_a_bad_speed_in_the_first_report_does_not_cost_the_start() -> None:
    plots, _ = scene("terminal", outlier_probability=0.0, position_sigma_m=0.5, time_sigma_s=0.0)
    first = plots.time_s < plots.time_s.min() + 0.9
    plots.ground_speed_mps[first] = 350.0

    points, summary = filtered(plots, AdsbFilterSettings(indicators="published", max_acceleration_mps2=8.0))

    assert summary.too_fast >= first.sum() > 0
    assert np.isfinite(points.lat_deg).all()


def test_stale_positions_are_not_observations() -> None:
    plots, truth = scene("cruise", stale_probability=0.15)

    points, summary = filtered(plots)

    assert summary.stale > 0.1 * len(plots)
    assert rms_of(points, truth) < 15.0


def test_lambert_and_local_planes_agree(terminal: tuple[Plots, TruthStates]) -> None:
    local, _ = filtered(terminal[0], AdsbFilterSettings(projection="local"))
    lambert, _ = filtered(terminal[0], AdsbFilterSettings(projection="lambert"))

    distance = GEOD.inv(local.lon_deg, local.lat_deg, lambert.lon_deg, lambert.lat_deg)[2]
    # The scales of the two planes differ by parts in ten thousand, and so do the gains.
    assert np.max(distance) < 1.0
    assert np.max(np.abs(local.ground_speed_mps - lambert.ground_speed_mps)) < 0.1


def test_unsmoothed_points_are_live_points(terminal: tuple[Plots, TruthStates]) -> None:
    points, _ = filtered(terminal[0])

    assert points.product == Product.LIVE
    assert np.isnan(points.span_s).all()
    assert (points.element == -1).all()
    assert (points.input_received_s >= points.time_s - 2.0).all()


def test_smoothed_points_are_contiguous_elements(terminal: tuple[Plots, TruthStates]) -> None:
    points, _ = filtered(terminal[0], smooth=True)

    assert points.product == Product.ELEMENT
    for track in np.unique(points.track_number):
        mine = points.take(points.track_number == track)
        np.testing.assert_array_equal(mine.seq, np.arange(len(mine)))
        np.testing.assert_array_equal(mine.element, np.arange(len(mine)))
        np.testing.assert_array_equal(mine.span_s[1:, 0], mine.span_s[:-1, 1])
        assert (mine.span_s[:, 0] <= mine.time_s).all()
        assert (mine.time_s < mine.span_s[:, 1]).all()


def test_every_report_is_accounted_for(terminal: tuple[Plots, TruthStates]) -> None:
    plots = terminal[0]

    points, summary = filtered(plots)

    left_out = summary.duplicates + summary.unidentified + summary.on_ground + summary.unstarted
    assert summary.reports == len(plots)
    assert points.sources.sum() + points.rejected.sum() + left_out == len(plots)


def test_a_silent_track_is_not_published_for_ever() -> None:
    plots, _ = scene("cruise", outlier_probability=0.0)
    plots = plots.take(plots.address == plots.address[0])
    frozen = plots.time_s > plots.time_s.min() + 100.0
    plots.lat_deg[frozen], plots.lon_deg[frozen] = plots.lat_deg[frozen][0], plots.lon_deg[frozen][0]

    points, _ = filtered(plots)

    last = points.time_s[points.sources.sum(axis=1) > 0].max()
    assert points.time_s.max() - last <= 30.0
    assert (points.flags[points.time_s > last] & Flag.COASTED > 0).all()


def test_missing_speeds_are_filled_from_the_state(terminal: tuple[Plots, TruthStates]) -> None:
    plots, _ = scene("terminal", outlier_probability=0.0)
    known = plots.ground_speed_mps.copy()
    every_third = np.arange(len(plots)) % 3 == 0
    plots.ground_speed_mps[every_third] = plots.track_angle_deg[every_third] = np.nan

    points, _ = filtered(plots)

    assert np.isfinite(points.ground_speed_mps).all()
    truth = dict(zip(zip(plots.address.tolist(), plots.time_s.tolist(), strict=True), known, strict=True))
    keys = zip(points.address.tolist(), points.time_s.tolist(), strict=True)
    error = [s - truth[k] for k, s in zip(keys, points.ground_speed_mps.tolist(), strict=True)]
    assert np.sqrt(np.mean(np.square(error))) < 2.5


def test_estimated_errors_replace_wrong_configured_ones() -> None:
    # The sensor is twice as bad as the configuration says.
    plots, truth = scene("cruise", position_sigma_m=25.0, time_sigma_s=0.4, outlier_probability=0.0)

    points, summary = filtered(plots, AdsbFilterSettings(use_velocity=False), estimate_errors=True)

    assert summary.source_errors is not None
    assert summary.source_errors[0].position_sigma_m == pytest.approx(25.0, rel=0.15)
    assert summary.source_errors[0].time_sigma_s == pytest.approx(0.4, rel=0.2)
    spread = np.sqrt(points.position_cov_m2[:, 0] + points.position_cov_m2[:, 2])
    assert rms_of(points, truth) == pytest.approx(float(np.sqrt(np.mean(spread**2))), rel=0.4)


def test_reports_without_any_identity_give_no_points() -> None:
    points, summary = filter_reports(Plots.of(3, time_s=[1.0, 2.0, 3.0]), ENGINE, SETTINGS, model="imm", smooth=False)

    assert points is None
    assert summary.unidentified == 3


def test_the_antimeridian_is_no_border() -> None:
    here, _ = run(ADSB, scenario="cruise", aircraft=2, duration_s=120.0, lat_deg=10.0, lon_deg=179.99)
    for projection in ("local", "lambert"):
        points, summary = filtered(here, AdsbFilterSettings(projection=projection))

        assert not summary.fallbacks
        assert len(points) == len(here) - summary.unstarted


def test_errors_of_radars_are_not_estimated_as_if_they_were_round() -> None:
    engine = EngineSettings(sensors=(ADSB, RADAR1))
    plots, _ = run(ADSB, RADAR1, scenario="cruise", aircraft=2, duration_s=400.0)

    points, summary = filter_reports(
        plots.take(plots.sensor == 1), engine, SETTINGS, model="imm", smooth=False, estimate_errors=True
    )

    assert points is not None
    assert summary.source_errors is not None
    assert [errors.windows for errors in summary.source_errors] == [0, 0]
