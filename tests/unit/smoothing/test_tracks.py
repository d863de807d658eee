"""Whole tracks from reports of several sensors: accuracy against truth, biases, and the points that are published."""

import functools
from typing import Any

import numpy as np
import pyproj
import pytest
from tests.simulation_scenes import ADSB, GEOD, RADAR1, run, true_at

from aeroskein.events import RegistrationState
from aeroskein.plots import Plots
from aeroskein.points import Flag, FusedPoints, Product
from aeroskein.settings import EngineSettings, FusionSettings, RegistrationSettings, SensorSettings
from aeroskein.simulation import SensorErrors, TruthStates
from aeroskein.smoothing import smooth_reports
from aeroskein.smoothing.biases import bias_table, corrected, left_over

SECOND = SensorSettings(
    id="radar2", kind="ssr", lat_deg=47.8, lon_deg=11.0, height_m=700.0, period_s=8.0, range_sigma_m=100.0,
    azimuth_sigma_deg=0.15,
)  # fmt: skip
ENGINE = EngineSettings(sensors=(ADSB, RADAR1, SECOND), registration=RegistrationSettings(enabled=False))
TO_GEODETIC = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)


@functools.cache
def simulated(**errors: float) -> tuple[Plots, TruthStates]:
    radar = SensorErrors(sensor="radar1", **errors)  # type: ignore[arg-type]
    return run(*ENGINE.sensors, errors=(radar,), scenario="terminal", aircraft=3, duration_s=200.0, seed=2)


def smooth(plots: Plots, engine: EngineSettings = ENGINE, **known: Any) -> FusedPoints:
    points, _ = smooth_reports(plots, engine, **known)
    assert points is not None
    return points


def error_m(points: FusedPoints, truth: TruthStates) -> np.ndarray:
    true = true_at(truth, points.address, points.time_s)
    lon, lat, _ = TO_GEODETIC.transform(*true["ecef"].T)
    known = np.isfinite(lon)
    return np.asarray(GEOD.inv(lon[known], lat[known], points.lon_deg[known], points.lat_deg[known])[2])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_fused_tracks_are_five_times_as_good_as_reports() -> None:
    plots, truth = simulated()

    points = smooth(plots)

    # Raw ADS-B is off by 25 to 30 m here (10 m per axis, and 0.2 s at 130 m/s).
    assert rms(error_m(points, truth)) < 5.5


def test_stated_covariances_are_honest() -> None:
    plots, truth = simulated()

    points = smooth(plots)

    spread = np.sqrt(points.position_cov_m2[:, 0] + points.position_cov_m2[:, 2])
    assert 0.75 < rms(error_m(points, truth)) / rms(spread) < 1.3


def test_altitude_and_height_are_smoothed_apart() -> None:
    plots, truth = simulated()

    points = smooth(plots)

    true = true_at(truth, points.address, points.time_s)
    assert rms(points.height_m - true["height_m"]) < 6.0
    # The encoder has a constant error of its own, of 4 m.
    assert rms(points.altitude_m - true["altitude_m"]) < 14.0


def test_points_are_contiguous_elements_with_their_sources() -> None:
    plots, _ = simulated()

    points = smooth(plots)

    assert points.product == Product.ELEMENT
    for track in np.unique(points.track_number):
        mine = points.take(points.track_number == track)
        np.testing.assert_array_equal(mine.seq, np.arange(len(mine)))
        np.testing.assert_array_equal(mine.span_s[1:, 0], mine.span_s[:-1, 1])
        np.testing.assert_allclose(mine.time_s, mine.span_s.mean(axis=1))
    assert (points.sources.sum(axis=0) > 0).all()
    assert points.sources.sum() + points.rejected.sum() == len(plots)
    np.testing.assert_array_equal(points.master[points.sources[:, 0] > 0], 0)


def test_length_of_elements_is_that_of_the_fusion() -> None:
    plots, _ = simulated()
    short = EngineSettings(sensors=ENGINE.sensors, fusion=FusionSettings(element_s=1.0))

    assert len(smooth(plots, short)) == pytest.approx(4 * len(smooth(plots)), rel=0.05)


def test_radars_alone_make_longer_elements() -> None:
    plots, truth = simulated()

    points = smooth(plots.take(plots.sensor > 0))

    assert np.median(np.diff(points.span_s, axis=1)) == pytest.approx(8.0)
    assert rms(error_m(points, truth)) < 60.0


