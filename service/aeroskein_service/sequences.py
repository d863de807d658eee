"""What the batch numbers tell: which batches were lost on the way, and which came twice.

A publisher counts its batches from 0 under an epoch of its own; there is one sequence per full key and epoch. The
first batch seen is the baseline, so that joining late is no loss; a batch that fills a hole later takes the loss back.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

__all__ = ["Sequence", "Sequences"]

# Epochs remembered per sensor: a sensor that restarts makes a new one, so old ones may go.
EPOCHS: Final = 64
# Holes remembered per sequence, and batches below the baseline: an outage of hours at one batch a second.
HOLES: Final = 10_000
# A jump of more than this is a number that went wrong, not a loss: it starts a new baseline.
LARGEST_JUMP: Final = 1_000_000


class Sequence:
    """The batch numbers of one key and epoch."""

    __slots__ = ("_before", "_highest", "_holes", "_lowest", "lost")

    def __init__(self, first: int) -> None:
        self._lowest = self._highest = first
        self._holes: OrderedDict[int, None] = OrderedDict()
        self._before: set[int] = set()
        self.lost = 0

    def take(self, seq: int) -> bool:
        """Count one batch; false where it has come before."""
        if seq > self._highest:
            if seq - self._highest > LARGEST_JUMP:
                self._lowest = seq
                self._before.clear()
                self._holes.clear()
            else:
                self._lose(self._highest + 1, seq)
            self._highest = seq
            return True
        if seq in self._holes:
            del self._holes[seq]
            self.lost -= 1
            return True
        if seq >= self._lowest or seq in self._before:
            return False
        if len(self._before) < HOLES:
            self._before.add(seq)
        return True

    def _lose(self, start: int, end: int) -> None:
        self.lost += end - start
        for seq in range(max(start, end - HOLES), end):
            self._holes[seq] = None
        while len(self._holes) > HOLES:
            self._holes.popitem(last=False)


class Sequences:
    """All sequences of one sensor."""

    def __init__(self) -> None:
        self._sequences: OrderedDict[tuple[str, int], Sequence] = OrderedDict()
        self._forgotten = 0

    def take(self, key: str, epoch: int, seq: int) -> bool:
        """Count one batch; false where it has come before."""
        name = (key, epoch)
        sequence = self._sequences.get(name)
        if sequence is None:
            self._sequences[name] = Sequence(seq)
            if len(self._sequences) > EPOCHS:
                self._forgotten += self._sequences.popitem(last=False)[1].lost
            return True
        self._sequences.move_to_end(name)
        return sequence.take(seq)

    @property
    def lost(self) -> int:
        """Batches that are missing."""
        return self._forgotten + sum(sequence.lost for sequence in self._sequences.values())
