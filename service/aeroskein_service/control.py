"""The operator's controls: a radar's registration, and sensors on or off; the answer says what is now in force."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, Literal, cast, get_args

import structlog

from aeroskein.engine import FusionEngine
from aeroskein.errors import AeroskeinError
from aeroskein_service.messages import VERSION, RegistrationMessage
from aeroskein_service.replies import registration_message

__all__ = ["Controls", "QuestionError"]

Action = Literal["freeze", "release", "reset", "set"]
_ACTIONS: Final = get_args(Action)
# What can be set, and the largest value that is no slip of the keyboard.
_VALUES: Final = {
    "range_bias_m": 10_000.0,
    "azimuth_bias_deg": 10.0,
    "time_bias_s": 10.0,
    "range_gain": 0.01,
}


class QuestionError(AeroskeinError):
    """A question that cannot be answered; the message is the reply."""


class Controls:
    """Carries out controls on the engine; only the worker calls it."""

    def __init__(self, engine: FusionEngine) -> None:
        self._engine = engine
        self._sensors = {sensor.id: sensor for sensor in engine.settings.sensors}
        self._log = structlog.get_logger("aeroskein.control")

    def registration(self, sensor: str, parameters: Mapping[str, str]) -> RegistrationMessage:
        """Freeze, release, reset or set one radar's registration. Raises ``QuestionError``."""
        if not self._sensors[sensor].is_radar:
            raise QuestionError(f"{sensor} is no radar, it has no registration")
        action = parameters.get("action", "")
        if action not in _ACTIONS:
            raise QuestionError(f"action: expected {', '.join(_ACTIONS)}, got {action!r}")
        values = {name: _value(name, text) for name, text in parameters.items() if name != "action"}
        if bool(values) != (action == "set"):
            raise QuestionError(
                f"action=set needs at least one of {', '.join(_VALUES)}"
                if action == "set"
                else f"{next(iter(values))}: values go with action=set only"
            )
        state = self._engine.control_registration(sensor, cast(Action, action), **values)
        self._log.warning("registration_control", sensor=sensor, action=action, **values)
        return registration_message(state)

    def sensor(self, sensor: str, parameters: Mapping[str, str], *, now_s: float) -> dict[str, Any]:
        """Switch one sensor's reports on or off. Raises ``QuestionError``."""
        for name in parameters:
            if name != "action":
                raise QuestionError(f"{name}: unknown parameter, expected action")
        action = parameters.get("action", "")
        if action not in ("on", "off"):
            raise QuestionError(f"action: expected on or off, got {action!r}")
        on = self._engine.control_sensor(sensor, action == "on")
        self._log.warning("sensor_control", sensor=sensor, action=action)
        return {"version": VERSION, "time_s": now_s, "sensor": sensor, "action": "on" if on else "off"}


def _value(name: str, text: str) -> float:
    largest = _VALUES.get(name)
    if largest is None:
        raise QuestionError(f"{name}: unknown parameter, expected action, {', '.join(_VALUES)}")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= largest:
        raise QuestionError(f"{name}: expected a number from {-largest:g} to {largest:g}, got {text!r}")
    return value
