"""The lead of an assignment, against all other assignments."""

from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.association.assignment import assign
from aeroskein.association.doubt import lead_of_chosen
from aeroskein.plots import Array

LIMIT = 14.0


def cost_of(cost: Array, choice: tuple[int, ...]) -> float:
    """Of an assignment: the track of each plot, -1 alone; infinity where two have the same."""
    given_out = [t for t in choice if t >= 0]
    if len(set(given_out)) < len(given_out):
        return np.inf
    return sum(LIMIT if t < 0 else cost[p, t] for p, t in enumerate(choice))


@given(st.lists(st.floats(0.0, 13.0), min_size=4, max_size=4))
def test_with_two_plots_and_two_tracks_it_is_the_cost_of_the_best_other_track(costs: list[float]) -> None:
    cost = np.array(costs).reshape(2, 2)
    plot, track = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    limit = np.full(4, LIMIT)
    chosen = assign(plot, track, cost.reshape(-1), limit)

    lead = lead_of_chosen(plot, track, cost.reshape(-1), limit, chosen)

    own = {int(plot[k]): int(track[k]) for k in np.flatnonzero(chosen)}
    everything = list(product((-1, 0, 1), repeat=2))
    best = min(cost_of(cost, c) for c in everything)
    for k in np.flatnonzero(chosen):
        p = int(plot[k])
        others = [cost_of(cost, c) for c in everything if c[p] >= 0 and c[p] != own[p]]
        assert np.isclose(lead[k], min(others) - best)


def test_a_pair_without_a_rival_leads_without_end() -> None:
    lead = lead_of_chosen(np.array([0]), np.array([3]), np.array([2.0]), np.array([LIMIT]), np.array([True]))

    assert np.isinf(lead).all()
