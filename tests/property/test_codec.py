"""What must hold for every payload: nothing raises, good reports survive, templates say what dictionaries say."""

from __future__ import annotations

import json
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.wire_samples import NOW_S, SENSORS, adsb_report, batch, decode, fused_points, good_reports

from aeroskein.plots import ON_GROUND, SIMULATED, SPI, Plots
from aeroskein.points import FusedPoints, Product
from aeroskein.reasons import Reason
from aeroskein_service.codec import (
    PointEncoder,
    decode_batch,
    decode_feed,
    decode_point,
    encode_batch,
    encode_feed,
    gather,
    open_batch,
    reports_of,
)
from aeroskein_service.messages import FLAG_NAMES, JSON, MSGPACK, STATUS_NAMES

EPOCH = 1_790_000_000_123

_json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
    max_leaves=6,
)
_msgpack_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=10)
    | st.binary(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=10), inner, max_size=3),
    max_leaves=6,
)
_fields = st.sampled_from([*adsb_report(), "range_m", "azimuth_deg", "local_track", "on_ground", "position_sigma_m"])


def pack(value: Any) -> bytes:
    return msgspec.msgpack.encode(value)


def accounted(decoded: Any, reports: int) -> bool:
    """Every report is either there or rejected; dropped fields are no reports."""
    fields = (Reason.BAD_CALLSIGN, Reason.BAD_MODE_A)
    return len(decoded.plots) + sum(n for reason, n in decoded.rejected.items() if reason not in fields) == reports


# -- decoding ------------------------------------------------------------------------------------------------------
@given(payload=st.binary(max_size=300), encoding=st.sampled_from([MSGPACK, JSON]) | st.text(max_size=30))
def test_any_bytes_are_a_rejection_and_never_an_error(payload, encoding):
    decoded = decode(payload, encoding)

    assert decoded.error
    assert sum(decoded.rejected.values()) == 1


@given(data=st.data(), encoding=st.sampled_from([MSGPACK, JSON]))
def test_one_changed_byte_never_raises(data, encoding):
    encoder = msgspec.json if encoding == JSON else msgspec.msgpack
    payload = bytearray(encoder.encode(batch([adsb_report(), adsb_report(callsign="X")])))
    payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))

    decoded = decode(bytes(payload), encoding)

    assert decoded.error is not None or accounted(decoded, 2)


@given(field=_fields, value=_msgpack_values)
def test_any_value_in_any_field_of_msgpack_costs_that_report_at_most(field, value):
    decoded = decode(batch([adsb_report(), adsb_report() | {field: value}, adsb_report()]))

    assert decoded.error is None
    assert accounted(decoded, 3)
    assert len(decoded.plots) >= 2


@given(field=_fields, value=_json_values)
def test_any_value_in_any_field_of_json_costs_that_report_at_most(field, value):
    # Python's own writer, so that NaN, Infinity and endless integers are among the values.
    payload = json.dumps(batch([adsb_report(), adsb_report() | {field: value}, adsb_report()]), allow_nan=True).encode()

    decoded = decode(payload, JSON)

    assert decoded.error is None
    assert accounted(decoded, 3)
    assert len(decoded.plots) >= 2


@given(reports=st.lists(_msgpack_values | good_reports, min_size=1, max_size=5))
def test_anything_in_the_place_of_reports_is_accounted_for(reports):
    assert accounted(decode(batch(reports)), len(reports))


@given(reports=st.lists(good_reports, min_size=1, max_size=6), encoding=st.sampled_from([MSGPACK, JSON]))
def test_good_reports_come_out_as_they_went_in(reports, encoding):
    decoded = decode(batch(reports), encoding)

    assert decoded.rejected == {}
    assert len(decoded.plots) == len(reports)
    for row, report in enumerate(reports):
        assert_same(decoded.plots, row, report)


def assert_same(plots: Plots, row: int, report: dict[str, Any]) -> None:
    bits = {"on_ground": ON_GROUND, "simulated": SIMULATED, "spi": SPI}
    for name in ("lat_deg", "lon_deg", "range_m", "azimuth_deg", "altitude_m", "heading_deg", "ground_speed_mps"):
        value = getattr(plots, name)[row]
        assert value == report[name] if name in report else math.isnan(value), name
    for name in ("local_track", "nac_p", "nac_v", "nic", "sil"):
        assert getattr(plots, name)[row] == report.get(name, -1), name
    assert plots.address[row] == int(report.get("address", "-1"), 16)
    assert plots.mode_a[row] == int(report.get("mode_a", "-1"), 8)
    assert plots.callsign[row] == report.get("callsign", "").encode()
    assert plots.flags[row] == sum(bit for name, bit in bits.items() if report.get(name))


