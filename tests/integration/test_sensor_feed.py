"""Simulated sensors on a real router: what is put is what was simulated, numbered and in small batches."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.integration.harness import LIMIT_S, Listener, wait_until, write_config
from tests.simulation_scenes import SENSORS

from aeroskein.plots import Plots
from aeroskein.simulation import Chunk, SimulationSettings, simulate
from aeroskein_service.codec import reports_of
from aeroskein_service.keys import Keys
from aeroskein_service.link import Link
from aeroskein_service.sensor_feed import BATCH_S, FeedCounts, feed_sensors
from aeroskein_service.transport import Session

NAMES = {index: sensor.id for index, sensor in enumerate(SENSORS)}


def play(endpoint: str, keys: Keys, settings: SimulationSettings, sensors: dict[int, str]) -> tuple[FeedCounts, float]:
    """Play a scenario to its end; what was put, and when it began."""
    began: list[float] = []

    def make_chunks(start_s: float) -> Iterator[Chunk]:
        began.append(start_s)
        return simulate(settings, SENSORS, chunk_s=BATCH_S, only=set(sensors.values()), start_s=start_s)

    counts = feed_sensors(
        make_chunks, sensors=sensors, link=Link(connect=(endpoint,)), keys=keys, instance="test",
        stop=threading.Event(), announce=lambda _: None,
    )  # fmt: skip
    return counts, began[0]


def by_sensor(listener: Listener) -> dict[str, list[Any]]:
    """Batches of each sensor, in order of arrival."""
    found = defaultdict(list)
    for key, message in listener.received:
        found[key.rsplit("/", 1)[1]].append(message)
    return found


def plain(plots: Plots) -> list[Any]:
    """Reports as they look after the wire."""
    return list(msgspec.to_builtins(reports_of(plots)))


def test_what_is_put_is_what_was_simulated(endpoint: str, session: Session, keys: Keys) -> None:
    settings = SimulationSettings(aircraft=60, duration_s=3.0)
    listener = Listener(session, f"{keys.prefix}/reports/**")

    counts, start_s = play(endpoint, keys, settings, NAMES)
    listener.wait_for(lambda messages: sum(len(m["reports"]) for m in messages) == counts.reports, "all reports")

    expected = Plots.concatenate([c.plots for c in simulate(settings, SENSORS, chunk_s=BATCH_S, start_s=start_s)])
    batches = by_sensor(listener)
    for index, name in NAMES.items():
        sent = [report for batch in batches[name] for report in batch["reports"]]
        assert sent == plain(expected.take(expected.sensor == index))
        assert [batch["seq"] for batch in batches[name]] == list(range(len(batches[name])))
        assert {batch["sensor"] for batch in batches[name]} == {name}
        assert len({batch["epoch"] for batch in batches[name]}) == 1
    assert counts.batches == len(listener.received)


def test_batches_hold_at_most_fifty_reports(endpoint: str, session: Session, keys: Keys) -> None:
    listener = Listener(session, f"{keys.prefix}/reports/**")

    counts, _ = play(endpoint, keys, SimulationSettings(aircraft=3000, duration_s=1.5), {0: "adsb"})
    listener.wait_for(lambda messages: len(messages) == counts.batches, "all batches")

    sizes = [len(batch["reports"]) for batch in listener.messages]
    assert max(sizes) == 50
    assert sum(sizes) == counts.reports


def test_each_sensor_is_alive_while_it_plays(endpoint: str, session: Session, keys: Keys) -> None:
    changes: list[tuple[str, bool]] = []
    session.watch_alive(f"{keys.prefix}/alive/**", lambda key, there: changes.append((key, there)))

    play(endpoint, keys, SimulationSettings(aircraft=2, duration_s=1.0), {1: "radar1"})

    token = keys.alive("sensor-radar1", "test")
    wait_until(lambda: (token, False) in changes, "the token to go")
    assert changes.index((token, True)) < changes.index((token, False))


def test_a_feed_that_is_told_to_stop_stops(endpoint: str, keys: Keys) -> None:
    stop = threading.Event()

    def stopping(start_s: float) -> Iterator[Chunk]:
        made = SimulationSettings(aircraft=5)
        for number, chunk in enumerate(simulate(made, SENSORS, chunk_s=BATCH_S, start_s=start_s, endless=True)):
            if number == 10:
                stop.set()
            yield chunk

    counts = feed_sensors(
        stopping, sensors=NAMES, link=Link(connect=(endpoint,)), keys=keys, instance="test", stop=stop,
        announce=lambda _: None,
    )  # fmt: skip

    assert counts.reports < 100


def test_an_error_of_the_simulator_ends_the_feed(endpoint: str, keys: Keys) -> None:
    def broken(start_s: float) -> Iterator[Chunk]:
        yield Chunk(start_s, Plots.of(0), None)
        raise RuntimeError("the scenario broke")

    with pytest.raises(RuntimeError, match="the scenario broke"):
        feed_sensors(
            broken, sensors={0: "adsb"}, link=Link(connect=(endpoint,)), keys=keys, instance="test",
            stop=threading.Event(), announce=lambda _: None,
        )  # fmt: skip


def test_the_command_plays_until_it_is_terminated(tmp_path: Path, endpoint: str, session: Session, keys: Keys) -> None:
    listener = Listener(session, f"{keys.prefix}/reports/**")
    config = write_config(tmp_path, endpoint, keys.prefix)
    command = [sys.executable, "-c", "from aeroskein_service.cli import main; main()"]
    options = ["simulate", "--config", str(config), "--aircraft", "5", "--sensor", "radar1"]

    with subprocess.Popen(
        [*command, *options], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        listener.wait_for(len, "the first batch")
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=LIMIT_S)

    assert process.returncode == 0
    assert set(by_sensor(listener)) == {"radar1"}
    assert "playing radar1: 5 aircraft" in said
