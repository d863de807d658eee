"""What the service says about itself, and how that went over the last minutes: rates, latencies, registration."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import msgspec

from aeroskein_service.codec import media_type
from aeroskein_service.messages import JSON, VERSION
from aeroskein_service.web.sensor_table import SensorTable

__all__ = ["ServiceWatch"]

STATUSES: Final = 300  # seconds of rates that are kept
STATES: Final = 720  # registration states kept for each radar: an hour at one every 5 s
INSTANCES: Final = 16  # services remembered at a time
GONE_S: Final = 5.0  # a service that has said nothing for so long gives way to another one
# What a registration history holds of each state.
REGISTERED: Final = (
    "time_s", "state", "range_bias_m", "range_bias_sigma_m", "azimuth_bias_deg", "azimuth_bias_sigma_deg",
    "time_bias_s", "time_bias_sigma_s", "range_gain", "range_gain_sigma", "samples", "aircraft",
)  # fmt: skip


class ServiceWatch:
    """Collects status and registration messages.

    Parameters
    ----------
    sensors : SensorTable
        Learns the sensors that are counted, and which are radars.
    clock : callable
        Gives the time. [s since the epoch]
    """

    def __init__(self, sensors: SensorTable, clock: Callable[[], float] = time.time) -> None:
        self._sensors = sensors
        self._clock = clock
        self._lock = threading.Lock()
        self._arrived: dict[str, tuple[float, dict[str, Any]]] = {}
        self._states: dict[str, deque[dict[str, Any]]] = {}
        self._current: dict[str, Any] | None = None
        self._heard_s: float | None = None
        self._began_s = clock()
        self._rates: deque[dict[str, Any]] = deque(maxlen=STATUSES)
        self.broken = 0

    # -- in, on threads of Zenoh -------------------------------------------------------------------------------------
    def note_status(self, _key: str, payload: bytes, _encoding: str) -> None:
        """Take one status message."""
        try:
            status = msgspec.json.decode(payload)
            instance, version = str(status["instance"]), status["version"]
            for name in ("time_s", "started_s"):
                status[name] = float(status[name])
            sensors = {str(name): dict(state) for name, state in status["sensors"].items()}
        except (msgspec.MsgspecError, KeyError, TypeError, ValueError, AttributeError):
            self.broken += 1
            return
        if version != VERSION:
            self.broken += 1
            return
        with self._lock:
            self._arrived[instance] = (self._clock(), status | {"sensors": sensors})
            while len(self._arrived) > INSTANCES:
                del self._arrived[min(self._arrived, key=lambda name: self._arrived[name][0])]

    def note_registration(self, _key: str, payload: bytes, encoding: str) -> None:
        """Take one registration state."""
        module = msgspec.json if media_type(encoding) == JSON else msgspec.msgpack
        try:
            state = module.decode(payload)
            sensor = str(state["sensor"])
            kept = {name: state[name] for name in REGISTERED}
        except (msgspec.MsgspecError, KeyError, TypeError, ValueError):
            self.broken += 1
            return
        with self._lock:
            self._sensors.note_radar(sensor)
            self._states.setdefault(sensor, deque(maxlen=STATES)).append(kept)

    # -- every second ------------------------------------------------------------------------------------------------
    def turn(self, now_s: float) -> None:
        """Take over the newest status; a service that was started later counts before one that has gone."""
        with self._lock:
            if not self._arrived:
                return
            fresh = [(s["started_s"], at, s) for at, s in self._arrived.values() if now_s - at < GONE_S]
            at, status = max(
                ((at, s) for _, at, s in fresh) if fresh else self._arrived.values(),
                key=lambda pair: (pair[1]["started_s"], pair[0]),
            )
        before = self._current
        if before is not None and before["instance"] == status["instance"] and before["time_s"] == status["time_s"]:
            return
        self._current, self._heard_s = status, at
        for sensor in status["sensors"]:
            self._sensors.index(sensor)
        if before is not None and before["instance"] == status["instance"]:
            self._rates.append(_rates(before, status))

    def silent_s(self, now_s: float) -> float:
        """How long no status has come. [s]"""
        return max(now_s - (self._began_s if self._heard_s is None else self._heard_s), 0.0)

    # -- out ---------------------------------------------------------------------------------------------------------
    @property
    def current(self) -> dict[str, Any] | None:
        """The newest status, None before the first."""
        return self._current

    def registration(self) -> dict[str, dict[str, Any]]:
        """The newest registration state of every radar."""
        with self._lock:
            return {sensor: states[-1] for sensor, states in self._states.items()}

    def report(self, now_s: float) -> dict[str, Any]:
        """The newest of everything."""
        return {
            "type": "status",
            "time_s": now_s,
            "heard": self._heard_s is not None,
            "silent_s": self.silent_s(now_s),
            "service": self._current,
            "rates": self._rates[-1] if self._rates else None,
            "registration": self.registration(),
        }

    def history(self) -> dict[str, Any]:
        """Rates of the last five minutes, registration of the last hour."""
        with self._lock:
            registration = {sensor: list(states) for sensor, states in self._states.items()}
        return {"rates": list(self._rates), "registration": registration}


def _rates(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """What was counted between two statuses, per second."""
    elapsed_s = max(after["time_s"] - before["time_s"], 1e-3)
    made: dict[str, Any] = {"time_s": after["time_s"], "sensors": {}}
    for name, state in after["sensors"].items():
        last = before["sensors"].get(name, {})
        accepted = _count(state.get("accepted")) - _count(last.get("accepted"))
        rejected = _sum(state.get("rejected")) - _sum(last.get("rejected"))
        made["sensors"][name] = {
            "accepted_per_s": max(accepted, 0.0) / elapsed_s,
            "rejected_per_s": max(rejected, 0.0) / elapsed_s,
            "latency_s": state.get("latency_s"),
            "inbox": state.get("inbox"),
        }
    made["delay_s"] = after.get("publish_delay_s")
    return made


def _count(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _sum(values: Any) -> float:
    return sum(map(_count, values.values())) if isinstance(values, dict) else 0.0
