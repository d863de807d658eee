"""Small tools for columns that are sorted by a group: runs, neighbours, ranges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Bools, Ints

__all__ = ["expand_ranges", "group_starts", "run_lengths"]


def group_starts(group: NDArray[Any]) -> Ints:
    """First row of every run of equal values, and the number of rows as a last entry."""
    if len(group) == 0:
        return np.zeros(1, dtype=np.int64)
    changes = np.flatnonzero(group[1:] != group[:-1]) + 1
    return np.concatenate([[0], changes, [len(group)]]).astype(np.int64)


def expand_ranges(first: Ints, count: Ints) -> tuple[Ints, Ints]:
    """Write ranges out: which range each number comes from, and the number.

    ``first = [5, 9]``, ``count = [2, 3]`` gives ``[0, 0, 1, 1, 1]`` and ``[5, 6, 9, 10, 11]``.
    """
    owner = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return owner, first[owner] + within


def run_lengths(flag: Bools, group: NDArray[Any]) -> Ints:
    """For every row, how many consecutive rows of its group around it have the flag; 0 where it has not."""
    if len(flag) == 0:
        return np.zeros(0, dtype=np.int64)
    breaks = np.append(True, (flag[1:] != flag[:-1]) | (group[1:] != group[:-1]))
    run = np.cumsum(breaks) - 1
    return np.where(flag, np.bincount(run)[run], 0)
