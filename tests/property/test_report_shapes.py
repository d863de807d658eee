"""Batches of one shape: what is read from their bytes is what the typed decoder says, for every value and field."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.wire_samples import NOW_S, adsb_report, batch, good_reports

from aeroskein.plots import Plots
from aeroskein.reasons import Reason
from aeroskein_service.codec import Gathered, OpenBatch, gather, open_batch
from aeroskein_service.messages import MSGPACK, Report

_values = (
    st.none() | st.booleans() | st.integers(-5, 300) | st.floats(width=64) | st.text(max_size=9)
    | st.sampled_from(["3C6444", "3c6444", "7700", "DLH 1", " AB ", "A\x00", "Ä", "", "0008", "GGGGGG"])
    | st.lists(st.integers(), max_size=2)
)  # fmt: skip
_fields = st.sampled_from([*Report.__struct_fields__, "unknown", "Ünknown"])


def gathered(payloads: list[bytes], *, packed: bool) -> tuple[list[OpenBatch], Gathered]:
    opened = [open_batch(payload, MSGPACK, sensor_id="adsb", packed=packed) for payload in payloads]
    return opened, gather(opened, sensors=[0] * len(opened), received_s=[NOW_S + i for i in range(len(opened))])


def all_rejected(opened: list[OpenBatch], result: Gathered) -> dict[Reason, int]:
    total: dict[Reason, int] = {}
    for reason, many in [
        *(item for one in opened for item in one.rejected.items()),
        *((reason, many) for (_, reason), many in result.rejected.items()),
    ]:
        total[reason] = total.get(reason, 0) + many
    return total


def assert_same(payloads: list[bytes]) -> list[OpenBatch]:
    """The same columns, in order of arrival, and the same rejections; returns the packed batches."""
    opened, packed = gathered(payloads, packed=True)
    typed_opened, typed = gathered(payloads, packed=False)
    assert all_rejected(opened, packed) == all_rejected(typed_opened, typed)
    assert [(b.epoch, b.seq, b.error) for b in opened] == [(b.epoch, b.seq, b.error) for b in typed_opened]
    for name in Plots.__dataclass_fields__:
        one, other = (p.plots.take(np.argsort(p.plots.received_s, kind="stable")) for p in (packed, typed))
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    return opened


@given(report=good_reports | st.dictionaries(_fields, _values, max_size=6))
@example(report={"time_s": math.nan})
@example(report=adsb_report(callsign="A\x00", mode_a="0008"))
@example(report=adsb_report(nac_p=200, local_track=70_000))
def test_one_report_is_read_as_the_typed_decoder_reads_it(report: dict[str, Any]) -> None:
    assert_same([msgspec.msgpack.encode(batch([report], sensor=None))])


@given(
    reports=st.lists(
        st.builds(
            adsb_report,
            time_s=st.floats(0.0, 2.0e9),
            lat_deg=st.floats(),
            lon_deg=st.floats(-200.0, 200.0),
            address=st.text("0123456789abcdefABCDEFG", min_size=6, max_size=6),
            callsign=st.text("AB1 _", min_size=6, max_size=6),
            mode_a=st.text("01789", min_size=4, max_size=4),
            nac_p=st.integers(0, 127),
            on_ground=st.booleans(),
            ground_speed_mps=st.floats(-1.0, 1.0) | st.just(0.0),
        ),
        min_size=1,
        max_size=6,
    )
)
def test_reports_of_one_shape_stay_packed_and_say_the_same(reports: list[dict[str, Any]]) -> None:
    opened = assert_same([msgspec.msgpack.encode(batch(reports, sensor=None))] * 2)

    assert all(one.rows is not None for one in opened)


@given(batches=st.lists(st.lists(good_reports | st.just({}) | st.just(7), min_size=1, max_size=4), max_size=4))
def test_batches_of_any_shapes_together_lose_nothing(batches: list[list[Any]]) -> None:
    assert_same([msgspec.msgpack.encode(batch(reports, sensor=None)) for reports in batches])


@given(data=st.data())
def test_one_changed_byte_is_judged_as_by_the_typed_decoder(data: st.DataObject) -> None:
    payload = bytearray(msgspec.msgpack.encode(batch([adsb_report(), adsb_report(lat_deg=47.0)], sensor=None)))
    at = data.draw(st.integers(0, len(payload) - 1))
    payload[at] = data.draw(st.integers(0, 255))
    assert_same([bytes(payload)])


@pytest.mark.parametrize("changed", [{"callsign": "LONGER1"}, {"mode_a": None}, {"nac_p": None}, {"lat_deg": 48}])
def test_a_batch_with_two_shapes_goes_the_other_way(changed: dict[str, Any]) -> None:
    (opened,) = assert_same([msgspec.msgpack.encode(batch([adsb_report(), adsb_report(**changed)], sensor=None))])

    assert opened.rows is None
    assert len(opened.reports) == 2


def test_what_was_learned_from_one_batch_is_not_believed_of_another() -> None:
    # The same length, another order of fields.
    first = {"time_s": NOW_S, "lat_deg": 48.0, "lon_deg": 11.0, "address": "3C6444"}
    second = {"time_s": NOW_S, "lon_deg": 11.0, "lat_deg": 48.0, "address": "3C6444"}
    opened = assert_same([msgspec.msgpack.encode(batch([report], sensor=None)) for report in (first, second, first)])

    shapes = [one.rows.shape for one in opened if one.rows is not None]
    assert len(shapes) == 3
    assert shapes[0] is shapes[2] is not shapes[1]
