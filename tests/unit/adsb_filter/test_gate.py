"""Outliers, when the filter is the one that is wrong, and velocities that stay frozen."""

from typing import Any

import numpy as np
import pytest
from tests.filter_scenes import measurements

from aeroskein.adsb_filter.gate import Gate
from aeroskein.adsb_filter.pipeline import filter_flights
from aeroskein.adsb_filter.prepare import FilterSummary
from aeroskein.adsb_filter.settings import AdsbFilterSettings
from aeroskein.measurements import Measurements

NONE = np.full((1, 2), np.nan)


def judge(gate: Gate, squared_distance: float, velocity: Any = NONE, observed: bool = True) -> tuple[bool, float]:
    accepted, widen = gate.judge(np.array([squared_distance]), np.array([observed]), np.asarray(velocity))
    return bool(accepted[0]), float(widen[0])


def test_reports_inside_the_gate_are_accepted_as_they_are() -> None:
    assert judge(Gate(1, 6.0, 4), 36.0) == (True, 1.0)


def test_reports_outside_are_refused_until_the_filter_must_be_wrong() -> None:
    gate = Gate(1, 6.0, 3)

    assert [judge(gate, 400.0) for _ in range(5)] == [
        (False, 1.0), (False, 1.0), (False, 1.0), (True, 400.0), (False, 1.0),
    ]  # fmt: skip


def test_an_accepted_report_ends_the_count() -> None:
    gate = Gate(1, 6.0, 2)

    assert [judge(gate, d)[0] for d in (400.0, 400.0, 1.0, 400.0, 400.0, 400.0)] == [
        False, False, True, False, False, True,
    ]  # fmt: skip


def test_missing_positions_neither_count_nor_end_the_count() -> None:
    gate = Gate(1, 6.0, 1)

    assert [judge(gate, d, observed=seen)[0] for d, seen in ((400.0, True), (0.0, False), (400.0, True))] == [
        False, False, True,
    ]  # fmt: skip


def test_a_velocity_of_a_refused_report_counts_only_when_it_changes() -> None:
    gate, frozen, other = Gate(1, 6.0, 9), np.array([[60.0, 20.0]]), np.array([[59.0, 20.0]])

    judge(gate, 400.0, frozen)

    assert [bool(gate.trusts(v)[0]) for v in (frozen, frozen, other, frozen, NONE)] == [False, False, True, True, False]


def braking(frozen: bool) -> Measurements:
    """Landing: 70 m/s down to taxi speed within 25 s; the reported velocity may stay at what it was at touch-down."""
    rng = np.random.default_rng(3)
    time_s = np.arange(70.0)
    speed = np.clip(70.0 - 2.5 * np.clip(time_s - 20.0, 0.0, None), 8.0, 70.0)
    position = np.stack([np.zeros(70), np.cumsum(speed)], axis=1) + 3.0 * rng.standard_normal((70, 2))
    reported = np.where(time_s < 20.0, speed, 70.0) if frozen else speed
    return measurements(
        np.zeros(70), time_s, position, r_ee=9.0, r_nn=9.0, time_variance=0.01, v_east_mps=0.0, v_north_mps=reported,
        velocity_variance=1.0,
    )  # fmt: skip


@pytest.mark.parametrize("model", ["linear", "ukf", "imm"])
def test_a_frozen_velocity_does_not_pull_the_filter_off_the_runway(model: Any) -> None:
    seen, summary = braking(frozen=True), FilterSummary()

    result, _ = filter_flights(seen, seen, np.zeros(70, dtype=np.bool_), AdsbFilterSettings(), model, False, summary)

    assert not summary.fallbacks
    # A few reports are lost until the velocity is found out, then positions alone lead.
    assert (~result.accepted).sum() < 12
    late = slice(45, 70)
    assert np.sqrt(np.mean((result.position_m[late, 1] - seen.north_m[late]) ** 2)) < 6.0
    assert result.velocity_mps[late, 1] == pytest.approx(8.0, abs=6.0)
