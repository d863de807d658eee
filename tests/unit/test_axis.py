"""The axis as a polyline: coordinates along and across, borders, and reading values off it."""

import numpy as np
import pytest

from aeroskein.axis import axis_stations, border_lines, interpolate_on_axis, project_on_axis, sagitta

# 3 km east, then 4 km north: one left turn of a right angle.
CORNER = np.array([[[0.0, 0.0], [3000.0, 0.0], [3000.0, 4000.0]]])


def _one(point: tuple[float, float], axis: np.ndarray = CORNER) -> tuple[float, float, int]:
    s, c, piece = project_on_axis(np.array([[point]]), axis)
    return float(s[0, 0]), float(c[0, 0]), int(piece[0, 0])


def test_stations_are_arc_lengths() -> None:
    assert axis_stations(CORNER).tolist() == [[0.0, 3000.0, 7000.0]]


@pytest.mark.parametrize(
    ("point", "s", "c", "piece"),
    [
        ((1000.0, 200.0), 1000.0, 200.0, 0),
        ((1000.0, -200.0), 1000.0, -200.0, 0),
        ((2900.0, 1500.0), 4500.0, 100.0, 1),
        ((3250.0, 1500.0), 4500.0, -250.0, 1),
        ((-500.0, 40.0), -500.0, 40.0, 0),
        ((3030.0, 5000.0), 8000.0, -30.0, 1),
    ],
    ids=["left", "right", "left of the second", "right of the second", "before the start", "behind the end"],
)
def test_points_have_coordinates_along_and_across_the_nearest_piece(
    point: tuple[float, float], s: float, c: float, piece: int
) -> None:
    assert _one(point) == (pytest.approx(s), pytest.approx(c), piece)


def test_a_point_outside_the_corner_belongs_to_the_corner() -> None:
    s, c, _ = _one((3030.0, -40.0))

    assert s == pytest.approx(3000.0)
    assert c == pytest.approx(-50.0)


def test_a_chord_measures_by_its_two_unit_vectors() -> None:
    rng = np.random.default_rng(1)
    points, ends = rng.normal(size=(20, 30, 2)) * 3000.0, rng.normal(size=(20, 2, 2)) * 3000.0

    s, c, piece = project_on_axis(points, ends)

    chord = ends[:, 1] - ends[:, 0]
    e = chord / np.linalg.norm(chord, axis=1)[:, None]
    n = np.stack([-e[:, 1], e[:, 0]], axis=-1)
    away = points - ends[:, :1]
    assert s == pytest.approx(np.einsum("nkc,nc->nk", away, e), abs=1e-8)
    assert c == pytest.approx(np.einsum("nkc,nc->nk", away, n), abs=1e-8)
    assert (piece == 0).all()


def test_repeated_points_at_the_end_change_nothing() -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(-1000.0, 6000.0, size=(1, 200, 2))
    padded = np.concatenate([CORNER, CORNER[:, -1:], CORNER[:, -1:]], axis=1)

    plain, other = project_on_axis(points, CORNER), project_on_axis(points, padded)

    assert np.array_equal(plain[0], other[0])
    assert np.array_equal(plain[1], other[1])


def test_hovering_measures_the_distance_from_the_place() -> None:
    s, c, _ = project_on_axis(np.array([[[13.0, 24.0], [7.0, 20.0]]]), np.full((1, 3, 2), [10.0, 20.0]))

    assert s.tolist() == [[0.0, 0.0]]
    assert c == pytest.approx(np.array([[5.0, 3.0]]))


def test_flights_do_not_touch_each_other() -> None:
    rng = np.random.default_rng(3)
    axes, points = np.cumsum(rng.normal(size=(50, 7, 2)) * 300.0, axis=1), rng.normal(size=(50, 9, 2)) * 1000.0
    axes[10:20, 4:] = axes[10:20, 3:4]

    together = project_on_axis(points, axes)

    for i in range(50):
        alone = project_on_axis(points[[i]], axes[[i]])
        assert [np.array_equal(a[i], b[0]) for a, b in zip(together, alone, strict=True)] == [True] * 3


def test_a_missing_point_has_no_coordinates() -> None:
    s, c, _ = project_on_axis(np.array([[[np.nan, 1.0]]]), CORNER)

    assert np.isnan(s).all()
    assert np.isnan(c).all()


