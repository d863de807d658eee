"""The simulator: truth and reports of a whole scenario, chunk by chunk, in order of arrival.

What comes out depends on the settings only: not on how the time is cut into chunks, and not on which of the sensors
are asked for, so several processes can each play one sensor of the same scenario.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from aeroskein.plots import Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation.block import Block
from aeroskein.simulation.radar import RadarSensor
from aeroskein.simulation.settings import SimulationSettings
from aeroskein.simulation.squitters import PositionSensor
from aeroskein.simulation.traffic import BLOCK_S
from aeroskein.simulation.trajectory import Fleet
from aeroskein.simulation.truth import Motion, TruthStates

__all__ = ["Chunk", "SensorModel", "TruthSamples", "in_chunks", "sensor_models", "simulate", "truth_by_track"]

# Rows of truth that are held in memory at a time when a truth file is written: about 300 MB.
TRUTH_ROWS: Final = 2_000_000

# Ranges of slots begin at a multiple of this, so that no pair and no formation of three is torn apart.
SLOT_STEP: Final = 6


class SensorModel(Protocol):
    """Whatever turns a block of motion into reports."""

    def measure(self, motion: Motion) -> Plots:
        """The reports measured in a block, in no order; each arrives after the block has begun."""
        ...


@dataclass(slots=True, eq=False)
class Chunk:
    """What happened up to a time.

    Attributes
    ----------
    until_s : float
        All reports that arrive before this have been given out. [s since the epoch]
    plots : Plots
        The reports that arrived since the last chunk, in order of arrival.
    truth : TruthStates, optional
        The truth since the last chunk, ordered by time, then slot; None where it was not asked for.
    """

    until_s: float
    plots: Plots
    truth: TruthStates | None


def sensor_models(
    settings: SimulationSettings,
    sensors: tuple[SensorSettings, ...],
    *,
    start_s: float,
    slots: int,
    only: Collection[str] | None = None,
) -> list[SensorModel]:
    """One model per sensor, or per sensor in ``only``. Raises ``UnknownSensorError``."""
    settings.check_sensors(sensors)
    models: list[SensorModel] = []
    for index, sensor in enumerate(sensors):
        if only is None or sensor.id in only:
            kind = RadarSensor if sensor.is_radar else PositionSensor
            errors = settings.errors_of(sensor.id)
            models.append(kind(sensor, index, errors, seed=settings.seed, start_s=start_s, slots=slots))
    return models


class _Arrivals:
    """Reports that are under way, given out in order of arrival."""

    def __init__(self) -> None:
        self._reports = Plots.of(0)
        self._given = 0

    def put(self, parts: Sequence[Plots]) -> None:
        """Add reports in any order."""
        waiting = self._reports.take(np.arange(self._given, len(self._reports)))
        joined = Plots.concatenate([waiting, *parts])
        self._reports = joined.take(np.argsort(joined.received_s, kind="stable"))
        self._given = 0

    def take_until(self, until_s: float) -> Plots:
        """The reports that arrive before a time."""
        first, self._given = self._given, int(np.searchsorted(self._reports.received_s, until_s, side="left"))
        return self._reports.take(np.arange(first, self._given))


class TruthSamples:
    """Truth samples on their own grid of times, taken from blocks as they pass and given out chunk by chunk."""

    def __init__(self, start_s: float, period_s: float) -> None:
        self._start_s, self._period_s, self._next = start_s, period_s, 0
        self._waiting: list[TruthStates] = []

    def of(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The same blocks, sampled."""
        for block in blocks:
            self._sample(block)
            yield block

    def _sample(self, block: Block) -> None:
        last = math.ceil((block.end_s - self._start_s) / self._period_s - 1e-9)
        if last > self._next:
            self._waiting.append(
                block.truth(self._start_s + self._period_s * np.arange(self._next, last, dtype=np.float64))
            )
            self._next = last

    def take_until(self, until_s: float) -> TruthStates | None:
        """The samples before a time."""
        if not self._waiting:
            return None
        joined = TruthStates.concatenate(self._waiting)
        n = int(np.searchsorted(joined.time_s, until_s - 1e-9, side="left"))
        self._waiting = [joined.take(np.arange(n, len(joined)))]
        return joined.take(np.arange(n))


