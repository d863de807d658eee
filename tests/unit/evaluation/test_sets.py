"""GOSPA, assignment and identity against independent implementations and counts made by hand."""

import math
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment
from tests.evaluation_scenes import START_S, points_on, truth_and, truth_of

from aeroskein.evaluation import EvaluationSettings, PointColumns, Truth, TruthCurve, evaluate
from aeroskein.evaluation.assignment import cheapest_assignment
from aeroskein.evaluation.gospa import gospa_terms
from aeroskein.evaluation.instants import picture_of
from aeroskein.evaluation.matching import match
from aeroskein.evaluation.windows import is_held, windows_of
from aeroskein.points import Flag

FROM_START = EvaluationSettings(from_s=0.0, step_s=5.0)


def only_product(points, truth, settings=FROM_START):
    (product,) = evaluate(points, truth, settings=settings).products
    return product


@given(st.integers(1, 7), st.integers(0, 5), st.integers(0, 2**32 - 1))
def test_assignment_costs_what_scipys_costs(rows, more, seed):
    cost = np.random.default_rng(seed).integers(-20, 20, (rows, rows + more)).astype(float)

    columns = cheapest_assignment(cost)

    assert len(set(columns.tolist())) == rows
    expected = cost[linear_sum_assignment(cost)].sum()
    assert cost[np.arange(rows), columns].sum() == pytest.approx(expected)


def test_assignment_refuses_more_rows_than_columns():
    with pytest.raises(ValueError, match="3 rows do not fit into 2 columns"):
        cheapest_assignment(np.zeros((3, 2)))


def gospa_at_one_instant(truth_m, track_m):
    """Our terms (squares, missed, false) for positions near where the equator meets Greenwich."""
    per_degree = np.array([111_319.490793, 110_574.275822])
    flights, times = len(truth_m), START_S + np.array([-5.0, 0.0, 5.0])
    lon, lat = np.repeat(truth_m / per_degree, 3, axis=0).T
    truth = Truth.of(
        [f"F{k}" for k in range(flights)],
        flights * 3,
        flight=np.repeat(np.arange(flights), 3),
        time_s=np.tile(times, flights),
        lon_deg=lon,
        lat_deg=lat,
    )
    lon, lat = (track_m / per_degree).T
    number = np.arange(len(track_m))
    points = PointColumns.of(len(track_m), track_number=number, time_s=START_S, lon_deg=lon, lat_deg=lat)
    curve = TruthCurve(truth)
    windows = windows_of(points, match(points, curve, 0.0), curve, 0.0)
    picture = picture_of(points, is_held(points), curve, windows, step_s=5.0, cutoff_m=1000.0)
    steps, *terms = gospa_terms(picture, 1000.0)
    at = int(np.flatnonzero(steps == round(START_S / 5.0))[0])
    return tuple(float(term[at]) for term in terms)


@given(st.integers(1, 8), st.integers(0, 8), st.integers(0, 2**32 - 1))
def test_gospa_is_the_best_of_all_assignments(aircraft, tracks, seed):
    rng = np.random.default_rng(seed)
    truth_m, track_m = rng.normal(0.0, 900.0, (aircraft, 2)), rng.normal(0.0, 900.0, (tracks, 2))
    distance = np.hypot(*(track_m[:, None] - truth_m).transpose(2, 0, 1))
    gain = np.minimum(distance**2 - 1000.0**2, 0.0)
    best = 5e5 * (aircraft + tracks) + gain[linear_sum_assignment(gain)].sum()

    square, missed, false = gospa_at_one_instant(truth_m, track_m)

    assert square + 5e5 * (missed + false) == pytest.approx(best, rel=1e-5)
    assert aircraft - missed == tracks - false


@pytest.mark.parametrize("seed", range(10))
def test_gospa_is_that_of_stone_soup(seed):
    metric = pytest.importorskip("stonesoup.metricgenerator.ospametric").GOSPAMetric(p=2, c=1000.0)
    state = pytest.importorskip("stonesoup.types.state").State
    rng = np.random.default_rng(seed)
    truth_m, track_m = rng.normal(0.0, 900.0, (5, 2)), rng.normal(0.0, 900.0, (6, 2))
    when = datetime(2026, 9, 21, tzinfo=UTC)
    tracks, truths = ([state(state_vector=xy, timestamp=when) for xy in xys] for xys in (track_m, truth_m))
    expected = metric.compute_gospa_metric(tracks, truths)[0].value

    square, missed, false = gospa_at_one_instant(truth_m, track_m)

    assert math.sqrt(square + 5e5 * (missed + false)) == pytest.approx(expected["distance"], rel=1e-5)
    assert square == pytest.approx(expected["localisation"], rel=1e-5, abs=1e-6)
    assert 5e5 * missed == pytest.approx(expected["missed"])
    assert 5e5 * false == pytest.approx(expected["false"])


def test_perfect_tracks_have_a_gospa_of_their_position_error():
    truth = truth_of(["3C6444", "4CA2D6"])

    gospa = only_product(points_on(truth, east_m=30.0), truth).gospa

    assert gospa.mean_m == pytest.approx(math.sqrt(2.0) * 30.0, rel=1e-6)
    assert gospa.pair_rms_m == pytest.approx(30.0, rel=1e-6)
    assert (gospa.missed_per_step, gospa.false_per_step, gospa.aircraft_per_step) == (0.0, 0.0, 2.0)


