"""Both themes can be read: every text on every surface it stands on, by the formula of WCAG 2.2."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

CSS = (Path(__file__).parents[2] / "service/aeroskein_service/web/static/css/theme.css").read_text(encoding="utf-8")
TEXT, LINES = 4.5, 3.0  # WCAG AA: text; parts of controls and graphics
SURFACES = ("bg", "surface", "raised")


def theme(name: str) -> dict[str, str]:
    block = re.search(rf"data-theme=\"{name}\"\] \{{(.*?)\n\}}", CSS, re.DOTALL)
    assert block
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", block[1]))


def luminance(colour: str) -> float:
    channels = [int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_formula_gives_the_known_extremes():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#777777") == 1.0


@pytest.fixture(params=["dark", "light"])
def colours(request) -> dict[str, str]:
    return theme(request.param)


def test_both_themes_define_the_same_colours():
    assert set(theme("dark")) == set(theme("light"))


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("text", ["text", "dim", "link", "good", "warn", "bad"])
def test_text_on_surfaces(colours, text, surface):
    assert contrast(colours[text], colours[surface]) >= TEXT


@pytest.mark.parametrize(
    ("text", "surface"), [("on-accent", "accent"), ("on-banner", "banner-bad"), ("on-banner", "banner-warn")]
)
def test_text_on_buttons_and_banners(colours, text, surface):
    assert contrast(colours[text], colours[surface]) >= TEXT


@pytest.mark.parametrize("surface", SURFACES)
def test_edges_of_controls(colours, surface):
    assert contrast(colours["control"], colours[surface]) >= LINES


@pytest.mark.parametrize("ground", ["map-sea", "map-land"])
@pytest.mark.parametrize("text", ["map-text", "map-selected", "map-emergency", "map-faint", "map-site"])
def test_text_on_the_map(colours, text, ground):
    assert contrast(colours[text], colours[ground]) >= TEXT


@pytest.mark.parametrize("ground", ["map-sea", "map-land"])
@pytest.mark.parametrize(
    "symbol", ["map-fused", "map-adsb", "map-radar", "map-coasted", "map-suspect", "map-unknown", "map-layer"]
)
def test_symbols_on_the_map(colours, symbol, ground):
    assert contrast(colours[symbol], colours[ground]) >= LINES


@pytest.mark.parametrize("line", ["map-axis", "map-division", "map-boundary", "map-rejected", "map-ellipse"])
def test_lines_of_the_element_view(colours, line):
    assert contrast(colours[line], colours["surface"]) >= LINES
