"""Known errors in, exactly those errors out."""

import math

import numpy as np
import pytest
from scipy.stats import chi2
from tests.evaluation_scenes import START_S, points_on, truth_of

from aeroskein.evaluation import EvaluationSettings, PointColumns, Truth, evaluate
from aeroskein.evaluation.accuracy import COVERAGE_NEES
from aeroskein.points import Flag, Product, Status

FROM_START = EvaluationSettings(from_s=0.0)


def only_product(points, truth, settings=FROM_START):
    (product,) = evaluate(points, truth, settings=settings).products
    return product


def test_points_on_truth_have_no_error():
    truth = truth_of(height_m=9000.0)

    accuracy = only_product(points_on(truth), truth).accuracy

    assert accuracy.horizontal_m.max == pytest.approx(0.0, abs=1e-6)
    assert accuracy.height_m.max == 0.0
    assert accuracy.velocity_mps.max == pytest.approx(0.0, abs=1e-6)


def test_known_distances_give_exactly_their_rms_and_percentiles():
    truth = truth_of()
    size_m = np.random.default_rng(3).gamma(2.0, 20.0, len(truth))

    horizontal = only_product(points_on(truth, east_m=size_m), truth).accuracy.horizontal_m

    assert horizontal.count == len(truth)
    assert horizontal.rms == pytest.approx(math.sqrt(np.mean(size_m**2)), rel=1e-7)
    assert horizontal.p50 == pytest.approx(np.median(size_m), rel=1e-7)
    assert horizontal.p95 == pytest.approx(np.percentile(size_m, 95), rel=1e-7)
    assert horizontal.p99 == pytest.approx(np.percentile(size_m, 99), rel=1e-7)
    assert horizontal.max == pytest.approx(size_m.max(), rel=1e-7)


def test_error_ahead_is_along_and_error_to_the_right_is_across():
    truth = truth_of(angle_deg=213.0)

    accuracy = only_product(points_on(truth, along_m=30.0, across_m=-40.0), truth).accuracy

    assert accuracy.along_m.mean == pytest.approx(30.0, abs=1e-5)
    assert accuracy.across_m.mean == pytest.approx(-40.0, abs=1e-5)


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "angle_deg"),
    [(0.0, 179.8, 88.0), (-16.0, -179.9, 271.0), (89.8, 5.0, 0.3), (-89.9, 0.0, 180.0)],
)
def test_antimeridian_and_poles_are_like_anywhere_else(lat_deg, lon_deg, angle_deg):
    truth = truth_of(lat_deg=lat_deg, lon_deg=lon_deg, angle_deg=angle_deg, speed_mps=250.0)

    accuracy = only_product(points_on(truth, along_m=30.0, across_m=40.0), truth).accuracy

    assert accuracy.along_m.max == pytest.approx(30.0, abs=1e-4)
    assert accuracy.across_m.max == pytest.approx(40.0, abs=1e-4)


def test_a_wrong_height_is_no_horizontal_error():
    truth = truth_of(height_m=9000.0)

    accuracy = only_product(points_on(truth, height_m=9300.0), truth).accuracy

    assert accuracy.horizontal_m.max == pytest.approx(0.0, abs=1e-6)
    assert accuracy.height_m.mean == pytest.approx(300.0)


def test_truth_between_its_samples_follows_a_standard_rate_turn():
    rate, speed = math.radians(3.0), 120.0
    radius = speed / rate
    second = np.arange(0.0, 121.0)
    lat_per_m, lon_per_m = 1.0 / 110_574.275822, 1.0 / 111_319.490793  # metres per degree where equator meets Greenwich
    truth = Truth.of(
        ["3C6444"],
        len(second),
        flight=0,
        time_s=START_S + second,
        lat_deg=radius * np.sin(rate * second) * lat_per_m,
        lon_deg=radius * (1.0 - np.cos(rate * second)) * lon_per_m,
        height_m=0.0,
        ground_speed_mps=speed,
        track_angle_deg=np.degrees(rate * second) % 360.0,
        vertical_rate_mps=0.0,
    )
    half = second[:-1] + 0.5
    points = PointColumns.of(
        len(half),
        address=0x3C6444,
        time_s=START_S + half,
        lat_deg=radius * np.sin(rate * half) * lat_per_m,
        lon_deg=radius * (1.0 - np.cos(rate * half)) * lon_per_m,
    )

    product = only_product(points, truth)

    assert product.accuracy.horizontal_m.max < 0.02
    assert [phase.phase for phase in product.phases] == ["turn"]


