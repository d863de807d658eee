"""Updates, gaps, spans, times, needles and jumps: each put in by hand, each found."""

import numpy as np
import pytest
from tests.evaluation_scenes import GEOD, START_S, points_on, truth_of

from aeroskein.evaluation import EvaluationSettings, PointColumns, evaluate
from aeroskein.evaluation.grouping import expand_ranges, group_starts, run_lengths
from aeroskein.points import Flag, Product, Status

FROM_START = EvaluationSettings(from_s=0.0)


def only_product(points, truth, settings=FROM_START):
    (product,) = evaluate(points, truth, settings=settings).products
    return product


def test_every_second_a_point_is_an_update_in_every_interval():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=400)

    three, five = only_product(points_on(truth), truth).continuity

    assert (three.interval_s, three.expected, three.update_probability) == (5.0, 160, 1.0)
    assert (five.interval_s, five.expected, five.update_probability) == (8.0, 100, 1.0)
    assert (three.long_gaps, three.long_gap_ratio, three.flights_below_97_percent) == (0, 0.0, 0)


def test_a_gap_of_forty_seconds_costs_its_intervals_and_is_named():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=400)
    second = truth.time_s - START_S
    kept = (truth.flight == 0) | (second <= 100.0) | (second >= 140.0)

    three, five = only_product(points_on(truth).take(kept), truth).continuity

    assert (three.expected, three.updated) == (160, 153)
    assert three.lowest_flight.flight == "4CA2D6"
    assert three.lowest_flight.value == pytest.approx(73 / 80)
    assert (three.longest_gap.flight, three.longest_gap.start_s, three.longest_gap.length_s) == (
        "4CA2D6",
        START_S + 100.0,
        40.0,
    )
    assert (three.long_gaps, three.long_gap_ratio) == (1, pytest.approx(7 / 160))
    assert (five.long_gaps, five.long_gap_ratio) == (1, pytest.approx(4 / 100))


def test_a_flight_that_was_never_tracked_has_no_update_at_all():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=400)

    three, _ = only_product(points_on(truth_of(["3C6444"], seconds=400)), truth).continuity

    assert (three.expected, three.updated) == (160, 80)
    assert (three.lowest_flight.flight, three.lowest_flight.value) == ("4CA2D6", 0.0)
    assert three.longest_gap.length_s == 400.0


@pytest.mark.parametrize("column", [{"flags": int(Flag.COASTED)}, {"status": int(Status.COASTING)}])
def test_a_coasted_point_is_no_update(column):
    truth = truth_of(seconds=400)

    three, _ = only_product(points_on(truth, **column), truth).continuity

    assert three.updated == 0


def test_a_track_that_ends_early_is_a_gap_until_the_truth_ends():
    truth = truth_of(seconds=400)

    three, _ = only_product(points_on(truth).take(np.arange(301)), truth).continuity

    assert three.longest_gap.length_s == 100.0


def test_contiguous_spans_leave_nothing_uncovered():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=400)
    points = points_on(truth).take(np.flatnonzero((truth.time_s - START_S) % 4 == 2))
    points.span_s = np.stack([points.time_s - 2.0, points.time_s + 2.0], axis=1)

    cover = only_product(points, truth, EvaluationSettings(from_s=30.0)).span_cover

    assert (cover.elements, cover.hole_s, cover.overlap_s) == (200, 0.0, 0.0)
    assert cover.judged_s == pytest.approx(2 * 370.0)
    assert cover.outside_s == pytest.approx(0.0, abs=1e-6)


def test_holes_and_overlaps_of_spans_are_measured():
    truth = truth_of(seconds=400)
    points = points_on(truth).take(np.arange(2, 401, 4))
    points.span_s = np.stack([points.time_s - 2.0, points.time_s + 2.0], axis=1)
    points.span_s[40, 0] += 1.5
    points.span_s[60, 0] -= 0.5

    cover = only_product(points, truth).span_cover

    assert cover.hole_s == pytest.approx(1.5, abs=1e-6)
    assert cover.overlap_s == pytest.approx(0.5, abs=1e-6)
    assert cover.outside_s == pytest.approx(1.5, abs=1e-5)


def test_live_points_have_no_spans_to_judge():
    truth = truth_of(seconds=60)

    assert only_product(points_on(truth, product=Product.LIVE), truth).span_cover is None


def test_age_processing_and_interval_are_percentiles_of_differences():
    truth = truth_of(seconds=100)
    age_s = np.linspace(0.0, 1.0, 101)
    points = points_on(truth, published_s=truth.time_s + age_s, input_received_s=truth.time_s + age_s - 0.25)

    timing = only_product(points, truth).timing

    assert (timing.age.p50_s, timing.age.p95_s, timing.age.max_s) == pytest.approx((0.5, 0.95, 1.0), abs=1e-6)
    assert timing.processing.p99_s == pytest.approx(0.25, abs=1e-6)
    assert timing.interval.p50_s == 1.0