def test_a_point_falls_on_the_lap_that_time_allows() -> None:
    # Out and back on parallels 200 m apart; a point 90 m from the first leg was flown on the second.
    axis = np.array([[[0.0, 0.0], [5000.0, 0.0], [5000.0, 200.0], [0.0, 200.0]]])
    point = np.array([[[2000.0, 90.0]]])

    anywhere = project_on_axis(point, axis)
    second = project_on_axis(point, axis, np.array([[[False, False, True]]]))
    nowhere = project_on_axis(point, axis, np.array([[[False, False, False]]]))

    assert (anywhere[0].item(), anywhere[1].item()) == pytest.approx((2000.0, 90.0))
    assert (second[0].item(), second[1].item()) == pytest.approx((8200.0, 110.0))
    assert np.isnan([nowhere[0].item(), nowhere[1].item()]).all()


# -- reading values off the axis ---------------------------------------------------------------------------------------


def test_times_are_read_off_the_axis_and_prolonged() -> None:
    times = np.array([[10.0, 40.0, 60.0]])

    read = interpolate_on_axis(axis_stations(CORNER), times, np.array([[0.0, 1500.0, 3000.0, 5000.0, 9000.0, -300.0]]))

    assert read.tolist() == [[10.0, 25.0, 40.0, 50.0, 70.0, 7.0]]


def test_points_read_at_stations_lie_on_the_axis() -> None:
    read = interpolate_on_axis(axis_stations(CORNER), CORNER, np.array([[1000.0, 4000.0]]))

    assert read.tolist() == [[[1000.0, 0.0], [3000.0, 1000.0]]]


@pytest.mark.parametrize(
    ("stations", "at", "expected"),
    [
        ([0.0, 10.0, 10.0, 10.0], 15.0, 1.5),
        ([0.0, 0.0, 10.0, 20.0], -5.0, 0.5),
        ([0.0, 0.0, 10.0, 20.0], 5.0, 1.5),
        ([4.0, 4.0, 4.0, 4.0], 9.0, 0.0),
    ],
)
def test_repeated_stations_do_not_divide_by_zero(stations: list[float], at: float, expected: float) -> None:
    read = interpolate_on_axis(np.array([stations]), np.array([[0.0, 1.0, 2.0, 3.0]]), np.array([[at]]))

    assert read.item() == pytest.approx(expected)


# -- borders -----------------------------------------------------------------------------------------------------------


def test_borders_of_a_chord_are_two_parallels() -> None:
    left, right = border_lines(np.array([[[0.0, 0.0], [3000.0, 4000.0]]]), 550.0)

    assert left[0] == pytest.approx(np.array([[-440.0, 330.0], [2560.0, 4330.0]]))
    assert right[0] == pytest.approx(np.array([[440.0, -330.0], [3440.0, 3670.0]]))


def test_borders_keep_their_distance_round_a_corner() -> None:
    left, right = border_lines(CORNER, np.array([100.0]))

    assert left[0] == pytest.approx(np.array([[0.0, 100.0], [2900.0, 100.0], [2900.0, 4000.0]]))
    assert right[0] == pytest.approx(np.array([[0.0, -100.0], [3100.0, -100.0], [3100.0, 4000.0]]))


def test_borders_of_a_reversal_stay_near() -> None:
    axis = np.array([[[0.0, 0.0], [1000.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [1000.0, 0.0], [0.0, 10.0]]])

    left, right = border_lines(axis, 100.0)

    assert np.linalg.norm(left - axis, axis=-1).max() <= 200.0 + 1e-9
    assert np.linalg.norm(right - axis, axis=-1).max() <= 200.0 + 1e-9


def test_borders_ignore_repeated_points_at_either_end() -> None:
    axis = np.array([[[0.0, 0.0], [0.0, 0.0], [1000.0, 0.0], [1000.0, 0.0]]])

    left, _ = border_lines(axis, 100.0)

    assert left[0] == pytest.approx(np.array([[0.0, 100.0], [0.0, 100.0], [1000.0, 100.0], [1000.0, 100.0]]))


def test_borders_without_a_direction_lie_on_the_axis() -> None:
    axis = np.full((1, 2, 2), 7.0)

    left, right = border_lines(axis, 100.0)

    assert np.array_equal(left, axis)
    assert np.array_equal(right, axis)


def test_sagitta_is_that_of_the_arc() -> None:
    # 3 degrees a second at 130 m/s for one second.
    turn = np.radians(3.0)
    radius = 130.0 / turn

    assert sagitta(np.array([130.0]), np.array([-turn]))[0] == pytest.approx(radius * (1 - np.cos(turn / 2)), rel=1e-3)
