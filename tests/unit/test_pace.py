"""The worker's pace: no rest under light load, thinning before dropping, and back again by itself."""

from __future__ import annotations

from aeroskein_service.pace import INTERRUPTS_S, LINGER_S, TURN_BYTES, Pace

PATIENCE_S = 1.0


def worked(busy: float, seconds: float = 5.0, turn_s: float = 0.004, taken: int = 20_000) -> Pace:
    """A worker that has been busy for a share of its time."""
    pace, now_s = Pace(PATIENCE_S), 100.0
    while now_s < 100.0 + seconds:
        pace.worked(now_s, now_s + turn_s, taken)
        now_s += turn_s / busy
    return pace


def test_a_worker_with_little_to_do_does_not_rest():
    assert Pace(PATIENCE_S).linger_s == 0.0
    assert worked(0.05).linger_s == 0.0
    assert worked(0.3).linger_s == 0.0


def test_the_busier_the_worker_the_longer_it_rests():
    rests = [worked(busy).linger_s for busy in (0.7, 0.8, 0.9, 0.99)]
    assert rests == sorted(rests)
    assert 0.0 < rests[0] < rests[-1] == LINGER_S


def test_a_worker_that_is_busy_with_single_reports_hardly_rests():
    assert worked(0.99, taken=200).linger_s < 0.001
    assert worked(0.99, taken=7_500).linger_s == 0.5 * LINGER_S


def test_rest_ends_soon_after_the_load():
    pace = worked(0.99)
    pace.worked(107.0, 107.002, 100)
    assert pace.linger_s == 0.0


def test_nothing_is_dropped_while_input_waits_no_longer_than_the_patience():
    pace = worked(0.99)
    assert pace.excess(0.0) is None
    assert pace.excess(PATIENCE_S) is None


def test_what_may_stay_is_what_the_worker_gets_through_in_half_of_the_patience():
    # 10,000 bytes in 4 ms.
    keep = worked(0.99, taken=10_000).excess(1.01 * PATIENCE_S)
    assert keep is not None
    assert abs(keep - 0.5 * PATIENCE_S * 2_500_000) < 10.0


def test_the_speed_is_that_of_the_last_seconds():
    pace, now_s = worked(0.99), 105.0
    for _ in range(1000):
        pace.worked(now_s, now_s + 0.01, 20_000)
        now_s += 0.01
    keep = pace.excess(2.0)
    assert keep is not None
    assert abs(keep - 0.5 * PATIENCE_S * 2_000_000) < 10_000.0


def test_a_worker_that_was_only_held_up_drops_no_more_than_it_must():
    assert worked(0.1, taken=100).excess(10.0) == TURN_BYTES


def test_a_worker_that_has_not_worked_yet_drops_nothing():
    assert Pace(PATIENCE_S).excess(100.0) is None


def test_live_points_are_thinned_before_anything_is_dropped_and_come_back_step_by_step():
    pace, steps = Pace(PATIENCE_S), []
    waits = [0.1] * 5 + [0.6] * 40 + [0.4] * 10 + [0.1] * 40
    for tick, waited_s in enumerate(waits):
        every_s = pace.thinning_s(waited_s, 0.1 * tick)
        assert pace.excess(waited_s) is None
        if not steps or steps[-1] != every_s:
            steps.append(every_s)
    assert steps == [0.0, 1.0, 2.0, 4.0, 2.0, 1.0, 0.0]


def test_a_short_wait_between_the_limits_changes_nothing():
    pace = Pace(PATIENCE_S)
    pace.thinning_s(0.9, 0.0)
    assert [pace.thinning_s(0.4, 10.0 + tick) for tick in range(5)] == [1.0] * 5


def shared(input_s: float, late_s: float, portion_s: float = 0.08, rounds: int = 200) -> float:
    """Share of the worker that elements get while both they and input are too much."""
    pace, closing_s = Pace(PATIENCE_S), 0.0
    for _ in range(rounds):
        pace.took_in(input_s, late_s)
        while pace.may_close(waited_s=1.0):
            pace.closed(portion_s)
            closing_s += portion_s
    return closing_s / (closing_s + rounds * input_s)


def test_elements_close_as_long_as_no_input_waits():
    pace = Pace(PATIENCE_S)
    for _ in range(20):
        assert pace.may_close(waited_s=0.01)
        pace.closed(0.08)


def test_input_comes_first_until_elements_are_late_whatever_a_portion_takes():
    for input_s in (0.005, 0.05, 0.2):
        assert abs(shared(input_s, late_s=0.5) - 1 / 3) < 0.03
        assert abs(shared(input_s, late_s=3.0) - 1 / 2) < 0.03


def test_a_long_rest_of_either_is_forgotten():
    busy, idle = Pace(PATIENCE_S), Pace(PATIENCE_S)
    for _ in range(1000):
        busy.took_in(0.1, 0.0)
        idle.closed(0.1)
    portions = 0
    while busy.may_close(waited_s=1.0):
        busy.closed(0.05)
        portions += 1
    assert portions <= 6
    for _ in range(6):
        idle.took_in(0.1, 0.0)
    assert idle.may_close(waited_s=1.0)


def test_input_interrupts_a_pass_at_once_under_light_load_and_later_the_busier_the_worker():
    assert Pace(PATIENCE_S).patience_while_closing_s == 0.0
    assert worked(0.3).patience_while_closing_s == 0.0
    waits = [worked(busy).patience_while_closing_s for busy in (0.67, 0.7, 0.99)]
    assert waits == sorted(waits)
    assert 0.0 < waits[0] < waits[-1] == INTERRUPTS_S
