"""Rings of reports: what is not settled yet is never lost, and what does not fit is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.builders import ADSB, RADAR1, RADAR2, engine_settings, measurements

from aeroskein.buffers import ReportBuffers, ring_depth
from aeroskein.lanes import ranks
from aeroskein.measurements import Measurements
from aeroskein.settings import SensorSettings

NEVER = -np.inf


def held(buffers: ReportBuffers, slot: int) -> list[float]:
    """Times in a ring."""
    times = buffers.rows.time_s[slot]
    return sorted(times[np.isfinite(times)].tolist())


def put(buffers: ReportBuffers, times: list[float], *, slot: int = 0, settled_s: float = NEVER) -> list[bool]:
    n = len(times)
    reports = measurements(n, slot=slot, time_s=times, stamp_s=times, east_m=np.array(times) * 100.0)
    return buffers.add(reports, np.full(n, settled_s)).tolist()


def test_reports_are_kept_as_they_came() -> None:
    buffers = ReportBuffers(2, 8)
    reports = measurements(3, slot=[0, 1, 1], time_s=[3.0, 1.0, 2.0], east_m=[30.0, 10.0, 20.0], sensor=[0, 1, 0])

    assert buffers.add(reports, np.full(3, NEVER)).all()

    kept = buffers.rows[np.array([1, 1]), np.array([0, 1])]
    assert np.array_equal(kept, reports.packed()[1:], equal_nan=True)
    assert held(buffers, 0) == [3.0]


def test_a_full_ring_refuses_rather_than_lose_what_is_not_settled() -> None:
    buffers = ReportBuffers(1, 4)

    verdicts = put(buffers, [1.0, 2.0, 3.0, 4.0, 5.0])

    assert verdicts == [True] * 4 + [False]
    assert held(buffers, 0) == [1.0, 2.0, 3.0, 4.0]


def test_settled_reports_give_way() -> None:
    buffers = ReportBuffers(1, 4)
    put(buffers, [1.0, 2.0, 3.0, 4.0])

    verdicts = put(buffers, [5.0, 6.0, 7.0], settled_s=2.0)

    assert verdicts == [True, True, False]
    assert held(buffers, 0) == [3.0, 4.0, 5.0, 6.0]


def test_one_full_ring_does_not_touch_the_others() -> None:
    buffers = ReportBuffers(2, 2)
    reports = measurements(6, slot=[0, 0, 0, 0, 1, 1], time_s=np.arange(6.0))

    assert buffers.add(reports, np.full(6, NEVER)).tolist() == [True, True, False, False, True, True]
    assert (held(buffers, 0), held(buffers, 1)) == ([0.0, 1.0], [4.0, 5.0])


adds = st.lists(
    st.tuples(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 30)), max_size=7), st.integers(-5, 25)), max_size=15
)


@given(adds)
def test_nothing_unsettled_is_lost_and_everything_refused_is_told(
    steps: list[tuple[list[tuple[int, int]], int]],
) -> None:
    buffers, depth = ReportBuffers(3, 5), 5
    kept: list[tuple[int, float]] = []
    settled = NEVER
    for reports, until in steps:
        settled = max(settled, float(until))
        # As in the engine: what lies behind the settled time is refused as late before it gets here.
        fresh = sorted((slot, float(t)) for slot, t in reports if t > settled)
        made = measurements(len(fresh), slot=[s for s, _ in fresh] or 0, time_s=[t for _, t in fresh] or 0.0)

        verdicts = buffers.add(made, np.full(len(fresh), settled))

        for slot in range(3):
            refused = sum(not v for v, (s, _) in zip(verdicts, fresh, strict=True) if s == slot)
            open_now = [t for s, t in kept if s == slot and t > settled]
            wanted = sum(s == slot for s, _ in fresh)
            # Refused only where a ring of this depth could not hold all that is open, whatever it overwrites first.
            assert refused == 0 or len(open_now) + wanted > depth or len(held(buffers, slot)) == depth
        kept += [r for v, r in zip(verdicts, fresh, strict=True) if v]
        for slot in range(3):
            open_now = sorted(t for s, t in kept if s == slot and t > settled)
            assert [t for t in held(buffers, slot) if t > settled] == open_now


def test_reports_of_an_aircraft_that_keeps_to_its_periods_never_overflow() -> None:
    settings = engine_settings(ADSB, RADAR1, RADAR2)
    buffers = ReportBuffers(1, ring_depth(settings))
    # One element behind, the look-ahead in front, watermark and six seconds of lateness.
    window_s = 4.0 * (1.0 + 1.0) + 2.0 + 1.0 + 6.0

    for second in range(200):
        times = [float(second)] + [float(second)] * (second % 4 == 0) + [float(second)] * (second % 8 == 0)
        assert all(put(buffers, times, settled_s=second - window_s))


@pytest.mark.parametrize("lookahead", [0, 1, 5])
def test_rings_are_deep_enough_for_the_look_ahead(lookahead: int) -> None:
    settings = engine_settings(ADSB, element_s=8.0, lookahead=lookahead)

    assert ring_depth(settings) >= 8.0 * (lookahead + 2.5)


def test_rings_have_a_bounded_depth() -> None:
    swift = SensorSettings(id="swift", kind="wam", period_s=0.01)

    assert ring_depth(engine_settings(swift, lookahead=5, element_s=30.0)) == 512


def test_a_report_that_is_there_is_known_again() -> None:
    buffers = ReportBuffers(2, 8)
    put(buffers, [1.0, 2.0], slot=1)
    same = measurements(1, slot=1, time_s=2.0, stamp_s=2.0, east_m=200.0)

    assert buffers.holds(same).tolist() == [True]


@pytest.mark.parametrize(
    "change", [{"stamp_s": 2.1}, {"east_m": 200.1}, {"north_m": 0.1}, {"sensor": 1.0}, {"slot": 0}]
)
def test_what_differs_in_anything_is_another_report(change: dict[str, float]) -> None:
    buffers = ReportBuffers(2, 8)
    put(buffers, [1.0, 2.0], slot=1)
    other = measurements(1, **({"slot": 1, "time_s": 2.0, "stamp_s": 2.0, "east_m": 200.0} | change))

    assert buffers.holds(other).tolist() == [False]


def test_a_plot_is_known_again_although_its_height_is_seen_otherwise_now() -> None:
    buffers = ReportBuffers(1, 8)
    plot = {"time_s": 2.0, "stamp_s": 2.0, "range_m": 60_000.0, "azimuth_deg": 45.0, "sensor": 1.0}
    buffers.add(measurements(1, east_m=41_000.0, **plot), np.array([NEVER]))

    again = measurements(1, east_m=40_950.0, **(plot | {"time_s": 2.001}))
    next_scan = measurements(1, east_m=41_000.0, **(plot | {"time_s": 6.0, "stamp_s": 6.0}))

    assert buffers.holds(again).tolist() == [True]
    assert buffers.holds(next_scan).tolist() == [False]


def test_the_oldest_report_is_found_wherever_it_lies() -> None:
    buffers = ReportBuffers(3, 4)
    put(buffers, [3.0, 1.0, 2.0], slot=0)
    put(buffers, [7.0], slot=2)

    assert buffers.earliest_s(np.array([2, 0, 1])).tolist() == [7.0, 1.0, np.inf]


def test_reports_come_back_in_order_of_track_and_time() -> None:
    buffers = ReportBuffers(3, 4)
    put(buffers, [3.0, 1.0, 2.0], slot=2)
    put(buffers, [9.0, 8.0], slot=0)

    reports = buffers.reports(np.array([2, 0]), np.array([1.5, 0.0]))

    assert isinstance(reports, Measurements)
    assert list(zip(reports.slot.tolist(), reports.time_s.tolist(), strict=True)) == [
        (0, 8.0), (0, 9.0), (2, 2.0), (2, 3.0),
    ]  # fmt: skip
    assert reports.east_m.tolist() == [800.0, 900.0, 200.0, 300.0]


def test_a_cleared_ring_is_empty() -> None:
    buffers = ReportBuffers(2, 2)
    put(buffers, [1.0, 2.0], slot=0)

    buffers.clear(np.array([0]))

    assert held(buffers, 0) == []
    assert put(buffers, [0.5, 0.6], slot=0) == [True, True]


def test_growth_keeps_what_is_buffered() -> None:
    buffers = ReportBuffers(1, 2)
    put(buffers, [1.0])

    buffers.grow(3)

    assert held(buffers, 0) == [1.0]
    assert put(buffers, [2.0, 3.0]) == [True, False]
    assert put(buffers, [4.0, 5.0], slot=2) == [True, True]


@given(st.lists(st.integers(0, 5)))
def test_ranks_count_within_each_run(values: list[int]) -> None:
    groups = np.sort(np.array(values, dtype=np.int64))

    found = ranks(groups)

    assert found.tolist() == [int((groups[:k] == groups[k]).sum()) for k in range(len(groups))]
