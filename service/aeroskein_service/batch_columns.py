"""Decoded batches to columns: the reports of everything that has arrived become one set of rows.

Making columns has a fixed cost of a tenth of a millisecond, so the worker gathers all batches of a turn first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Final

import numpy as np

from aeroskein.plots import Plots
from aeroskein.reasons import Reason
from aeroskein_service.batch_decoder import OpenBatch, open_batch
from aeroskein_service.report_columns import Columns, columns_of, judged
from aeroskein_service.report_shapes import plots_of

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

    Reports that came packed stand together by their shape, the others after them, both in order.

    Parameters
    ----------
    batches : sequence of OpenBatch
        In order of arrival.
    sensors : sequence of int
        Index of each batch's sensor.
    received_s : sequence of float
        Arrival of each batch. [s since the epoch]
    """
    groups: dict[int, list[int]] = {}
    for index, batch in enumerate(batches):
        if batch.rows is not None:
            groups.setdefault(id(batch.rows.shape), []).append(index)
    parts = [_packed([batches[i] for i in group], group, sensors, received_s) for group in groups.values()]
    reports = list(chain.from_iterable(batch.reports for batch in batches))
    if reports:
        lengths = [len(batch.reports) for batch in batches]
        sensor = np.repeat(np.array(sensors, dtype=np.int16), lengths)
        parts.append(columns_of(reports, received_s=np.repeat(received_s, lengths), sensor=sensor))
    rejected: dict[tuple[int, Reason], int] = {}
    good = []
    for part in parts:
        if part.reasons.any() or part.bad_callsign is not None or part.bad_mode_a is not None:
            for reason, many in _counts(part).items():
                rejected[reason] = rejected.get(reason, 0) + many
            good.append(part.plots.take(part.reasons == Reason.ACCEPTED))
        else:
            good.append(part.plots)
    return Gathered(Plots.concatenate(good), rejected) if good else Gathered()


def _packed(
    batches: Sequence[OpenBatch], places: Sequence[int], sensors: Sequence[int], received_s: Sequence[float]
) -> Columns:
    """Columns of batches whose reports all have the same shape."""
    rows = [batch.rows for batch in batches if batch.rows is not None]
    lengths = [len(part.matrix) for part in rows]
    matrix = rows[0].matrix if len(rows) == 1 else np.concatenate([part.matrix for part in rows])
    plots, bad_callsign, bad_mode_a = plots_of(rows[0].shape, matrix)
    plots.sensor = np.repeat(np.array([sensors[i] for i in places], dtype=np.int16), lengths)
    plots.received_s = np.repeat(np.array([received_s[i] for i in places]), lengths)
    return judged(plots, bad_callsign, bad_mode_a)


def _counts(columns: Columns) -> dict[tuple[int, Reason], int]:
    kinds, sensor = len(Reason), columns.plots.sensor
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
