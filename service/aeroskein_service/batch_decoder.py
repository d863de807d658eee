"""Report batches from bytes: one payload becomes reports, and what is wrong with it becomes counts, never an error.

The fast path decodes the whole payload with one typed msgspec decoder, or, where the reports are to become columns and
all have one shape, leaves them as they are (``report_shapes``). Only when that fails is the batch taken apart:
first the envelope, whose faults cost the batch, then each report by itself, whose faults cost that report.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final, cast

import msgspec

from aeroskein.reasons import Reason
from aeroskein_service.messages import BATCH_REPORTS, JSON, MSGPACK, VERSION, NonNegative, Report, ReportBatch
from aeroskein_service.report_shapes import Rows, rows_of

__all__ = ["OpenBatch", "lenient_json", "media_type", "open_batch", "read_report"]

# 500 reports with every field are 250 kB of JSON; what is larger is refused before it is parsed. [bytes]
PAYLOAD_BYTES: Final = 4_000_000

# Everything a decoder can raise on bytes from outside: broken syntax, bad UTF-8, nesting without end, huge numbers.
_DECODE_ERRORS: Final = (msgspec.MsgspecError, ValueError, RecursionError, OverflowError)

_DECODERS: Final[dict[str, Any]] = {
    MSGPACK: msgspec.msgpack.Decoder(ReportBatch),
    JSON: msgspec.json.Decoder(ReportBatch),
}


class _Envelope(msgspec.Struct):
    """A batch of which nothing is known yet."""

    version: Any = None
    sensor: Any = None
    epoch: Any = None
    seq: Any = None
    sent_s: Any = None
    reports: msgspec.Raw = msgspec.Raw()


class _Packed(msgspec.Struct, gc=False):
    """A batch as ``ReportBatch`` has it, whose reports are left as they are."""

    version: int
    epoch: NonNegative
    seq: NonNegative
    reports: msgspec.Raw
    sensor: str | None = None
    sent_s: float | None = None


_PACKED: Final = msgspec.msgpack.Decoder(_Packed)


@dataclass(slots=True)
class OpenBatch:
    """What one payload contained, before its reports become columns.

    Attributes
    ----------
    reports : list of Report
        Those of the right types, in order; their values have not been looked at.
    rejected : dict
        How many were not, by reason. ``BAD_CALLSIGN`` and ``BAD_MODE_A`` count fields that were dropped from a report;
        all others count reports, and a batch that was rejected whole counts once.
    epoch, seq : int or None
        The batch's place in its sensor's sequence; None where it could not be read.
    sent_s : float or None
        When the sensor says it sent the batch. [s since the epoch]
    rows : Rows or None
        The reports where they were left packed because all have one shape; ``reports`` is empty then.
    error : str or None
        Why the whole batch was rejected, as one sentence; None where it was not.
    """

    reports: list[Report] = field(default_factory=list)
    rejected: dict[Reason, int] = field(default_factory=dict)
    epoch: int | None = None
    seq: int | None = None
    sent_s: float | None = None
    rows: Rows | None = None
    error: str | None = None


class _WholeBatchError(Exception):
    """The batch cannot be used; stays inside this file."""

    def __init__(self, reason: Reason, sentence: str) -> None:
        super().__init__(sentence)
        self.reason = reason


def media_type(encoding: str) -> str:
    """An encoding without its schema and parameters, in lower case."""
    return encoding.partition(";")[0].strip().lower()


def open_batch(payload: bytes, encoding: str, *, sensor_id: str, packed: bool = False) -> OpenBatch:
    """Decode one report batch. Never raises: whatever is wrong comes back as counts and a sentence.

    Parameters
    ----------
    payload : bytes
        As received.
    encoding : str
        As received, with or without ``;schema``.
    sensor_id : str
        The sensor in the key, which is the truth.
    packed : bool
        Whether reports of one shape may stay packed, for ``gather``.
    """
    batch = OpenBatch()
    try:
        batch.reports = _open(batch, payload, encoding, sensor_id, packed)
    except _WholeBatchError as error:
        batch.error = str(error)
        batch.rejected = {error.reason: 1}
    return batch


def _open(decoded: OpenBatch, payload: bytes, encoding: str, sensor_id: str, packed: bool) -> list[Report]:
    """Read envelope and reports; what is wrong with single reports is counted in ``decoded``."""
    decoder = _DECODERS.get(media_type(encoding))
    if decoder is None:
        raise _WholeBatchError(Reason.BAD_ENCODING, f"encoding {encoding[:60]!r} is neither {MSGPACK!r} nor {JSON!r}")
    if len(payload) > PAYLOAD_BYTES:
        raise _WholeBatchError(
            Reason.TOO_MANY_REPORTS, f"the payload has {len(payload)} bytes, at most {PAYLOAD_BYTES} are read"
        )
    try:
        if packed and media_type(encoding) == MSGPACK and _left_packed(decoded, payload, sensor_id):
            return []
        batch: ReportBatch = decoder.decode(payload)
    except _DECODE_ERRORS:
        return _open_slowly(decoded, payload, media_type(encoding), sensor_id)
    _check_envelope(decoded, batch, sensor_id)
    _check_size(len(batch.reports))
    return batch.reports


def _left_packed(decoded: OpenBatch, payload: bytes, sensor_id: str) -> bool:
    """Whether the reports have one shape and the envelope is good; the rows are then in ``decoded``."""
    batch = _PACKED.decode(payload)
    rows = rows_of(bytes(batch.reports))
    if rows is None:
        return False
    _check_envelope(decoded, batch, sensor_id)
    _check_size(len(rows.matrix))
    decoded.rows = rows
    return True


def _check_size(reports: int) -> None:
    if reports > BATCH_REPORTS:
        raise _WholeBatchError(
            Reason.TOO_MANY_REPORTS, f"the batch has {reports} reports, at most {BATCH_REPORTS} are taken"
        )
    if reports == 0:
        raise _WholeBatchError(Reason.MALFORMED, "the batch has no reports")


def _check_envelope(decoded: OpenBatch, batch: ReportBatch | _Packed | _Envelope, sensor_id: str) -> None:
    if batch.version != VERSION or isinstance(batch.version, bool):
        raise _WholeBatchError(Reason.BAD_VERSION, f"version {_shown(batch.version)} is unknown, expected {VERSION}")
    for name in ("epoch", "seq"):
        value = getattr(batch, name)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**63:
            raise _WholeBatchError(Reason.MALFORMED, f"{name} is {_shown(value)}, expected an integer of 0 or more")
    decoded.epoch, decoded.seq = batch.epoch, batch.seq
    if isinstance(batch.sent_s, int | float) and not isinstance(batch.sent_s, bool) and abs(batch.sent_s) < math.inf:
        decoded.sent_s = float(batch.sent_s)
    if batch.sensor is not None and batch.sensor != sensor_id:
        raise _WholeBatchError(
            Reason.WRONG_SENSOR, f"the batch names sensor {_shown(batch.sensor)}, its key names {sensor_id!r}"
        )


def _shown(value: object) -> str:
    """A value for a sentence, short whatever was sent."""
    if isinstance(value, str):
        value = value[:40]
    elif not isinstance(value, int | float | None):
        return f"a {type(value).__name__}"
    return "absent" if value is None else repr(value)[:42]


# -- the slow path ---------------------------------------------------------------------------------------------------
def _open_slowly(decoded: OpenBatch, payload: bytes, kind: str, sensor_id: str) -> list[Report]:
    """Take a batch apart that did not decode as a whole."""
    try:
        envelope, rows = _take_apart(payload, kind)
    except _DECODE_ERRORS as error:
        raise _WholeBatchError(Reason.MALFORMED, f"the payload is no report batch: {_first(error)}") from None
    _check_envelope(decoded, envelope, sensor_id)
    if rows is None:
        raise _WholeBatchError(Reason.MALFORMED, "reports is no list")
    _check_size(len(rows))
    return list(_good(decoded, rows, kind))


def _take_apart(payload: bytes, kind: str) -> tuple[_Envelope, list[Any] | None]:
    """The envelope and its reports, each still encoded or already plain; None where there is no list of reports."""
    module = msgspec.msgpack if kind == MSGPACK else msgspec.json
    try:
        envelope = module.decode(payload, type=_Envelope)
        if not bytes(envelope.reports):
            return envelope, None
        try:
            return envelope, module.decode(envelope.reports, type=list[msgspec.Raw])
        except msgspec.ValidationError:
            return envelope, None
    except msgspec.ValidationError:
        raise
    except _DECODE_ERRORS:
        if kind == MSGPACK:
            raise
    content = lenient_json(payload)
    if not isinstance(content, dict):
        raise ValueError("expected an object")
    rows = content.pop("reports", None)
    names = _Envelope.__struct_fields__
    return _Envelope(**{k: v for k, v in content.items() if k in names}), rows if isinstance(rows, list) else None


def lenient_json(payload: bytes) -> Any:
    """Decode JSON with NaN, Infinity and endless digits in it, so that they cost only the report they stand in.

    Many writers, Python's own among them, put NaN and Infinity, which are no JSON. Raises ``ValueError`` or
    ``RecursionError``.
    """
    return json.loads(payload.decode(), parse_int=lambda text: int(text) if len(text) < 20 else float(text))


def _good(decoded: OpenBatch, rows: Iterable[Any], kind: str) -> Iterable[Report]:
    for row in rows:
        report = read_report(row, kind, decoded.rejected)
        if isinstance(report, Report):
            yield report
        else:
            decoded.rejected[report] = decoded.rejected.get(report, 0) + 1


def read_report(row: Any, kind: str, dropped: dict[Reason, int]) -> Report | Reason:
    """One report by itself: a struct, or why it is none.

    Parameters
    ----------
    row : msgspec.Raw, bytes or plain value
        The report, encoded or already plain.
    kind : str
        ``MSGPACK`` or ``JSON``, for what is encoded.
    dropped : dict
        Counts callsigns and Mode A codes of a wrong type, which do not cost the report.
    """
    module = msgspec.msgpack if kind == MSGPACK else msgspec.json
    try:
        if isinstance(row, bytes | msgspec.Raw):
            try:
                return cast(Report, module.decode(row, type=Report))
            except msgspec.ValidationError:
                row = msgspec.msgpack.decode(row) if kind == MSGPACK else lenient_json(bytes(row))
    except _DECODE_ERRORS:
        return Reason.MALFORMED
    if not isinstance(row, dict):
        return Reason.MALFORMED
    if not isinstance(row.get("address"), str | None):
        return Reason.BAD_ADDRESS
    for name, reason in (("callsign", Reason.BAD_CALLSIGN), ("mode_a", Reason.BAD_MODE_A)):
        if not isinstance(row.get(name), str | None):
            del row[name]
            dropped[reason] = dropped.get(reason, 0) + 1
    try:
        return msgspec.convert(row, Report)
    except _DECODE_ERRORS:
        return Reason.BAD_VALUE


def _first(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
