"""Zenoh sessions, publishers, subscribers and queryables as the rest of the service sees them: keys, bytes, callbacks.

This is the only file that imports zenoh. What it fixes once and for all: every process is a client of a router (two
peers that only share a router exchange nothing), scouting and implicit shared memory are off, reconnection is quick,
callbacks get plain bytes, and a session always closes.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self, cast

import zenoh
from zenoh import ext

from aeroskein.errors import AeroskeinError
from aeroskein_service.link import BASE_SETTINGS, Link, client_settings

__all__ = [
    "SENSOR_CACHE",
    "FeedPublisher",
    "Link",
    "OnMessage",
    "OpenCancelledError",
    "Publisher",
    "Question",
    "Router",
    "SensorPublisher",
    "Session",
    "TransportError",
    "open_session",
]

OnMessage = Callable[[str, bytes, str], None]
"""Called with key, payload and encoding on a thread of Zenoh: append and return, nothing else."""

RETRY_S: Final = 0.2  # between two tries to reach the router
REMIND_S: Final = 30.0  # how often a process that waits for the router says so again
CLOSE_S: Final = 2.0  # closing on a broken link can block ten seconds; nobody waits longer than this
SENSOR_CACHE: Final = 2000  # batches a sensor can repeat after an outage: over three minutes at ten a second
FEED_CACHE: Final = 1000  # batches of the feed that can be repeated: 2.5 s at 20,000 points/s, minutes at 200/s
KNOWN_KEYS: Final = 65_536  # key expressions kept parsed, about 20 MB; tracks that ended leave theirs behind
HEARTBEAT_S: Final = 0.5  # how soon a subscriber notices that the newest sample is missing


class TransportError(AeroskeinError):
    """Something about Zenoh that the operator has to repair; the message is one sentence for them."""


class OpenCancelledError(Exception):
    """The process was told to stop while it waited for the router."""


def _config(settings: Mapping[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _in_short(error: Exception) -> str:
    """Zenoh's message in one line, without the place in its source; of a picture of a file, where and what."""
    lines = [line.strip(" |=->") for line in str(error).split(" at /", 1)[0].splitlines()]
    lines = [line for line in lines if line]
    return ": ".join(dict.fromkeys([lines[0], lines[-1]])).rstrip(".") if lines else type(error).__name__


def open_session(
    link: Link, *, announce: Callable[[str], None] | None = None, stop: threading.Event | None = None
) -> Session:
    """Connect to the router, waiting as long as it takes.

    Parameters
    ----------
    link : Link
        Where the router is and how to log in.
    announce : callable, optional
        Gets one sentence when waiting begins, every 30 s while it lasts, and when it ends.
    stop : threading.Event, optional
        Ends the waiting.

    Raises
    ------
    TransportError
        An endpoint that cannot work, or files that cannot be read.
    OpenCancelledError
        ``stop`` was set.
    """
    wrong = link.complaint()
    if wrong:
        raise TransportError(wrong)
    config = _config(client_settings(link))
    say = announce or (lambda _sentence: None)
    said_s, waited = -REMIND_S, False
    while True:
        if stop is not None and stop.is_set():
            raise OpenCancelledError
        try:
            session = Session(zenoh.open(config))
        except zenoh.ZError as error:
            if "Unable to connect" not in str(error):
                raise TransportError(f"zenoh: {_in_short(error)}") from error
        else:
            if waited:
                say(f"connected to the Zenoh router at {link.where}")
            return session
        waited = True
        if time.monotonic() - said_s >= REMIND_S:
            said_s = time.monotonic()
            if link.answers():
                say(f"waiting for the Zenoh router at {link.where}: it answers but refuses us (user, password, TLS?)")
            else:
                say(f"waiting for a Zenoh router at {link.where}")
        if stop is not None:
            stop.wait(RETRY_S)
        else:
            time.sleep(RETRY_S)


def _to_callback(on_message: OnMessage) -> Callable[[zenoh.Sample], None]:
    def deliver(sample: zenoh.Sample) -> None:
        on_message(str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding))

    return deliver


