"""Closing elements: division points, settled states, and estimates that equal one plain smoother over everything."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tests import plain_algebra as plain
from tests.builders import ADSB, RADAR1, RADAR2, engine_settings, measurements

from aeroskein import kalman, manoeuvre
from aeroskein.buffers import ReportBuffers
from aeroskein.closed import Closed
from aeroskein.closing import ElementTable
from aeroskein.live import first_state
from aeroskein.measurements import Measurements
from aeroskein.mode_bank import ModeBank
from aeroskein.windows import REPORT

NEVER = np.array([-np.inf])
FIRST_S = 1000.0


def turning_flight(seed: int, seconds: int = 60) -> Measurements:
    """ADS-B once a second with velocity, a radar every four: 20 s straight at 120 m/s, 20 s of turning, straight."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, seconds, 0.01)
    angle = np.radians(np.clip(3.0 * (fine - 20.0), 0.0, 60.0))
    v = 120.0 * np.stack([np.cos(angle), np.sin(angle)])
    at = np.cumsum(v, axis=1) * 0.01
    times = np.sort(np.concatenate([np.arange(0.0, seconds, 1.0), np.arange(2.3, seconds, 4.0)]))
    k = np.round(times * 100.0).astype(int)
    radar = np.round(times % 1.0, 3) == 0.3
    sigma = np.where(radar, 60.0, 10.0)
    noise, v_noise = rng.standard_normal((2, len(times))) * sigma, rng.standard_normal((2, len(times)))
    return measurements(
        len(times), time_s=FIRST_S + times, sensor=radar, east_m=at[0, k] + noise[0], north_m=at[1, k] + noise[1],
        r_ee=sigma**2, r_nn=sigma**2, v_east_mps=np.where(radar, np.nan, v[0, k] + v_noise[0]),
        v_north_mps=np.where(radar, np.nan, v[1, k] + v_noise[1]), velocity_variance=np.where(radar, np.nan, 1.0),
        time_variance=np.where(radar, 1e-4, 0.0),
    )  # fmt: skip


class Table:
    """An element table, with the rings beside it, for tracks that all begin with their first report."""

    def __init__(self, *tracks: Measurements, room: int = 0, **fusion: float) -> None:
        sensors = (ADSB, RADAR1, RADAR2)
        self.elements = ElementTable(engine_settings(*sensors, **fusion), len(tracks))
        self.buffers = ReportBuffers(len(tracks), room + max(len(t) for t in tracks), np.float64)
        slots = np.arange(len(tracks))
        for slot, track in enumerate(tracks):
            track.slot[:] = slot
            assert self.buffers.add(track, np.full(len(track), -np.inf)).all()
        rows = [int(track.time_s.argmin()) for track in tracks]
        firsts = [track.take(np.array([row])) for track, row in zip(tracks, rows, strict=True)]
        first_s = np.array([f.time_s[0] for f in firsts])
        states = [first_state(f) for f in firsts]
        x, P = (np.concatenate([s[i] for s in states], axis=1) for i in (0, 1))
        self.elements.start(slots, first_s, np.full(len(slots), -np.inf), x, P)

    def close(self, slot: int = 0) -> Closed:
        return self.elements.close(np.array([slot]), self.buffers.rows)


def densities(track: Measurements) -> np.ndarray:
    """What the detector finds at each report, one after the other in order of time."""
    bank, x, P = ModeBank(1, 3, manoeuvre.DETECTOR), *first_state(track.take(np.array([0])))
    bank.start(np.array([0]), x, P, track.time_s[:1].copy())
    found = np.zeros(len(track))
    for k in range(1, len(track)):
        r = track.take(np.array([k]))
        work = bank.take(np.array([0]))
        lag = work.predict(r.time_s)
        columns = (r.east_m, r.north_m, r.r_ee, r.r_en, r.r_nn, r.v_east_mps, r.v_north_mps, r.velocity_variance,
                   r.time_variance)  # fmt: skip
        work.update(columns, r.sensor.astype(np.int64), lag, np.array([True]))
        bank.put(np.array([0]), work)
        found[k] = manoeuvre.jerk_density(work.mu)[0]
    return found


