"""Properties of elements and axes for any flight."""

from itertools import pairwise

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from aeroskein import axis, elements

coordinates = st.one_of(st.integers(-3, 3).map(lambda v: 1000.0 * v), st.floats(-5e4, 5e4))
places = st.tuples(coordinates, coordinates)
counts = st.integers(1, 12)


def _length(start: tuple[float, float], end: tuple[float, float]) -> float:
    return float(np.hypot(end[0] - start[0], end[1] - start[1]))


@given(places, places, counts, st.sampled_from(["natural", "odd", "even"]), st.floats(0.0, 1.0), st.floats(-549, 549))
def test_each_point_of_the_strip_lies_in_exactly_one_element(
    start: tuple[float, float], end: tuple[float, float], count: int, series: str, share: float, across: float
) -> None:
    assume(_length(start, end) > 1.0)
    a, b = np.array(start), np.array(end)
    e = (b - a) / _length(start, end)
    point = a + share * (b - a) + across * np.array([-e[1], e[0]])
    boundaries = elements.element_boundaries(count, series) * _length(start, end)  # type: ignore[arg-type]

    s, c, _ = axis.project_on_axis(point[None, None], np.stack([a, b])[None])
    index = elements.membership(s, boundaries[None]).item()

    holding = [k for k in range(len(boundaries) - 1) if boundaries[k] <= s.item() < boundaries[k + 1]]
    within = boundaries[0] <= s.item() < boundaries[-1]
    assert holding == ([index] if within else [])
    assert within or index == -1
    assert elements.inside_boundary(c, 550.0).all()


@given(places, places, counts, places)
def test_membership_is_that_of_the_rectangles(
    start: tuple[float, float], end: tuple[float, float], count: int, place: tuple[float, float]
) -> None:
    length = _length(start, end)
    assume(length > 1.0)
    a, b, point = np.array(start), np.array(end), np.array(place)
    s, c, _ = axis.project_on_axis(point[None, None], np.stack([a, b])[None])
    boundaries = elements.division_fractions(count) * length
    # On an edge rounding decides, for either of the two ways.
    assume(np.abs(boundaries - s).min() > 1e-6)
    assume(abs(abs(c.item()) - 550.0) > 1e-6)

    index = elements.membership(s, boundaries[None]).item()
    by_coordinates = [index] if index >= 0 and elements.inside_boundary(c, 550.0).all() else []

    corners = elements.rectangle_vertices(a, b, count, 550.0)
    sides, away = np.roll(corners, -1, axis=1) - corners, point - corners
    by_corners = (sides[..., 0] * away[..., 1] - sides[..., 1] * away[..., 0] > 0.0).all(axis=1)
    assert np.flatnonzero(by_corners).tolist() == by_coordinates


@given(st.lists(places, min_size=2, max_size=6), places)
def test_cross_distance_is_the_distance_from_the_axis(
    corners: list[tuple[float, float]], place: tuple[float, float]
) -> None:
    line, point = np.array(corners), np.array(place)
    s, c, piece = (v.item() for v in axis.project_on_axis(point[None, None], line[None]))
    stations = axis.axis_stations(line[None])
    assume(0.0 <= s <= stations[0, -1])

    # An independent search: the distance to every piece, one after the other.
    distances = []
    for p, q in pairwise(line):
        square = float((q - p) @ (q - p))
        share = 0.0 if square == 0.0 else min(max(float((point - p) @ (q - p)) / square, 0.0), 1.0)
        distances.append(float(np.linalg.norm(point - p - share * (q - p))))
    assert abs(abs(c) - min(distances)) < 1e-6
    assert distances[piece] <= min(distances) + 1e-6


@given(st.lists(places, min_size=2, max_size=6), places)
def test_the_point_at_s_on_the_axis_is_the_foot_of_the_perpendicular(
    corners: list[tuple[float, float]], place: tuple[float, float]
) -> None:
    line = np.array(corners)
    assume((np.hypot(*np.diff(line, axis=0).T) > 1.0).all())
    s, c, _ = axis.project_on_axis(np.array(place)[None, None], line[None])

    foot = axis.interpolate_on_axis(axis.axis_stations(line[None]), line[None], s)

    assert abs(np.linalg.norm(foot[0, 0] - place) - abs(c.item())) < 1e-6


@given(st.lists(places, min_size=3, max_size=6), st.floats(0.0, 1.0), st.floats(-50.0, 50.0), places)
def test_a_flight_seen_from_elsewhere_keeps_its_coordinates(
    corners: list[tuple[float, float]], share: float, across: float, origin: tuple[float, float]
) -> None:
    line = np.array(corners)
    stations = axis.axis_stations(line[None])
    point = axis.interpolate_on_axis(stations, line[None], share * stations[:, -1:]) + across
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])

    s, c, piece = axis.project_on_axis(point, line[None])
    seen_s, seen_c, seen_piece = axis.project_on_axis(point @ turn.T + origin, (line @ turn.T + origin)[None])

    # Two pieces may be equally near (laps, crossings); then rounding chooses.
    assume(piece.item() == seen_piece.item())
    assert abs(seen_s.item() - s.item()) < 1e-6
    assert abs(seen_c.item() - c.item()) < 1e-6


@given(st.lists(places, min_size=2, max_size=6), st.floats(1.0, 3000.0))
def test_borders_stay_within_twice_the_half_width(corners: list[tuple[float, float]], half: float) -> None:
    line = np.array(corners)[None]

    left, right = axis.border_lines(line, half)

    assert np.linalg.norm(left - line, axis=-1).max() <= 2.0 * half + 1e-6
    assert np.abs(left + right - 2.0 * line).max() < 1e-6
