"""What is applied to reports is what was known when their ten seconds began."""

import numpy as np
import pytest

from aeroskein.applied_biases import AppliedBiases
from aeroskein.calibration import (
    CELL_SIGMA_M,
    OWN_SIGMA_M,
    UNKNOWN_SIGMA_M,
    BlockTime,
    HeightOffsets,
)
from aeroskein.plots import Plots

NOW, BEFORE = np.array([False]), np.array([True])
ROWS = np.array([0])


HERE, NEAR, ELSEWHERE = (48.0, 11.5), (48.05, 11.45), (50.0, 14.0)


def applied(
    offsets: HeightOffsets, slot: int, place: tuple[float, float] = HERE, before: np.ndarray = NOW
) -> tuple[float, float]:
    offset, sigma = offsets.applied(np.array([slot]), before, lambda rows: (np.array(place[:1]), np.array(place[1:])))
    return float(offset[0]), float(sigma[0])


def learn(offsets: HeightOffsets, slot: int, *differences: float, place: tuple[float, float] = HERE) -> None:
    for difference in differences:
        offsets.learn(np.array([slot]), np.array(place[:1]), np.array(place[1:]), np.array([difference]))


# -- blocks -----------------------------------------------------------------------------------------------------------
def test_a_block_begins_every_ten_seconds() -> None:
    block = BlockTime()

    assert [block.begins(t) for t in (12.0, 19.9, 20.0, 20.1, 35.0, 34.0)] == [True, False, True, False, True, False]


def test_reports_belong_to_the_block_of_their_stamp() -> None:
    block = BlockTime()
    block.begins(25.0)

    assert block.before(np.array([19.9, 20.0, 25.0, 31.0])).tolist() == [True, False, False, False]


# -- height offsets ---------------------------------------------------------------------------------------------------
def test_nothing_learned_is_no_offset_and_little_trust() -> None:
    offsets = HeightOffsets(4)
    offsets.begin_block()

    assert applied(offsets, 0) == (0.0, UNKNOWN_SIGMA_M)
    assert applied(offsets, -1) == (0.0, UNKNOWN_SIGMA_M)


def test_what_is_learned_is_applied_from_the_next_block_on() -> None:
    offsets = HeightOffsets(4)
    learn(offsets, 1, 60.0)

    assert applied(offsets, 1) == (0.0, UNKNOWN_SIGMA_M)
    offsets.begin_block()
    assert applied(offsets, 1) == (60.0, OWN_SIGMA_M)
    assert applied(offsets, 1, before=BEFORE) == (0.0, UNKNOWN_SIGMA_M)


def test_the_block_before_keeps_what_was_known_then() -> None:
    offsets = HeightOffsets(4)
    learn(offsets, 1, 60.0)
    offsets.begin_block()
    learn(offsets, 1, 160.0)
    offsets.begin_block()

    assert applied(offsets, 1, before=BEFORE)[0] == 60.0
    assert applied(offsets, 1)[0] == pytest.approx(80.0)


def test_neighbours_lend_their_offset_to_an_aircraft_that_reports_no_height() -> None:
    offsets = HeightOffsets(4)
    learn(offsets, 0, 60.0, place=HERE)
    learn(offsets, 1, 80.0, place=NEAR)
    learn(offsets, 3, 10.0, place=ELSEWHERE)
    offsets.begin_block()

    for slot in (2, -1):
        assert applied(offsets, slot, HERE) == (70.0, CELL_SIGMA_M)
        assert applied(offsets, slot, ELSEWHERE) == (10.0, CELL_SIGMA_M)


def test_where_nobody_has_taught_anything_the_mean_of_all_places_holds() -> None:
    offsets = HeightOffsets(4)
    learn(offsets, 0, 60.0, place=HERE)
    learn(offsets, 1, 20.0, place=ELSEWHERE)
    offsets.begin_block()

    assert applied(offsets, 2, (-30.0, 100.0)) == (40.0, CELL_SIGMA_M)
    assert applied(offsets, 2, (-30.0, 100.0), before=BEFORE) == (0.0, UNKNOWN_SIGMA_M)
    assert applied(offsets, 2, (np.nan, np.nan)) == (40.0, CELL_SIGMA_M)


def test_a_place_that_is_taught_in_the_middle_of_a_block_waits_for_the_next() -> None:
    offsets = HeightOffsets(4)
    learn(offsets, 0, 60.0, place=HERE)
    offsets.begin_block()
    learn(offsets, 1, 20.0, place=ELSEWHERE)

    assert applied(offsets, 2, ELSEWHERE) == (60.0, CELL_SIGMA_M)
    offsets.begin_block()
    # The mean of all counts as one element.
    assert applied(offsets, 2, ELSEWHERE) == (40.0, CELL_SIGMA_M)


