"""``aeroskein simulate``: the sensors of a scenario, live on Zenoh or written to a report file with its truth."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.progress import Progress

from aeroskein.simulation import Chunk, SimulationSettings, simulate, truth_by_track
from aeroskein_service.config import Config
from aeroskein_service.keys import Keys
from aeroskein_service.real_traffic import RecordedTraffic
from aeroskein_service.recording import load_recording
from aeroskein_service.scenario_files import LineFile, report_lines, truth_lines, truth_path
from aeroskein_service.sensor_feed import BATCH_S, feed_sensors
from aeroskein_service.signals import stop_on_signals
from aeroskein_service.transport import OpenCancelledError, TransportError

__all__ = ["UsageError", "run"]

# Time in one chunk of a file that is written at a given pace, and as fast as it goes. [s]
PACED_CHUNK_S: Final = 0.2
FREE_CHUNK_S: Final = 10.0
# Lines of truth that are encoded at a time: some 50 MB of Python objects.
TRUTH_LINES: Final = 100_000


class UsageError(Exception):
    """Options that do not go together; the message is one sentence."""

    exit_status = 2


def run(
    config: Config,
    *,
    scenario: str | None = None,
    seed: int | None = None,
    speed: float | None = None,
    aircraft: int | None = None,
    duration: float | None = None,
    output: Path | None = None,
    sensor: Sequence[str] | None = None,
    real: bool = False,
    begin: float | None = None,
) -> int:
    """Simulate sensors.

    Parameters
    ----------
    config : Config
        Sensors, section ``simulation``, and for a live feed section ``zenoh``.
    scenario, seed, aircraft, duration : optional
        Instead of the configured ones; a live feed runs until it is stopped unless ``duration`` is given. [s]
    speed : float, optional
        Times real time; only 1 without ``output``. Absent: a file is written as fast as it goes.
    output : Path, optional
        A report file; its truth is written beside it.
    sensor : sequence of str, optional
        Only these sensors, for processes that play one sensor each of the same scenario.
    real : bool
        Recorded ADS-B traffic instead of a scenario.
    begin : float, optional
        A live feed plays as if its traffic had begun then, so that several processes agree. [s since the epoch]

    Returns
    -------
    int
        Exit status.
    """
    changes: dict[str, Any] = {"scenario": scenario, "seed": seed, "aircraft": aircraft, "duration_s": duration}
    settings = replace(config.simulation, **{key: value for key, value in changes.items() if value is not None})
    only = _checked(sensor, config.sensor_ids)
    if speed is not None and not speed > 0.0:
        raise UsageError(f"--speed {speed:g}: expected a number above 0")
    if output is None and speed not in (None, 1.0):
        raise UsageError(f"--speed {speed:g} needs --output: a live feed runs in real time")
    traffic = RecordedTraffic(load_recording(), config.sensors, settings) if real else None
    if traffic is not None:
        _tell(*traffic.notes())
    if output is not None:
        return _write(config, settings, traffic, output, only, speed)
    return _play(config, settings, traffic, only, duration, begin)


def _checked(wanted: Sequence[str] | None, known: Sequence[str]) -> frozenset[str]:
    for sensor_id in wanted or ():
        if sensor_id not in known:
            raise UsageError(f"--sensor {sensor_id}: no such sensor in the configuration, which has {', '.join(known)}")
    return frozenset(wanted or known)


def _tell(*sentences: str) -> None:
    for sentence in sentences:
        print(sentence, file=sys.stderr, flush=True)


# -- to a file -------------------------------------------------------------------------------------------------------
def _write(
    config: Config,
    settings: SimulationSettings,
    traffic: RecordedTraffic | None,
    output: Path,
    only: Collection[str],
    speed: float | None,
) -> int:
    """Write the report file, and the truth where there is one."""
    chunk_s = FREE_CHUNK_S if speed is None else PACED_CHUNK_S * max(1.0, speed)
    start_s, end_s = settings.start_s, settings.start_s + settings.duration_s
    if traffic is not None:
        chunks = traffic.chunks(start_s=start_s, end_s=end_s, chunk_s=chunk_s, only=only)
    else:
        chunks = simulate(settings, config.sensors, chunk_s=chunk_s, only=only)
    reports = 0
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("reports", total=settings.duration_s)
        with LineFile(output) as file:
            for chunk in chunks if speed is None else _paced(chunks, start_s, speed):
                file.write(report_lines(chunk.plots, config.sensor_ids))
                reports += len(chunk.plots)
                progress.update(task, completed=chunk.until_s - start_s)
            samples = None if traffic is not None else _write_truth(config, settings, truth_path(output), progress)
    print(f"{output}: {reports} reports")
    if samples is not None:
        print(f"{truth_path(output)}: {samples} samples of truth")
    return 0


def _write_truth(config: Config, settings: SimulationSettings, path: Path, progress: Progress) -> int:
    samples = 0
    task = progress.add_task("truth", total=settings.aircraft)
    with LineFile(path) as file:
        for truth in truth_by_track(settings, config.sensors):
            for first in range(0, len(truth), TRUTH_LINES):
                file.write(truth_lines(truth.take(np.arange(first, min(first + TRUTH_LINES, len(truth))))))
            samples += len(truth)
            progress.update(task, completed=int(truth.slot.max()) + 1)
    return samples


def _paced(chunks: Iterator[Chunk], start_s: float, speed: float) -> Iterator[Chunk]:
    """The chunks, each when its time has come at ``speed`` times real time."""
    began_s = time.monotonic()
    for chunk in chunks:
        time.sleep(max(0.0, began_s + (chunk.until_s - start_s) / speed - time.monotonic()))
        yield chunk


# -- to Zenoh --------------------------------------------------------------------------------------------------------
def _play(
    config: Config,
    settings: SimulationSettings,
    traffic: RecordedTraffic | None,
    only: Collection[str],
    duration_s: float | None,
    begin_s: float | None,
) -> int:
    """Play the sensors until a signal or the end."""
    stop = stop_on_signals()
    sensors = {index: sensor_id for index, sensor_id in enumerate(config.sensor_ids) if sensor_id in only}
    # Processes that play some of the sensors each must agree about the traffic, so it hangs on the epoch, not on
    # when each of them starts.
    anchor_s = 0.0 if begin_s is None and len(sensors) < len(config.sensors) else begin_s

    def make_chunks(start_s: float) -> Iterator[Chunk]:
        what = (
            "recorded traffic"
            if traffic
            else f"{settings.aircraft} aircraft ({settings.scenario}, seed {settings.seed})"
        )
        _tell(f"playing {', '.join(sensors.values())}: {what} at {config.zenoh.link.where}")
        if traffic is not None:
            end_s = start_s + (traffic.duration_s if duration_s is None else duration_s)
            return traffic.chunks(start_s=start_s, end_s=end_s, chunk_s=BATCH_S, only=only, anchor_s=anchor_s)
        return simulate(
            settings, config.sensors, chunk_s=BATCH_S, only=only, start_s=start_s, anchor_s=anchor_s,
            endless=duration_s is None,
        )  # fmt: skip

    try:
        counts = feed_sensors(
            make_chunks,
            sensors=sensors,
            link=config.zenoh.link,
            keys=Keys(config.zenoh.prefix),
            instance=config.service.effective_instance,
            stop=stop,
            announce=_tell,
        )
    except OpenCancelledError:
        return 0
    except TransportError as error:
        _tell(str(error))
        return 1
    _tell(f"put {counts.reports} reports in {counts.batches} batches")
    return 0
