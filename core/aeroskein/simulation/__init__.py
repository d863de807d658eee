"""Seeded scenarios with truth: flights over the ellipsoid, and what ADS-B, WAM and radars make of them.

scenarios ─► traffic (who, when, where from) ─► trajectory (20 Hz truth, in blocks)
                                                      │
                      squitters (ADS-B, WAM), radar ◄─┘─► truth samples
                                 │
                             delivery ─► simulator: chunks in order of arrival
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
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

# Loaded when it is asked for: a service only wants to know the settings.
_HOMES: Final = {
    "aeroskein.simulation.settings": ("SCENARIOS", "Scenario", "SensorErrors", "SimulationSettings"),
    "aeroskein.simulation.simulator": ("Chunk", "in_chunks", "sensor_models", "simulate", "truth_by_track"),
    "aeroskein.simulation.truth": ("Phase", "TruthStates"),
}
_HOME_OF: Final = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)
