"""The live product: report by report in order of arrival, many aircraft at once."""

import numpy as np
import pytest
from tests import plain_algebra as plain
from tests.builders import measurements

from aeroskein import kalman
from aeroskein.live import LATEST_LAG_S, LiveProduct, first_state
from aeroskein.measurements import Measurements

ALTITUDE_SIGMA_M = np.array([8.0, 8.0])


def flights(seed: int = 1, seconds: int = 12) -> Measurements:
    """Three aircraft, sorted by slot, then time; the second one with twice as many reports."""
    rng = np.random.default_rng(seed)
    slot = np.repeat([0, 1, 1, 2], seconds)
    time = np.concatenate([np.arange(seconds) + 0.1 * k for k in range(4)])
    order = np.lexsort((time, slot))
    slot, time = slot[order], time[order]
    n = len(slot)
    return measurements(
        n, slot=slot, time_s=time, east_m=150.0 * time + 1000.0 * slot + rng.normal(0, 10, n),
        north_m=rng.normal(0, 10, n), v_east_mps=150.0 + rng.normal(0, 1, n), v_north_mps=rng.normal(0, 1, n),
        velocity_variance=np.where(slot == 2, np.nan, 1.0), time_variance=0.01, altitude_m=9000.0, sensor=slot % 2,
    )  # fmt: skip


def begun(reports: Measurements) -> tuple[LiveProduct, np.ndarray]:
    """A product whose tracks began with their first reports."""
    live = LiveProduct(3, ALTITUDE_SIGMA_M)
    live.clear(np.arange(3))
    first = np.zeros(len(reports), dtype=bool)
    first[np.unique(reports.slot, return_index=True)[1]] = True
    live.start(reports.take(first))
    return live, first


def test_a_batch_of_many_reports_is_one_report_after_the_other() -> None:
    reports = flights()
    together, first = begun(reports)
    alone, _ = begun(reports)

    accepted = together.receive(reports, first)
    one_by_one = np.concatenate([
        alone.receive(reports.take(np.array([k])), first[[k]]) for k in np.argsort(reports.time_s, kind="stable")
    ])  # fmt: skip

    plain.close(together.bank.rows, alone.bank.rows, rtol=1e-10)
    assert np.array_equal(together.vertical.rows, alone.vertical.rows, equal_nan=True)
    assert accepted.all()
    assert one_by_one.all()
    assert together.sources.tolist() == alone.sources.tolist() == [[12, 0], [0, 24], [12, 0]]


def test_a_first_report_is_the_state() -> None:
    report = measurements(1, east_m=5.0, north_m=6.0, v_east_mps=100.0, v_north_mps=0.0, velocity_variance=4.0,
                          time_variance=0.04)  # fmt: skip

    x, P = first_state(report)

    assert x[:, 0].tolist() == [5.0, 6.0, 100.0, 0.0, 0.0, 0.0]
    full = kalman.to_matrix(P)[0]
    # The stamp's error along the flight: 0.2 s at 100 m/s, whose own uncertainty adds next to nothing.
    assert np.diag(full)[:4].tolist() == [100.0 + 0.04 * 10_004.0, 100.0 + 0.04 * 4.0, 4.0, 4.0]


def test_without_velocity_a_flight_may_go_anywhere() -> None:
    x, P = first_state(measurements(1, r_ee=25.0, r_en=5.0, r_nn=36.0))

    full = kalman.to_matrix(P)[0]
    assert not x[2:].any()
    assert np.diag(full)[2] == 250.0**2
    assert full[0, 1] == full[1, 0] == 5.0


def test_a_straight_flight_that_only_radars_see_is_known_nearly_as_well_as_if_no_turn_were_expected() -> None:
    n, r = 80, 100.0**2
    rng = np.random.default_rng(3)
    time_s = 4.0 * np.arange(n)
    plots = measurements(
        n, time_s=time_s, east_m=200.0 * time_s + rng.normal(0, 100.0, n), north_m=rng.normal(0, 100.0, n), r_ee=r,
        r_nn=r, v_east_mps=np.nan, v_north_mps=np.nan, velocity_variance=np.nan, time_variance=0.0,
    )  # fmt: skip
    live = LiveProduct(1, ALTITUDE_SIGMA_M)
    live.clear(np.zeros(1, dtype=np.int64))
    live.start(plots.take(np.zeros(1, dtype=np.int64)))

    assert live.receive(plots, np.arange(n) == 0).all()

    # A filter of constant velocity under white acceleration, one axis.
    P, F = np.diag([r, 250.0**2]), np.array([[1.0, 4.0], [0.0, 1.0]])
    for _ in range(n - 1):
        P = F @ P @ F.T + 0.08**2 * np.array([[64.0 / 3.0, 8.0], [8.0, 4.0]])
        P -= np.outer(P[:, 0], P[:, 0]) / (P[0, 0] + r)
    steady = live.bank.take(np.zeros(1, dtype=np.int64)).P[:, 0, 0]
    mixture = live.state_at(np.zeros(1, dtype=np.int64), time_s[-1:])[1][:, 0]
    assert steady[[0, 12]] == pytest.approx([P[0, 0], P[1, 1]], rel=0.1)
    assert steady[[7, 17]] == pytest.approx([P[0, 0], P[1, 1]], rel=0.1)
    assert max(mixture[0], mixture[7]) < 1.5 * P[0, 0]


def test_late_reports_improve_the_state_and_do_not_turn_it_back() -> None:
    reports = flights()
    live, first = begun(reports)
    live.receive(reports, first)
    before_s, before = live.bank.time_s.copy(), live.state_at(np.arange(3), live.bank.time_s)[1]
    late = reports.take(np.array([10]))
    late.time_s[:] -= 0.5
    late.east_m[:] -= 75.0

    assert live.receive(late, np.array([False])).all()

    after = live.state_at(np.arange(3), live.bank.time_s)[1]
    assert np.array_equal(live.bank.time_s, before_s)
    assert after[0, 0] < before[0, 0]


def test_reports_too_late_for_the_live_product_change_nothing() -> None:
    reports = flights()
    live, first = begun(reports)
    live.receive(reports, first)
    before = live.bank.rows.copy()
    late = reports.take(np.array([11]))
    late.time_s[:] -= LATEST_LAG_S + 0.1

    accepted = live.receive(late, np.array([False]))

    # Without a verdict: the elements will decide.
    assert accepted.all()
    plain.close(live.bank.rows, before, rtol=1e-15)


def test_outliers_are_refused_and_counted() -> None:
    reports = flights()
    live, first = begun(reports)
    reports.north_m[8] += 5_000.0

    accepted = live.receive(reports, first)

    assert np.flatnonzero(~accepted).tolist() == [8]
    assert live.rejected.tolist() == [1, 0, 0]
    assert live.sources[0].tolist() == [11, 0]


def test_growth_and_clearing_leave_nothing_behind() -> None:
    reports = flights()
    live, first = begun(reports)
    live.receive(reports, first)

    live.grow(5)
    assert live.sources.shape == (5, 2)
    live.clear(np.array([0]))

    assert np.isneginf(live.bank.time_s[[0, 3, 4]]).all()
    assert not live.sources[0].any()
    assert live.sources[2, 0] == 12
    assert np.isneginf(live.published_s[0])