@given(reports=st.lists(good_reports, min_size=1, max_size=6), encoding=st.sampled_from(["msgpack", "json"]))
def test_columns_that_are_encoded_again_decode_to_the_same_columns(reports, encoding):
    plots = decode(batch(reports)).plots

    payload = encode_batch(plots, sensor_id="adsb", epoch=1, seq=2, sent_s=NOW_S, encoding=encoding)
    again = decode(payload, f"application/{encoding}").plots

    for name in Plots.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(plots, name), err_msg=name)


@given(
    batches=st.lists(
        st.tuples(st.lists(good_reports | _msgpack_values, min_size=1, max_size=3), st.integers(0, 2)), max_size=4
    )
)
def test_batches_that_are_gathered_are_the_same_as_one_by_one(batches):
    payloads = [pack(batch(reports, sensor=None)) for reports, _ in batches]
    indices = [index for _, index in batches]
    arrivals = [NOW_S + i for i in range(len(batches))]

    opened = [open_batch(payload, MSGPACK, sensor_id="adsb") for payload in payloads]
    together = gather(opened, sensors=indices, received_s=arrivals)
    single = [
        decode_batch(payload, MSGPACK, sensor_id="adsb", sensor_index=index, received_s=arrival_s)
        for payload, index, arrival_s in zip(payloads, indices, arrivals, strict=True)
    ]

    expected = Plots.concatenate([one.plots for one in single])
    for name in Plots.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(together.plots, name), getattr(expected, name), err_msg=name)
    assert sum(together.rejected.values()) + sum(sum(b.rejected.values()) for b in opened) == sum(
        sum(one.rejected.values()) for one in single
    )
    assert {index for index, _ in together.rejected} <= set(indices)


@given(reports=st.lists(good_reports, max_size=4))
def test_reports_as_messages_hold_no_field_that_is_missing(reports):
    plots = decode(batch(reports)).plots if reports else Plots.of(0)

    made = [msgspec.to_builtins(report) for report in reports_of(plots)]

    assert [set(report) for report in made] == [set(report) for report in reports]


# -- encoding ------------------------------------------------------------------------------------------------------
_maybe = st.floats(allow_nan=False, allow_infinity=False) | st.just(math.nan)
_rows = st.fixed_dictionaries(
    {
        "track_number": st.integers(1, 2**40),
        "label": st.integers(-1, 0xFFFFFF),
        "address": st.integers(-1, 0xFFFFFF),
        "mode_a": st.integers(-1, 0o7777),
        "callsign": st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=8).map(str.encode),
        "seq": st.integers(0, 2**40),
        "time_s": st.floats(0, 1e11),
        **dict.fromkeys(
            (
                "lat_deg",
                "lon_deg",
                "altitude_m",
                "height_m",
                "ground_speed_mps",
                "track_angle_deg",
                "vertical_rate_mps",
            ),
            _maybe,
        ),
        "position_cov_m2": st.just([math.nan] * 3) | st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=3),
        "velocity_cov_m2ps2": st.just([math.nan] * 3) | st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=3),
        "status": st.integers(0, 3),
        "element": st.integers(-1, 2**40),
        "span_s": st.just([math.nan] * 2) | st.lists(st.floats(0, 1e11), min_size=2, max_size=2),
        "master": st.integers(-1, 2),
        "sources": st.lists(st.integers(0, 2**20), min_size=3, max_size=3),
        "rejected": st.integers(0, 2**20),
        "input_received_s": st.floats(0, 1e11) | st.just(math.nan),
        "flags": st.integers(0, 127),
        "renamed_to": st.just(-1) | st.integers(-1, 0xFFFFFF),
    }
)


def points_of(rows: list[dict[str, Any]], product: Product) -> FusedPoints:
    return fused_points(len(rows), product, **{name: [row[name] for row in rows] for name in rows[0]})


