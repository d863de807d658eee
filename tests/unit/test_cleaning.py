"""Value checks and time checks of single reports."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aeroskein.cleaning import BAD_ADDRESS_MARK, LIMITS, QUALITY_LIMITS, check_times, check_values
from aeroskein.plots import Plots
from aeroskein.reasons import Reason


def adsb(n: int = 1, **columns: object) -> Plots:
    return Plots.of(n, **({"time_s": 1000.0, "lat_deg": 48.0, "lon_deg": 11.0} | columns))


def radar(n: int = 1, **columns: object) -> Plots:
    return Plots.of(n, **({"time_s": 1000.0, "range_m": 80_000.0, "azimuth_deg": 90.0} | columns))


def test_report_with_a_geographic_position_and_nothing_else_is_good():
    assert check_values(adsb())[0] == Reason.ACCEPTED


def test_primary_plot_without_altitude_is_good():
    assert check_values(radar())[0] == Reason.ACCEPTED


def test_no_reports_have_no_reasons():
    assert len(check_values(Plots.of(0))) == 0


@pytest.mark.parametrize("name", [name for name in LIMITS if name != "time_s"])
def test_every_number_is_good_at_both_ends_of_its_range(name):
    make = radar if name in ("range_m", "azimuth_deg") else adsb

    reasons = check_values(make(2, **{name: LIMITS[name]}))

    assert reasons.tolist() == [Reason.ACCEPTED, Reason.ACCEPTED]


@pytest.mark.parametrize("name", list(LIMITS))
def test_every_number_just_outside_its_range_is_a_bad_value(name):
    low, high = LIMITS[name]
    make = radar if name in ("range_m", "azimuth_deg") else adsb

    reasons = check_values(make(2, **{name: [np.nextafter(low, -np.inf), np.nextafter(high, np.inf)]}))

    assert reasons.tolist() == [Reason.BAD_VALUE, Reason.BAD_VALUE]


@pytest.mark.parametrize("name", list(LIMITS))
@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_every_infinite_number_is_a_bad_value(name, value):
    make = radar if name in ("range_m", "azimuth_deg") else adsb

    assert check_values(make(**{name: value}))[0] == Reason.BAD_VALUE


def test_infinite_arrival_is_a_bad_value():
    assert check_values(adsb(received_s=np.inf))[0] == Reason.BAD_VALUE


@pytest.mark.parametrize("name", ["azimuth_deg", "track_angle_deg", "heading_deg"])
def test_angle_of_360_degrees_is_a_bad_value(name):
    make = radar if name == "azimuth_deg" else adsb

    assert check_values(make(**{name: 360.0}))[0] == Reason.BAD_VALUE


def test_missing_time_is_a_bad_value():
    assert check_values(adsb(time_s=np.nan))[0] == Reason.BAD_VALUE


def test_time_in_milliseconds_is_a_bad_value():
    assert check_values(adsb(time_s=1_790_000_000_000.0))[0] == Reason.BAD_VALUE


def test_report_without_any_position_has_no_position():
    assert check_values(Plots.of(1, time_s=1000.0))[0] == Reason.NO_POSITION


def test_report_with_two_positions_is_a_bad_value():
    assert check_values(adsb(range_m=1000.0, azimuth_deg=1.0))[0] == Reason.BAD_VALUE


@pytest.mark.parametrize("name", ["lat_deg", "lon_deg", "range_m", "azimuth_deg"])
def test_half_a_position_is_a_bad_value(name):
    assert check_values(Plots.of(1, time_s=1000.0, **{name: 1.0}))[0] == Reason.BAD_VALUE


@pytest.mark.parametrize("name", ["range_m", "azimuth_deg"])
def test_position_with_half_of_another_is_a_bad_value(name):
    assert check_values(adsb(**{name: 1.0}))[0] == Reason.BAD_VALUE


@pytest.mark.parametrize("name", list(QUALITY_LIMITS))
def test_quality_indicator_is_good_from_absent_to_its_highest_category(name):
    highest = QUALITY_LIMITS[name]

    reasons = check_values(adsb(highest + 2, **{name: np.arange(-1, highest + 1)}))

    assert not reasons.any()


@pytest.mark.parametrize("name", list(QUALITY_LIMITS))
def test_reserved_category_of_a_quality_indicator_is_a_bad_value(name):
    reasons = check_values(adsb(2, **{name: [QUALITY_LIMITS[name] + 1, -2]}))

    assert reasons.tolist() == [Reason.BAD_VALUE, Reason.BAD_VALUE]


@pytest.mark.parametrize(("name", "value"), [("mode_a", 0o7777 + 1), ("mode_a", -2), ("local_track", -2)])
def test_identity_number_outside_its_range_is_a_bad_value(name, value):
    assert check_values(adsb(**{name: value}))[0] == Reason.BAD_VALUE


@pytest.mark.parametrize("address", [BAD_ADDRESS_MARK, 0x1000000])
def test_address_that_is_no_24_bit_number_is_a_bad_address(address):
    assert check_values(adsb(address=address))[0] == Reason.BAD_ADDRESS


def test_bad_address_comes_before_a_bad_value_and_that_before_no_position():
    plots = Plots.of(2, time_s=1000.0, address=[BAD_ADDRESS_MARK, -1], altitude_m=np.inf)

    assert check_values(plots).tolist() == [Reason.BAD_ADDRESS, Reason.BAD_VALUE]


@given(st.lists(st.sampled_from(["good", "bad", "nowhere"]), max_size=20))
def test_reports_are_judged_each_by_itself(kinds):
    plots = Plots.of(
        len(kinds),
        time_s=1000.0,
        lat_deg=[np.nan if kind == "nowhere" else 48.0 for kind in kinds],
        lon_deg=[np.nan if kind == "nowhere" else 11.0 for kind in kinds],
        altitude_m=[np.inf if kind == "bad" else np.nan for kind in kinds],
    )

    reasons = check_values(plots)

    expected = {"good": Reason.ACCEPTED, "bad": Reason.BAD_VALUE, "nowhere": Reason.NO_POSITION}
    assert reasons.tolist() == [expected[kind] for kind in kinds]


def test_report_exactly_at_the_limits_of_the_clock_is_accepted():
    plots = adsb(2, time_s=[970.0, 1005.0])

    assert not check_times(plots, 1000.0, max_age_s=30.0, max_future_s=5.0).any()


def test_report_behind_the_limit_is_too_old_and_one_ahead_of_it_is_future():
    plots = adsb(2, time_s=[969.999, 1005.001])

    reasons = check_times(plots, 1000.0, max_age_s=30.0, max_future_s=5.0)

    assert reasons.tolist() == [Reason.TOO_OLD, Reason.FUTURE]


def test_each_report_may_have_a_clock_of_its_own():
    plots = adsb(2, time_s=1000.0)

    reasons = check_times(plots, np.array([1000.0, 1031.0]), max_age_s=30.0, max_future_s=5.0)

    assert reasons.tolist() == [Reason.ACCEPTED, Reason.TOO_OLD]
