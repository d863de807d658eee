"""One-to-one assignment of plots to tracks: the cheapest set of pairs in which nobody occurs twice.

Sparse Jonker-Volgenant (``lap.lapmod``) over the pairs inside the gate only. Every plot and every track also has a
place of its own at which it stays alone, so that a pair is made only where it is cheaper than two left alone. Pairs
that nobody else competes for are taken out first.
"""

from __future__ import annotations

import lap
import numpy as np

from aeroskein.plots import Array, Bools, Ints

__all__ = ["assign"]


def assign(plot: Ints, track: Ints, cost: Array, limit: Array) -> Bools:
    """Choose pairs.

    Parameters
    ----------
    plot, track : (p,) int64 array
        The pairs that may be chosen; any labels.
    cost : (p,) array
        Cost of each.
    limit : (p,) array
        Cost from which a pair is not worth making; one value per plot.

    Returns
    -------
    (p,) bool array
        The chosen pairs: no plot and no track occurs in two of them.
    """
    # Relative to staying alone, a pair costs cost - limit; what is not below zero is never chosen.
    gain = limit - cost
    worth = np.flatnonzero(gain > 0.0)
    chosen = np.zeros(len(plot), dtype=np.bool_)
    if not len(worth):
        return chosen
    _, i = np.unique(plot[worth], return_inverse=True)
    _, j = np.unique(track[worth], return_inverse=True)
    alone = (np.bincount(i)[i] == 1) & (np.bincount(j)[j] == 1)
    chosen[worth[alone]] = True
    rest = np.flatnonzero(~alone)
    if len(rest):
        _, i = np.unique(i[rest], return_inverse=True)
        _, j = np.unique(j[rest], return_inverse=True)
        chosen[worth[rest[_solve(i, j, gain[worth[rest]])]]] = True
    return chosen


def _solve(i: Ints, j: Ints, gain: Array) -> Bools:
    """Chosen pairs of rows ``i`` (0 to n - 1) and columns ``j`` (0 to m - 1) with positive gains."""
    n, m = int(i.max()) + 1, int(j.max()) + 1
    # Row r < n: plot; row n + c: the twin of track c. Column c < m: track; column m + r: the twin of plot r.
    # A plot with its own twin is alone; the twins of a chosen pair go with each other at no cost.
    base = float(gain.max())
    rows = np.concatenate([i, np.arange(n), n + np.arange(m), n + j])
    columns = np.concatenate([j, m + np.arange(n), np.arange(m), m + i])
    # A pair and its twins cost base - gain + base; both alone cost base each, so the difference is the gain.
    cost = np.concatenate([base - gain, np.full(n, base), np.full(m, base), np.full(len(i), base)])
    order = np.lexsort((columns, rows))
    begins = np.searchsorted(rows[order], np.arange(n + m + 1))
    partner = np.asarray(
        lap.lapmod(n + m, cost[order], begins.astype(np.int32), columns[order].astype(np.int32), return_cost=False)[0]
    )
    solved: Bools = partner[i] == j
    return solved
