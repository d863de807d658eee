"""The series of division points decides where the elements of a track begin and end while it flies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.builders import ADSB, engine_settings

from aeroskein.closing import ElementTable
from aeroskein.settings import PatentSettings

FIRST_S = 1000.0


def boundaries_s(series: str, mode: str, lookahead: int = 1) -> list[float]:
    """Division points of a track at its start, after its first report."""
    settings = engine_settings(ADSB, mode=mode, element_s=4.0, lookahead=lookahead)
    table = ElementTable(replace(settings, patent=PatentSettings(series=series)), 1)
    table.start(np.array([0]), np.array([FIRST_S]), np.array([-np.inf]), np.zeros((6, 1)), np.ones((24, 1)))
    return [float(t) for t in table.boundaries_s[0] - FIRST_S]


@pytest.mark.parametrize("series", ["natural", "even"])
def test_natural_and_even_series_begin_with_a_full_element(series: str) -> None:
    assert boundaries_s(series, "patent") == [0.0, 4.0, 8.0]


def test_odd_series_begins_with_half_an_element() -> None:
    assert boundaries_s("odd", "patent") == [0.0, 2.0, 6.0]


def test_odd_series_has_full_elements_behind_the_first_half() -> None:
    assert boundaries_s("odd", "patent", lookahead=3) == [0.0, 2.0, 6.0, 10.0, 14.0]


@pytest.mark.parametrize("mode", ["information", "weighted"])
def test_other_modes_know_no_series(mode: str) -> None:
    assert boundaries_s("odd", mode) == [0.0, 4.0, 8.0]


@pytest.mark.parametrize("lookahead", range(6))
def test_division_points_lie_an_element_apart_to_the_last_bit(lookahead: int) -> None:
    assert boundaries_s("natural", "patent", lookahead) == [4.0 * m for m in range(lookahead + 2)]