def test_velocity_errors_are_vector_length_speed_and_angle():
    truth = truth_of(angle_deg=0.0, lat_deg=10.0, speed_mps=200.0)
    points = points_on(truth, ground_speed_mps=203.0, track_angle_deg=truth.track_angle_deg + 2.0)

    accuracy = only_product(points, truth).accuracy

    assert accuracy.ground_speed_mps.mean == pytest.approx(3.0, abs=1e-4)
    assert accuracy.track_angle_deg.mean == pytest.approx(2.0, abs=1e-3)
    assert accuracy.velocity_mps.rms == pytest.approx(
        math.sqrt(203.0**2 + 200.0**2 - 2 * 203.0 * 200.0 * math.cos(math.radians(2.0))), abs=1e-2
    )


def test_track_angle_is_not_judged_where_the_aircraft_is_too_slow():
    truth = truth_of(speed_mps=15.0)

    accuracy = only_product(points_on(truth, track_angle_deg=0.0), truth).accuracy

    assert accuracy.track_angle_deg.count == 0
    assert accuracy.track_angle_deg.rms is None
    assert accuracy.ground_speed_mps.count == len(truth)


def test_nees_is_the_squared_error_in_units_of_the_covariance():
    truth = truth_of(lat_deg=0.0, lon_deg=0.0)
    points = points_on(truth, east_m=30.0, north_m=40.0, position_cov_m2=[900.0, 0.0, 1600.0])

    consistency = only_product(points, truth).accuracy.position_consistency

    assert consistency.mean_nees == pytest.approx(2.0, rel=1e-4)
    assert consistency.coverage_95 == 1.0


def test_correlation_in_the_covariance_counts():
    truth = truth_of(lat_deg=0.0, lon_deg=0.0)
    covariance = np.array([[500.0, 300.0], [300.0, 400.0]])
    error = np.array([12.0, -20.0])
    points = points_on(truth, east_m=error[0], north_m=error[1], position_cov_m2=[500.0, 300.0, 400.0])

    consistency = only_product(points, truth).accuracy.position_consistency

    assert consistency.mean_nees == pytest.approx(error @ np.linalg.inv(covariance) @ error, rel=1e-4)


def test_an_honest_gaussian_covers_95_percent():
    truth = truth_of(seconds=20_000, speed_mps=5.0)
    rng = np.random.default_rng(11)
    east, north = rng.normal(0.0, 7.0, (2, len(truth)))
    points = points_on(truth, east_m=east, north_m=north, position_cov_m2=[49.0, 0.0, 49.0])

    consistency = only_product(points, truth).accuracy.position_consistency

    assert consistency.coverage_95 == pytest.approx(np.mean((east**2 + north**2) / 49.0 <= chi2.ppf(0.95, 2)), abs=2e-4)
    assert consistency.mean_nees == pytest.approx(np.mean((east**2 + north**2) / 49.0), rel=1e-3)


def test_coverage_limit_is_the_chi_square_quantile():
    assert pytest.approx(chi2.ppf(0.95, 2)) == COVERAGE_NEES


def test_a_covariance_that_is_none_is_not_judged():
    truth = truth_of()
    points = points_on(truth, position_cov_m2=[4.0, 5.0, 4.0])

    assert only_product(points, truth).accuracy.position_consistency.count == 0


def test_points_before_the_settling_time_are_left_out():
    truth = truth_of(seconds=100)
    size_m = np.where(np.arange(101) < 30, 500.0, 10.0)

    product = only_product(points_on(truth, east_m=size_m), truth, EvaluationSettings(from_s=30.0))

    assert product.judged == 71
    assert product.accuracy.horizontal_m.max == pytest.approx(10.0, abs=1e-6)


def test_an_element_that_reaches_back_starts_the_clock_of_its_flight():
    truth = truth_of(seconds=100)
    points = points_on(truth).take(np.arange(20, 101))
    points.span_s = np.stack([points.time_s - 20.0, points.time_s], axis=1)

    product = only_product(points, truth, EvaluationSettings(from_s=30.0))

    assert product.judged == 71


