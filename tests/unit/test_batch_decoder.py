"""Report batches from bytes: what is taken, what costs one report, what costs the batch."""

from __future__ import annotations

import json
import math

import msgspec
import numpy as np
import pytest
from tests.wire_samples import NOW_S, adsb_report, batch, decode, radar_report

from aeroskein.plots import ON_GROUND, SIMULATED, SPI
from aeroskein.reasons import Reason
from aeroskein_service import batch_decoder, report_columns

BOTH = pytest.mark.parametrize("encoding", ["application/msgpack", "application/json"])


# -- what is taken -------------------------------------------------------------------------------------------------
@BOTH
def test_report_comes_out_with_every_field(encoding):
    report = adsb_report(
        heading_deg=90.0, position_sigma_m=5.0, velocity_sigma_mps=0.5, local_track=4, elevation_deg=1.0
    )

    decoded = decode(batch([report]), encoding)

    assert decoded.error is None
    assert decoded.rejected == {}
    plots = decoded.plots
    for name in report.keys() - {"address", "callsign", "mode_a"}:
        assert getattr(plots, name)[0] == report[name], name
    assert (plots.address[0], plots.callsign[0], plots.mode_a[0]) == (0x3C6444, b"DLH4AB", 0o1000)
    assert (plots.received_s[0], plots.sensor[0]) == (NOW_S + 0.2, 0)


@BOTH
def test_radar_plot_comes_out_with_its_polar_position(encoding):
    plots = decode(batch([radar_report()]), encoding).plots

    assert (plots.range_m[0], plots.azimuth_deg[0], plots.local_track[0]) == (80_000.0, 271.25, 17)
    assert math.isnan(plots.lat_deg[0])
    assert plots.address[0] == -1


def test_batch_says_its_place_in_the_sequence_and_when_it_was_sent():
    decoded = decode(batch([adsb_report()]))

    assert (decoded.epoch, decoded.seq, decoded.sent_s) == (1_790_000_000_000, 17, NOW_S + 0.1)


def test_batch_may_leave_out_the_sensor_and_when_it_was_sent():
    decoded = decode(batch([adsb_report()], sensor=None, sent_s=None))

    assert len(decoded.plots) == 1
    assert decoded.sent_s is None


@pytest.mark.parametrize(
    "encoding", ["application/msgpack;aeroskein", "Application/MsgPack", " application/msgpack ; charset=x"]
)
def test_encoding_may_carry_a_schema(encoding):
    assert len(decode(batch([adsb_report()]), encoding).plots) == 1


def test_null_is_the_same_as_absent():
    absent = decode(batch([adsb_report(altitude_m=None, address=None, nac_p=None)])).plots
    nothing = adsb_report() | {"altitude_m": None, "address": None, "nac_p": None, "on_ground": None}

    null = decode(batch([nothing])).plots

    for name in ("altitude_m", "address", "nac_p", "flags"):
        np.testing.assert_array_equal(getattr(null, name), getattr(absent, name))


def test_whole_number_serves_where_a_float_is_expected():
    assert decode(batch([adsb_report(altitude_m=10_000)])).plots.altitude_m[0] == 10_000.0


def test_unknown_fields_are_for_later_versions_and_do_no_harm():
    decoded = decode(batch([adsb_report() | {"wind_mps": 3.0}], quality="high"))

    assert len(decoded.plots) == 1
    assert decoded.rejected == {}


def test_lower_case_address_is_the_same_address():
    plots = decode(batch([adsb_report(address="3c6444"), adsb_report(address="3C6444")])).plots

    assert plots.address.tolist() == [0x3C6444, 0x3C6444]


def test_blanks_around_a_callsign_are_dropped():
    assert decode(batch([adsb_report(callsign="DLH4AB  ")])).plots.callsign[0] == b"DLH4AB"


def test_blank_callsign_is_no_callsign_and_no_fault():
    decoded = decode(batch([adsb_report(callsign="        ")]))

    assert decoded.plots.callsign[0] == b""
    assert decoded.rejected == {}


