"""Questions of browsers to the service, over Zenoh: few at a time, and the same one only once a second.

However many people look at one aircraft, the service is asked for its elements once; so viewers never hold up fusion.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any, Final

import msgspec

from aeroskein_service.codec import media_type
from aeroskein_service.keys import Keys
from aeroskein_service.messages import JSON
from aeroskein_service.transport import Session
from aeroskein_service.web.source import NotNowError, UnknownTrackError

__all__ = ["Questions"]

AT_ONCE: Final = 4  # questions that are with the service at a time
WAIT_S: Final = 2.0  # for an answer
FRESH_S: Final = 0.9  # an answer is given again for so long
WAITING: Final = 64  # different questions that may wait; more are refused at once


class Questions:
    """Asks the service, and remembers the answers for a moment.

    Parameters
    ----------
    session : Session
    keys : Keys
    """

    def __init__(self, session: Session, keys: Keys) -> None:
        self._session = session
        self._keys = keys
        self._places = asyncio.Semaphore(AT_ONCE)
        self._answers: dict[str, tuple[float, asyncio.Task[dict[str, Any]]]] = {}

    async def elements(self, label: str) -> dict[str, Any]:
        """The reply to ``query/elements``. Raises ``UnknownTrackError`` and ``NotNowError``."""
        return await self._once(f"{self._keys.query('elements')}?track={label}")

    async def reports(self, address: str) -> dict[str, Any]:
        """The reply to ``query/reports`` about one aircraft. Raises ``NotNowError``."""
        return await self._once(f"{self._keys.query('reports')}?address={address}")

    async def _once(self, selector: str) -> dict[str, Any]:
        now_s = time.monotonic()
        for old in [s for s, (at, task) in self._answers.items() if now_s - at > FRESH_S and task.done()]:
            del self._answers[old]
        found = self._answers.get(selector)
        if found is None:
            if len(self._answers) >= WAITING:
                raise NotNowError("too many questions at a time, ask again")
            found = self._answers[selector] = (now_s, asyncio.create_task(self._ask(selector)))
        # Whoever gives up waiting does not take the answer from the others.
        return await asyncio.shield(found[1])

    async def _ask(self, selector: str) -> dict[str, Any]:
        async with self._places:
            answers = await asyncio.to_thread(self._session.ask, selector, timeout_s=WAIT_S)
        for answer in answers:
            if answer.ok:
                module = msgspec.json if media_type(answer.encoding) == JSON else msgspec.msgpack
                try:
                    made = module.decode(answer.payload)
                except msgspec.MsgspecError:
                    continue
                if isinstance(made, dict):
                    return made
        if answers:
            raise UnknownTrackError(answers[0].payload.decode("utf-8", "replace")[:200])
        raise NotNowError("the service does not answer")
