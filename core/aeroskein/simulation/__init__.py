"""Seeded scenarios with truth: flights over the ellipsoid, and what ADS-B, WAM and radars make of them.

scenarios ─► traffic (who, when, where from) ─► trajectory (20 Hz truth, in blocks)
                                                      │
                      squitters (ADS-B, WAM), radar ◄─┘─► truth samples
                                 │
                             delivery ─► simulator: chunks in order of arrival
"""

from aeroskein.simulation.settings import SCENARIOS, Scenario, SensorErrors, SimulationSettings
from aeroskein.simulation.simulator import Chunk, in_chunks, sensor_models, simulate, truth_by_track
from aeroskein.simulation.truth import Phase, TruthStates

__all__ = [
    "SCENARIOS",
    "Chunk",
    "Phase",
    "Scenario",
    "SensorErrors",
    "SimulationSettings",
    "TruthStates",
    "in_chunks",
    "sensor_models",
    "simulate",
    "truth_by_track",
]
