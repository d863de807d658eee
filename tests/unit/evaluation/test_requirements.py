"""Requirement rows: the limit decides, what cannot be known is said to be so."""

import re

import numpy as np
import pytest
from tests.evaluation_scenes import START_S, points_on, truth_of

from aeroskein.evaluation import EvaluationSettings, evaluate
from aeroskein.evaluation.figures import Verdict
from aeroskein.evaluation.requirements import COLUMNS, RULES, rows_of

FROM_START = EvaluationSettings(from_s=0.0)


def row_of(points, truth, row, item="", column="3 NM", level="mandatory", standard="ESASSP"):
    (product,) = evaluate(points, truth, settings=FROM_START).products
    (found,) = [
        r
        for r in product.requirements
        if (r.standard, r.row, r.column, r.level) == (standard, row, column, level) and item in r.item
    ]
    return found


@pytest.mark.parametrize(
    ("error_m", "column", "verdict"),
    [(299.0, "3 NM", Verdict.MET), (301.0, "3 NM", Verdict.NOT_MET), (301.0, "5 NM", Verdict.MET)],
)
def test_horizontal_rms_is_held_against_the_limit_of_its_column(error_m, column, verdict):
    truth = truth_of(seconds=60)

    row = row_of(points_on(truth, east_m=error_m), truth, "R4", column=column)

    assert row.measured == pytest.approx(error_m, rel=1e-6)
    assert row.verdict is verdict


@pytest.mark.parametrize(("run", "expected_percent"), [(2, 0.0), (3, 300.0 / 401), (5, 500.0 / 401)])
def test_only_three_large_errors_in_a_row_are_correlated(run, expected_percent):
    truth = truth_of(seconds=400)
    size_m = np.where((np.arange(401) >= 100) & (np.arange(401) < 100 + run), 600.0, 0.0)

    assert row_of(points_on(truth, east_m=size_m), truth, "R5").measured == pytest.approx(expected_percent)


def test_lowest_flight_decides_the_probability_of_update():
    truth = truth_of(["3C6444", "4CA2D6"], seconds=400)
    kept = (truth.flight == 0) | (truth.time_s < START_S + 300.0)

    row = row_of(points_on(truth).take(kept), truth, "R2")

    assert row.measured == pytest.approx(75.0)
    assert row.verdict is Verdict.NOT_MET


@pytest.mark.parametrize(("row", "item", "expected"), [("R8", "", 100.0), ("R9", "", 0.0), ("R10", "level", 100.0)])
def test_altitude_rows_are_measured_where_truth_has_an_altitude(row, item, expected):
    truth = truth_of(seconds=60)
    truth.altitude_m[:] = 3000.0

    found = row_of(points_on(truth, altitude_m=3090.0), truth, row, item)

    assert found.measured == pytest.approx(expected)
    assert found.verdict is Verdict.MET


def test_an_altitude_off_by_more_than_300_feet_is_incorrect():
    truth = truth_of(seconds=60)
    truth.altitude_m[:] = 3000.0

    assert row_of(points_on(truth, altitude_m=3092.0), truth, "R9").measured == 100.0


@pytest.mark.parametrize("row", ["R6", "R7", "R8", "R9", "R11", "R12", "R13", "R14", "R18", "R20"])
def test_what_the_files_do_not_tell_is_not_measurable(row):
    truth = truth_of(seconds=60)
    (product,) = evaluate(points_on(truth), truth, settings=FROM_START).products

    found = [r for r in product.requirements if r.row == row and r.standard == "ESASSP"]

    assert found
    assert all(r.verdict is Verdict.NOT_MEASURABLE and r.measured is None and r.note for r in found)


def test_callsign_rows_are_measured_where_truth_has_callsigns():
    truth = truth_of(seconds=60)
    truth.callsigns[:] = b"DLH123"
    callsign = np.where(np.arange(61) < 30, b"DLH123", b"DLH124")

    assert row_of(points_on(truth, callsign=callsign), truth, "R13").measured == pytest.approx(50.0)
    assert row_of(points_on(truth, callsign=callsign), truth, "R14").measured > 40.0


def test_velocity_is_judged_apart_in_turns():
    truth = truth_of(seconds=60)

    row = row_of(points_on(truth, ground_speed_mps=205.0), truth, "R16", "straight", level="recommended")
    turn = row_of(points_on(truth), truth, "R16", "turn", level="recommended")

    assert (row.measured, row.verdict) == (pytest.approx(5.0, abs=1e-3), Verdict.NOT_MET)
    assert (turn.measured, turn.verdict) == (None, Verdict.NOT_MEASURABLE)


def test_rate_of_climb_is_in_feet_per_minute():
    truth = truth_of(seconds=60)

    row = row_of(points_on(truth, vertical_rate_mps=1.016), truth, "R15", "level", level="recommended")

    assert row.measured == pytest.approx(200.0)


def test_a_false_track_counts_per_hour():
    truth = truth_of(seconds=3600, step_s=10.0)
    ghost = points_on(truth_of(["AAAAAA"], seconds=100, lat_deg=50.0))
    points = type(ghost).concatenate([points_on(truth), ghost])
    points.track_number[-len(ghost) :] = 99

    assert row_of(points, truth, "R19").measured == pytest.approx(1.0, abs=0.01)


def test_ed_142_has_its_own_columns_and_limits():
    truth = truth_of(seconds=60)
    points = points_on(truth, east_m=200.0)

    assert row_of(points, truth, "RMS", column="TMA", standard="ED-142").verdict is Verdict.NOT_MET
    assert row_of(points, truth, "RMS", column="en route", standard="ED-142").verdict is Verdict.MET


def test_every_row_of_esassp_is_in_the_table():
    assert {rule.row for rule in RULES if rule.standard == "ESASSP"} == {f"R{k}" for k in range(1, 21)}


def test_a_rule_that_cannot_be_measured_says_why():
    assert all(rule.note for rule in RULES if not rule.measure)


def test_every_measure_that_a_rule_asks_for_is_measured_by_somebody():
    truth = truth_of(seconds=400)
    truth.altitude_m[:], truth.callsigns[:] = 3000.0, b"DLH123"
    truth.vertical_rate_mps[truth.time_s > START_S + 200.0] = 5.0
    turning = truth.time_s > START_S + 300.0
    truth.track_angle_deg[turning] += 2.0 * (truth.time_s[turning] - START_S - 300.0)
    points = points_on(truth, callsign=b"DLH123")
    (product,) = evaluate(points, truth, settings=FROM_START).products

    silent = {row.row for row in product.requirements if row.verdict is Verdict.NOT_MEASURABLE}

    assert silent == {rule.row for rule in RULES if not rule.measure}


def test_no_text_claims_conformity():
    text = " ".join(f"{rule.item} {rule.note}" for rule in RULES)

    assert not re.search("complian|certif|conform", text, re.IGNORECASE)


def test_without_measures_nothing_is_met():
    rows = rows_of({column: {} for column in COLUMNS})

    assert {row.verdict for row in rows} == {Verdict.NOT_MEASURABLE}
    assert len(rows) == 2 * len(RULES)
