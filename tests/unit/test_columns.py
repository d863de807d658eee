"""Columns of reports and points, and the selection of rows by dimension."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from tests.builders import START_S, Drive, Flight, adsb

from aeroskein.measurements import COLUMN_COUNT, COLUMNS, Measurements
from aeroskein.plots import Plots
from aeroskein.points import FusedPoints
from aeroskein.selection import Selection


# -- reports ----------------------------------------------------------------------------------------------------------
def test_what_is_not_named_is_missing() -> None:
    plots = Plots.of(2, time_s=[1.0, 2.0])

    assert np.isnan(plots.lat_deg).all()
    assert (plots.address == -1).all()
    assert (plots.mode_a == -1).all()
    assert (plots.callsign == b"").all()
    assert (plots.flags == 0).all()
    assert len(plots) == 2


def test_a_scalar_stands_in_every_row() -> None:
    assert Plots.of(3, sensor=2).sensor.tolist() == [2, 2, 2]


def test_wrong_columns_are_refused() -> None:
    with pytest.raises(TypeError, match="no column 'colour'"):
        Plots.of(1, colour="red")
    with pytest.raises(ValueError, match="lat_deg has shape"):
        Plots.of(2, lat_deg=[1.0, 2.0, 3.0])


def test_rows_are_taken_and_joined_in_every_column() -> None:
    plots = adsb(Flight(), np.arange(5.0))

    joined = Plots.concatenate([plots.take(np.array([3, 1])), plots.take(np.array([0]))])

    for field in fields(Plots):
        whole, part = getattr(plots, field.name), getattr(joined, field.name)
        assert np.array_equal(part, whole[[3, 1, 0]], equal_nan=whole.dtype.kind == "f"), field.name
        assert part.dtype == whole.dtype


def test_columns_are_replaced_one_by_one() -> None:
    plots = Plots.of(2, time_s=[1.0, 2.0], range_m=5.0)

    other = replace(plots, time_s=np.array([3.0, 4.0]))

    assert (other.time_s.tolist(), plots.time_s.tolist()) == ([3.0, 4.0], [1.0, 2.0])
    assert other.range_m is plots.range_m


def test_nothing_joined_is_no_rows() -> None:
    assert len(Plots.concatenate([])) == 0


def test_packed_rows_stand_in_the_order_of_their_columns() -> None:
    values = {name: np.arange(3.0) + 10.0 * k for k, name in enumerate(COLUMNS[:-1])}

    packed = Measurements(slot=np.arange(3), **values).packed()

    assert packed.shape == (3, COLUMN_COUNT)
    for k, name in enumerate(COLUMNS[:-1]):
        assert np.array_equal(packed[:, k], values[name])
    assert not packed[:, -1].any()


# -- points -----------------------------------------------------------------------------------------------------------
def points() -> FusedPoints:
    return Drive.of().feed(adsb(Flight(), np.arange(0.5, 6.0))).live


def test_points_are_taken_and_joined_in_every_column() -> None:
    p = points()

    joined = FusedPoints.concatenate([p.take(np.array([4])), p.take(np.array([1, 2]))])

    assert joined.product is p.product
    for field in fields(FusedPoints):
        if field.name != "product":
            whole, part = getattr(p, field.name), getattr(joined, field.name)
            assert np.array_equal(part, whole[[4, 1, 2]], equal_nan=whole.dtype.kind == "f"), field.name


# -- selection --------------------------------------------------------------------------------------------------------
def chosen(selection: Selection, **columns: object) -> list[bool]:
    plots = Plots.of(3, **columns)
    return selection.of_plots(plots, plots.lat_deg, plots.lon_deg).tolist()


def test_no_condition_matches_everything() -> None:
    assert chosen(Selection()) == [True] * 3


@pytest.mark.parametrize(
    ("condition", "column"),
    [("speed_mps", "ground_speed_mps"), ("altitude_m", "altitude_m"), ("time_s", "time_s")],
)
def test_limits_are_included_and_what_lacks_a_value_does_not_match(condition: str, column: str) -> None:
    selection = Selection(**{condition: (10.0, 20.0)})

    assert chosen(selection, **{column: [10.0, 20.0, np.nan]}) == [True, True, False]
    assert chosen(selection, **{column: [9.9, 20.1, 15.0]}) == [False, False, True]


def test_a_box_may_cross_the_antimeridian() -> None:
    across = Selection(bbox=(-20.0, 170.0, -10.0, -170.0))
    beside = Selection(bbox=(-20.0, -170.0, -10.0, 170.0))
    columns = {"lat_deg": [-15.0, -15.0, -15.0], "lon_deg": [175.0, -175.0, 0.0]}

    assert chosen(across, **columns) == [True, True, False]
    assert chosen(beside, **columns) == [False, False, True]


def test_a_box_has_edges() -> None:
    box = Selection(bbox=(10.0, 20.0, 11.0, 21.0))

    assert chosen(box, lat_deg=[10.0, 11.0, 11.1], lon_deg=[20.0, 21.0, 20.5]) == [True, True, False]
    assert chosen(box, lat_deg=[10.5, 10.5, np.nan], lon_deg=[19.9, 20.5, 20.5]) == [False, True, False]


def test_identity_and_sensor_are_chosen_exactly() -> None:
    assert chosen(Selection(addresses=frozenset({1, 3})), address=[1, 2, 3]) == [True, False, True]
    assert chosen(Selection(callsign="DLH1"), callsign=[b"DLH1", b"DLH12", b""]) == [True, False, False]
    assert chosen(Selection(sensors=frozenset({1})), sensor=[0, 1, 2]) == [False, True, False]


def test_all_conditions_must_hold() -> None:
    selection = Selection(addresses=frozenset({1}), altitude_m=(0.0, 100.0))

    assert chosen(selection, address=[1, 1, 2], altitude_m=[50.0, 150.0, 50.0]) == [True, False, False]


def test_sensors_of_points_are_those_that_contributed() -> None:
    p = points()

    assert Selection(sensors=frozenset({0})).of_points(p).all()
    assert not Selection(sensors=frozenset({1})).of_points(p).any()
    assert Selection(sensors=frozenset({0, 1}), time_s=(START_S, START_S + 2.0)).of_points(p).sum() == 2
