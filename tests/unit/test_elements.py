"""Geometry of the elements: the worked example of a 3-4-5 flight, and what the published formulas do instead."""

import numpy as np
import pytest

from aeroskein import elements

# The flight from (0, 0) to (3, 4) km: L = 5 km, e = (0.6, 0.8), n = (-0.8, 0.6); b = 550 m. [m]
A, B = np.array([0.0, 0.0]), np.array([3000.0, 4000.0])
HALF_M = 550.0


# -- division -------------------------------------------------------------------------------------------


def test_natural_series_bounds_the_elements() -> None:
    points = elements.division_points(A, B, 5)

    assert points.tolist() == [[0, 0], [600, 800], [1200, 1600], [1800, 2400], [2400, 3200], [3000, 4000]]


def test_odd_series_gives_the_centres_of_the_elements() -> None:
    natural = elements.division_points(A, B, 5)

    odd = elements.division_points(A, B, 5, "odd")

    assert odd == pytest.approx((natural[:-1] + natural[1:]) / 2.0)


def test_even_series_gives_the_boundaries_again() -> None:
    assert np.array_equal(elements.division_fractions(7, "even"), elements.division_fractions(7))


def test_odd_boundaries_leave_half_an_element_at_each_end() -> None:
    assert elements.element_boundaries(2, "odd").tolist() == [0.0, 0.25, 0.75, 1.0]
    assert elements.element_boundaries(2).tolist() == [0.0, 0.5, 1.0]


def test_many_flights_are_divided_at_once() -> None:
    rng = np.random.default_rng(1)
    starts, ends = rng.normal(size=(2, 6, 2)) * 1e4

    points = elements.division_points(starts, ends, 4)

    assert points.shape == (6, 5, 2)
    assert points[3] == pytest.approx(elements.division_points(starts[3], ends[3], 4))


def test_no_element_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        elements.division_fractions(0)


# -- rectangles -----------------------------------------------------------------------------------------


def test_first_rectangle_of_the_worked_example() -> None:
    first = elements.rectangle_vertices(A, B, 5, HALF_M)[0]

    assert first == pytest.approx(np.array([[-440.0, 330.0], [440.0, -330.0], [1040.0, 470.0], [160.0, 1130.0]]))


def test_following_rectangles_are_the_first_moved_along_the_flight() -> None:
    vertices = elements.rectangle_vertices(A, B, 5, HALF_M)

    moved = vertices[0] + np.arange(5)[:, None, None] * np.array([600.0, 800.0])
    assert vertices == pytest.approx(moved)


def test_full_width_is_twice_the_half_width() -> None:
    vertices = elements.rectangle_vertices(A, B, 5, HALF_M)

    assert np.linalg.norm(vertices[:, 0] - vertices[:, 1], axis=1) == pytest.approx(np.full(5, 1100.0))
    assert np.linalg.norm(vertices[:, 1] - vertices[:, 2], axis=1) == pytest.approx(np.full(5, 1000.0))


@pytest.mark.parametrize("end", [(5e3, 0.0), (-5e3, 0.0), (0.0, 5e3), (0.0, -5e3), (-3e3, -4e3), (3e3, -4e3)], ids=str)
def test_rectangles_are_right_in_every_direction(end: tuple[float, float]) -> None:
    vertices = elements.rectangle_vertices(A, np.array(end), 5, HALF_M)

    sides = np.roll(vertices, -1, axis=1) - vertices
    assert np.linalg.norm(sides, axis=-1) == pytest.approx(np.tile([1100.0, 1000.0, 1100.0, 1000.0], (5, 1)))
    turns = sides[:, :, 0] * np.roll(sides, -1, axis=1)[:, :, 1] - sides[:, :, 1] * np.roll(sides, -1, axis=1)[:, :, 0]
    # Right angles, and A, B, C, D run counterclockwise: A left of the flight, B right of it.
    assert turns == pytest.approx(np.full((5, 4), 1.1e6))
    assert vertices.mean(axis=1) == pytest.approx(elements.division_points(A, np.array(end), 5, "odd"), abs=1e-9)