def test_flags_become_bits():
    reports = [adsb_report(on_ground=True), adsb_report(simulated=True, spi=True), adsb_report(on_ground=False)]

    assert decode(batch(reports)).plots.flags.tolist() == [ON_GROUND, SIMULATED | SPI, 0]


def test_speed_without_angle_is_no_velocity():
    plots = decode(batch([adsb_report(track_angle_deg=None), adsb_report(ground_speed_mps=None)])).plots

    assert np.isnan(plots.ground_speed_mps).all()
    assert np.isnan(plots.track_angle_deg).all()


def test_standing_target_needs_no_angle():
    plots = decode(batch([adsb_report(ground_speed_mps=0.0, track_angle_deg=None)])).plots

    assert (plots.ground_speed_mps[0], plots.track_angle_deg[0]) == (0.0, 0.0)


def test_five_hundred_reports_are_taken_in_their_order():
    reports = [adsb_report(time_s=NOW_S + i) for i in range(500)]

    plots = decode(batch(reports)).plots

    np.testing.assert_array_equal(plots.time_s, NOW_S + np.arange(500))


# -- what costs one report -----------------------------------------------------------------------------------------
GOOD = adsb_report(address="4CA2D6")

WRONG = {
    "number as text": (adsb_report(altitude_m="high"), Reason.BAD_VALUE),
    "number as truth": (adsb_report(altitude_m=True), Reason.BAD_VALUE),
    "list for a number": (adsb_report(lat_deg=[48.0]), Reason.BAD_VALUE),
    "integer with a fraction": (adsb_report(nac_p=8.5), Reason.BAD_VALUE),
    "category out of range": (adsb_report(nac_p=12), Reason.BAD_VALUE),
    "category far out of range": (adsb_report(sil=10**15), Reason.BAD_VALUE),
    "negative track number": (adsb_report(local_track=-1), Reason.BAD_VALUE),
    "truth as number": (adsb_report(on_ground=1), Reason.BAD_VALUE),
    "latitude out of range": (adsb_report(lat_deg=90.5), Reason.BAD_VALUE),
    "azimuth of 360": (radar_report(azimuth_deg=360.0), Reason.BAD_VALUE),
    "negative range": (radar_report(range_m=-1.0), Reason.BAD_VALUE),
    "no time": (adsb_report(time_s=None), Reason.BAD_VALUE),
    "negative speed without angle": (adsb_report(ground_speed_mps=-3.0, track_angle_deg=None), Reason.BAD_VALUE),
    "two positions": (adsb_report(range_m=1.0, azimuth_deg=1.0), Reason.BAD_VALUE),
    "half a position": (adsb_report(lon_deg=None), Reason.BAD_VALUE),
    "no position": (adsb_report(lat_deg=None, lon_deg=None), Reason.NO_POSITION),
    "address too short": (adsb_report(address="3C644"), Reason.BAD_ADDRESS),
    "address not hex": (adsb_report(address="3C644G"), Reason.BAD_ADDRESS),
    "address with sign": (adsb_report(address="+3C644"), Reason.BAD_ADDRESS),
    "empty address": (adsb_report(address=""), Reason.BAD_ADDRESS),
    "address in wide digits": (adsb_report(address="３C6444"), Reason.BAD_ADDRESS),
    "address as number": (adsb_report(address=0x3C6444), Reason.BAD_ADDRESS),
    "no map": (17, Reason.MALFORMED),
    "nothing": (None, Reason.MALFORMED),
    "list": ([1, 2], Reason.MALFORMED),
}


@BOTH
@pytest.mark.parametrize("name", list(WRONG))
def test_wrong_report_costs_itself_only(encoding, name):
    wrong, reason = WRONG[name]

    decoded = decode(batch([GOOD, wrong, GOOD]), encoding)

    assert decoded.error is None
    assert decoded.rejected == {reason: 1}
    assert decoded.plots.address.tolist() == [0x4CA2D6, 0x4CA2D6]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["time_s", "lat_deg", "altitude_m", "heading_deg", "position_sigma_m"])
