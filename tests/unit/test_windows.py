"""Windows: the reports of closing elements and the marks among them, in order of time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.builders import measurements

from aeroskein.buffers import ReportBuffers
from aeroskein.rings import Rings
from aeroskein.windows import CENTRE, FOUNDING, NOTHING, REPORT, SETTLED, Window, gather

EVERYTHING = (-np.inf, np.inf)


def rings(*times: list[float], depth: int = 8) -> Rings:
    """Ring contents of one track per list; the sensor column says in which place a report was put."""
    buffers = ReportBuffers(len(times), depth)
    for slot, of_track in enumerate(times):
        n = len(of_track)
        if n:
            reports = measurements(n, slot=slot, time_s=of_track, sensor=np.arange(n), stamp_s=of_track)
            assert buffers.add(reports, np.full(n, -np.inf)).all()
    return buffers.rows


def gathered(
    rows: Rings, centre: float, settled: float, begin: float = EVERYTHING[0], until: float = EVERYTHING[1]
) -> Window:
    n = len(rows)
    return gather(rows, np.arange(n), *(np.full(n, value) for value in (begin, until, centre, settled)))


def told(window: Window, lane: int) -> list[tuple[int, float]]:
    """Kind and time of each event of a lane."""
    kinds, times = window.kind[:, lane].tolist(), window.time_s[:, lane].tolist()
    return [(kind, time) for kind, time in zip(kinds, times, strict=True) if kind != NOTHING]


def test_reports_come_in_order_of_time() -> None:
    window = gathered(rings([3.0, 1.0, 2.0]), centre=1.5, settled=0.5)

    assert told(window, 0) == [(SETTLED, 0.5), (REPORT, 1.0), (CENTRE, 1.5), (REPORT, 2.0), (REPORT, 3.0)]
    assert window.stamp_s[window.kind == REPORT].tolist() == [1.0, 2.0, 3.0]


def test_only_reports_of_the_window_are_there() -> None:
    window = gathered(rings([0.9, 2.0, 3.0, 3.1]), centre=2.5, settled=2.5, begin=1.0, until=3.0)

    assert told(window, 0) == [(REPORT, 2.0), (CENTRE, 2.5), (REPORT, 3.0)]


def test_reports_at_the_very_start_are_founding_ones() -> None:
    window = gathered(rings([2.0, 1.0, 1.0]), centre=2.5, settled=1.0, begin=1.0)

    assert told(window, 0) == [(FOUNDING, 1.0), (FOUNDING, 1.0), (SETTLED, 1.0), (REPORT, 2.0), (CENTRE, 2.5)]
    assert window.reported[:, 0].tolist() == [True, True, False, True, False]
    assert window.sensor_index[:2, 0].tolist() == [1, 2]


def test_marks_at_one_instant_are_one_mark() -> None:
    window = gathered(rings([1.0, 3.0]), centre=2.0, settled=2.0)

    assert told(window, 0) == [(REPORT, 1.0), (CENTRE, 2.0), (REPORT, 3.0)]


def test_a_report_at_the_instant_of_a_mark_comes_before_it() -> None:
    window = gathered(rings([2.0, 2.0, 1.0]), centre=2.0, settled=1.0)

    assert told(window, 0) == [(REPORT, 1.0), (SETTLED, 1.0), (REPORT, 2.0), (REPORT, 2.0), (CENTRE, 2.0)]


def test_reports_of_one_instant_keep_the_order_of_their_places() -> None:
    window = gathered(rings([5.0, 5.0, 5.0]), centre=9.0, settled=9.0)

    assert window.sensor[window.kind == REPORT].tolist() == [0.0, 1.0, 2.0]


def test_lanes_with_the_most_events_come_first() -> None:
    window = gathered(rings([1.0], [1.0, 2.0, 3.0], [], [1.0]), centre=9.0, settled=9.0)

    assert window.lanes.tolist() == [1, 0, 3, 2]
    assert window.active == [4, 3, 1, 1]
    assert (window.kind == NOTHING).sum(axis=0).tolist() == [0, 2, 2, 3]


def test_what_is_no_event_lies_later_than_everything_and_is_a_number() -> None:
    window = gathered(rings([1.0], []), centre=9.0, settled=9.0)

    nothing = window.time_s[window.kind == NOTHING]
    assert (nothing > 1e12).all()
    assert np.isfinite(nothing).all()


def test_each_report_says_where_it_lies_in_its_ring() -> None:
    rows = rings([3.0, 1.0], [2.0])

    window = gathered(rows, centre=9.0, settled=9.0)

    for lane, slot in enumerate(window.lanes):
        for k in np.flatnonzero(window.kind[:, lane] == REPORT):
            assert np.array_equal(rows[slot, window.place[k, lane]], window.columns[:, k, lane], equal_nan=True)


def test_columns_have_names_and_others_do_not_exist() -> None:
    window = gathered(rings([1.0]), centre=2.0, settled=2.0)

    assert window.r_ee[0, 0] == 100.0
    assert window.sensor_index.dtype == np.int64
    with pytest.raises(AttributeError, match="no_such_column"):
        _ = window.no_such_column


def test_no_tracks_make_no_events() -> None:
    window = gathered(Rings(0, 8), centre=1.0, settled=1.0)

    assert window.active == []
    assert window.kind.shape == (0, 0)


times = st.lists(st.floats(0.0, 20.0), max_size=8)


@given(st.lists(times, min_size=1, max_size=4), st.floats(0.0, 20.0), st.floats(0.0, 1.0), st.floats(0.0, 20.0))
def test_every_report_of_the_window_is_there_once(
    tracks: list[list[float]], centre: float, share: float, until: float
) -> None:
    settled = centre * share

    window = gathered(rings(*tracks), centre=centre, settled=settled, begin=1.0, until=until)

    assert sorted(window.lanes.tolist()) == list(range(len(tracks)))
    for lane, slot in enumerate(window.lanes):
        events = told(window, lane)
        reports = [t for t in tracks[slot] if 1.0 <= t <= until]
        assert [t for kind, t in events if kind == REPORT] == sorted(t for t in reports if t > 1.0)
        assert [t for kind, t in events if kind == FOUNDING] == [t for t in reports if t == 1.0]
        assert [t for kind, t in events if kind >= CENTRE] == sorted({settled, centre})
        assert [t for _, t in events] == sorted(t for _, t in events)