class PlainElements:
    """Element after element in plain algebra: filter from the settled state, smooth back to the centre."""

    def __init__(self, track: Measurements) -> None:
        x, P = first_state(track.take(np.array([0])))
        self.track, self.density = track, densities(track)
        self.x, self.P, self.t = x[:, 0], kalman.to_matrix(P)[0], float(track.time_s[0])

    def close(self, centre: float, horizon: float, settled: float) -> tuple[np.ndarray, np.ndarray]:
        """State at the centre; goes on from the settled time. All reports are good ones."""
        track, begin = self.track, (self.x, self.P)
        rows = np.flatnonzero((track.time_s > self.t) & (track.time_s <= horizon))
        marks = [(time, 10**9) for time in sorted({centre, settled})]
        x, P, t, events, centre_at = *begin, self.t, [], 0
        for time, row in sorted([*((float(track.time_s[k]), int(k)) for k in rows), *marks]):
            near = rows[(track.time_s[rows] >= time - 1.0) & (track.time_s[rows] <= time + 4.0)]
            event = plain.Event(time - t, max(self.density[near].max(initial=0.0), 0.02**2))
            if row < 10**9:
                event = self._measured(event, row, x, P)
            elif time == centre:
                centre_at = len(events)
            x, P = plain.forward(x, P, [event])[0][2:]
            if time == settled:
                self.x, self.P, self.t = x, P, time
            t = time
            events.append(event)
        return plain.rauch_tung_striebel(plain.forward(*begin, events), events)[centre_at]

    def _measured(self, event: plain.Event, row: int, x: np.ndarray, P: np.ndarray) -> plain.Event:
        """The event with the report; the error of its time stamp acts along the predicted flight."""
        track = self.track
        x, P = plain.forward(x, P, [event])[0][2:]
        moment = np.outer(x[2:4], x[2:4]) + P[2:4, 2:4]
        R = track.r_ee[row] * np.eye(2) + track.time_variance[row] * moment
        event = event._replace(position=(np.array([track.east_m[row], track.north_m[row]]), R))
        if np.isnan(track.velocity_variance[row]):
            return event
        v = np.array([track.v_east_mps[row], track.v_north_mps[row]])
        return event._replace(velocity=(v, track.velocity_variance[row] * np.eye(2)))


@pytest.mark.parametrize("lookahead", [0, 1, 2])
def test_elements_are_the_plain_smoothers(lookahead: int) -> None:
    track = turning_flight(1)
    table, wanted = Table(track, lookahead=lookahead), PlainElements(track)
    settled = FIRST_S

    for _ in range(11):
        closed = table.close()
        centre, horizon = closed.centre_s[0], closed.span_s[0, 1] + 4.0 * lookahead
        # The last four seconds of the look-ahead stay open to late reports.
        settled = max(settled, min(centre, horizon - 4.0))

        x, P = wanted.close(centre, horizon, settled)
        assert not closed.estimate.reason.any()
        plain.close(closed.estimate.x[:, 0], x, atol=1e-5)
        plain.close(closed.estimate.P[0], P, rtol=1e-7, atol=1e-9)
        assert table.elements.settled_s[0] == settled


def test_element_after_element_is_one_long_run() -> None:
    track = turning_flight(2)
    table = Table(track)

    for _ in range(11):
        closed = table.close()

        # Nothing settled: everything from the first report on, once more.
        x, P = PlainElements(track).close(closed.centre_s[0], closed.span_s[0, 1] + 4.0, FIRST_S)
        # Where a manoeuvre fades just behind a settled time its last second is forgotten, which moves millimetres.
        assert np.abs(closed.estimate.x[:2, 0] - x[:2]).max() < 0.02
        plain.close(closed.estimate.P[0], P, rtol=0.02, atol=1e-2)


def test_spans_are_contiguous_and_their_centres_in_the_middle() -> None:
    table = Table(turning_flight(3), element_s=3.0)

    closed = [table.close() for _ in range(10)]

    assert closed[0].span_s[0, 0] == FIRST_S
    assert [c.index[0] for c in closed] == list(range(10))
    for one, following in pairwise(closed):
        assert one.span_s[0, 1] == following.span_s[0, 0]
        assert one.centre_s[0] == 0.5 * one.span_s[0].sum()
        assert one.span_s[0, 1] - one.span_s[0, 0] == 3.0


def test_an_element_is_due_when_its_look_ahead_and_the_watermark_have_passed() -> None:
    table = Table(turning_flight(3), element_s=4.0, lookahead=1, watermark_s=1.5)

    due = [float(table.elements.due_s[0])]
    for _ in range(3):
        table.close()
        due.append(float(table.elements.due_s[0]))

    assert due == [FIRST_S + 9.5 + 4.0 * k for k in range(4)]


def test_elements_are_twice_as_long_while_no_source_is_fast() -> None:
    rng = np.random.default_rng(4)
    seconds = np.concatenate([np.arange(0.0, 20.0), np.arange(21.0, 61.0, 4.0), np.arange(61.0, 120.0)])
    fast = (seconds < 20.0) | (seconds >= 61.0)
    n = len(seconds)
    track = measurements(
        n, time_s=FIRST_S + seconds, sensor=np.where(fast, 0, 1), east_m=150.0 * seconds + rng.normal(0, 5, n),
        v_east_mps=np.where(fast, 150.0, np.nan), v_north_mps=np.where(fast, 0.0, np.nan),
        velocity_variance=np.where(fast, 1.0, np.nan),
    )  # fmt: skip
    table = Table(track)

    spans = np.concatenate([table.close().span_s for _ in range(20)]) - FIRST_S

    lengths = np.diff(spans, axis=1)[:, 0]
    assert set(lengths.tolist()) == {4.0, 8.0}
    middle = spans.mean(axis=1)
    # A division point is laid one look-ahead in advance, by what was heard until then.
    assert (lengths[middle < 20.0] == 4.0).all()
    assert (lengths[(middle > 32.0) & (middle < 60.0)] == 8.0).all()
    assert (lengths[middle > 76.0] == 4.0).all()
    assert (spans[1:, 0] == spans[:-1, 1]).all()


