"""The sensors as the page knows them: which bit stands for which, what kind it is, and when it counts as silent.

With a configuration they are known beforehand. Without one they are learned from the feed (a sensor that contributes),
from the status (a sensor the service counts) and from registration states (a sensor that has one is a radar).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.settings import SensorSettings

__all__ = ["MOST_SENSORS", "SensorTable"]

# Bits of the field ``sensors`` of a record; more sensors than that share the last one.
MOST_SENSORS: Final = 32
# A sensor contributes to a track for this many of its periods after its last accepted report, at least 5 s.
CONTRIBUTES_PERIODS: Final = 2.5
CONTRIBUTES_MIN_S: Final = 5.0
UNKNOWN_PERIOD_S: Final = 5.0  # of a sensor nobody has described


class SensorTable:
    """Sensors in the order of their bits.

    Parameters
    ----------
    sensors : iterable of SensorSettings
        As configured; more are added as they are met.
    """

    def __init__(self, sensors: Iterable[SensorSettings] = ()) -> None:
        self.ids: list[str] = []
        self._settings = {sensor.id: sensor for sensor in sensors}
        self._radars = {sensor.id for sensor in self._settings.values() if sensor.is_radar}
        self._index: dict[str, int] = {}
        for name in self._settings:
            self.index(name)

    def __len__(self) -> int:
        return len(self.ids)

    def index(self, sensor: str) -> int:
        """The bit of a sensor; a new one gets the next."""
        found = self._index.get(sensor)
        if found is None:
            found = len(self.ids)
            if found >= MOST_SENSORS:
                return MOST_SENSORS - 1
            self._index[sensor] = found
            self.ids.append(sensor)
        return found

    def note_radar(self, sensor: str) -> None:
        """Learn that a sensor is a radar."""
        self.index(sensor)
        self._radars.add(sensor)

    def contributes_s(self) -> NDArray[np.float64]:
        """How long each sensor counts as contributing after its last report. [s]"""
        periods = [self._settings[name].period_s if name in self._settings else UNKNOWN_PERIOD_S for name in self.ids]
        return np.maximum(CONTRIBUTES_MIN_S, CONTRIBUTES_PERIODS * np.array(periods, dtype=np.float64))

    def describe(self) -> list[dict[str, Any]]:
        """What the page needs to know about each, in the order of the bits."""
        return [self._description(name) for name in self.ids]

    def _description(self, name: str) -> dict[str, Any]:
        known = self._settings.get(name)
        if known is None:
            return {"id": name, "kind": "ssr" if name in self._radars else "adsb", "radar": name in self._radars}
        return {
            "id": name,
            "kind": known.kind,
            "radar": known.is_radar,
            "lat_deg": known.lat_deg,
            "lon_deg": known.lon_deg,
            "height_m": known.height_m,
            "period_s": known.period_s,
            "range_max_m": known.range_max_m,
            "range_sigma_m": known.range_sigma_m if known.is_radar else None,
            "azimuth_sigma_deg": known.azimuth_sigma_deg if known.is_radar else None,
        }