def test_known_biases_are_taken_out() -> None:
    bias = {"range_bias_m": 400.0, "azimuth_bias_deg": 0.5, "time_bias_s": 0.5}
    plots, truth = simulated(**bias)
    radars = plots.take(plots.sensor == 1)
    state = RegistrationState(
        sensor="radar1", time_s=0.0, state="converged", **bias, range_gain=0.0, range_bias_sigma_m=5.0,
        azimuth_bias_sigma_deg=0.005, time_bias_sigma_s=0.05, range_gain_sigma=0.0, samples=100, aircraft=9,
    )  # fmt: skip

    raw = rms(error_m(smooth(radars), truth))
    registered = rms(error_m(smooth(radars, registration=[state]), truth))

    assert raw > 300.0
    assert registered < 70.0


def test_an_unregistered_radar_hardly_counts_beside_adsb() -> None:
    plots, truth = simulated(range_bias_m=400.0, azimuth_bias_deg=0.5)
    cautious = EngineSettings(sensors=ENGINE.sensors)

    points = smooth(plots, cautious)

    assert rms(error_m(points, truth)) < 6.5


def test_uncertain_biases_widen_what_a_radar_measures() -> None:
    state = RegistrationState(
        sensor="radar1", time_s=0.0, state="converging", range_bias_m=10.0, azimuth_bias_deg=0.1, time_bias_s=0.2,
        range_gain=1e-4, range_bias_sigma_m=30.0, azimuth_bias_sigma_deg=0.2, time_bias_sigma_s=0.4,
        range_gain_sigma=4e-4, samples=5, aircraft=1,
    )  # fmt: skip
    table = bias_table(ENGINE, [state])
    plot = Plots.of(1, sensor=1, time_s=100.0, range_m=100_000.0, azimuth_deg=0.05)

    better, sigma = corrected(plot, table), left_over(plot, table)

    assert better.range_m[0] == pytest.approx((100_000.0 - 10.0) / 1.0001)
    assert better.azimuth_deg[0] == pytest.approx(359.95)
    assert better.time_s[0] == pytest.approx(99.8)
    # 30 m of bias, and 40 m of gain at that range.
    np.testing.assert_allclose(sigma[0], [50.0, 0.2, 0.4, 4e-4])


def test_a_radar_that_corrects_itself_is_left_alone() -> None:
    own = SensorSettings(
        id="radar1", kind="ssr", lat_deg=48.0, lon_deg=11.0, height_m=0.0, correction="sensor", range_bias_m=70.0
    )
    table = bias_table(EngineSettings(sensors=(own,)), [])

    assert not table.bias.any()
    assert not table.sigma.any()


def test_presets_count_where_nothing_was_registered() -> None:
    preset = SensorSettings(id="r", kind="ssr", lat_deg=48.0, lon_deg=11.0, height_m=0.0, range_bias_m=70.0)

    enabled = bias_table(EngineSettings(sensors=(preset,)), [])
    switched_off = bias_table(EngineSettings(sensors=(preset,), registration=RegistrationSettings(enabled=False)), [])

    assert enabled.bias[0, 0] == switched_off.bias[0, 0] == 70.0
    assert enabled.sigma[0, 0] == 300.0
    assert switched_off.sigma[0, 0] == 0.0


def test_a_gap_that_ends_a_track_begins_another() -> None:
    plots, _ = simulated()
    start = plots.time_s.min()
    silent = (plots.time_s > start + 80.0) & (plots.time_s < start + 115.0)

    points = smooth(plots.take(~silent))

    assert len(np.unique(points.track_number)) == 6
    assert not (points.flags & Flag.COASTED > 0).any()


def test_a_short_gap_is_bridged_and_flagged() -> None:
    plots, _ = simulated()
    start = plots.time_s.min()
    silent = (plots.time_s > start + 80.0) & (plots.time_s < start + 100.0)

    points = smooth(plots.take(~silent))

    assert len(np.unique(points.track_number)) == 3
    coasted = points.flags & Flag.COASTED > 0
    assert 6 <= coasted.sum() <= 15
    assert (points.sources[coasted].sum(axis=1) == 0).all()


def test_too_few_reports_make_no_track() -> None:
    plots, _ = simulated()

    points, summary = smooth_reports(plots.take(np.arange(2)), ENGINE)

    assert points is None
    assert summary.unconfirmed + summary.unidentified == 2


def test_a_frozen_position_ends_a_track_like_silence() -> None:
    plots, _ = simulated()
    plots = plots.take(np.flatnonzero((plots.sensor == 0) & (plots.address == plots.address[0])))
    start = plots.time_s.min()
    frozen = (plots.time_s > start + 80.0) & (plots.time_s < start + 120.0)
    first = np.flatnonzero(frozen)[0]
    plots.lat_deg[frozen], plots.lon_deg[frozen] = plots.lat_deg[first], plots.lon_deg[first]

    points, summary = smooth_reports(plots, ENGINE)

    assert points is not None
    assert summary.stale == frozen.sum() - 1
    assert len(np.unique(points.track_number)) == 2
    assert points.span_s[points.track_number == 1].max() < start + 85.0