def test_a_refused_fast_source_does_not_shorten_elements() -> None:
    seconds = np.arange(0.0, 60.0)
    radar = seconds % 4.0 == 0.0
    track = measurements(
        60, time_s=FIRST_S + seconds, sensor=np.where(radar, 1, 0), east_m=150.0 * seconds,
        north_m=np.where(radar, 0.0, 30_000.0), r_ee=np.where(radar, 50.0, 5_000.0),
        r_nn=np.where(radar, 50.0, 5_000.0),
    )  # fmt: skip
    table = Table(track)

    lengths = [float(np.diff(table.close().span_s)[0, 0]) for _ in range(6)]

    assert lengths == [4.0, 4.0, 8.0, 8.0, 8.0, 8.0]


def test_after_a_restart_no_element_starts_before_what_was_published() -> None:
    track = turning_flight(5)
    table = Table(track)
    x, P = first_state(track.take(np.array([0])))
    table.elements.start(np.array([0]), track.time_s[:1].copy(), np.array([FIRST_S + 6.5]), x, P)

    closed = table.close()

    assert closed.span_s[0, 0] == FIRST_S + 6.5
    assert closed.index[0] == 0
    # What came before it still counts for the state.
    wanted, _ = PlainElements(track).close(FIRST_S + 8.5, FIRST_S + 14.5, FIRST_S)
    plain.close(closed.estimate.x[:, 0], wanted, atol=1e-7)


def test_late_reports_count_as_if_they_had_come_in_time_until_their_time_is_settled() -> None:
    track = turning_flight(6)
    late = np.array([5, 9])
    rest = np.setdiff1d(np.arange(len(track)), late)
    in_time, patient = Table(track), Table(track.take(rest), room=2)
    patient.close(), in_time.close()
    settled = patient.elements.settled_s[0]
    assert (track.time_s[late] > settled).all()

    assert patient.buffers.add(track.take(late), np.full(2, -np.inf)).all()

    for _ in range(3):
        one, other = in_time.close(), patient.close()
        # They weigh the same; only the manoeuvre detector has not seen them.
        assert np.abs(one.estimate.x[:2] - other.estimate.x[:2]).max() < 0.3
        assert (other.window.kind == REPORT).sum() == (one.window.kind == REPORT).sum()


def test_tracks_close_side_by_side_as_alone() -> None:
    tracks = [turning_flight(seed, seconds) for seed, seconds in ((7, 60), (8, 40), (9, 20))]
    alone = [Table(track) for track in tracks]
    together = Table(*[track.take(np.arange(len(track))) for track in tracks])

    for _ in range(8):
        closed = together.elements.close(np.array([2, 0, 1]), together.buffers.rows)
        for lane, slot in enumerate(closed.slots):
            one = alone[slot].close()
            plain.close(closed.estimate.x[:, lane], one.estimate.x[:, 0], rtol=1e-12)
            plain.close(closed.estimate.P[lane], one.estimate.P[0], rtol=1e-11)
            assert np.array_equal(closed.span_s[lane], one.span_s[0])
            assert closed.inside[:, lane].sum() == one.inside[:, 0].sum()


def test_without_reports_elements_go_on_and_grow_uncertain() -> None:
    table = Table(turning_flight(10, 8))

    closed = [table.close() for _ in range(6)]

    sizes = [np.trace(c.estimate.P[0, :2, :2]) for c in closed]
    assert all(b > a for a, b in pairwise(sizes[2:]))
    assert [bool(c.inside.any()) for c in closed] == [True, True, False, False, False, False]


def test_stopped_tracks_are_never_due() -> None:
    table = Table(turning_flight(11), turning_flight(12))

    table.elements.stop(np.array([0]))

    assert table.elements.due_s[0] == np.inf
    assert table.elements.open.tolist() == [False, True]
    assert table.elements.settled_s[0] == -np.inf


def test_growth_keeps_open_elements() -> None:
    small, large = Table(turning_flight(13)), Table(turning_flight(13))
    small.close(), large.close()

    small.elements.grow(5)

    assert np.isinf(small.elements.due_s[1:]).all()
    assert np.array_equal(small.close().estimate.x, large.close().estimate.x)