class Session:
    """One connection to the router. Use it in a ``with`` block: a session left open keeps the process alive."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._kept: list[Any] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Undeclare everything and disconnect; gives up waiting after two seconds."""
        self._kept.clear()
        closer = threading.Thread(target=self._session.close, name="zenoh-close", daemon=True)
        closer.start()
        closer.join(CLOSE_S)

    @property
    def connected(self) -> bool:
        """Whether the router is there now."""
        return not self._session.is_closed() and bool(self._session.info.routers_zid())

    def put(self, key: str, payload: bytes, encoding: str) -> None:
        """Put once; for many keys see ``Publisher``."""
        self._session.put(key, payload, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP)

    def watched_publisher(self, key: str, on_matching: Callable[[bool], None]) -> None:
        """Tell ``on_matching`` whenever the first subscriber of ``key`` comes or the last one goes."""
        publisher = self._session.declare_publisher(key)
        listener = publisher.declare_matching_listener(lambda status: on_matching(status.matching))
        self._kept += [publisher, listener]

    def subscribe(self, key: str, on_message: OnMessage) -> None:
        """Follow a key expression until the session closes."""
        self._kept.append(self._session.declare_subscriber(key, _to_callback(on_message)))

    def subscribe_recovering(
        self,
        key: str,
        on_message: OnMessage,
        *,
        on_miss: Callable[[int], None] | None = None,
        history: int = 0,
        history_age_s: float | None = None,
    ) -> None:
        """Follow a key expression whose publishers keep a cache: what was lost on the way is fetched again.

        ``history`` samples per key, no older than ``history_age_s``, are asked for at the start; ``on_miss`` gets the
        number of samples that could not be had any more.
        """
        subscriber = ext.declare_advanced_subscriber(
            self._session,
            key,
            _to_callback(on_message),
            history=ext.HistoryConfig(max_samples=history, max_age=history_age_s) if history else None,
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        self._kept.append(subscriber)
        if on_miss is not None:
            self._kept.append(subscriber.sample_miss_listener(lambda miss: on_miss(miss.nb)))

    def answer(self, key: str, on_question: Callable[[Question], None]) -> None:
        """Declare a queryable; ``on_question`` must see to it that every question is answered or refused."""
        self._kept.append(self._session.declare_queryable(key, lambda query: on_question(Question(key, query))))

    def ask(self, selector: str, *, timeout_s: float = 5.0, payload: bytes | None = None) -> list[Answer]:
        """Put a question and collect the answers; none where nobody answers."""
        answers = []
        for reply in self._session.get(
            selector, timeout=timeout_s, payload=payload, consolidation=zenoh.ConsolidationMode.NONE
        ):
            if reply.ok is not None:
                sample = reply.ok
                answers.append(Answer(True, str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)))
            elif reply.err is not None:
                answers.append(Answer(False, "", reply.err.payload.to_bytes(), str(reply.err.encoding)))
        return answers

    def declare_alive(self, key: str) -> None:
        """Hold a liveliness token until the session closes or the process dies."""
        self._kept.append(self._session.liveliness().declare_token(key))

    def alive(self, key: str, *, timeout_s: float = 2.0) -> list[str]:
        """Keys of the liveliness tokens that match now."""
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})

    def watch_alive(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        """Tell ``on_change`` of every token that is there, comes or goes; it may be told the same twice."""

        def deliver(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._kept.append(self._session.liveliness().declare_subscriber(key, deliver, history=True))


@dataclass(frozen=True, slots=True)
class Answer:
    """One reply to ``Session.ask``; where ``ok`` is false the payload is a sentence."""

    ok: bool
    key: str
    payload: bytes
    encoding: str


class Publisher:
    """Puts to many keys with DROP: a key expression is parsed once, which halves the cost of a put.

    Parameters
    ----------
    session : Session
        Where to put.
    encoding : str
        Of all payloads.
    key_of : callable
        Spells the key of a code that has not been seen before.
    """

    def __init__(self, session: Session, encoding: str, key_of: Callable[[int], str]) -> None:
        self._put = session._session.put
        self._encoding = zenoh.Encoding(encoding)
        self._key_of = key_of
        self._keys: dict[int, zenoh.KeyExpr] = {}

    def put(self, codes: Iterable[int], payloads: Iterable[bytes]) -> None:
        """Put payload by payload to the key of its code."""
        known, put, encoding, drop = self._keys, self._put, self._encoding, zenoh.CongestionControl.DROP
        for code, payload in zip(codes, payloads, strict=True):
            expression = known.get(code)
            if expression is None:
                if len(known) >= KNOWN_KEYS:
                    known.clear()
                expression = known[code] = zenoh.KeyExpr(self._key_of(code))
            put(expression, payload, encoding=encoding, congestion_control=drop)


class FeedPublisher:
    """Puts to one key and keeps the last ``cache`` payloads, so that a recovering subscriber loses none."""

    def __init__(self, session: Session, key: str, encoding: str, cache: int = FEED_CACHE) -> None:
        self._publisher = ext.declare_advanced_publisher(
            session._session,
            key,
            encoding=encoding,
            congestion_control=zenoh.CongestionControl.DROP,
            cache=ext.CacheConfig(cache),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=HEARTBEAT_S, sporadic_heartbeat=None),
            publisher_detection=True,
        )

    def put(self, payload: bytes) -> None:
        """Put one payload."""
        self._publisher.put(payload)


class SensorPublisher(FeedPublisher):
    """What a sensor feed puts its report batches with.

    Parameters
    ----------
    session : Session
        One per sensor process.
    key : str
        ``Keys.reports(sensor)``, or a key below it.
    encoding : str
        ``application/msgpack`` or ``application/json``, as the batches are.
    """

    def __init__(self, session: Session, key: str, encoding: str = "application/msgpack") -> None:
        super().__init__(session, key, encoding, SENSOR_CACHE)


class Question:
    """A query that came in; exactly one of ``reply`` and ``refuse`` ends it."""

    __slots__ = ("_query", "key", "parameters", "payload")

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self._query = query
        # A wildcard queryable answers on the concrete key that was asked for.
        self.key = str(query.key_expr) if "*" in key else key
        self.parameters: dict[str, str] = dict(iter(cast(Iterable[tuple[str, str]], query.parameters)))
        self.payload = None if query.payload is None else query.payload.to_bytes()

    def reply(self, payload: bytes, encoding: str) -> None:
        """Answer; whoever has stopped waiting is no error."""
        with self._query, contextlib.suppress(zenoh.ZError):
            self._query.reply(self.key, payload, encoding=encoding)

    def refuse(self, sentence: str) -> None:
        """Say what is wrong with the question."""
        with self._query, contextlib.suppress(zenoh.ZError):
            self._query.reply_err(sentence.encode(), encoding="text/plain")


class Router:
    """A Zenoh router in this process; its work is done by Zenoh's own threads, not under Python's lock.

    Raises ``TransportError`` where an endpoint is taken or the file cannot be used.
    """

    def __init__(self, *, listen: Sequence[str] = (), config_file: Path | None = None) -> None:
        try:
            if config_file is not None:
                config = zenoh.Config.from_file(str(config_file))
                config.insert_json5("mode", '"router"')
            else:
                config = _config(BASE_SETTINGS | {"mode": "router"})
            if listen:
                config.insert_json5("listen/endpoints", json.dumps(list(listen)))
            self._session = Session(zenoh.open(config))
        except zenoh.ZError as error:
            where = ", ".join(listen) or str(config_file)
            if "in use" in str(error):
                raise TransportError(f"another program already listens at {where}") from error
            raise TransportError(f"no router at {where}: {_in_short(error)}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def declare_alive(self, key: str) -> None:
        """Hold a liveliness token while the router runs."""
        self._session.declare_alive(key)

    def close(self) -> None:
        """Disconnect everybody and stop listening."""
        self._session.close()
