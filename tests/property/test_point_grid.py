"""Neighbours found by the grid, against comparing all with all."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.association import PointGrid
from aeroskein.ellipsoid import to_ecef

# Where longitudes break: around the antimeridian, a pole, and an ordinary place.
centres = st.sampled_from([(10.0, 180.0), (90.0, 0.0), (-89.99, 30.0), (48.0, 11.0)])


@given(centre=centres, reach_m=st.floats(50.0, 20_000.0), seed=st.integers(0, 2**32 - 1))
def test_the_grid_finds_exactly_the_pairs_within_reach(centre: tuple[float, float], reach_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    lat = np.clip(centre[0] + rng.normal(size=60) * 0.1, -90.0, 90.0)
    lon = centre[1] + rng.normal(size=60) * 0.1
    points = to_ecef(lat, lon)
    queries, points = points[:25], points[25:]
    points[3] = np.nan

    query, point = PointGrid(points, reach_m).near(queries, reach_m)

    distance = np.linalg.norm(queries[:, None] - points[None], axis=2)
    expected = np.stack(np.nonzero(distance <= reach_m), axis=-1)
    assert np.stack([query, point], axis=-1).tolist() == expected.tolist()


@given(seed=st.integers(0, 2**32 - 1))
def test_each_query_has_its_own_distance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-5e3, 5e3, (30, 3)) + 6.4e6
    distance = rng.uniform(0.0, 3e3, 30)

    query, point = PointGrid(points, 3e3).near(points, distance)

    gap = np.linalg.norm(points[query] - points[point], axis=1)
    assert (gap <= distance[query]).all()
    assert set(zip(range(30), range(30), strict=True)) <= set(zip(query.tolist(), point.tolist(), strict=True))