def test_a_flight_without_length_has_no_rectangle() -> None:
    assert np.isnan(elements.rectangle_vertices(A, A, 3, HALF_M)).all()


def test_each_flight_has_its_own_half_width() -> None:
    starts, ends = np.zeros((2, 2)), np.array([[3000.0, 4000.0], [0.0, 1000.0]])

    vertices = elements.rectangle_vertices(starts, ends, 2, np.array([550.0, 100.0]))

    assert np.linalg.norm(vertices[:, :, 0] - vertices[:, :, 1], axis=-1).tolist() == [[1100.0] * 2, [200.0] * 2]


def test_vertices_lie_on_the_lines_through_their_sides() -> None:
    starts, ends = np.random.default_rng(2).normal(size=(2, 8, 2)) * 1e4
    vertices = elements.rectangle_vertices(starts, ends, 3, HALF_M)

    sides = elements.side_equations(starts, ends, 3, HALF_M)

    for side, corners in enumerate([(0, 1), (1, 2), (2, 3), (3, 0)]):
        for corner in corners:
            left = np.einsum("...c,...c->...", sides[:, :, side, :2], vertices[:, :, corner])
            assert left == pytest.approx(sides[:, :, side, 2], abs=1e-8)


def test_side_lines_of_the_worked_example() -> None:
    first = elements.side_equations(A, B, 5, HALF_M)[0]

    # A-B: 0.6 x + 0.8 y = 0; B-C: -0.8 x + 0.6 y = -550; C-D: ... = 1000; D-A: ... = 550.
    assert first == pytest.approx(
        np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, -550.0], [0.6, 0.8, 1000.0], [-0.8, 0.6, 550.0]])
    )


# -- membership -----------------------------------------------------------------------------------------


def test_a_division_point_belongs_to_the_element_that_begins_there() -> None:
    index = elements.membership(np.array([[0.0, 999.9, 1000.0, 4999.9]]), np.linspace(0.0, 5000.0, 6)[None])

    assert index.tolist() == [[0, 0, 1, 4]]


def test_outside_the_first_and_last_division_point_there_is_no_element() -> None:
    index = elements.membership(np.array([[-0.1, 5000.0, 9000.0, np.nan]]), np.linspace(0.0, 5000.0, 6)[None])

    assert index.tolist() == [[-1, -1, -1, -1]]


def test_the_end_of_a_finite_track_belongs_to_its_last_element() -> None:
    index = elements.membership(np.array([[5000.0, 5000.1]]), np.linspace(0.0, 5000.0, 6)[None], closed_end=True)

    assert index.tolist() == [[4, -1]]


@pytest.mark.parametrize("closed_end", [False, True])
def test_flights_may_have_different_numbers_of_elements(closed_end: bool) -> None:
    boundaries = np.array([[0.0, 1.0, 2.0, 3.0], [0.0, 1.5, np.nan, np.nan], [np.nan] * 4])

    index = elements.membership(np.full((3, 2), [0.5, 1.5]), boundaries, closed_end=closed_end)

    assert index.tolist() == [[0, 1], [0, 0 if closed_end else -1], [-1, -1]]


def test_the_boundary_lines_belong_to_the_inside() -> None:
    inside = elements.inside_boundary(np.array([-550.0, 550.0, 550.1, np.nan]), HALF_M)

    assert inside.tolist() == [True, True, False, False]


# -- width of the boundary ------------------------------------------------------------------------------


def _half_width(report: float, axis: float = 0.0, bias: float = 0.0, sagitta: float = 0.0) -> float:
    across = np.array([[-0.8, 0.6]])
    width = elements.boundary_half_width(
        np.array([[report**2, 0.0, report**2]]), np.array([[axis**2, 0.0, axis**2]]), across, bias * across, sagitta
    )
    return float(width[0])


def test_boundary_is_four_sigma_plus_bias_plus_sagitta() -> None:
    assert _half_width(60.0, 80.0, bias=-70.0, sagitta=14.0) == pytest.approx(4.0 * 100.0 + 70.0 + 14.0)