def test_missing_and_repeated_numbers_are_counted_per_track_and_start():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=9)
    points = points_on(truth)
    points.seq = np.r_[0, 1, 2, 3, 7, 8, 9, 9, 10, 11, np.arange(5), np.arange(5)]
    points.epoch = np.r_[np.full(15, 1), np.full(5, 2)]

    timing = only_product(points, truth).timing

    assert (timing.seq_missing, timing.seq_repeated) == (3, 1)


def test_points_without_numbers_have_no_number_figures():
    truth = truth_of(seconds=9)

    timing = only_product(points_on(truth, seq=-1), truth).timing

    assert (timing.seq_missing, timing.seq_repeated) == (None, None)


def test_times_that_repeat_or_go_back_are_counted():
    truth = truth_of(seconds=9)
    points = points_on(truth)
    points.time_s = START_S + np.array([0.0, 1.0, 1.0, 2.0, 3.0, 2.5, 4.0, 5.0, 6.0, 7.0])

    timing = only_product(points, truth).timing

    assert (timing.times_repeated, timing.times_backwards) == (1, 1)


def test_a_point_that_turns_back_is_a_spike():
    truth = truth_of(seconds=50)
    along_m = np.zeros(51)
    along_m[20] = 450.0

    roughness = only_product(points_on(truth, along_m=along_m), truth).roughness

    assert roughness.spikes == 2
    assert roughness.spikes_per_10000 == pytest.approx(2e4 / 51)


def test_a_point_beside_the_track_is_a_spike_only_when_its_angle_is_sharp():
    truth = truth_of(seconds=50)
    blunt, sharp = np.zeros(51), np.zeros(51)
    blunt[20], sharp[20] = 900.0, 1300.0  # tips of 25 and 17.5 degrees over legs of 200 m

    assert only_product(points_on(truth, along_m=0.0, across_m=blunt), truth).roughness.spikes == 0
    assert only_product(points_on(truth, along_m=0.0, across_m=sharp), truth).roughness.spikes == 1


def test_noise_of_a_hovering_aircraft_is_no_spike():
    truth = truth_of(seconds=200, speed_mps=0.0)
    east, north = np.random.default_rng(2).normal(0.0, 1.5, (2, 201))

    assert only_product(points_on(truth, east_m=east, north_m=north), truth).roughness.spikes == 0


def test_a_standard_turn_is_no_spike():
    angle = np.radians(3.0) * np.arange(120.0)
    lon, lat, _ = GEOD.fwd(np.full(120, 11.0), np.full(120, 48.0), np.degrees(angle), np.full(120, 2400.0))
    points = PointColumns.of(120, track_number=1, time_s=START_S + np.arange(120.0), lat_deg=lat, lon_deg=lon)

    assert only_product(points, truth_of()).roughness.spikes == 0


def test_a_jump_of_the_error_is_a_step_of_its_size():
    truth = truth_of(seconds=50)
    across_m = np.where(np.arange(51) < 25, 0.0, 80.0)

    roughness = only_product(points_on(truth, along_m=0.0, across_m=across_m), truth).roughness

    assert roughness.steps == 1
    assert roughness.step_max_m == pytest.approx(80.0, abs=0.1)


def test_a_constant_error_is_no_step():
    truth = truth_of(seconds=50)

    assert only_product(points_on(truth, east_m=500.0), truth).roughness.step_max_m == pytest.approx(0.0, abs=0.1)


def test_groups_ranges_and_runs():
    group = np.array([4, 4, 7, 7, 7])

    assert group_starts(group).tolist() == [0, 2, 5]
    assert group_starts(group[:0]).tolist() == [0]
    assert [part.tolist() for part in expand_ranges(np.array([5, 0, 9]), np.array([2, 0, 3]))] == [
        [0, 0, 2, 2, 2],
        [5, 6, 9, 10, 11],
    ]
    assert run_lengths(np.array([True, True, True, False, True]), group).tolist() == [2, 2, 1, 0, 1]


def test_the_terminated_point_may_repeat_the_time_before_it():
    truth = truth_of(seconds=9)
    points = points_on(truth)
    points.time_s[-1], points.status[-1] = points.time_s[-2], int(Status.TERMINATED)

    assert only_product(points, truth).timing.times_repeated == 0


def test_a_coasted_point_has_no_processing_time():
    truth = truth_of(seconds=9)
    status = np.where(np.arange(10) < 5, int(Status.CONFIRMED), int(Status.COASTING))
    received_s = np.where(np.arange(10) < 5, truth.time_s + 0.9, START_S)

    timing = only_product(points_on(truth, status=status, input_received_s=received_s), truth).timing

    assert timing.processing.count == 5
    assert timing.processing.max_s == pytest.approx(0.1, abs=1e-6)