def test_a_missed_aircraft_costs_half_the_squared_cutoff():
    truth = truth_of(["3C6444", "4CA2D6"])

    gospa = only_product(points_on(truth_of(["3C6444"])), truth).gospa

    assert gospa.missed_per_step == 1.0
    assert gospa.mean_m == pytest.approx(1000.0 / math.sqrt(2.0), rel=1e-6)
    assert gospa.missed_m == pytest.approx(1000.0 / math.sqrt(2.0), rel=1e-6)


def test_element_points_eight_seconds_apart_miss_nobody():
    truth = truth_of(seconds=318)
    points = points_on(truth).take(np.arange(4, 318, 8))
    points.span_s = np.stack([points.time_s - 4.0, points.time_s + 4.0], axis=1)

    assert only_product(points, truth, EvaluationSettings(from_s=4.0)).gospa.missed_per_step == 0.0


def test_one_track_per_aircraft_and_nothing_else():
    truth = truth_of(["3C6444", "4CA2D6"])

    identity = only_product(points_on(truth), truth).identity

    assert (identity.tracks, identity.flights_judged, identity.flights_tracked) == (2, 2, 2)
    assert (identity.tracks_per_flight, identity.flights_with_one_track) == (1.0, 1.0)
    assert (identity.track_changes, identity.swaps, identity.false_tracks) == (0, 0, 0)
    assert identity.address_correct == 1.0


def test_a_new_number_on_an_aircraft_is_a_change_and_no_swap():
    truth = truth_of(seconds=100)
    number = np.where(np.arange(101) < 50, 1, 2)

    identity = only_product(points_on(truth, track_number=number), truth).identity

    assert (identity.track_changes, identity.swaps, identity.tracks_per_flight) == (1, 0, 2.0)


def test_two_tracks_that_exchange_their_aircraft_are_two_swaps():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=100)
    late = truth.time_s > START_S + 50.0
    points = points_on(truth, track_number=np.where(late, 2 - truth.flight, 1 + truth.flight))

    identity = only_product(points, truth).identity

    assert (identity.track_changes, identity.swaps) == (2, 2)


def test_the_right_address_on_the_wrong_aircraft_shows():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=100)
    exchanged = truth.addresses[1 - truth.flight]

    assert only_product(points_on(truth, address=exchanged), truth).identity.address_correct == 0.0


def test_a_track_with_no_aircraft_near_is_false_and_its_warning_is_counted():
    truth = truth_of(["3C6444"], seconds=100)
    ghosts = points_on(truth_of(["AAAAAA", "BBBBBB"], seconds=100, lat_deg=50.0))
    ghosts.track_number += 10
    ghosts.flags[ghosts.track_number == 12] = int(Flag.ADSB_SUSPECT)

    identity = only_product(PointColumns.concatenate([points_on(truth), ghosts]), truth).identity

    assert (identity.false_tracks, identity.false_tracks_flagged) == (2, 1)
    assert identity.false_track_s == pytest.approx(2 * 100.0, abs=10.0)


def test_a_second_track_on_an_aircraft_is_extra_and_not_false():
    truth = truth_of(["3C6444"], seconds=100)
    second = points_on(truth, east_m=200.0, track_number=9)

    identity = only_product(PointColumns.concatenate([points_on(truth), second]), truth).identity

    assert identity.false_tracks == 0
    assert identity.extra_track_ratio == pytest.approx(1.0, abs=0.06)


def test_initiation_is_from_first_report_to_first_confirmed_point():
    truth = truth_of(seconds=100)
    points = points_on(truth).take(np.arange(7, 101))
    points.span_s = np.stack([np.maximum(points.time_s - 7.0, START_S), points.time_s], axis=1)

    assert only_product(points, truth).identity.initiation.p50_s == pytest.approx(7.0)


def test_a_track_that_coasts_after_the_truth_of_its_flight_has_ended_is_not_false():
    whole = truth_of(["3C6444"], seconds=130)
    truth = truth_of(["3C6444"], seconds=100)
    other = truth_of(["4CA2D6"], seconds=130, lat_deg=50.0)
    both = truth_and(truth, other)
    others = points_on(other)
    others.track_number[:] = 5

    product = only_product(PointColumns.concatenate([points_on(whole), others]), both)

    assert product.gospa.false_per_step == 0.0
    assert product.identity.false_tracks == 0
    assert product.identity.beyond_truth_s == pytest.approx(30.0, abs=5.0)


def test_a_track_that_leaves_an_aircraft_that_is_still_there_is_false():
    truth = truth_of(["3C6444"], seconds=100)
    away = np.where(truth.time_s > START_S + 50.0, 30_000.0, 0.0)

    product = only_product(points_on(truth, east_m=away, address=-1), truth)

    assert product.gospa.false_per_step == pytest.approx(0.5, abs=0.06)
    assert product.identity.beyond_truth_s == 0.0
