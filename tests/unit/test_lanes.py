"""Walking many flights through time at once."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.lanes import MANY, Lanes, by_flight_and_time, flight_quantile, held_rows, lengths_of_runs, step_s

lengths = st.lists(st.integers(1, 9), min_size=1, max_size=8)


@given(lengths)
def test_steps_visit_every_row_once_and_in_order(lengths: list[int]) -> None:
    flight = np.repeat(np.arange(len(lengths)), lengths)

    lanes = Lanes(flight)
    visited = [lanes.rows(k) for k in range(lanes.steps)]

    assert sorted(np.concatenate(visited).tolist()) == list(range(len(flight)))
    for earlier, later in itertools.pairwise(visited):
        np.testing.assert_array_equal(earlier[: len(later)] + 1, later)
        np.testing.assert_array_equal(flight[earlier[: len(later)]], flight[later])


def test_no_rows_make_no_steps() -> None:
    assert Lanes(np.zeros(0, dtype=np.int64)).steps == 0


def test_time_since_the_row_before_starts_anew_with_each_flight() -> None:
    flight, time_s = np.array([0, 0, 1, 1]), np.array([5.0, 7.0, 1.0, 1.5])

    np.testing.assert_array_equal(step_s(flight, time_s), [0.0, 2.0, 0.0, 0.5])


@given(lengths, st.data())
def test_nearest_marked_rows_lie_in_the_same_flight(lengths: list[int], data: st.DataObject) -> None:
    flight = np.repeat(np.arange(len(lengths)), lengths)
    marked = np.array(data.draw(st.lists(st.booleans(), min_size=len(flight), max_size=len(flight))))

    before, after = held_rows(flight, marked)

    for row in range(len(flight)):
        mine = [k for k in range(len(flight)) if marked[k] and flight[k] == flight[row]]
        assert before[row] == max((k for k in mine if k <= row), default=-1)
        assert after[row] == min((k for k in mine if k >= row), default=-1)


@given(lengths, st.floats(0.0, 1.0), st.integers(0, 100))
def test_quantiles_of_flights_are_numpys(lengths: list[int], quantile: float, seed: int) -> None:
    flight = np.repeat(np.arange(len(lengths)), lengths)
    values = np.random.default_rng(seed).standard_normal(len(flight))

    result = flight_quantile(flight, values, quantile)

    expected = [np.quantile(values[flight == f], quantile) for f in range(len(lengths))]
    np.testing.assert_allclose(result, expected, atol=1e-12)


@given(lengths)
def test_lengths_of_runs_are_counted_from_their_first_rows(lengths: list[int]) -> None:
    first = np.cumsum([0, *lengths[:-1]])

    assert lengths_of_runs(first, sum(lengths)).tolist() == lengths
    assert not len(lengths_of_runs(first[:0], 0))


@given(st.integers(0, 2**32 - 1), st.sampled_from([0, 1, 7, MANY, 3 * MANY]), st.integers(1, 40))
def test_few_or_many_rows_are_sorted_by_flight_then_time_and_equal_ones_stay(seed: int, n: int, kinds: int) -> None:
    rng = np.random.default_rng(seed)
    flight, time_s = rng.integers(0, kinds, n), rng.integers(0, kinds, n).astype(np.float64)

    assert np.array_equal(by_flight_and_time(flight, time_s), np.lexsort((time_s, flight)))
