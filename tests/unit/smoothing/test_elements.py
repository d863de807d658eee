"""Elements of smoothed tracks: contiguous, half-open, and every report in exactly one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.smoothing.elements import cut_elements

flights = st.lists(st.lists(st.floats(0.0, 20.0), min_size=1, max_size=30), min_size=1, max_size=4)


def reports(steps: list[list[float]]) -> tuple[np.ndarray, np.ndarray]:
    flight = np.repeat(np.arange(len(steps)), [len(s) for s in steps])
    return flight, np.concatenate([1.79e9 + 1000.0 * k + np.cumsum(s) for k, s in enumerate(steps)])


@given(flights, st.sampled_from([0.5, 4.0, 7.3]))
def test_every_report_lies_in_its_element(steps: list[list[float]], element_s: float) -> None:
    flight, time_s = reports(steps)

    elements = cut_elements(flight, time_s, np.ones(len(flight)), element_s)

    mine = elements.span_s[elements.of_report]
    assert ((mine[:, 0] <= time_s) & (time_s < mine[:, 1])).all()
    np.testing.assert_array_equal(elements.flight[elements.of_report], flight)


@given(flights, st.sampled_from([0.5, 4.0, 7.3]))
def test_spans_are_contiguous_and_cover_the_flight(steps: list[list[float]], element_s: float) -> None:
    flight, time_s = reports(steps)

    elements = cut_elements(flight, time_s, np.ones(len(flight)), element_s)

    for k in range(len(steps)):
        span = elements.span_s[elements.flight == k]
        np.testing.assert_array_equal(span[1:, 0], span[:-1, 1])
        assert span[0, 0] == time_s[flight == k][0]
        assert 0.0 < span[-1, 1] - time_s[flight == k][-1] < 0.01
        np.testing.assert_array_equal(elements.index[elements.flight == k], np.arange(len(span)))


@given(flights)
def test_elements_are_as_long_as_asked_for(steps: list[list[float]]) -> None:
    flight, time_s = reports(steps)

    elements = cut_elements(flight, time_s, np.ones(len(flight)), 4.0)

    length = np.diff(elements.span_s, axis=1)[:, 0]
    is_last = np.append(np.diff(elements.flight) > 0, True)
    np.testing.assert_allclose(length[~is_last], 4.0, atol=1e-6)
    assert (length <= 5.0 + 1e-6).all()


def test_elements_of_slow_sensors_are_twice_as_long() -> None:
    flight, time_s = np.array([0, 0, 1, 1]), np.array([0.0, 24.0, 0.0, 24.0])

    elements = cut_elements(flight, time_s, np.array([1.0, 4.0, 4.0, 8.0]), 4.0)

    assert np.bincount(elements.flight).tolist() == [6, 3]


def test_centres_are_the_middles_of_spans() -> None:
    elements = cut_elements(np.zeros(2, dtype=np.int64), np.array([10.0, 18.0]), np.ones(2), 4.0)

    np.testing.assert_allclose(elements.centre_s, [12.0, 16.0], atol=1e-3)
