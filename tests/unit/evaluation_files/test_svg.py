"""Scales, ticks and figures as people read them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aeroskein_service.evaluation.formats import number, percent
from aeroskein_service.evaluation.svg import Plot, Scale, same_scale, tick_text, ticks_of


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_ticks_are_few_inside_and_evenly_spaced(low, width):
    ticks = ticks_of(low, low + width)

    assert 2 <= len(ticks) <= 8
    assert low - 1e-6 * width <= ticks[0]
    assert ticks[-1] <= low + width * (1.0 + 1e-6)
    assert np.diff(ticks) == pytest.approx(np.full(len(ticks) - 1, ticks[1] - ticks[0]))


def test_ticks_of_a_logarithmic_axis_are_ones_twos_and_fives():
    assert ticks_of(1.0, 100.0, is_log=True) == pytest.approx([1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0])


def test_a_scale_of_no_width_is_no_error():
    assert np.isfinite(Scale(3.0, 3.0, 0.0, 100.0)(3.0))
    assert ticks_of(3.0, 3.0) == [3.0]


def test_a_scale_may_run_downwards():
    assert Scale(5.0, 0.0, 300.0, 10.0)(np.array([5.0, 0.0])).tolist() == [300.0, 10.0]


def test_a_logarithmic_scale_puts_decades_at_equal_distances():
    assert Scale(1.0, 100.0, 0.0, 200.0, is_log=True)(np.array([1.0, 10.0, 100.0])).tolist() == [0.0, 100.0, 200.0]


def test_a_line_breaks_where_a_value_is_missing():
    plot = Plot((0.0, 3.0), (0.0, 1.0), x_label="x", y_label="y", title="t")

    svg = plot.line(np.arange(4.0), np.array([0.0, 1.0, np.nan, 1.0]), "c0").svg()

    path = svg.split('class="line c0" d="')[1].split('"')[0]
    assert (path.count("M"), path.count("L")) == (2, 1)


def test_same_scale_has_as_many_metres_to_a_pixel_both_ways():
    x, y = same_scale(np.array([[0.0, 0.0], [100.0, 10.0]]), (400.0, 300.0))

    plot = Plot(x, y, x_label="", y_label="", title="", size=(400.0, 300.0))
    across = float(plot.x(10.0) - plot.x(0.0))
    up = float(plot.y(0.0) - plot.y(10.0))
    assert across == pytest.approx(up)
    assert x[0] <= 0.0
    assert x[1] >= 100.0


NUMBERS = {
    None: "·",
    0.0: "0",
    0.00004: "0",
    0.0123: "0.012",
    1.234: "1.23",
    12.34: "12.3",
    1234.5: "1234",
    -7: "-7.00",
}
SHARES = {None: "·", 0.0: "0 %", 1.0: "100 %", 0.97123: "97.1 %", 0.99996: "99.996 %", 0.0002: "0.02 %"}
LABELS = {0.0: "0", 0.5: "0.5", 20.0: "20", 1e-5: "1e-05", 0.1 + 0.2: "0.3"}


@pytest.mark.parametrize(("value", "text"), NUMBERS.items())
def test_numbers_have_three_digits(value, text):
    assert number(value) == text


@pytest.mark.parametrize(("share", "text"), SHARES.items())
def test_a_share_is_not_rounded_to_all_or_nothing(share, text):
    assert percent(share) == text


@pytest.mark.parametrize(("value", "text"), LABELS.items())
def test_tick_labels_have_no_needless_digits(value, text):
    assert tick_text(value) == text
