"""Banks of mode filters: work in rounds on many lanes is the work on each lane alone."""

import numpy as np
import pytest
from tests import plain_algebra as plain

from aeroskein import kalman, manoeuvre
from aeroskein.gating import MISSES_TO_OPEN
from aeroskein.mode_bank import ModeBank

SENSORS = 2
# A report of good ADS-B without velocity: covariance, no velocity, no velocity variance, no time variance.
GOOD = (25.0, 0.0, 25.0, np.nan, np.nan, np.nan, 0.0)


def bank(n: int, seed: int = 1, speed_mps: float = 100.0) -> ModeBank:
    """Tracks that fly east at time 0, each somewhere else."""
    rng = np.random.default_rng(seed)
    x = np.zeros((6, n))
    x[:2], x[2] = rng.uniform(-2e4, 2e4, (2, n)), speed_mps
    P = np.broadcast_to(np.diag([25.0, 25.0, 4.0, 4.0, 0.04, 0.04]), (n, 6, 6))
    made = ModeBank(n, SENSORS, manoeuvre.DETECTOR)
    made.start(np.arange(n), x, kalman.from_matrix(P), np.zeros(n))
    return made


def report(east_m: float, north_m: float, r_m2: float = 25.0) -> tuple[np.ndarray, ...]:
    return tuple(np.array([value]) for value in (east_m, north_m, r_m2, 0.0, r_m2, *GOOD[3:]))


def place(of: ModeBank, slot: int) -> tuple[float, float]:
    x, _ = of.mixture_at(np.array([slot]), of.time_s[[slot]])
    return float(x[0, 0]), float(x[1, 0])


def feed(of: ModeBank, slot: int, time_s: float, columns: tuple[np.ndarray, ...], sensor: int = 0) -> bool:
    """One report for one track, taken and put back."""
    slots = np.array([slot])
    work = of.take(slots)
    lag = work.predict(np.array([time_s]))
    ok = work.update(columns, np.array([sensor]), lag, np.ones(1, dtype=bool))
    of.put(slots, work)
    return bool(ok[0])


def test_rounds_over_lanes_are_one_track_after_the_other() -> None:
    rng = np.random.default_rng(2)
    together, alone = bank(4), bank(4)
    counts = [5, 3, 3, 1]
    at = [place(together, slot) for slot in range(4)]
    events = [
        [
            (time_s, tuple(np.array([v]) for v in (
                at[slot][0] + 100.0 * time_s + rng.normal(0, 5), at[slot][1] + rng.normal(0, 5), 25.0, 1.0, 30.0,
                100.0 + rng.normal(), rng.normal(), 1.0 if k % 2 else np.nan, 0.01,
            )), int(rng.integers(2)))
            for k, time_s in enumerate(rng.permutation(count) + rng.random())
        ]
        for slot, count in enumerate(counts)
    ]  # fmt: skip

    for slot, of_slot in enumerate(events):
        for time_s, columns, sensor in of_slot:
            feed(alone, slot, time_s, columns, sensor)
    work = together.take(np.arange(4))
    for k in range(5):
        m = sum(count > k for count in counts)
        now = [events[slot][k] for slot in range(m)]
        lag = work.predict(np.array([e[0] for e in now]))
        columns = tuple(np.concatenate([e[1][c] for e in now]) for c in range(9))
        work.update(columns, np.array([e[2] for e in now]), lag, np.ones(m, dtype=bool))
    together.put(np.arange(4), work)

    plain.close(together.rows, alone.rows, rtol=1e-12)
    assert np.array_equal(together.time_s, alone.time_s)
    assert np.array_equal(together.memory.misses, alone.memory.misses)


def test_time_never_goes_back() -> None:
    tracks = bank(1)
    work = tracks.take(np.array([0]))

    lags = [float(work.predict(np.array([t]))[0]) for t in (3.0, 1.0, 4.0)]

    assert lags == [0.0, 2.0, 0.0]
    assert work.time_s[0] == 4.0


