"""The table of fusion planes: shared by neighbours, made where there is none."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aeroskein import geodesy
from aeroskein.frames import FrameTable

positions = st.tuples(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))


def near(table: FrameTable, *places: tuple[float, float]) -> list[int]:
    lat, lon = np.array(places, dtype=np.float64).reshape(-1, 2).T
    return table.near(lat, lon).tolist()


def test_neighbours_share_a_frame() -> None:
    table = FrameTable()

    found = near(table, (48.02, 11.52), (47.98, 11.46), (48.3, 11.5))

    assert found[0] == found[1]
    assert found[2] != found[0]
    assert len(table.rows) == 2


def test_a_frame_is_found_again_later() -> None:
    table = FrameTable()
    first = near(table, (48.0, 11.5), (10.0, -20.0), (-33.0, 151.0))
    near(table, (60.0, 25.0), (0.0, 0.0))

    assert near(table, (10.0, -20.0), (48.0, 11.5), (-33.0, 151.0)) == [first[1], first[0], first[2]]
    assert len(table.rows) == 5


def test_both_names_of_the_antimeridian_are_one_place() -> None:
    table = FrameTable()

    assert len(set(near(table, (20.0, 180.0), (20.0, -180.0), (20.0, 179.95), (20.0, -179.95)))) == 1


def test_a_pole_is_one_place() -> None:
    table = FrameTable()

    assert len(set(near(table, (90.0, 0.0), (90.0, 90.0), (89.99, -170.0), (89.95, 33.0)))) == 1
    assert near(table, (-90.0, 0.0)) != near(table, (90.0, 0.0))


def test_nothing_asked_makes_nothing() -> None:
    table = FrameTable()

    assert near(table) == []
    assert table.rows.shape == (0, 12)


@given(st.lists(st.lists(positions, min_size=1, max_size=6), min_size=1, max_size=5))
def test_every_position_gets_the_frame_of_its_own_origin(calls: list[list[tuple[float, float]]]) -> None:
    table = FrameTable()
    found = [near(table, *call) for call in calls]

    for call, indices in zip(calls, found, strict=True):
        lat, lon = np.array(call).T
        wanted = geodesy.frame_rows(*geodesy.snap_origin(lat, lon))
        assert np.array_equal(table.rows[indices], wanted)
        e, n = geodesy.to_plane(table.rows[indices], lat, lon)
        assert np.hypot(e, n).max() < 22_000.0
    assert len(table.rows) == len(np.unique(table.rows, axis=0))
