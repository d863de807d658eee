"""Streaming track fusion for air surveillance: reports of ADS-B and radars in, one picture of the traffic out.

    receive   Plots ─► intake ─► applied biases ─► conversion ─► identity ─► repeats ─► integrity
                                        ▲                                                   │
                                        │       live FusedPoints ◄─ live filter ◄───────────┤  in order of arrival
                                        │                                                   ▼
    advance   registration ◄─ references ◄─ closing: division points, both passes ◄───── buffers  in order of time
                                                │
                                                └─► fusion ─► element FusedPoints

Everything is columns: ``Plots`` go in, ``FusedPoints`` come out, state lives in arrays by track slot. The core has no
clock, no I/O and no log; time is an argument, and what happened comes back as events:

    engine = FusionEngine(EngineSettings(sensors=(SensorSettings(id="adsb", kind="adsb"),)), epoch_ms=0)
    events = engine.receive(plots, now_s=now_s)  # live points, rejections, changes of tracks
    events += engine.advance(now_s=now_s)  # element points whose watermark has passed

``docs/architecture.md`` says which module does what and who may import whom, ``docs/algorithm.md`` which published step
each function is. The names below are the public ones; everything else may change.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aeroskein.engine import ElementRecord as ElementRecord
    from aeroskein.engine import FusionEngine as FusionEngine
    from aeroskein.errors import AeroskeinError as AeroskeinError
    from aeroskein.errors import SettingsError as SettingsError
    from aeroskein.errors import SnapshotError as SnapshotError
    from aeroskein.errors import UnknownSensorError as UnknownSensorError
    from aeroskein.events import Dispositions as Dispositions
    from aeroskein.events import Event as Event
    from aeroskein.events import RegistrationState as RegistrationState
    from aeroskein.events import Rejections as Rejections
    from aeroskein.events import TrackChanges as TrackChanges
    from aeroskein.plots import Plots as Plots
    from aeroskein.points import Flag as Flag
    from aeroskein.points import FusedPoints as FusedPoints
    from aeroskein.points import Product as Product
    from aeroskein.points import Status as Status
    from aeroskein.reasons import Reason as Reason
    from aeroskein.selection import Selection as Selection
    from aeroskein.settings import AssociationSettings as AssociationSettings
    from aeroskein.settings import EngineSettings as EngineSettings
    from aeroskein.settings import FusionSettings as FusionSettings
    from aeroskein.settings import PatentSettings as PatentSettings
    from aeroskein.settings import RegistrationSettings as RegistrationSettings
    from aeroskein.settings import SensorSettings as SensorSettings
    from aeroskein.settings import TrackSettings as TrackSettings

# Where each public name lives; imported when it is first used, so that a command's --help need not wait for numpy.
_HOME = {
    "engine": ("ElementRecord", "FusionEngine"),
    "errors": ("AeroskeinError", "SettingsError", "SnapshotError", "UnknownSensorError"),
    "events": ("Dispositions", "Event", "RegistrationState", "Rejections", "TrackChanges"),
    "plots": ("Plots",),
    "points": ("Flag", "FusedPoints", "Product", "Status"),
    "reasons": ("Reason",),
    "selection": ("Selection",),
    "settings": (
        "AssociationSettings",
        "EngineSettings",
        "FusionSettings",
        "PatentSettings",
        "RegistrationSettings",
        "SensorSettings",
        "TrackSettings",
    ),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"aeroskein.{_MODULE_OF[name]}"), name)
