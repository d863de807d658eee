"""Memory per track is fixed, and docs/architecture.md states it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aeroskein.engine import FusionEngine
from aeroskein.settings import EngineSettings
from aeroskein_service.config import load_config

ROOT = Path(__file__).resolve().parents[2]
SLOTS = 256


def array_bytes(thing: Any, seen: set[int]) -> int:
    """Bytes of all arrays that hang on an object of ours, each counted once."""
    if id(thing) in seen:
        return 0
    seen.add(id(thing))
    if isinstance(thing, np.ndarray):
        return int(thing.nbytes)
    if isinstance(thing, list | tuple):
        return sum(array_bytes(part, seen) for part in thing)
    if isinstance(thing, dict):
        return sum(array_bytes(part, seen) for part in thing.values())
    if not type(thing).__module__.startswith("aeroskein"):
        return 0
    names = list(getattr(thing, "__dict__", {})) + [n for c in type(thing).__mro__ for n in getattr(c, "__slots__", ())]
    return sum(array_bytes(getattr(thing, name), seen) for name in names if hasattr(thing, name))


def bytes_per_track(settings: EngineSettings) -> float:
    """What one more slot costs."""
    sizes = []
    for capacity in (SLOTS, 2 * SLOTS):
        tracks = replace(settings.tracks, capacity=capacity)
        sizes.append(array_bytes(FusionEngine(replace(settings, tracks=tracks), epoch_ms=0), set()))
    return (sizes[1] - sizes[0]) / SLOTS


def test_bytes_per_track_are_those_on_the_architecture_page() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    parts = [int(number.replace(",", "")) for number in re.findall(r"^\| [^|*]+ \| ([\d,]+) \|$", page, re.MULTILINE)]
    stated = re.search(r"^\| \*\*sum\*\* \| \*\*([\d,]+)\*\* \|$", page, re.MULTILINE)
    assert stated is not None

    settings = load_config(ROOT / "deploy" / "fusion.toml", environ={}).engine

    assert sum(parts) == int(stated[1].replace(",", "")) == bytes_per_track(settings)
