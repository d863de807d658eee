"""Properties of the smallest enclosing circle for any set of points."""

from itertools import combinations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.enclosing_circle import smallest_circles

coordinates = st.one_of(st.integers(-5, 5).map(float), st.floats(-1e6, 1e6))
point_sets = st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=9)


def _circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    centers, radii = smallest_circles(points[None])
    return centers[0], float(radii[0])


def _smallest_by_trying_all(points: np.ndarray) -> float:
    """Radius over all circles on two points and through three, made to hold all points."""
    centers = [points[0], *((a + b) / 2 for a, b in combinations(points, 2))]
    for a, b, c in combinations(points, 3):
        matrix = 2.0 * np.array([b - a, c - a])
        scale = np.abs(matrix).max()
        if abs(matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]) > 1e-9 * scale * scale:
            centers.append(a + np.linalg.solve(matrix, [(b - a) @ (b - a), (c - a) @ (c - a)]))
    return float(min(np.linalg.norm(points - center, axis=1).max() for center in centers))


@given(point_sets)
def test_every_point_lies_inside(raw: list[tuple[float, float]]) -> None:
    points = np.array(raw)

    center, radius = _circle(points)

    assert np.linalg.norm(points - center, axis=1).max() <= radius * (1.0 + 1e-9)


@given(point_sets)
def test_no_circle_on_two_or_three_points_is_smaller(raw: list[tuple[float, float]]) -> None:
    points = np.array(raw)

    _, radius = _circle(points)

    assert radius <= _smallest_by_trying_all(points) * (1.0 + 1e-9) + 1e-12


@given(point_sets)
def test_the_radius_is_that_of_trying_all(raw: list[tuple[float, float]]) -> None:
    points = np.array(raw)

    _, radius = _circle(points)

    # The trial leaves out triangles that are nearly lines, so it may be the larger one by their thickness.
    assert radius >= _smallest_by_trying_all(points) * (1.0 - 1e-6) - 1e-12


@given(point_sets, st.randoms(use_true_random=False))
def test_order_does_not_matter(raw: list[tuple[float, float]], random: object) -> None:
    points = np.array(raw)
    shuffled = list(raw)
    random.shuffle(shuffled)  # type: ignore[attr-defined]

    center, radius = _circle(points)
    other_center, other_radius = _circle(np.array(shuffled))

    assert abs(radius - other_radius) <= 1e-9 * max(radius, 1e-3)
    # The centre is the square root less certain than the radius: a flat minimum.
    assert np.linalg.norm(center - other_center) <= 1e-6 * max(radius, 1e-3)


@given(point_sets, st.integers(-1000, 1000), st.integers(-1000, 1000))
def test_a_translation_moves_the_circle(raw: list[tuple[float, float]], e: int, n: int) -> None:
    points = np.array(raw)

    center, radius = _circle(points)
    moved_center, moved_radius = _circle(points + np.array([e, n], dtype=np.float64))

    assert abs(radius - moved_radius) <= 1e-9 * max(radius, 1.0)
    assert np.linalg.norm(moved_center - center - [e, n]) <= 1e-6 * max(radius, 1.0)


@given(point_sets)
def test_repeated_points_change_nothing(raw: list[tuple[float, float]]) -> None:
    points = np.array(raw)

    _, radius = _circle(points)
    _, twice = _circle(np.concatenate([points, points[::-1]]))

    assert abs(radius - twice) <= 1e-9 * max(radius, 1e-3)


@given(point_sets, st.integers(-200, 200))
def test_a_power_of_two_scales_the_circle_exactly(raw: list[tuple[float, float]], power: int) -> None:
    points = np.array(raw).round(3)
    scaled = np.ldexp(points, power)

    _, radius = _circle(points)
    _, scaled_radius = _circle(scaled)

    assert scaled_radius == np.ldexp(radius, power)