def test_tentative_and_terminated_points_are_not_judged():
    truth = truth_of(seconds=99)
    status = np.repeat([int(s) for s in Status], 25)

    product = only_product(points_on(truth, status=status), truth)

    assert product.points == 100
    assert product.judged == 50


def test_products_are_judged_apart():
    truth = truth_of()
    live, element = points_on(truth, product=Product.LIVE, east_m=20.0), points_on(truth, east_m=5.0)

    evaluation = evaluate(PointColumns.concatenate([element, live]), truth, settings=FROM_START)

    assert [p.product for p in evaluation.products] == ["live", "element"]
    assert [round(p.accuracy.horizontal_m.rms, 6) for p in evaluation.products] == [20.0, 5.0]


def test_phases_are_judged_apart():
    truth = truth_of(seconds=99)
    truth.phases, truth.phase = ("straight", "hold"), np.repeat([0, 1], [60, 40]).astype(np.int16)
    size_m = np.repeat([4.0, 9.0], [60, 40])

    phases = only_product(points_on(truth, east_m=size_m), truth).phases

    assert [(p.phase, p.accuracy.horizontal_m.count) for p in phases] == [("straight", 60), ("hold", 40)]
    assert [p.accuracy.horizontal_m.rms for p in phases] == pytest.approx([4.0, 9.0], rel=1e-6)


def test_worst_flight_is_named_with_its_figure_and_time():
    truth = truth_of(["3C6444", "4CA2D6", "AB0001"], seconds=100)
    size_m = np.where(truth.flight == 1, 20.0, 10.0)
    size_m[101 + 77] = 60.0

    product = only_product(points_on(truth, east_m=size_m), truth)

    assert product.worst_rms_m.flight == "4CA2D6"
    assert product.worst_point_m.flight == "4CA2D6"
    assert product.worst_point_m.value == pytest.approx(60.0, rel=1e-6)
    assert product.worst_point_m.time_s == START_S + 77.0


def test_a_flight_without_truth_is_not_judged():
    truth = truth_of(["3C6444", "4CA2D6"])
    known = truth_of(["3C6444"])

    product = only_product(points_on(truth), known)

    assert product.points == len(truth)
    assert product.judged == len(known)


def test_a_flight_without_points_is_named():
    truth = truth_of(["3C6444", "4CA2D6"])

    evaluation = evaluate(points_on(truth_of(["3C6444"])), truth)

    assert evaluation.flights_without_points == ("4CA2D6",)


def test_a_hole_in_truth_is_not_bridged():
    truth = truth_of(seconds=100, step_s=1.0)
    kept = np.r_[0:40, 60:101]
    holed = Truth.of(
        truth.names,
        len(kept),
        phases=truth.phases,
        **{
            name: getattr(truth, name)[kept]
            for name in ("flight", "phase", "time_s", "lat_deg", "lon_deg", "height_m", "ground_speed_mps",
                         "track_angle_deg", "vertical_rate_mps")
        },
    )  # fmt: skip

    assert only_product(points_on(truth), holed).judged == 81


def test_nothing_at_all_is_an_evaluation_without_products():
    assert evaluate(PointColumns.of(0), Truth.of((), 0)).products == ()


def test_points_without_any_truth_are_counted_and_not_judged():
    product = only_product(points_on(truth_of()), Truth.of((), 0))

    assert (product.points, product.judged, product.accuracy.horizontal_m.rms) == (301, 0, None)


def test_truth_without_points_names_every_flight():
    assert evaluate(PointColumns.of(0), truth_of(["3C6444"])).flights_without_points == ("3C6444",)


def test_coasted_points_are_judged_with_the_others_and_once_more_apart():
    truth = truth_of(seconds=99)
    is_coasted = np.arange(100) >= 90
    points = points_on(truth, east_m=np.where(is_coasted, 50.0, 5.0), flags=np.where(is_coasted, int(Flag.COASTED), 0))

    product = only_product(points, truth)

    assert product.accuracy.horizontal_m.count == 100
    assert product.coasted.horizontal_m.count == 10
    assert product.coasted.horizontal_m.rms == pytest.approx(50.0, rel=1e-6)