def test_several_elements_of_one_call_are_averaged() -> None:
    offsets = HeightOffsets(4)
    lat, lon = np.array([HERE, NEAR, ELSEWHERE]).T

    offsets.learn(np.array([0, 1, 2]), lat, lon, np.array([40.0, 60.0, np.nan]))
    offsets.begin_block()

    assert applied(offsets, 3, HERE)[0] == pytest.approx(50.0)
    assert applied(offsets, 2, ELSEWHERE) == (50.0, CELL_SIGMA_M)


def test_offsets_follow_the_weather() -> None:
    offsets = HeightOffsets(4)
    learn(offsets, 0, *[50.0] * 300)
    learn(offsets, 0, *[90.0] * 600)
    offsets.begin_block()

    assert applied(offsets, 0)[0] == pytest.approx(90.0, abs=0.1)
    assert 85.0 < applied(offsets, 1)[0] < 90.0


def test_a_new_track_in_an_old_slot_has_no_offset_of_its_own() -> None:
    offsets = HeightOffsets(4)
    learn(offsets, 0, 500.0)
    offsets.begin_block()

    offsets.clear(np.array([0]))

    assert applied(offsets, 0)[1] == CELL_SIGMA_M
    assert applied(offsets, 0, before=BEFORE)[1] == UNKNOWN_SIGMA_M


def test_growth_keeps_offsets() -> None:
    offsets = HeightOffsets(1)
    learn(offsets, 0, 60.0)
    offsets.begin_block()

    offsets.grow(3)

    assert applied(offsets, 0) == (60.0, OWN_SIGMA_M)
    assert applied(offsets, 2)[1] == CELL_SIGMA_M


# -- biases of radars -------------------------------------------------------------------------------------------------
def biases(range_m: float = 0.0, azimuth_deg: float = 0.0, time_s: float = 0.0, gain: float = 0.0) -> tuple[
    np.ndarray, np.ndarray, np.ndarray
]:  # fmt: skip
    """Sensor 1 has these, sensor 0 none."""
    correction = np.array([[0.0] * 4, [range_m, azimuth_deg, time_s, gain]])
    return correction, np.abs(correction) / 10.0, np.array([False, True])


def plot(**changes: float) -> Plots:
    return Plots.of(1, **({"sensor": 1, "time_s": 100.0, "range_m": 50_000.0, "azimuth_deg": 10.0} | changes))


def test_bias_is_what_a_radar_reports_too_much() -> None:
    table = AppliedBiases(*biases(120.0, 0.3, 0.5, 1e-3))

    true = table.correct(plot(), NOW, ROWS)

    assert true.range_m[0] == pytest.approx((50_000.0 - 120.0) / 1.001)
    assert true.azimuth_deg[0] == pytest.approx(9.7)
    assert true.time_s[0] == 99.5


def test_corrected_azimuths_stay_in_the_circle() -> None:
    table = AppliedBiases(*biases(azimuth_deg=0.3))

    assert table.correct(plot(azimuth_deg=0.1), NOW, ROWS).azimuth_deg[0] == pytest.approx(359.8)


def test_a_corrected_range_is_never_negative() -> None:
    table = AppliedBiases(*biases(range_m=300.0))

    assert table.correct(plot(range_m=100.0), NOW, ROWS).range_m[0] == 0.0


def test_the_report_itself_and_other_sensors_are_not_changed() -> None:
    table, raw = AppliedBiases(*biases(120.0, 0.3, 0.5, 1e-3)), plot()

    table.correct(raw, NOW, ROWS)
    other = table.correct(plot(sensor=0), NOW, ROWS)

    assert raw.range_m[0] == 50_000.0
    assert (other.range_m[0], other.azimuth_deg[0], other.time_s[0]) == (50_000.0, 10.0, 100.0)


def test_biases_change_with_the_block_of_the_stamp() -> None:
    table = AppliedBiases(*biases(100.0))

    table.begin_block(*biases(200.0))
    table.begin_block(*biases(300.0))

    assert table.correct(plot(), NOW, ROWS).range_m[0] == 49_700.0
    assert table.correct(plot(), BEFORE, ROWS).range_m[0] == 49_800.0
    assert table.sigmas(np.array([1], dtype=np.int16), NOW)[0].tolist() == [30.0, 0.0, 0.0, 0.0]
    assert table.sigmas(np.array([1], dtype=np.int16), BEFORE)[0].tolist() == [20.0, 0.0, 0.0, 0.0]


def test_restored_biases_are_in_force_at_once() -> None:
    table = AppliedBiases(*biases(100.0))

    table.replace(*biases(200.0))

    assert table.correct(plot(), BEFORE, ROWS).range_m[0] == 49_800.0
    assert table.uncertain.tolist() == [False, True]
