"""Doubt: how much better an assignment is than the best one that gives a plot to another track.

In a formation two plots may as well be exchanged: the assignment that is cheaper by a little is right little more often
than the other. Costs are minus twice the log likelihood, so the difference to the best other assignment says how often.
Other assignments of a plot are: a track that nobody got; and a track that another plot got, which then takes the first
one's track, a track that nobody got, or none.
"""

from __future__ import annotations

import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["lead_of_chosen"]


def lead_of_chosen(plot: Ints, track: Ints, evidence: Array, limit: Array, chosen: Bools) -> Array:
    """By how much each chosen pair leads the best assignment without it.

    Parameters
    ----------
    plot, track : (p,) int64 array
        The pairs that could have been chosen; any labels.
    evidence : (p,) array
        Minus twice the log likelihood of each.
    limit : (p,) array
        The same of a plot that is left alone; one value per plot.
    chosen : (p,) bool array
        The assignment, in which no plot and no track occurs twice.

    Returns
    -------
    (p,) array
        Infinity where nothing else was possible, and for pairs that are not chosen.
    """
    lead = np.full(len(plot), np.inf)
    if not chosen.any() or chosen.all():
        return lead
    _, i = np.unique(plot, return_inverse=True)
    tracks, j = np.unique(track, return_inverse=True)
    own = np.full(int(i.max()) + 1, -1)
    own[i[chosen]] = np.flatnonzero(chosen)
    holder = np.full(len(tracks), -1)
    holder[j[chosen]] = np.flatnonzero(chosen)
    # Pairs that were not chosen, of plots that got another track: what it would cost to choose them instead.
    other = np.flatnonzero(~chosen & (own[i] >= 0))
    step = evidence[other] - evidence[own[i[other]]]
    held = holder[j[other]] >= 0
    # Where nobody has the other track, that is all; for a plot that must give way, staying alone is possible too.
    free = np.full(len(own), np.inf)
    np.minimum.at(free, i[other[~held]], step[~held])
    np.minimum.at(free, i[chosen], limit[chosen] - evidence[chosen])
    rival = holder[j[other[held]]]
    key = i * len(tracks) + j
    order = np.argsort(key, kind="stable")
    wanted = i[rival] * len(tracks) + j[own[i[other[held]]]]
    place = order[np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)]
    exchange = np.where(key[place] == wanted, evidence[place] - evidence[rival], np.inf)
    step[held] += np.minimum(exchange, free[i[rival]])
    best = np.full(len(own), np.inf)
    np.minimum.at(best, i[other], step)
    lead[chosen] = best[i[chosen]]
    return lead