def in_chunks(
    blocks: Iterable[Motion],
    models: Sequence[SensorModel],
    *,
    start_s: float,
    end_s: float,
    chunk_s: float,
    samples: TruthSamples | None = None,
) -> Iterator[Chunk]:
    """Measure blocks of motion, and give out what arrives from ``start_s`` to ``end_s`` (with truth from ``samples``).

    Ends with the blocks, or at ``end_s``: reports that are still under way then are not given out, as in a recording
    that is stopped.
    """
    source = iter(blocks)
    arrivals = _Arrivals()
    done_s, number = start_s, 0
    while True:
        number += 1
        until_s = min(start_s + number * chunk_s, end_s)
        while done_s < until_s:
            block = next(source, None)
            if block is None:
                return
            arrivals.put([model.measure(block) for model in models])
            if number == 1:
                arrivals.take_until(start_s)  # the first block may begin before the start
            done_s = block.end_s
        yield Chunk(until_s, arrivals.take_until(until_s), samples.take_until(until_s) if samples else None)
        if until_s >= end_s:
            return


def simulate(
    settings: SimulationSettings,
    sensors: tuple[SensorSettings, ...],
    *,
    chunk_s: float = 1.0,
    only: Collection[str] | None = None,
    truth: bool = False,
    start_s: float | None = None,
    anchor_s: float | None = None,
    endless: bool = False,
) -> Iterator[Chunk]:
    """Simulate a scenario.

    Parameters
    ----------
    settings : SimulationSettings
        Flights and errors.
    sensors : tuple of SensorSettings
        Sensors, in the order of the engine.
    chunk_s : float
        How much time one chunk covers. [s]
    only : collection of str, optional
        Ids of the sensors that are wanted; their reports are the same as with all of them.
    truth : bool
        Whether chunks carry the truth.
    start_s : float, optional
        When the scenario starts; absent: ``settings.start_s``. [s since the epoch]
    anchor_s : float, optional
        When the first flights begin; absent: at the start. What is flown is a function of the time since the anchor,
        so simulations with the same anchor agree, whenever each of them starts. [s since the epoch]
    endless : bool
        Go on until the iterator is dropped, instead of for ``settings.duration_s``.

    Yields
    ------
    Chunk
        One per ``chunk_s``, the first one from ``start_s`` on.

    Raises
    ------
    UnknownSensorError
        Where errors are given for a sensor that does not exist.
    """
    start_s = settings.start_s if start_s is None else start_s
    anchor_s = start_s if anchor_s is None else anchor_s
    models = sensor_models(settings, sensors, start_s=start_s, slots=settings.aircraft, only=only)
    samples = TruthSamples(start_s, settings.truth_period_s) if truth else None
    blocks = _blocks(settings, sensors, start_s=start_s, anchor_s=anchor_s, endless=endless)
    return in_chunks(
        samples.of(blocks) if samples else blocks,
        models,
        start_s=start_s,
        end_s=math.inf if endless else start_s + settings.duration_s,
        chunk_s=chunk_s,
        samples=samples,
    )


def truth_by_track(settings: SimulationSettings, sensors: tuple[SensorSettings, ...]) -> Iterator[TruthStates]:
    """The truth of a scenario ordered by address, then time: the order of a truth file.

    The flights are flown once more, some at a time, so that memory stays bounded however many there are.
    """
    start_s, period_s = settings.start_s, settings.truth_period_s
    tile = SLOT_STEP * max(1, int(TRUTH_ROWS * period_s / settings.duration_s) // SLOT_STEP)
    for first in range(0, settings.aircraft, tile):
        slots = range(first, min(first + tile, settings.aircraft))
        samples = TruthSamples(start_s, period_s)
        blocks = _blocks(settings, sensors, start_s=start_s, anchor_s=start_s, endless=False, slots=slots)
        end_s = start_s + settings.duration_s
        chunks = in_chunks(
            samples.of(blocks), (), start_s=start_s, end_s=end_s, chunk_s=settings.duration_s, samples=samples
        )
        yield from (chunk.truth.by_track() for chunk in chunks if chunk.truth is not None)


def _blocks(
    settings: SimulationSettings,
    sensors: tuple[SensorSettings, ...],
    *,
    start_s: float,
    anchor_s: float,
    endless: bool,
    slots: range | None = None,
) -> Iterator[Block]:
    """The blocks of a fleet from the one in which ``start_s`` lies."""
    first = int((start_s - anchor_s) // BLOCK_S)
    # Who is in the air now began within the last flight's length.
    begin = max(0, first - math.ceil(settings.flight_s / BLOCK_S) - 1)
    fleet = Fleet(
        settings,
        centre_deg=settings.centre_deg(sensors),
        anchor_s=anchor_s,
        span_s=settings.flight_s if endless else settings.duration_s,
        begin_block=begin,
        slots=slots,
    )
    for _ in range(begin, first):
        fleet.advance()
    while True:
        yield fleet.advance()
