"""Report batches to bytes, for those who speak as sensors: the simulator, replays, gateways; and for report files."""

from __future__ import annotations

from typing import Any, Final

import msgspec
import numpy as np

from aeroskein.plots import ON_GROUND, SIMULATED, SPI, Plots
from aeroskein_service.messages import BATCH_REPORTS, VERSION, Encoding, Report

__all__ = ["encode_batch", "reports_of"]

_NUMBERS: Final = Report.__struct_fields__[: Report.__struct_fields__.index("local_track")]
_INTEGERS: Final = ("local_track", "nac_p", "nac_v", "nic", "sil")
_FLAGS: Final = (("on_ground", ON_GROUND), ("simulated", SIMULATED), ("spi", SPI))


def reports_of(plots: Plots) -> list[Report]:
    """The rows as messages; what is missing is absent."""
    n = len(plots)
    nothing = [None] * n
    columns: list[list[Any]] = []
    for name in _NUMBERS:
        column = getattr(plots, name)
        known = np.isfinite(column)
        columns.append(_where(column, known) if known.any() else nothing)
    for name in _INTEGERS:
        column = getattr(plots, name)
        known = column >= 0
        columns.append(_where(column, known) if known.any() else nothing)
    columns.append([f"{a:06X}" if a >= 0 else None for a in plots.address.tolist()])
    columns.append([c.decode("ascii", "replace") or None for c in plots.callsign.tolist()])
    columns.append([f"{m:04o}" if m >= 0 else None for m in plots.mode_a.tolist()])
    for _, bit in _FLAGS:
        columns.append([True if flags & bit else None for flags in plots.flags.tolist()])
    return [Report(*row) for row in zip(*columns, strict=True)]


def encode_batch(
    plots: Plots, *, sensor_id: str, epoch: int, seq: int, sent_s: float, encoding: Encoding = "msgpack"
) -> bytes:
    """One report batch of one sensor; raises ``ValueError`` for none or more than ``BATCH_REPORTS`` rows."""
    if not 1 <= len(plots) <= BATCH_REPORTS:
        raise ValueError(f"{len(plots)} reports, a batch takes 1 to {BATCH_REPORTS}")
    batch = {
        "version": VERSION,
        "sensor": sensor_id,
        "epoch": epoch,
        "seq": seq,
        "sent_s": sent_s,
        "reports": reports_of(plots),
    }
    return msgspec.json.encode(batch) if encoding == "json" else msgspec.msgpack.encode(batch)


def _where(column: Any, known: Any) -> list[Any]:
    if known.all():
        return list(column.tolist())
    return [value if there else None for value, there in zip(column.tolist(), known.tolist(), strict=True)]
