"""Rings: what a buffered report loses by lying in single precision, and that empty places say nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.builders import START_S, measurements

from aeroskein.measurements import COLUMNS
from aeroskein.rings import Rings

ONE = (np.array([0]), np.array([0]))


@given(
    st.floats(0.0, 1e6), st.floats(-60.0, 60.0), st.floats(0.0, 30.0), st.floats(-64_000.0, 64_000.0),
    st.floats(0.0, 360.0), st.floats(0.0, 400_000.0),
)  # fmt: skip
def test_times_come_back_in_full_and_measures_within_single_precision(
    after_s: float, bias_s: float, delay_s: float, east_m: float, azimuth_deg: float, range_m: float
) -> None:
    rings, time_s = Rings(1, 2), START_S + after_s
    report = measurements(
        1, time_s=time_s, stamp_s=time_s + bias_s, received_s=time_s + delay_s, east_m=east_m, azimuth_deg=azimuth_deg,
        range_m=range_m,
    )  # fmt: skip

    rings[ONE] = report.packed()

    kept = dict(zip(COLUMNS, rings[ONE][0], strict=True))
    assert kept["time_s"] == time_s
    assert abs(kept["stamp_s"] - report.stamp_s[0]) < 5e-6
    assert abs(kept["received_s"] - report.received_s[0]) < 2e-6
    assert abs(kept["east_m"] - east_m) <= 0.002
    assert abs(kept["azimuth_deg"] - azimuth_deg) <= 1.6e-5
    assert abs(kept["range_m"] - range_m) <= 0.016


def test_an_own_position_keeps_its_stamp_to_the_last_bit() -> None:
    rings, time_s = Rings(1, 1), START_S + 0.123456789

    rings[ONE] = measurements(1, time_s=time_s, stamp_s=time_s).packed()

    assert rings[ONE][0, COLUMNS.index("stamp_s")] == time_s


def test_empty_places_are_nan_behind_a_time_before_everything() -> None:
    rings = Rings(2, 3)
    rings[ONE] = measurements(1, time_s=5.0, east_m=1.0).packed()

    row = rings[np.array([0])][0]

    assert row[:, 0].tolist() == [5.0, -np.inf, -np.inf]
    assert np.isnan(row[1:, 1:]).all()


def test_whole_rings_are_written_back_as_they_were_read() -> None:
    rings, slots = Rings(2, 3), np.array([0, 1])
    rings[np.array([0, 1]), np.array([2, 0])] = measurements(2, time_s=[5.0, 6.0], east_m=[1.0, 2.0]).packed()
    before = rings[slots]

    rings[slots] = before

    assert np.array_equal(rings[slots], before, equal_nan=True)


def test_growth_keeps_what_is_there_and_adds_empty_rings() -> None:
    rings = Rings(1, 2)
    rings[ONE] = measurements(1, time_s=5.0, east_m=1.5).packed()

    rings.grow(3)

    assert len(rings) == 3
    assert rings[ONE][0, COLUMNS.index("east_m")] == 1.5
    assert np.isneginf(rings.time_s[1:]).all()


def test_one_column_is_written_alone() -> None:
    rings = Rings(1, 1)
    rings[ONE] = measurements(1, time_s=5.0, east_m=1.5).packed()

    rings.set_column("jerk_density", *ONE, np.array([0.25]))

    kept = dict(zip(COLUMNS, rings[ONE][0], strict=True))
    assert (kept["jerk_density"], kept["east_m"], kept["time_s"]) == (0.25, 1.5, 5.0)
