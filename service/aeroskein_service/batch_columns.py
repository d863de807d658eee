"""Decoded batches to columns: the reports of everything that has arrived become one set of rows.

Making columns has a fixed cost of a tenth of a millisecond, so the worker gathers all batches of a turn first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from aeroskein.plots import Plots
from aeroskein.reasons import Reason
from aeroskein_service.batch_decoder import OpenBatch, open_batch
from aeroskein_service.report_columns import Columns, columns_of

__all__ = ["DecodedBatch", "Gathered", "decode_batch", "gather"]

# Shared: nobody writes into no rows.
_NO_PLOTS: Final = Plots.of(0)


@dataclass(slots=True)
class Gathered:
    """The reports of several batches.

    Attributes
    ----------
    plots : Plots
        The good ones, in order.
    rejected : dict
        How many were not good, and fields that were dropped, by sensor index and reason; what the batches have already
        counted themselves is not in it.
    """

    plots: Plots = _NO_PLOTS
    rejected: dict[tuple[int, Reason], int] = field(default_factory=dict)


def gather(batches: Sequence[OpenBatch], *, sensors: Sequence[int], received_s: Sequence[float]) -> Gathered:
    """Make columns of all reports of these batches and check their values.

    Parameters
    ----------
    batches : sequence of OpenBatch
        In order of arrival.
    sensors : sequence of int
        Index of each batch's sensor.
    received_s : sequence of float
        Arrival of each batch. [s since the epoch]
    """
    reports = list(chain.from_iterable(batch.reports for batch in batches))
    if not reports:
        return Gathered()
    lengths = [len(batch.reports) for batch in batches]
    sensor = np.repeat(np.array(sensors, dtype=np.int16), lengths)
    columns = columns_of(reports, received_s=np.repeat(received_s, lengths), sensor=sensor)
    if not columns.reasons.any() and columns.bad_callsign is None and columns.bad_mode_a is None:
        return Gathered(columns.plots)
    return Gathered(columns.plots.take(columns.reasons == Reason.ACCEPTED), _counts(columns, sensor))


def _counts(columns: Columns, sensor: NDArray[Any]) -> dict[tuple[int, Reason], int]:
    kinds = len(Reason)
    codes = [(sensor.astype(np.int64) * kinds + columns.reasons)[columns.reasons != Reason.ACCEPTED]]
    for reason, bad in ((Reason.BAD_CALLSIGN, columns.bad_callsign), (Reason.BAD_MODE_A, columns.bad_mode_a)):
        if bad is not None:
            codes.append(sensor[bad].astype(np.int64) * kinds + reason)
    found, many = np.unique(np.concatenate(codes), return_counts=True)
    return {(c // kinds, Reason(c % kinds)): n for c, n in zip(found.tolist(), many.tolist(), strict=True)}


@dataclass(slots=True)
class DecodedBatch:
    """One batch in columns; the fields are those of ``OpenBatch``, with columns in place of the reports."""

    plots: Plots
    rejected: dict[Reason, int]
    epoch: int | None
    seq: int | None
    sent_s: float | None
    error: str | None


def decode_batch(
    payload: bytes, encoding: str, *, sensor_id: str, sensor_index: int, received_s: float
) -> DecodedBatch:
    """Decode one report batch to columns. Never raises.

    Parameters
    ----------
    payload, encoding, sensor_id
        As for ``open_batch``.
    sensor_index : int
        The sensor's index in the configuration.
    received_s : float
        When the payload arrived. [s since the epoch]
    """
    batch = open_batch(payload, encoding, sensor_id=sensor_id)
    gathered = gather([batch], sensors=[sensor_index], received_s=[received_s])
    rejected = dict(batch.rejected)
    for (_, reason), many in gathered.rejected.items():
        rejected[reason] = rejected.get(reason, 0) + many
    return DecodedBatch(gathered.plots, rejected, batch.epoch, batch.seq, batch.sent_s, batch.error)
