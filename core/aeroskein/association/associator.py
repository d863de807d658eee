"""The front of association: candidates in, decision out."""

from __future__ import annotations

import numpy as np

from aeroskein.association.deciding import Claims, Decision, PairingMemory
from aeroskein.association.scoring import Candidates, Scorer
from aeroskein.plots import Array, Bools, Ints
from aeroskein.settings import EngineSettings

__all__ = ["Associator"]


class Associator:
    """Gives plots without identity to tracks.

    The caller finds pairs (``PointGrid``), predicts the tracks of the pairs to the plots' times and fills
    ``Candidates``; this class scores them, decides and remembers.

    Parameters
    ----------
    settings : EngineSettings
        Sensors and the section ``association``.
    slots : int
        Track slots.
    """

    def __init__(self, settings: EngineSettings, slots: int) -> None:
        period_s = np.array([s.period_s for s in settings.sensors])
        self.scorer = Scorer(settings.association)
        self.claims = Claims(period_s, slots)
        self._memory = PairingMemory(period_s)

    def decide(
        self,
        sensor: Ints,
        local_track: Ints,
        time_s: Array,
        pairs: Candidates,
        taken: Bools,
        spared: Bools | None = None,
    ) -> Decision:
        """Score the pairs and decide; see ``PairingMemory.decide``. Tracks spare nothing where it is not said."""
        spared = np.zeros(len(pairs), dtype=np.bool_) if spared is None else spared
        return self._memory.decide(sensor, local_track, time_s, pairs, self.scorer.score(pairs), taken, spared)

    def partner(self, sensor: Ints, local_track: Ints) -> Ints:
        """Established track number of a sensor's own targets, ``(n,)``; -1 where none."""
        return self._memory.partner(sensor, local_track)
