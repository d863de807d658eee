"""What the service says about itself every second: counts per sensor and reason, tracks, points, times, alarms.

Only the worker writes here. What others read - the status message, ``/metrics``, ``/readyz`` - is the finished
dictionary of the last second, which is never changed again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from aeroskein.plots import Array, Ints, Plots
from aeroskein.points import Product
from aeroskein.reasons import Reason
from aeroskein.settings import SensorSettings
from aeroskein_service.sequences import Sequences

__all__ = ["Counters", "is_fresh", "sensor_alarms"]

# A sensor is silent after three of its periods without a batch, but not before this: feeds pause. [s]
SILENT_S: Final = 10.0


class Counters:
    """What has been counted since the start of the service.

    Parameters
    ----------
    sensors : sequence of SensorSettings
        In the order of the engine.
    """

    def __init__(self, sensors: Sequence[SensorSettings]) -> None:
        self._ids = [sensor.id for sensor in sensors]
        self.reports: Ints = np.zeros((len(sensors), len(Reason)), dtype=np.int64)
        self.sequences = [Sequences() for _ in sensors]
        self.batches = [0] * len(sensors)
        self.points = dict.fromkeys(Product, 0)
        self._dropped = [0] * len(sensors)
        self._last_report_s = np.full(len(sensors), np.nan)
        self._latency_s = np.full(len(sensors), np.nan)
        self._delay_sum_s = np.zeros(len(sensors))
        self._delays = np.zeros(len(sensors))

    def reject(self, sensor: int, reason: Reason, many: int = 1) -> None:
        """Count what was wrong with a batch or with reports the engine never saw."""
        self.reports[sensor, reason] += many

    def drop(self, dropped: Sequence[int]) -> None:
        """Count what the inbox has dropped so far: each batch counts as one rejection."""
        for sensor, many in enumerate(dropped):
            self.reports[sensor, Reason.OVERLOAD] += many - self._dropped[sensor]
            self._dropped[sensor] = many

    def see(self, plots: Plots) -> None:
        """Note when reports came and how old they were."""
        sensors = len(self._ids)
        self._delay_sum_s += np.bincount(plots.sensor, plots.received_s - plots.time_s, sensors)
        self._delays += np.bincount(plots.sensor, minlength=sensors)
        np.fmax.at(self._last_report_s, plots.sensor, plots.received_s)

    def last_report_s(self) -> Array:
        """When each sensor's newest report came, NaN where none has."""
        return self._last_report_s

    def per_sensor(self, depths: Sequence[int], dropped: Sequence[int]) -> dict[str, dict[str, Any]]:
        """The ``sensors`` part of the status; the latency is the mean since the last call."""
        seen = self._delays > 0
        self._latency_s[seen] = self._delay_sum_s[seen] / self._delays[seen]
        self._delay_sum_s[:] = self._delays[:] = 0.0
        made = {}
        for index, sensor in enumerate(self._ids):
            counts = self.reports[index]
            made[sensor] = {
                "accepted": int(counts[Reason.ACCEPTED]),
                "rejected": {reason.wire_name: int(counts[reason]) for reason in Reason if reason and counts[reason]},
                "batches": self.batches[index],
                "lost_batches": self.sequences[index].lost,
                "last_report_s": _or_none(self._last_report_s[index]),
                "latency_s": _or_none(self._latency_s[index]),
                "inbox": depths[index],
                "dropped": dropped[index],
            }
        return made


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def is_fresh(sensor: SensorSettings, last_report_s: float | None, now_s: float) -> bool:
    """Whether a sensor has sent lately, by its own period."""
    return last_report_s is not None and now_s - last_report_s <= max(SILENT_S, 3.0 * sensor.period_s)


def sensor_alarms(
    sensors: Sequence[SensorSettings],
    now: Mapping[str, Any],
    before: Mapping[str, Any],
    *,
    now_s: float,
    started_s: float,
) -> list[str]:
    """Sentences about sensors that are silent, lose batches, or flood their inbox.

    ``now`` and ``before`` are the ``sensors`` parts of this status and the last one.
    """
    alarms = []
    for sensor in sensors:
        state, last = now[sensor.id], before.get(sensor.id)
        since_s = started_s if state["last_report_s"] is None else state["last_report_s"]
        if not is_fresh(sensor, since_s, now_s):
            alarms.append(f"no report from {sensor.id} for {now_s - since_s:.0f} s")
        if last is not None and state["dropped"] > last["dropped"]:
            alarms.append(f"{sensor.id} sends faster than the service works: {state['dropped']} batches dropped so far")
    return alarms