def test_number_that_is_none_costs_its_report_in_msgpack(field, value):
    decoded = decode(batch([GOOD, GOOD | {field: value}]))

    assert decoded.rejected == {Reason.BAD_VALUE: 1}
    assert len(decoded.plots) == 1


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_number_that_is_none_costs_its_report_in_json_though_it_is_no_json(value):
    payload = json.dumps(batch([GOOD, GOOD | {"altitude_m": value}])).encode()

    decoded = decode(payload, "application/json")

    assert decoded.error is None
    assert decoded.rejected == {Reason.BAD_VALUE: 1}
    assert len(decoded.plots) == 1


@pytest.mark.parametrize("number", [b"1e999", b"-1e999", b"9" * 400, b"9" * 5000])
def test_number_too_large_for_a_float_costs_its_report(number):
    payload = msgspec.json.encode(batch([GOOD, adsb_report(altitude_m=123.5)])).replace(b"123.5", number)

    decoded = decode(payload, "application/json")

    assert decoded.rejected == {Reason.BAD_VALUE: 1}
    assert len(decoded.plots) == 1


def test_text_that_is_no_utf8_costs_its_report_in_msgpack():
    payload = msgspec.msgpack.encode(batch([GOOD, adsb_report(callsign="DLH4AB")])).replace(
        b"DLH4AB", b"\xff\xfe\xfd\xfc\xfb\xfa"
    )
    other = msgspec.msgpack.encode(batch([GOOD | {"callsign": "X"}, adsb_report(callsign="DLH4AB")]))
    other = other.replace(b"DLH4AB", b"\xff\xfe\xfd\xfc\xfb\xfa")

    both, one = decode(payload), decode(other)

    assert both.rejected == {Reason.MALFORMED: 2}
    assert one.rejected == {Reason.MALFORMED: 1}
    assert one.plots.callsign.tolist() == [b"X"]


BAD_CALLSIGNS = ["TOOLONG99", "DLHÄ", "A\tB", "\x00", 17, ["DLH"], True]


@BOTH
@pytest.mark.parametrize("callsign", BAD_CALLSIGNS)
def test_bad_callsign_is_dropped_and_counted(encoding, callsign):
    decoded = decode(batch([GOOD, GOOD | {"callsign": callsign}]), encoding)

    assert decoded.rejected == {Reason.BAD_CALLSIGN: 1}
    assert decoded.plots.callsign.tolist() == [b"DLH4AB", b""]


@BOTH
@pytest.mark.parametrize("mode_a", ["100", "10000", "1008", "", "+100", 1000, {"a": 1}])
def test_bad_mode_a_is_dropped_and_counted(encoding, mode_a):
    decoded = decode(batch([GOOD, GOOD | {"mode_a": mode_a}]), encoding)

    assert decoded.rejected == {Reason.BAD_MODE_A: 1}
    assert decoded.plots.mode_a.tolist() == [0o1000, -1]


def test_batch_in_which_every_report_is_wrong_is_still_a_batch():
    decoded = decode(batch([adsb_report(address="?")]))

    assert decoded.error is None
    assert len(decoded.plots) == 0
    assert decoded.seq == 17


# -- what costs the batch ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("encoding", ["", "text/plain", "application/cbor", "zenoh/bytes", "msgpack", "x" * 10_000])
def test_other_encodings_are_refused(encoding):
    decoded = decode(msgspec.msgpack.encode(batch([GOOD])), encoding)

    assert decoded.rejected == {Reason.BAD_ENCODING: 1}
    assert len(decoded.error) < 200


BROKEN = [
    b"",
    b"\xc1",
    b"not a batch",
    b"\x91" * 200_000,
    b"[" * 200_000,
    b'{"version": 1,',
    b"[]",
    b"17",
    b'"text"',
    b"\xdd\xff\xff\xff\xff",
    msgspec.msgpack.encode(batch([GOOD]))[:-3],
    msgspec.json.encode(batch([GOOD]))[:-3],
]


