"""The fusion service put together: sessions, inbox, worker, queries and health, started and stopped in order."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

import structlog

from aeroskein_service.config import Config
from aeroskein_service.http import HealthServer, bind, url_of
from aeroskein_service.inbox import Inbox
from aeroskein_service.keys import Keys
from aeroskein_service.metrics import Metrics
from aeroskein_service.neighbours import Claim, Neighbours
from aeroskein_service.state_store import StateStore
from aeroskein_service.transport import SENSOR_CACHE, Session, open_session
from aeroskein_service.web.page_process import PageProcess

if TYPE_CHECKING:
    from aeroskein.engine import FusionEngine
    from aeroskein_service.runner import Runner

__all__ = ["Service"]

# What is fetched from the sensors' caches at the start, so that elements go on where they ended before a restart: an
# element is published up to ten seconds after it began, which leaves fifteen for being away. Older reports would soon
# be too old (``fusion.max_age_s``).
HISTORY_S: Final = 25.0
STUCK_S: Final = 10.0  # a worker that has not turned for so long is not alive


class Service:
    """One fusion service.

    Parameters
    ----------
    config : Config
        Checked, with at least one sensor.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._keys = Keys(config.zenoh.prefix)
        self._log = structlog.get_logger("aeroskein.service")
        self._session: Session | None = None
        self._intake: list[Session] = []
        self._held = ExitStack()
        self._engine: FusionEngine | None = None
        self._runner: Runner | None = None
        self._store: StateStore | None = None
        self._page: PageProcess | None = None
        self._waiting = "starting"
        self.instance = config.service.effective_instance
        self.http_url: str | None = None

    # -- start ---------------------------------------------------------------------------------------------------
    def start(self, stop: threading.Event) -> None:
        """Start everything; waits for the router until ``stop`` is set.

        Raises ``ListenError``, ``StateError``, ``TransportError``, ``AnotherServiceError`` (each message is a sentence
        for the operator) and ``OpenCancelledError``. Call ``stop`` in any case.
        """
        config = self._config
        self._store = StateStore(config.service.state_dir, complain=self._log.error)
        self._serve_health()
        self._session = self._held.enter_context(self._connect("service", stop))
        claimed = Claim(self._session, self._keys, self.instance)
        # While others may come to see the claim, the heavy parts are loaded and made.
        from aeroskein_service.worker import make_engine, make_runner

        neighbours = Neighbours(self._session, self._keys, self.instance, config.sensor_ids)
        inbox = Inbox(len(config.sensors), config.service.inbox_batches)
        self._engine = make_engine(config, self._store)
        self._runner = make_runner(
            config,
            self._engine,
            self._session,
            inbox,
            self._store,
            instance=self.instance,
            alarms=lambda: [*self._link_alarms(), *neighbours.alarms()],
        )
        # A session for each sensor: a stall of one link cannot hold up the others.
        for sensor in config.sensor_ids:
            self._intake.append(self._connect(sensor, stop))
        claimed.confirm(stop)
        # What exists now stays: the collector need not look at it again.
        gc.collect()
        gc.freeze()
        self._runner.start()
        self._take_in(inbox)
        self._waiting = ""
        self._log.info(
            "service_started",
            instance=self.instance,
            prefix=self._keys.prefix,
            sensors=list(config.sensor_ids),
            http=self.http_url,
            configuration=config.fingerprint(),
        )

    def _take_in(self, inbox: Inbox) -> None:
        for index, (sensor, session) in enumerate(zip(self._config.sensor_ids, self._intake, strict=True)):
            session.subscribe_recovering(
                self._keys.reports_below(sensor),
                inbox.receiver(index),
                on_miss=self._misser(sensor),
                history=SENSOR_CACHE,
                history_age_s=min(HISTORY_S, self._config.fusion.max_age_s),
            )

    def _connect(self, purpose: str, stop: threading.Event) -> Session:
        def announce(sentence: str) -> None:
            self._waiting = sentence
            self._log.warning("router", what=sentence)

        self._waiting = f"connecting {purpose} to {self._config.zenoh.link.where}"
        return open_session(self._config.zenoh.link, announce=announce, stop=stop)

    def _misser(self, sensor: str) -> Callable[[int], None]:
        def note(many: int) -> None:
            self._log.warning("batches_unrecoverable", sensor=sensor, batches=many)

        return note

    # -- health --------------------------------------------------------------------------------------------------
    def _serve_health(self) -> None:
        """Answer health checks on a port of our own; the page, a process of its own, has the public one."""
        if self._config.http.listen:
            listener = bind(self._config.http.listen)
            metrics = Metrics(lambda: None if self._runner is None else self._runner.status, self._is_connected)
            server = HealthServer(bind("127.0.0.1:0"), live=self.not_live, ready=self.not_ready, metrics=metrics.text)
            self._held.enter_context(server)
            self.http_url = url_of(listener)
            self._page = self._held.enter_context(PageProcess(listener, self._config, server.url))

    def _is_connected(self) -> bool:
        return self._session is not None and self._session.connected

    def _link_alarms(self) -> list[str]:
        return [] if self._is_connected() else [f"no connection to the Zenoh router at {self._config.zenoh.link.where}"]

    def not_live(self) -> list[str]:
        """Why the process should be restarted; nothing where it works."""
        runner = self._runner
        if runner is None:
            return []
        if runner.failure is not None:
            return [f"the worker failed: {runner.failure}"]
        stuck_s = time.monotonic() - runner.turned_s
        return [f"the worker has not turned for {stuck_s:.0f} s"] if stuck_s > STUCK_S else []

    def not_ready(self) -> list[str]:
        """Why the service cannot do its work now; nothing where it can."""
        if self._waiting:
            return [self._waiting]
        reasons = self.not_live() + self._link_alarms()
        if self._runner is None or not self._runner.hears:
            reasons.append("no sensor has sent a report lately")
        return reasons

    @property
    def failure(self) -> BaseException | None:
        """What ended the worker, None while it works."""
        return None if self._runner is None else self._runner.failure

    @property
    def status(self) -> dict[str, object] | None:
        """The last status, None before the first."""
        return None if self._runner is None else self._runner.status

    # -- stop ----------------------------------------------------------------------------------------------------
    def stop(self) -> None:
        """Stop intake, finish what is there, publish the last points and status, close everything."""
        if self._waiting == "stopped":
            return
        self._waiting = "stopping"
        if self._page is not None:
            self._page.end()
        for session in self._intake:
            session.close()
        if self._runner is not None:
            self._runner.stop()
        if self._store is not None:
            if self._engine is None or self.failure is not None:
                self._store.abandon()
            else:
                self._store.close(self._engine.next_track_number, self._engine.snapshot())
        self._held.close()
        self._waiting = "stopped"
        self._log.info("service_stopped", instance=self.instance)
