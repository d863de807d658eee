"""Duplicates, stale places and jumps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.repeats import SensorMemory, is_implausible

FAST, SLOW = 200.0, 5.0


def compare(memory: SensorMemory, *reports: tuple[float, float], speed_mps: float = FAST) -> list[str]:
    """Reports ``(time, place)`` of one sensor about one track, in order of arrival: what each is."""
    n = len(reports)
    place = np.array([[p, -p] for _, p in reports])
    found = memory.compare(
        np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int16), np.array([t for t, _ in reports]), place,
        lambda rows: np.full(len(rows), speed_mps),
    )  # fmt: skip
    assert all(sum(row) <= 1 for row in zip(*found, strict=True))
    return [next((w for w, v in zip(("duplicate", "stale", "behind"), row, strict=True) if v), "") for row in
            zip(*found, strict=True)]  # fmt: skip


def test_first_report_is_nothing_special() -> None:
    assert compare(SensorMemory(1, 1), (10.0, 1.0)) == [""]


@pytest.mark.parametrize("together", [True, False])
def test_the_same_report_twice_is_a_duplicate(together: bool) -> None:
    memory, reports = SensorMemory(1, 1), ((10.0, 1.0), (10.0, 1.0))

    found = compare(memory, *reports) if together else compare(memory, reports[0]) + compare(memory, reports[1])

    assert found == ["", "duplicate"]


def test_a_duplicate_is_found_with_other_reports_in_between() -> None:
    assert compare(SensorMemory(1, 1), (10.0, 1.0), (11.0, 2.0), (10.0, 1.0)) == ["", "", "duplicate"]


def test_the_newest_report_is_remembered_even_if_it_did_not_come_last() -> None:
    memory = SensorMemory(1, 1)
    compare(memory, (10.0, 1.0), (12.0, 3.0), (11.0, 2.0))

    assert compare(memory, (12.0, 3.0)) == ["duplicate"]
    assert compare(memory, (13.0, 3.0)) == ["stale"]


@pytest.mark.parametrize("together", [True, False])
def test_the_same_place_with_a_newer_time_is_stale(together: bool) -> None:
    memory, reports = SensorMemory(1, 1), ((10.0, 1.0), (11.0, 1.0))

    found = compare(memory, *reports) if together else compare(memory, reports[0]) + compare(memory, reports[1])

    assert found == ["", "stale"]


def test_stale_places_go_on_being_stale() -> None:
    assert compare(SensorMemory(1, 1), (1.0, 1.0), (2.0, 1.0), (3.0, 1.0), (4.0, 2.0)) == ["", "stale", "stale", ""]


def test_a_standing_aircraft_repeats_its_place_truthfully() -> None:
    assert compare(SensorMemory(1, 1), (10.0, 1.0), (11.0, 1.0), speed_mps=SLOW) == ["", ""]


def test_an_aircraft_of_unknown_speed_counts_as_moving() -> None:
    assert compare(SensorMemory(1, 1), (10.0, 1.0), (11.0, 1.0), speed_mps=np.nan) == ["", "stale"]


def test_an_older_report_is_behind() -> None:
    memory = SensorMemory(1, 1)

    assert compare(memory, (10.0, 1.0), (9.0, 0.5)) == ["", "behind"]
    assert compare(memory, (8.0, 0.2), (10.0, 7.0)) == ["behind", "behind"]


def test_sensors_and_tracks_are_kept_apart() -> None:
    memory = SensorMemory(2, 2)

    found = memory.compare(
        np.array([0, 0, 1, 0]), np.array([0, 1, 0, 0], dtype=np.int16), np.full(4, 10.0), np.ones((4, 2)),
        lambda rows: np.full(len(rows), FAST),
    )  # fmt: skip

    assert found[0].tolist() == [False, False, False, True]
    assert not found[1].any()
    assert not found[2].any()


def test_a_cleared_track_remembers_nothing() -> None:
    memory = SensorMemory(2, 1)
    compare(memory, (10.0, 1.0))

    memory.clear(np.array([0]))

    assert compare(memory, (10.0, 1.0)) == [""]


def test_growth_keeps_what_is_remembered() -> None:
    memory = SensorMemory(1, 1)
    compare(memory, (10.0, 1.0))

    memory.grow(3)

    assert compare(memory, (10.0, 1.0)) == ["duplicate"]
    assert memory.place.shape == (3, 1, 2)


reports = st.tuples(st.integers(0, 1), st.integers(0, 1), st.integers(0, 4), st.integers(0, 2))


def one_by_one(calls: list[list[tuple[int, int, int, int]]]) -> list[tuple[bool, bool, bool]]:
    """The rules in plain words, report by report."""
    newest: dict[tuple[int, int], tuple[int, int]] = {}
    found = []
    for call in calls:
        for row, (slot, sensor, time, place) in enumerate(call):
            before = newest.get((slot, sensor), (-1, -1))
            # What stands twice in one call is found at once; across calls only the buffer can tell what lies behind.
            duplicate = before == (time, place) or call[row] in call[:row]
            found.append((duplicate, before[1] == place and time > before[0], time <= before[0] and not duplicate))
            if time > before[0]:
                newest[slot, sensor] = time, place
    return found


@given(st.lists(st.lists(reports, max_size=8), max_size=6))
def test_calls_of_any_length_are_one_report_after_the_other(calls: list[list[tuple[int, int, int, int]]]) -> None:
    memory, found = SensorMemory(2, 2), []
    for call in calls:
        slot, sensor, time, place = (np.array([r[i] for r in call], dtype=np.float64) for i in range(4))
        result = memory.compare(
            slot.astype(np.int64), sensor.astype(np.int16), time, np.stack([place, -place], axis=1),
            lambda rows: np.full(len(rows), FAST),
        )  # fmt: skip
        found += list(zip(*(r.tolist() for r in result), strict=True))

    assert found == one_by_one(calls)


def test_no_aircraft_flies_faster_than_the_limit() -> None:
    away = np.array([9_000.0, 11_000.0, 10_000.0 + 690.0 * 60, 10_000.0 + 710.0 * 60, 11_000.0])
    elapsed = np.array([0.0, 0.0, 60.0, 60.0, -30.0])

    assert is_implausible(away, elapsed).tolist() == [False, True, False, True, False]
