"""Association: which track a plot without identity belongs to, and which such plots begin new tracks.

gating.py      which tracks are near: cubes of the earth-centred frame
scoring.py     how well a plot fits: statistical distance, or the published multi-factor distance
assignment.py  one-to-one
deciding.py    over several scans, with hysteresis; who has a better claim
associator.py  these together
tentative.py   chains of plots that one flight could have made
clutter.py     density of false plots
initiation.py  new tracks
"""

from aeroskein.association.associator import Associator
from aeroskein.association.deciding import Decision
from aeroskein.association.gating import PointGrid
from aeroskein.association.initiation import FreePlots, Initiated, Initiator
from aeroskein.association.scoring import Candidates, mode_a_cost, velocity_factors

__all__ = [
    "Associator", "Candidates", "Decision", "FreePlots", "Initiated", "Initiator", "PointGrid",
    "mode_a_cost", "velocity_factors",
]  # fmt: skip
