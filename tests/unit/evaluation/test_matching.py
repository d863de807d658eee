"""Whose point is it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.evaluation_scenes import GEOD, START_S, points_on, truth_of

from aeroskein.evaluation import PointColumns, Truth, TruthCurve
from aeroskein.evaluation.matching import match
from aeroskein.evaluation.neighbours import near_pairs
from aeroskein.points import Flag


def test_an_address_belongs_to_its_flight_however_far_off_the_point_is():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=10)

    matches = match(points_on(truth, east_m=50_000.0), TruthCurve(truth), 2000.0)

    assert matches.flight.tolist() == truth.flight.tolist()
    assert matches.by_address.all()


def test_a_track_without_address_belongs_to_the_flight_it_follows():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=10)

    matches = match(points_on(truth, address=-1, east_m=300.0), TruthCurve(truth), 2000.0)

    assert matches.flight.tolist() == truth.flight.tolist()
    assert not matches.by_address.any()


def test_a_track_far_from_everything_belongs_to_no_flight():
    truth = truth_of(["3C6444"], seconds=10)

    matches = match(points_on(truth, address=-1, east_m=5000.0), TruthCurve(truth), 2000.0)

    assert (matches.flight == -1).all()


def test_of_two_tracks_with_one_address_each_belongs_where_it_is():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=10)
    points = points_on(truth, address=0x3C6444, flags=int(Flag.DUPLICATE_ADDRESS))

    assert match(points, TruthCurve(truth), 2000.0).flight.tolist() == truth.flight.tolist()


def test_two_flights_with_one_address_are_told_apart_by_position():
    truth = truth_of(["one", "two"], seconds=10)
    truth.addresses[:] = 0x3C6444

    assert match(points_on(truth), TruthCurve(truth), 2000.0).flight.tolist() == truth.flight.tolist()


def test_a_track_keeps_its_flight_while_another_comes_nearer():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=20, apart_deg=0.01)
    first = points_on(truth, address=-1).take(np.arange(21))
    lon, lat, _ = GEOD.fwd(first.lon_deg, first.lat_deg, np.zeros(21), np.linspace(0.0, 900.0, 21))
    drifting = PointColumns.of(21, track_number=7, time_s=first.time_s, lat_deg=lat, lon_deg=lon)

    assert match(drifting, TruthCurve(truth), 2000.0).flight.tolist() == [0] * 21


def test_a_track_that_left_its_flight_takes_the_one_it_is_with():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=20, apart_deg=0.1)
    both = points_on(truth, address=-1)
    jumping = PointColumns.concatenate([both.take(np.arange(11)), both.take(np.arange(21 + 11, 42))])
    jumping.track_number[:] = 7

    assert match(jumping, TruthCurve(truth), 2000.0).flight.tolist() == [0] * 11 + [1] * 10


@given(st.integers(0, 2**32 - 1))
def test_near_pairs_are_those_of_comparing_everything(seed):
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 21.0)
    flights = 6
    lat = 80.0 + rng.normal(0.0, 0.03, (flights, 1)) + 1e-3 * rng.normal(0.0, 1.0, (flights, 1)) * time_s
    lon = 179.99 + rng.normal(0.0, 0.1, (flights, 1)) + 5e-3 * rng.normal(0.0, 1.0, (flights, 1)) * time_s
    truth = Truth.of(
        [f"F{k}" for k in range(flights)], flights * 21, flight=np.repeat(np.arange(flights), 21),
        time_s=np.tile(START_S + time_s, flights), lat_deg=lat.ravel(), lon_deg=(lon.ravel() + 180.0) % 360.0 - 180.0,
    )  # fmt: skip
    row = rng.integers(0, len(truth), 40)
    point_lat = truth.lat_deg[row] + rng.normal(0.0, 0.01, 40)
    point_lon = truth.lon_deg[row] + rng.normal(0.0, 0.05, 40)

    pairs = near_pairs(truth.time_s[row], point_lat, point_lon, TruthCurve(truth), 1500.0)

    found = {(int(p), int(f)): d for p, f, d in zip(pairs.point, pairs.flight, pairs.distance_m, strict=True)}
    for point in range(40):
        for flight in range(flights):
            sample = flight * 21 + row[point] % 21
            *_, distance = GEOD.inv(point_lon[point], point_lat[point], truth.lon_deg[sample], truth.lat_deg[sample])
            if distance < 1499.0:
                assert found[point, flight] == pytest.approx(distance, abs=0.01)
            elif distance > 1501.0:
                assert (point, flight) not in found
