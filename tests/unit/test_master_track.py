"""Which sensor leads: the most accurate that is heard, with hand-over when it falls silent and return."""

import numpy as np
import pytest

from aeroskein.master_track import MasterChoice

ADSB, RADAR1, RADAR2 = 0, 1, 2
PERIODS_S = np.array([1.0, 4.0, 8.0])
TRACE_M2 = np.array([200.0, 5_000.0, 20_000.0])
ELEMENT_S = 4.0


class Elements:
    """One track's elements of four seconds, one after the other."""

    def __init__(self, capacity: int = 1, slot: int = 0) -> None:
        self.choice = MasterChoice(capacity, PERIODS_S)
        self.slot, self.end_s = slot, 100.0

    def close(self, *heard: tuple[float, int], trace_m2: float | None = None, overlap: tuple[float, int] = ()) -> int:
        """Close one element in which sensors were heard so long after its start; who leads?"""
        start, self.end_s = self.end_s, self.end_s + ELEMENT_S
        events = sorted([*heard, *([overlap] if overlap else [])])
        time = np.array([start + after for after, _ in events]).reshape(-1, 1)
        sensor = np.array([s for _, s in events], dtype=np.int64).reshape(-1, 1)
        trace = TRACE_M2[sensor] if trace_m2 is None else np.full(sensor.shape, trace_m2)
        accepted = np.ones(sensor.shape, dtype=bool)
        slots = np.array([self.slot])
        return int(self.choice.choose(slots, np.array([self.end_s]), time, sensor, trace, accepted)[0])


SECONDS = tuple((after, ADSB) for after in (0.5, 1.5, 2.5, 3.5))


def test_the_most_accurate_sensor_leads() -> None:
    assert Elements().close(*SECONDS, (1.0, RADAR1), (2.0, RADAR2)) == ADSB


def test_accuracy_decides_not_the_kind_of_sensor() -> None:
    track = Elements()
    track.close(*SECONDS, (1.0, RADAR1))

    masters = [track.close((0.3, RADAR1), (1.3, RADAR1), (2.3, RADAR1), trace_m2=10.0), track.close(*SECONDS)]

    # The radar has said three times that it is better now, so it leads, until it is not heard any more.
    assert masters == [RADAR1, RADAR1]
    assert [track.close(*SECONDS) for _ in range(3)] == [RADAR1, ADSB, ADSB]


def test_nobody_leads_where_nobody_is_heard() -> None:
    track = Elements()

    assert [track.close() for _ in range(2)] == [-1, -1]


def test_a_single_report_leads_where_there_is_no_other() -> None:
    assert Elements().close((1.0, RADAR2)) == RADAR2


def test_a_silent_master_hands_over_to_the_next_best() -> None:
    track = Elements()
    for _ in range(3):
        track.close(*SECONDS, (1.0, RADAR1))

    masters = [track.close((1.0, RADAR1)) for _ in range(3)]

    # 3.5 s after its start ADS-B was heard last; at the end of the next element that is 4.5 s ago.
    assert masters == [RADAR1] * 3


@pytest.mark.parametrize(("quiet", "master"), [(2.9, ADSB), (3.1, RADAR1)])
def test_silence_begins_after_three_seconds_of_a_fast_sensor(quiet: float, master: int) -> None:
    track = Elements()
    for _ in range(3):
        track.close(*SECONDS, (1.0, RADAR1))

    assert track.close((ELEMENT_S - quiet, ADSB), (1.0, RADAR1)) == master


def test_silence_begins_after_two_and_a_half_periods_of_a_slow_sensor() -> None:
    track = Elements()
    for _ in range(3):
        track.close((1.0, RADAR1))

    # Heard 3 s before the end of the third element: 7 s and 11 s before the ends of the next two.
    assert [track.close(), track.close()] == [RADAR1, -1]


def test_a_master_that_was_silent_leads_again_after_three_reports() -> None:
    track = Elements()
    for _ in range(3):
        track.close(*SECONDS, (1.0, RADAR1))
    for _ in range(4):
        track.close((1.0, RADAR1))

    masters = [
        track.close((3.0, ADSB), (1.0, RADAR1)),
        track.close((1.0, ADSB), (1.0, RADAR1)),
        track.close((0.0, ADSB), (1.0, RADAR1)),
    ]

    # The second report came within three seconds of the first, the third too.
    assert masters[:2] == [RADAR1, RADAR1]
    assert track.close(*SECONDS, (1.0, RADAR1)) == ADSB


def test_a_report_in_two_overlapping_windows_counts_once() -> None:
    track = Elements()
    for _ in range(3):
        track.close((1.0, RADAR1))
    track.close((2.5, ADSB), (1.0, RADAR1))
    track.close((1.0, ADSB), (1.0, RADAR1), overlap=(-1.5, ADSB))

    master = track.close((1.0, RADAR1), overlap=(-3.0, ADSB))

    # Twice heard, each time in two windows: that is not three times.
    assert track.choice.run[0, ADSB] == 2
    assert master == RADAR1


def test_refused_reports_do_not_count() -> None:
    choice = MasterChoice(1, PERIODS_S)
    sensor = np.array([[ADSB], [RADAR1]])

    master = choice.choose(
        np.array([0]), np.array([4.0]), np.array([[1.0], [2.0]]), sensor, TRACE_M2[sensor], sensor == RADAR1
    )  # fmt: skip

    assert master.tolist() == [RADAR1]


def test_tracks_are_chosen_for_side_by_side_as_alone() -> None:
    together = MasterChoice(2, PERIODS_S)
    sensor = np.array([[RADAR1, RADAR2], [ADSB, ADSB]])
    accepted = np.array([[True, True], [True, False]])

    masters = together.choose(
        np.array([1, 0]), np.array([4.0, 4.0]), np.array([[1.0, 1.0], [2.0, 2.0]]), sensor, TRACE_M2[sensor], accepted
    )  # fmt: skip

    assert masters.tolist() == [ADSB, RADAR2]
    assert together.master.tolist() == [RADAR2, ADSB]


def test_a_new_track_in_an_old_slot_has_no_master() -> None:
    track = Elements()
    track.close(*SECONDS)

    track.choice.clear(np.array([0]))

    assert track.choice.master.tolist() == [-1]
    assert track.close() == -1


def test_growth_keeps_masters() -> None:
    track = Elements()
    track.close(*SECONDS)

    track.choice.grow(4)

    assert track.choice.master.tolist() == [ADSB, -1, -1, -1]
    assert track.close((1.0, ADSB)) == ADSB


def test_places_of_a_window_that_hold_no_report_say_nothing_about_accuracy() -> None:
    choice = MasterChoice(1, PERIODS_S)
    time = np.array([100.5, 101.0, 101.5, 102.5, 1e18])[:, None]
    sensor = np.array([RADAR1, RADAR1, RADAR1, RADAR2, 0])[:, None]
    trace = np.append(TRACE_M2[sensor[:4, 0]], np.nan)[:, None]

    master = choice.choose(np.array([0]), np.array([104.0]), time, sensor, trace, np.isfinite(trace))

    assert master.tolist() == [RADAR1]
    assert np.isfinite(choice.trace_m2[0, [RADAR1, RADAR2]]).all()