def test_boundary_stays_between_150_m_and_3_km() -> None:
    assert _half_width(5.0) == 150.0
    assert _half_width(2000.0) == 3000.0


def test_boundary_sees_only_the_error_across_the_flight() -> None:
    # 1 km along a flight to the north-east, 100 m across it.
    e, n = np.array([np.sqrt(0.5), np.sqrt(0.5)]), np.array([-np.sqrt(0.5), np.sqrt(0.5)])
    full = 1000.0**2 * np.outer(e, e) + 100.0**2 * np.outer(n, n)
    packed = np.array([[full[0, 0], full[0, 1], full[1, 1]]])
    nothing = np.zeros((1, 3)), np.zeros((1, 2))

    across = elements.boundary_half_width(packed, nothing[0], n[None], nothing[1])
    along = elements.boundary_half_width(packed, nothing[0], e[None], nothing[1])

    assert across[0] == pytest.approx(400.0)
    assert along[0] == 3000.0


def test_published_width_is_550_m_and_fits_no_distant_radar() -> None:
    # A radar of 0.15 degrees at 150 km has 393 m across: 4 sigma are 1.6 km.
    assert elements.published_half_width() == 550.0
    assert _half_width(150_000.0 * np.radians(0.15)) > 2.8 * elements.published_half_width()


# -- the formulas as published --------------------------------------------------------------------------


def test_published_vertex_b_leaves_the_boundary_line_by_110_m() -> None:
    x, y, length = 3000.0, 4000.0, 5000.0

    published = np.array([HALF_M * y / length, -HALF_M * y / length])

    right = elements.rectangle_vertices(A, B, 5, HALF_M)[0, 1]
    assert right == pytest.approx(np.array([HALF_M * y / length, -HALF_M * x / length]))
    assert np.linalg.norm(published - right) == pytest.approx(110.0)


def test_published_slope_of_the_long_sides_is_the_reciprocal() -> None:
    x, y, length = 3000.0, 4000.0, 5000.0
    a, d = elements.rectangle_vertices(A, B, 5, HALF_M)[0, [0, 3]]
    intercept = HALF_M * length / x

    # Both ends of side D-A lie on Y = (y/x) X + b L/x; with the published x/y they miss it by 257 and 93 m.
    assert [(y / x) * p[0] + intercept - p[1] for p in (a, d)] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert [(x / y) * p[0] + intercept - p[1] for p in (a, d)] == pytest.approx([256.67, -93.33], abs=0.01)


def test_published_vertices_hold_for_the_first_element_only() -> None:
    # As printed, C and D of every element contain x/n and y/n, not m x/n and m y/n.
    vertices = elements.rectangle_vertices(A, B, 5, HALF_M)
    published_c = np.array([HALF_M * 0.8 + 3000.0 / 5, -HALF_M * 0.6 + 4000.0 / 5])

    assert vertices[0, 2] == pytest.approx(published_c)
    assert np.linalg.norm(vertices[4, 2] - published_c) == pytest.approx(4000.0)


def test_published_interval_loses_the_first_element() -> None:
    n, fraction = 10, 0.05

    published = [m for m in range(1, n) if m / n <= fraction < (m + 1) / n]

    assert published == []
    assert elements.membership(np.array([[fraction]]), elements.division_fractions(n)[None]).item() == 0


def test_published_odd_and_even_series_run_past_the_end() -> None:
    n = 10
    published_odd = [(2 * m - 1) / n for m in range(1, n)]
    published_even = [2 * m / n for m in range(1, n)]

    assert (published_odd[-1], published_even[-1]) == (1.7, 1.8)
    assert elements.division_fractions(n, "odd").max() == 0.95
    assert elements.division_fractions(n, "even").max() == 1.0


def test_published_width_taken_for_the_half_width_doubles_the_element() -> None:
    as_half = elements.rectangle_vertices(A, B, 5, 2.0 * HALF_M)[0]

    assert np.linalg.norm(as_half[0] - as_half[1]) == pytest.approx(2.0 * 1100.0)
