"""Who else is there: other fusion services under the same prefix, and sensors that nobody configured.

Both are learned from liveliness tokens, which appear and vanish with their processes; none of it costs traffic.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from typing import Final

from aeroskein.errors import AeroskeinError
from aeroskein_service.keys import Keys
from aeroskein_service.transport import Session

__all__ = ["AnotherServiceError", "Neighbours", "claim"]

# Time for two services started together to see each other's token through the router. [s]
SETTLE_S: Final = 0.5


class AnotherServiceError(AeroskeinError):
    """Another fusion service works here already; the message is one sentence for the operator."""


def claim(session: Session, keys: Keys, instance: str, stop: threading.Event) -> None:
    """Announce this service, unless another is alive under the same prefix and shard.

    Of two that start together the one with the lower instance name stays. Raises ``AnotherServiceError``.
    """
    own = keys.alive_fusion(instance)
    others = session.alive(keys.alive_fusion())
    if not others:
        session.declare_alive(own)
        stop.wait(SETTLE_S)
        others = [key for key in session.alive(keys.alive_fusion()) if key < own]
    if others:
        name = others[0].rpartition("/")[2]
        raise AnotherServiceError(
            f"another fusion service, {name!r}, is alive under {keys.prefix}; stop it or choose another zenoh.prefix"
        )


class Neighbours:
    """Keeps an eye on liveliness tokens and says what is wrong with them.

    Parameters
    ----------
    session : Session
    keys : Keys
    instance : str
        This service's own name.
    sensors : iterable of str
        The configured sensors.
    """

    def __init__(self, session: Session, keys: Keys, instance: str, sensors: Iterable[str]) -> None:
        self._keys = keys
        self._own = keys.alive_fusion(instance)
        self._known = frozenset(sensors)
        self._others: set[str] = set()
        self._unknown: set[str] = set()
        self._lock = threading.Lock()
        session.watch_alive(keys.alive_fusion(), self._note_fusion)
        # Every recovering publisher holds a token below its own key.
        session.watch_alive(keys.reports("*") + "/**/@adv/**", self._note_sensor)

    def _note_fusion(self, key: str, alive: bool) -> None:
        if key != self._own:
            self._note(self._others, key, alive)

    def _note_sensor(self, key: str, alive: bool) -> None:
        sensor = self._keys.sensor_of(key)
        if sensor is not None and sensor not in self._known:
            self._note(self._unknown, key, alive)

    def _note(self, those: set[str], key: str, alive: bool) -> None:
        with self._lock:
            (those.add if alive else those.discard)(key)

    def alarms(self) -> list[str]:
        """One sentence for each neighbour that should not be there."""
        with self._lock:
            others = sorted(key.rpartition("/")[2] for key in self._others)
            unknown = sorted({str(self._keys.sensor_of(key)) for key in self._unknown})
        return [f"another fusion service, {name!r}, is alive under the same prefix" for name in others] + [
            f"a sensor {name!r} publishes that is not in the configuration" for name in unknown
        ]
