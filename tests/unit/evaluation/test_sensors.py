"""Raw reports against truth: known sensor errors come back."""

import numpy as np
import pytest
from pyproj import Transformer
from tests.evaluation_scenes import START_S, points_on, truth_of

from aeroskein.evaluation import EvaluationSettings, Truth, TruthCurve, evaluate
from aeroskein.evaluation.sensors import SensorReports, Site
from aeroskein.plots import Plots

SITE = Site(48.35, 11.78, 460.0)
FROM_START = EvaluationSettings(from_s=0.0)


def radar_plots(truth: Truth, site: Site, *, range_m=0.0, azimuth_deg=0.0) -> Plots:
    """Exact slant range and azimuth by pyproj's topocentric conversion, plus known errors."""
    to_enu = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lon_0={site.lon_deg} +lat_0={site.lat_deg} +h_0={site.height_m}"
    )
    east, north, up = to_enu.transform(truth.lon_deg, truth.lat_deg, truth.height_m)
    return Plots.of(
        len(truth),
        address=truth.addresses[truth.flight],
        time_s=truth.time_s,
        range_m=np.sqrt(east**2 + north**2 + up**2) + range_m,
        azimuth_deg=np.degrees(np.arctan2(east, north)) % 360.0 + azimuth_deg,
    )


def only_sensor(plots, truth, sites=None, points=None):
    reports = SensorReports(plots, ("radar1",), sites or {})
    evaluation = evaluate(
        points if points is not None else points_on(truth), truth, reports=reports, settings=FROM_START
    )
    return evaluation.sensors[0], evaluation


def test_an_exact_radar_has_no_error():
    truth = truth_of(lat_deg=48.5, height_m=9000.0)

    sensor, _ = only_sensor(radar_plots(truth, SITE), truth, {"radar1": SITE})

    assert sensor.judged == len(truth)
    assert sensor.horizontal_m.max == pytest.approx(0.0, abs=1e-3)
    assert sensor.range_m.max == pytest.approx(0.0, abs=1e-5)
    assert sensor.azimuth_deg.max == pytest.approx(0.0, abs=1e-9)


def test_range_and_azimuth_errors_come_back_in_their_own_coordinates():
    truth = truth_of(lat_deg=48.5, height_m=9000.0)
    plots = radar_plots(truth, SITE, range_m=120.0, azimuth_deg=-0.2)

    sensor, _ = only_sensor(plots, truth, {"radar1": SITE})

    assert sensor.range_m.mean == pytest.approx(120.0, abs=1e-4)
    assert sensor.azimuth_deg.mean == pytest.approx(-0.2, abs=1e-9)


def test_an_azimuth_error_is_a_position_error_of_ground_range_times_angle():
    truth = truth_of(seconds=2, lat_deg=48.35, lon_deg=13.0, height_m=9000.0)
    plots = radar_plots(truth, SITE, azimuth_deg=0.1)

    sensor, _ = only_sensor(plots, truth, {"radar1": SITE})

    ground_m = np.sqrt(plots.range_m.mean() ** 2 - 8000.0**2)
    assert sensor.horizontal_m.p50 == pytest.approx(ground_m * np.radians(0.1), rel=2e-3)


def test_a_radar_whose_site_is_unknown_says_so():
    truth = truth_of(lat_deg=48.5)

    sensor, _ = only_sensor(radar_plots(truth, SITE), truth)

    assert (sensor.reports, sensor.judged) == (len(truth), 0)
    assert sensor.not_judged_because == "the site of this radar is not known"


def test_fused_is_compared_with_raw():
    truth = truth_of()
    raw = points_on(truth, east_m=50.0)
    plots = Plots.of(
        len(truth), address=truth.addresses[truth.flight], time_s=raw.time_s, lat_deg=raw.lat_deg, lon_deg=raw.lon_deg
    )

    sensor, evaluation = only_sensor(plots, truth, points=points_on(truth, east_m=5.0))

    assert sensor.horizontal_m.rms == pytest.approx(50.0, rel=1e-6)
    assert evaluation.products[0].ratio_to_sensor == {"radar1": pytest.approx(0.1, rel=1e-6)}


def test_reports_without_address_are_not_judged():
    truth = truth_of()
    plots = Plots.of(5, time_s=truth.time_s[:5], lat_deg=truth.lat_deg[:5], lon_deg=truth.lon_deg[:5])

    sensor, _ = only_sensor(plots, truth)

    assert sensor.judged == 0
    assert "address" in sensor.not_judged_because


def test_reports_tell_when_a_flight_is_to_be_judged():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=300)
    seen = (truth.flight == 0) & (truth.time_s >= START_S + 50.0) & (truth.time_s <= START_S + 200.0)
    plots = Plots.of(len(truth), address=truth.addresses[truth.flight], time_s=truth.time_s).take(seen)
    settings = EvaluationSettings(from_s=30.0)

    evaluation = evaluate(points_on(truth), truth, reports=SensorReports(plots, ("adsb",)), settings=settings)

    (product,) = evaluation.products
    assert product.judged == 121  # 50 + 30 to 200
    assert product.continuity[0].expected == 24
    assert product.identity.flights_judged == 1


def test_spikes_of_raw_reports_are_counted():
    truth = truth_of(seconds=60)
    along = np.zeros(61)
    along[30] = 450.0
    raw = points_on(truth, along_m=along)
    plots = Plots.of(61, address=raw.address, time_s=raw.time_s, lat_deg=raw.lat_deg, lon_deg=raw.lon_deg)

    assert only_sensor(plots, truth)[0].spikes == 2


def test_one_curve_serves_several_files():
    truth = truth_of()
    curve = TruthCurve(truth)

    first, second = (evaluate(points_on(truth, east_m=e), curve, settings=FROM_START) for e in (3.0, 4.0))

    assert first.products[0].accuracy.horizontal_m.rms == pytest.approx(3.0, rel=1e-6)
    assert second.products[0].accuracy.horizontal_m.rms == pytest.approx(4.0, rel=1e-6)


def test_a_report_with_a_senseless_time_does_not_move_the_judged_time():
    truth = truth_of(seconds=300)
    seen = truth.time_s >= START_S + 100.0
    plots = Plots.of(len(truth), address=truth.addresses[truth.flight], time_s=truth.time_s).take(seen)
    plots.time_s[50] = 0.0

    evaluation = evaluate(points_on(truth), truth, reports=SensorReports(plots, ("adsb",)), settings=FROM_START)

    assert evaluation.products[0].judged == 201
