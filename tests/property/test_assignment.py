"""One-to-one assignment, against scipy's solver of the full matrix."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from aeroskein.association.assignment import assign


@given(
    plots=st.integers(1, 14),
    tracks=st.integers(1, 14),
    density=st.sampled_from([0.1, 0.3, 1.0]),
    limit=st.floats(0.5, 12.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_chosen_pairs_are_the_cheapest_set(
    plots: int, tracks: int, density: float, limit: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    cost = rng.exponential(5.0, (plots, tracks)) - 2.0
    plot, track = np.nonzero(rng.random((plots, tracks)) < density)

    chosen = assign(plot * 7, track + 1000, cost[plot, track], np.full(len(plot), limit))

    # The same by brute force: a pair that is not made, or not allowed, saves nothing.
    saving = np.zeros((plots, tracks))
    saving[plot, track] = np.minimum(cost[plot, track] - limit, 0.0)
    best = saving[linear_sum_assignment(saving)].sum()
    assert abs((cost[plot, track][chosen] - limit).sum() - best) < 1e-9


@given(n=st.integers(0, 40), seed=st.integers(0, 2**32 - 1))
def test_no_plot_and_no_track_occurs_twice(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    plot, track = rng.integers(0, 6, n), rng.integers(0, 6, n)
    plot, track = np.unique(np.stack([plot, track]), axis=1)

    chosen = assign(plot, track, rng.random(len(plot)), np.full(len(plot), 0.8))

    assert len(set(plot[chosen])) == len(set(track[chosen])) == chosen.sum()
