"""The worker put together: the engine with what survived, the way in, the ways out, the desk for questions.

Imported when a service has claimed its place, for these are the heavy parts of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

import structlog

from aeroskein.engine import FusionEngine
from aeroskein.errors import SnapshotError
from aeroskein_service.codec import PointEncoder
from aeroskein_service.config import Config
from aeroskein_service.inbox import Inbox
from aeroskein_service.keys import Keys
from aeroskein_service.publisher import Outlet
from aeroskein_service.queries import Desk
from aeroskein_service.runner import Runner
from aeroskein_service.stage_clock import StageClock
from aeroskein_service.state_store import StateStore
from aeroskein_service.status import Counters
from aeroskein_service.transport import Session

__all__ = ["make_engine", "make_runner"]


def make_engine(config: Config, store: StateStore) -> FusionEngine:
    """The engine, with numbers and registration that go on where the last one stopped."""
    engine = FusionEngine(
        config.engine,
        epoch_ms=int(time.time() * 1000),
        first_track_number=store.first_number,
        stopwatch_s=time.perf_counter,
    )
    try:
        snapshot = store.snapshot(engine.snapshot())
        if snapshot is not None:
            engine.restore(snapshot)
    except SnapshotError as error:
        structlog.get_logger("aeroskein.service").error("snapshot_ignored", why=str(error))
    return engine


def make_runner(
    config: Config,
    engine: FusionEngine,
    session: Session,
    inbox: Inbox,
    store: StateStore,
    *,
    instance: str,
    alarms: Callable[[], Iterable[str]],
) -> Runner:
    """The worker thread, not started, whose questions go into its inbox."""
    keys, stages = Keys(config.zenoh.prefix), StageClock()
    encoder = PointEncoder(config.sensor_ids, engine.epoch_ms, config.output.encoding)
    outlet = Outlet(
        session, keys, instance, encoder, epoch_ms=engine.epoch_ms, sensor_ids=config.sensor_ids, clock=stages
    )
    desk = Desk(engine, encoder)
    for key in desk.keys(keys):
        session.answer(key, inbox.ask)
    return Runner(
        engine,
        inbox,
        outlet,
        desk,
        store,
        Counters(config.sensors),
        stages,
        instance=instance,
        patience_s=config.service.patience_s,
        alarms=alarms,
    )