def expected_of(row: dict[str, Any], product: Product, published_s: float) -> dict[str, Any]:
    """The plain form of one fused point, written down from the contract."""

    def number(name: str) -> float | None:
        return None if math.isnan(row[name]) else row[name]

    def vector(name: str) -> list[float] | None:
        return None if math.isnan(row[name][0]) else row[name]

    point = {
        "version": 1,
        "product": "live" if product == Product.LIVE else "element",
        "track": f"{row['label']:06X}" if row["label"] >= 0 else f"T{row['track_number']:06d}",
        "track_number": row["track_number"],
        "address": f"{row['address']:06X}" if row["address"] >= 0 else None,
        "callsign": row["callsign"].decode() or None,
        "mode_a": f"{row['mode_a']:04o}" if row["mode_a"] >= 0 else None,
        "epoch": EPOCH,
        "seq": row["seq"],
        "time_s": row["time_s"],
        "published_s": published_s,
        **{name: number(name) for name in ("lat_deg", "lon_deg", "altitude_m", "height_m", "ground_speed_mps")},
        **{name: number(name) for name in ("track_angle_deg", "vertical_rate_mps", "input_received_s")},
        "position_cov_m2": vector("position_cov_m2"),
        "velocity_cov_m2ps2": vector("velocity_cov_m2ps2"),
        "status": STATUS_NAMES[row["status"]],
        "element": row["element"] if row["element"] >= 0 else None,
        "span_s": vector("span_s"),
        "master": SENSORS[row["master"]] if row["master"] >= 0 else None,
        "sources": {sensor: many for sensor, many in zip(SENSORS, row["sources"], strict=True) if many},
        "rejected": row["rejected"],
        "flags": [name for bit, name in enumerate(FLAG_NAMES) if row["flags"] & 2**bit],
    }
    if row["renamed_to"] >= 0:
        point["renamed_to"] = f"{row['renamed_to']:06X}"
    return point


@given(rows=st.lists(_rows, min_size=1, max_size=6), product=st.sampled_from(Product), published_s=st.floats(0, 1e11))
def test_template_decodes_to_the_plain_form(rows, product, published_s):
    payloads = PointEncoder(SENSORS, EPOCH).encode(points_of(rows, product), published_s)

    assert [msgspec.msgpack.decode(payload) for payload in payloads] == [
        expected_of(row, product, published_s) for row in rows
    ]


@given(rows=st.lists(_rows, min_size=1, max_size=4), product=st.sampled_from(Product), published_s=st.floats(0, 1e11))
def test_json_decodes_to_the_plain_form(rows, product, published_s):
    payloads = PointEncoder(SENSORS, EPOCH, "json").encode(points_of(rows, product), published_s)

    assert [json.loads(payload) for payload in payloads] == [expected_of(row, product, published_s) for row in rows]


@given(rows=st.lists(_rows, min_size=1, max_size=6), product=st.sampled_from(Product))
def test_consumer_reads_the_same_point_in_both_encodings(rows, product):
    points = points_of(rows, product)

    binary = [decode_point(p, MSGPACK) for p in PointEncoder(SENSORS, EPOCH).encode(points, NOW_S)]
    text = [decode_point(p, JSON) for p in PointEncoder(SENSORS, EPOCH, "json").encode(points, NOW_S)]

    assert binary == text


@given(rows=st.lists(_rows, min_size=1, max_size=20), encoding=st.sampled_from(["msgpack", "json"]))
def test_feed_holds_its_points_in_order(rows, encoding):
    encoder = PointEncoder(SENSORS, EPOCH, encoding)
    payloads = encoder.encode(points_of(rows, Product.LIVE), NOW_S)

    feed = decode_feed(encode_feed(payloads, encoder.content_type, epoch=EPOCH, seq=3), encoder.content_type)

    assert (feed.version, feed.epoch, feed.seq) == (1, EPOCH, 3)
    assert feed.points == [decode_point(payload, encoder.content_type) for payload in payloads]


@pytest.mark.parametrize("count", [0, 1, 50])
@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_feed_takes_up_to_fifty_points(count, encoding):
    encoder = PointEncoder(SENSORS, EPOCH, encoding)
    payloads = encoder.encode(fused_points(count), NOW_S)

    feed = decode_feed(encode_feed(payloads, encoder.content_type, epoch=1, seq=0), encoder.content_type)

    assert len(feed.points) == count
