"""Gates that open again: refusals in a row, and who speaks against them."""

import numpy as np
import pytest

from aeroskein.gating import ASTRAY_MPS, MISSES_TO_OPEN, GateMemory, astray_velocity_variance

ONE = np.array([0])
GOOD_M2, BAD_M2 = 50.0, 5000.0


def note(memory: GateMemory, sensor: int, *, accepted: bool, trace_m2: float = GOOD_M2, lane: int = 0) -> None:
    memory.note(np.array([lane]), np.array([sensor]), np.array([trace_m2]), np.array([accepted]))


def opens(memory: GateMemory, sensor: int, trace_m2: float = GOOD_M2, lane: int = 0) -> bool:
    return bool(memory.opens(np.array([lane]), np.array([sensor]), np.array([trace_m2]))[0])


def refuse(memory: GateMemory, sensor: int, times: int, trace_m2: float = GOOD_M2) -> None:
    for _ in range(times):
        note(memory, sensor, accepted=False, trace_m2=trace_m2)


@pytest.mark.parametrize("refusals", range(MISSES_TO_OPEN + 2))
def test_a_gate_opens_after_four_refusals_in_a_row(refusals: int) -> None:
    memory = GateMemory.empty(1, 2)

    refuse(memory, 0, refusals)

    assert opens(memory, 0) == (refusals >= 4)


def test_an_accepted_report_begins_the_count_anew() -> None:
    memory = GateMemory.empty(1, 2)
    refuse(memory, 0, 3)

    note(memory, 0, accepted=True)
    refuse(memory, 0, 3)

    assert not opens(memory, 0)


def test_a_gate_stays_shut_against_a_better_source() -> None:
    memory = GateMemory.empty(1, 2)

    for _ in range(20):
        note(memory, 0, accepted=False, trace_m2=BAD_M2)
        note(memory, 1, accepted=True, trace_m2=GOOD_M2)

    assert not opens(memory, 0, BAD_M2)
    assert not opens(memory, 0, GOOD_M2)
    assert opens(memory, 0, 0.9 * GOOD_M2)


def test_a_gate_opens_against_a_worse_source() -> None:
    memory = GateMemory.empty(1, 2)

    for _ in range(MISSES_TO_OPEN):
        note(memory, 0, accepted=False, trace_m2=GOOD_M2)
        note(memory, 1, accepted=True, trace_m2=BAD_M2)

    assert opens(memory, 0, GOOD_M2)


def test_what_was_accepted_before_the_refusals_does_not_speak_against_a_source() -> None:
    memory = GateMemory.empty(1, 2)
    note(memory, 1, accepted=True)

    refuse(memory, 0, MISSES_TO_OPEN, BAD_M2)

    assert opens(memory, 0, BAD_M2)


def test_lanes_do_not_touch_each_other() -> None:
    memory = GateMemory.empty(3, 2)

    for _ in range(MISSES_TO_OPEN):
        note(memory, 0, accepted=False, lane=1)

    assert [opens(memory, 0, lane=lane) for lane in range(3)] == [False, True, False]


def test_several_lanes_are_noted_at_once_as_one_by_one() -> None:
    rng = np.random.default_rng(1)
    together, alone = GateMemory.empty(4, 3), GateMemory.empty(4, 3)

    for _ in range(50):
        lanes = rng.permutation(4)[: rng.integers(1, 5)]
        sensor, trace = rng.integers(0, 3, len(lanes)), rng.uniform(1.0, 100.0, len(lanes))
        accepted = rng.random(len(lanes)) < 0.4
        together.note(lanes, sensor, trace, accepted)
        for i, lane in enumerate(lanes):
            alone.note(np.array([lane]), sensor[[i]], trace[[i]], accepted[[i]])

    assert np.array_equal(together.misses, alone.misses)
    assert np.array_equal(together.best_m2, alone.best_m2)


def test_a_copy_is_a_copy_until_it_is_put_back() -> None:
    memory = GateMemory.empty(2, 1)
    copy = memory.take(np.array([1]))

    refuse(copy, 0, 2)
    before = memory.misses.copy()
    memory.put(np.array([1]), copy)

    assert not before.any()
    assert memory.misses[:, 0].tolist() == [0, 2]


def test_an_astray_velocity_is_no_wider_than_an_aircraft_flies() -> None:
    off_m2 = np.array([0.0, 400.0**2, 1e5**2])

    assert astray_velocity_variance(off_m2).tolist() == [0.0, 100.0**2, ASTRAY_MPS**2]
