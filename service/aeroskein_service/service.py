"""The fusion service put together: sessions, inbox, worker, queries and health, started and stopped in order."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Final

import structlog

from aeroskein.engine import FusionEngine
from aeroskein.errors import SnapshotError
from aeroskein_service.codec import PointEncoder
from aeroskein_service.config import Config
from aeroskein_service.http import HealthServer, bind, url_of
from aeroskein_service.inbox import Inbox
from aeroskein_service.keys import Keys
from aeroskein_service.metrics import Metrics
from aeroskein_service.neighbours import Neighbours, claim
from aeroskein_service.publisher import Outlet
from aeroskein_service.queries import Desk
from aeroskein_service.runner import Runner
from aeroskein_service.stage_clock import StageClock
from aeroskein_service.state_store import StateStore
from aeroskein_service.status import Counters, is_fresh
from aeroskein_service.transport import Session, open_session
from aeroskein_service.web.page_process import PageProcess

__all__ = ["Service"]

# Batches fetched from the sensors' caches at the start: enough to bridge a quick restart, too few to be mostly late.
HISTORY_BATCHES: Final = 500
HISTORY_S: Final = 5.0
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
        claim(self._session, self._keys, self.instance, stop)
        neighbours = Neighbours(self._session, self._keys, self.instance, config.sensor_ids)
        inbox = Inbox(len(config.sensors), config.service.inbox_batches)
        self._engine = self._make_engine(self._store)
        self._runner = self._make_runner(self._engine, inbox, self._store, neighbours)
        # What exists now stays: the collector need not look at it again.
        gc.collect()
        gc.freeze()
        self._runner.start()
        for index, sensor in enumerate(config.sensor_ids):
            # A session of its own for each sensor: a stall of one link cannot hold up the others.
            session = self._connect(sensor, stop)
            self._intake.append(session)
            session.subscribe_recovering(
                self._keys.reports_below(sensor),
                inbox.receiver(index),
                on_miss=self._misser(sensor),
                history=HISTORY_BATCHES,
                history_age_s=min(HISTORY_S, config.fusion.max_age_s),
            )
        self._waiting = ""
        self._log.info(
            "service_started",
            instance=self.instance,
            prefix=self._keys.prefix,
            sensors=list(config.sensor_ids),
            http=self.http_url,
            configuration=config.fingerprint(),
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

    def _make_engine(self, store: StateStore) -> FusionEngine:
        engine = FusionEngine(
            self._config.engine,
            epoch_ms=int(time.time() * 1000),
            first_track_number=store.first_number,
            stopwatch_s=time.perf_counter,
        )
        try:
            snapshot = store.snapshot(engine.snapshot())
            if snapshot is not None:
                engine.restore(snapshot)
        except SnapshotError as error:
            self._log.error("snapshot_ignored", why=str(error))
        return engine

    def _make_runner(self, engine: FusionEngine, inbox: Inbox, store: StateStore, neighbours: Neighbours) -> Runner:
        config, session = self._config, self._session
        assert session is not None
        stages = StageClock()
        encoder = PointEncoder(config.sensor_ids, engine.epoch_ms, config.output.encoding)
        outlet = Outlet(
            session,
            self._keys,
            self.instance,
            encoder,
            epoch_ms=engine.epoch_ms,
            sensor_ids=config.sensor_ids,
            clock=stages,
        )
        desk = Desk(engine, encoder)
        for key in desk.keys(self._keys):
            session.answer(key, inbox.ask)
        return Runner(
            engine,
            inbox,
            outlet,
            desk,
            store,
            Counters(config.sensors),
            stages,
            instance=self.instance,
            alarms=lambda: [*self._link_alarms(), *neighbours.alarms()],
        )

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
        status = None if self._runner is None else self._runner.status
        now_s = time.time()
        if status is None or not any(
            is_fresh(sensor, status["sensors"][sensor.id]["last_report_s"], now_s) for sensor in self._config.sensors
        ):
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