def test_looking_ahead_changes_nothing() -> None:
    tracks = bank(3)
    before = tracks.rows.copy()

    x, P = tracks.mixture_at(np.arange(3), np.full(3, 7.0))

    assert np.array_equal(tracks.rows, before)
    assert not tracks.time_s.any()
    start, start_P = tracks.mixture_at(np.arange(3), np.zeros(3))
    plain.close(x[0] - start[0], 700.0)
    assert (P[0] > start_P[0]).all()


def test_a_source_that_is_refused_again_and_again_is_believed_at_last() -> None:
    tracks = bank(1)
    east, north = place(tracks, 0)

    verdicts = [feed(tracks, 0, t, report(east + 100.0 * t, north + 4_000.0)) for t in range(1, MISSES_TO_OPEN + 2)]

    # The state was wrong by as much as the source says, so it goes where the source is.
    assert verdicts == [False] * MISSES_TO_OPEN + [True]
    assert abs(place(tracks, 0)[1] - north - 4_000.0) < 200.0


def test_a_source_is_not_believed_against_one_at_least_as_good() -> None:
    tracks = bank(1)
    east, north = place(tracks, 0)

    verdicts = []
    for t in range(1, 12):
        assert feed(tracks, 0, t, report(east + 100.0 * t, north), sensor=0)
        verdicts.append(feed(tracks, 0, t, report(east + 100.0 * t, north + 4_000.0), sensor=1))

    assert not any(verdicts)
    assert abs(place(tracks, 0)[1] - north) < 20.0


def test_a_better_source_is_believed_against_a_worse_one() -> None:
    tracks = bank(1)
    east, north = place(tracks, 0)

    for t in range(1, 12):
        feed(tracks, 0, t, report(east + 100.0 * t, north, r_m2=1e4), sensor=0)
        feed(tracks, 0, t, report(east + 100.0 * t, north + 4_000.0), sensor=1)

    assert abs(place(tracks, 0)[1] - north - 4_000.0) < 100.0


def test_growth_keeps_what_is_there() -> None:
    tracks = bank(2)
    feed(tracks, 1, 1.0, report(1e6, 1e6))
    before = tracks.rows.copy(), tracks.time_s.copy(), tracks.memory.misses.copy()

    tracks.grow(5)

    assert np.array_equal(tracks.rows[:2], before[0])
    assert np.array_equal(tracks.time_s[:2], before[1])
    assert np.array_equal(tracks.memory.misses[:2], before[2])
    assert np.isneginf(tracks.time_s[2:]).all()
    assert tracks.memory.misses.shape == (5, SENSORS)


def test_steady_state_is_the_first_models() -> None:
    tracks = bank(3)

    east, north, v_east, v_north = tracks.steady(np.array([2, 0]))

    work = tracks.take(np.array([2, 0]))
    for got, wanted in zip((east, north, v_east, v_north), work.x[:4, 0], strict=True):
        assert np.array_equal(got, wanted)
    assert manoeuvre.MODELS == 3


@pytest.mark.parametrize("later_s", [0.0, 2.5])
def test_what_a_point_needs_is_part_of_the_mixture(later_s: float) -> None:
    tracks = bank(3)
    east, north = place(tracks, 0)
    for t in (1, 2, 3):
        feed(tracks, 0, t, report(east + 80.0 * t**1.5, north + 30.0))
    slots = np.arange(3)
    x, P = tracks.mixture_at(slots, tracks.time_s + later_s)

    motion, position_cov, velocity_cov = tracks.motion_at(slots, tracks.time_s + later_s)

    plain.close(motion, x[:4], rtol=1e-12)
    plain.close(position_cov, P[[0, 1, 7]], rtol=1e-12)
    plain.close(velocity_cov, P[[12, 13, 17]], rtol=1e-12)
