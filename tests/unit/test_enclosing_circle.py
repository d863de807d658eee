"""Smallest enclosing circles: the shapes that decide, and agreement with an optimiser."""

import numpy as np
import pytest
from scipy.optimize import minimize

from aeroskein.enclosing_circle import smallest_circles


def _circle(*points: tuple[float, float]) -> tuple[list[float], float]:
    centers, radii = smallest_circles(np.array([points], dtype=np.float64))
    return centers[0].tolist(), float(radii[0])


def test_circle_of_one_plot_is_the_plot() -> None:
    assert _circle((3.0, -4.0)) == ([3.0, -4.0], 0.0)


def test_circle_of_two_plots_is_their_midpoint() -> None:
    assert _circle((0.0, 0.0), (6.0, 8.0)) == ([3.0, 4.0], 5.0)


def test_circle_of_plots_on_a_line_has_the_line_as_diameter() -> None:
    center, radius = _circle((0.0, 0.0), (10.0, 20.0), (1.0, 2.0), (4.0, 8.0))

    assert center == pytest.approx([5.0, 10.0], abs=1e-12)
    assert radius == pytest.approx(np.sqrt(125.0), rel=1e-15)


def test_circle_of_equal_plots_is_the_plot() -> None:
    assert _circle(*[(7.0, 7.0)] * 5) == ([7.0, 7.0], 0.0)


def test_circle_of_an_acute_triangle_is_its_circumcircle() -> None:
    center, radius = _circle((5.0, 0.0), (-3.0, 4.0), (-4.0, -3.0))

    assert center == pytest.approx([0.0, 0.0], abs=1e-12)
    assert radius == pytest.approx(5.0)


def test_circle_of_an_obtuse_triangle_has_its_longest_side_as_diameter() -> None:
    # The published circumcircle would have its centre 247.5 m off and a radius of 252.5 m.
    center, radius = _circle((0.0, 0.0), (100.0, 0.0), (50.0, 5.0))

    assert center == pytest.approx([50.0, 0.0], abs=1e-10)
    assert radius == pytest.approx(50.0)


def test_circle_of_a_right_triangle_has_the_hypotenuse_as_diameter() -> None:
    center, radius = _circle((0.0, 0.0), (3.0, 0.0), (0.0, 4.0))

    assert center == pytest.approx([1.5, 2.0], abs=1e-12)
    assert radius == pytest.approx(2.5)


def test_a_set_without_plots_has_no_circle() -> None:
    centers, radii = smallest_circles(np.zeros((1, 3, 2)), np.zeros((1, 3), dtype=bool))

    assert np.isnan(centers).all()
    assert np.isnan(radii).all()


@pytest.mark.parametrize("shape", [(0, 5, 2), (2, 0, 2), (0, 0, 2)])
def test_no_sets_and_no_places_are_allowed(shape: tuple[int, int, int]) -> None:
    centers, radii = smallest_circles(np.zeros(shape))

    assert centers.shape == (shape[0], 2)
    assert radii.shape == (shape[0],)


def test_masked_plots_do_not_count_whatever_they_hold() -> None:
    points = np.array([[[np.nan, np.inf], [0.0, 0.0], [2.0, 0.0], [1e9, 1e9]]])

    centers, radii = smallest_circles(points, np.array([[False, True, True, False]]))

    assert centers.tolist() == [[1.0, 0.0]]
    assert radii.tolist() == [1.0]


def test_a_plot_that_is_not_finite_spoils_its_own_set_only() -> None:
    points = np.array([[[0.0, 0.0], [np.nan, 0.0]], [[0.0, 0.0], [2.0, 0.0]]])

    centers, _ = smallest_circles(points)

    assert np.isnan(centers[0]).all()
    assert centers[1].tolist() == [1.0, 0.0]


def test_sets_of_different_sizes_do_not_touch_each_other() -> None:
    rng = np.random.default_rng(11)
    points = rng.normal(size=(200, 8, 2)) * 500.0
    mask = rng.random((200, 8)) < 0.6
    mask[:, 0] = True

    together = smallest_circles(points, mask)

    alone = [smallest_circles(points[i, mask[i]][None]) for i in range(200)]
    assert together[0] == pytest.approx(np.concatenate([a[0] for a in alone]), abs=1e-9)
    assert together[1] == pytest.approx(np.concatenate([a[1] for a in alone]), rel=1e-12)


def test_fifty_plots_on_a_rim_have_that_rim() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 50, endpoint=False)
    points = np.stack([1e5 + 300.0 * np.cos(angle), -2e5 + 300.0 * np.sin(angle)], axis=-1)[None]

    centers, radii = smallest_circles(points)

    assert centers[0] == pytest.approx([1e5, -2e5], abs=1e-6)
    assert radii[0] == pytest.approx(300.0, abs=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_circle_of_fifty_plots_is_what_an_optimiser_finds(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(50, 2))
    inside = {"type": "ineq", "fun": lambda v: v[2] - ((points - v[:2]) ** 2).sum(axis=1)}

    centers, radii = smallest_circles(points[None])

    best = minimize(lambda v: v[2], [0.0, 0.0, 25.0], constraints=[inside], method="SLSQP", options={"ftol": 1e-14})
    assert centers[0] == pytest.approx(best.x[:2], abs=1e-6)
    assert radii[0] == pytest.approx(np.sqrt(best.x[2]), rel=1e-8)


@pytest.mark.parametrize("size", [4, 12, 40])
def test_the_rim_holds_the_centre_from_all_sides(size: int) -> None:
    # A circle around all points is the smallest exactly when no half of its rim is free of points.
    rng = np.random.default_rng(size)
    angle, radius = rng.uniform(0.0, 2.0 * np.pi, (1000, size)), rng.uniform(0.8, 1.0, (1000, size))
    points = 500.0 * np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)

    centers, radii = smallest_circles(points)

    away = points - centers[:, None, :]
    on_rim = np.hypot(away[..., 0], away[..., 1]) > radii[:, None] * (1.0 - 1e-9)
    seen = np.where(on_rim, np.arctan2(away[..., 1], away[..., 0]), np.nan)
    ordered = np.sort(seen, axis=1)
    around = np.concatenate([ordered, ordered[:, :1] + 2.0 * np.pi], axis=1)
    gaps = np.diff(np.sort(around, axis=1), axis=1)
    assert on_rim.sum(axis=1).min() >= 2
    assert np.nanmax(gaps) <= np.pi + 1e-4