@BOTH
@pytest.mark.parametrize("payload", BROKEN, ids=range(len(BROKEN)))
def test_broken_payload_is_malformed(encoding, payload):
    decoded = decode(payload, encoding)

    assert decoded.rejected == {Reason.MALFORMED: 1}
    assert decoded.error
    assert len(decoded.plots) == 0


def test_payload_in_the_other_encoding_is_malformed():
    assert decode(msgspec.json.encode(batch([GOOD])), "application/msgpack").rejected == {Reason.MALFORMED: 1}
    assert decode(msgspec.msgpack.encode(batch([GOOD])), "application/json").rejected == {Reason.MALFORMED: 1}


@BOTH
@pytest.mark.parametrize(
    "changes",
    [{"reports": None}, {"reports": {}}, {"reports": "x"}, {"reports": []}, {"epoch": None}, {"epoch": -1},
     {"epoch": "x"}, {"epoch": True}, {"seq": None}, {"seq": 1.5}, {"seq": 2**63}],
)  # fmt: skip
def test_envelope_with_a_fault_is_malformed(encoding, changes):
    decoded = decode(batch([GOOD], **changes), encoding)

    assert decoded.rejected == {Reason.MALFORMED: 1}
    assert next(iter(changes)) in decoded.error


@BOTH
@pytest.mark.parametrize("version", [0, 2, -1, "1", None, True, [1], 10**18])
def test_unknown_version_is_refused_whatever_else_the_batch_holds(encoding, version):
    decoded = decode(batch([GOOD], version=version) | {"reports": {"new": "layout"}}, encoding)

    assert decoded.rejected == {Reason.BAD_VERSION: 1}


@BOTH
def test_unknown_version_of_a_batch_that_looks_right_is_refused(encoding):
    assert decode(batch([GOOD], version=2), encoding).rejected == {Reason.BAD_VERSION: 1}


@BOTH
@pytest.mark.parametrize("sensor", ["radar1", "", 17])
def test_batch_that_names_another_sensor_than_its_key_is_refused(encoding, sensor):
    decoded = decode(batch([GOOD], sensor=sensor), encoding)

    assert decoded.rejected == {Reason.WRONG_SENSOR: 1}
    assert decoded.seq == 17


@BOTH
@pytest.mark.parametrize("spoil", [False, True])
def test_more_than_five_hundred_reports_are_refused(encoding, spoil):
    reports = [GOOD] * 501
    if spoil:
        reports[3] = GOOD | {"nac_p": "x"}

    decoded = decode(batch(reports), encoding)

    assert decoded.rejected == {Reason.TOO_MANY_REPORTS: 1}
    assert "501" in decoded.error


def test_huge_payload_is_refused_before_it_is_parsed(monkeypatch):
    monkeypatch.setattr(batch_decoder, "PAYLOAD_BYTES", 100)

    assert decode(b"x" * 101).rejected == {Reason.TOO_MANY_REPORTS: 1}


@pytest.mark.parametrize("sent_s", ["now", math.nan, math.inf, True, None])
def test_bad_time_of_sending_is_no_time_of_sending(sent_s):
    decoded = decode(batch([GOOD]) | {"sent_s": sent_s})

    assert decoded.sent_s is None
    assert len(decoded.plots) == 1


def test_sentence_about_a_long_value_is_short():
    decoded = decode(batch([GOOD], sensor="x" * 100_000))

    assert len(decoded.error) < 200


# -- caches --------------------------------------------------------------------------------------------------------
def test_flood_of_new_addresses_does_not_grow_the_cache(monkeypatch):
    monkeypatch.setattr(report_columns, "CACHE_ENTRIES", 100)
    addresses = [f"{number:06X}" for number in range(450)]

    plots = decode(batch([adsb_report(address=address) for address in addresses])).plots

    assert plots.address.tolist() == list(range(450))
    assert len(report_columns._ADDRESSES) <= 102
