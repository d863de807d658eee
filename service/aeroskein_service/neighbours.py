"""Who else is there: other fusion services under the same prefix, and sensors that nobody configured.

Both are learned from liveliness tokens, which appear and vanish with their processes; none of it costs traffic.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from time import monotonic
from typing import Final

from aeroskein.errors import AeroskeinError
from aeroskein_service.keys import Keys
from aeroskein_service.transport import Session

__all__ = ["AnotherServiceError", "Claim", "Neighbours"]

# Time for two services started together to see each other's token through the router. [s]
SETTLE_S: Final = 0.5


class AnotherServiceError(AeroskeinError):
    """Another fusion service works here already; the message is one sentence for the operator."""


class Claim:
    """The place of a fusion service, claimed by a liveliness token and then confirmed.

    What takes time at the start can be done between the two. Of services that start together the one with the lower
    instance name stays. Both steps raise ``AnotherServiceError`` where another service has the place.
    """

    def __init__(self, session: Session, keys: Keys, instance: str) -> None:
        self._session, self._keys, self._own = session, keys, keys.alive_fusion(instance)
        self._refuse(session.alive(keys.alive_fusion()))
        session.declare_alive(self._own)
        self._confirms_s = monotonic() + SETTLE_S

    def confirm(self, stop: threading.Event) -> None:
        """Look again once others that began at the same moment can be seen; ``stop`` ends the waiting."""
        stop.wait(max(self._confirms_s - monotonic(), 0.0))
        self._refuse([key for key in self._session.alive(self._keys.alive_fusion()) if key < self._own])

    def _refuse(self, others: Sequence[str]) -> None:
        if others:
            name, prefix = others[0].rpartition("/")[2], self._keys.prefix
            raise AnotherServiceError(
                f"another fusion service, {name!r}, is alive under {prefix}; stop it or choose another zenoh.prefix"
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
