"""The page over files: a report file with all its elements, and a fused file as it is."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.integration.browser import Page, launched
from tests.integration.harness import Process, free_port

pytestmark = pytest.mark.slow

CONFIGURATION = """
[[sensors]]
id = "adsb"
kind = "adsb"
[[sensors]]
id = "radar1"
kind = "ssr"
lat_deg = 48.35
lon_deg = 11.78
height_m = 460.0
[simulation]
aircraft = 12
"""
SECONDS = 60


@pytest.fixture(scope="module")
def browser():
    with launched() as opened:
        yield opened


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A configuration, a minute of reports of twelve aircraft, and the same fused."""
    made = tmp_path_factory.mktemp("replay")
    config, reports = made / "config.toml", made / "reports.jsonl.gz"
    config.write_text(CONFIGURATION)
    simulate = ["simulate", "--config", config, "--output", reports, "--duration", str(SECONDS)]
    for command in (simulate, ["fuse", "--config", config, reports, "--output", made / "fused.jsonl"]):
        with Process(made, *command) as process:
            assert process.wait() == 0, process.err
    return made


@pytest.fixture(scope="module")
def replayed(folder):
    """The page over the report file."""
    http = f"127.0.0.1:{free_port()}"
    with Process(
        folder, "web", "--config", folder / "config.toml", "--listen", http, folder / "reports.jsonl.gz"
    ) as web:
        web.wait_for_err("the page is at")
        yield f"http://{http}"
        assert web.stop() == 0


def test_replay_plays_pauses_jumps_and_has_its_speed(browser, replayed):
    shown = Page(browser, replayed)
    replay = shown.wait("__view.replay && __view.replay.playing && __view.count > 0 && __view.replay")
    assert replay["end"] - replay["begin"] == pytest.approx(SECONDS, abs=5.0)
    # When it stands, nothing moves
    shown.press(" ")
    shown.wait("!__view.replay.playing")
    time_s, frame = shown.get("[__view.replay.time, __view.frame]")
    shown.wait(f"__view.frame > {frame} + 1")
    assert shown.get("__view.replay.time") == pytest.approx(time_s, abs=0.3)
    # When it jumps, it is there
    shown.press(".", ".")
    shown.wait(f"__view.replay.time > {time_s} + 9")
    shown.page.locator("#replay input[type=range]").fill("500")
    middle = (replay["begin"] + replay["end"]) / 2
    shown.wait(f"Math.abs(__view.replay.time - {middle}) < 1")
    # When it runs ten times as fast, ten seconds pass in one
    shown.page.get_by_label("Speed of the replay").select_option("10")
    shown.press(" ")
    shown.get("document.activeElement.blur()")
    shown.press(" ")
    began = shown.wait(
        "__view.replay.playing && __view.replay.speed === 10 && {t: __view.replay.time, at: performance.now()}"
    )
    # A look later than the picture is by some tenths of a second: twenty seconds make little of that
    passed = shown.wait(
        f"__view.replay.time > {began['t']} + 20 && "
        f"(__view.replay.time - {began['t']}) / ((performance.now() - {began['at']}) / 1000)"
    )
    assert 5.0 < passed < 15.0
    assert shown.said == []
    shown.close()


def test_replay_opens_where_the_address_says_with_its_elements(browser, replayed):
    first = Page(browser, replayed, "paused=1")
    begin = first.get("__view.replay.begin")
    first.close()
    shown = Page(browser, replayed, f"paused=1&t={begin + 45:.1f}&view=map")
    shown.wait(f"Math.abs(__view.replay.time - {begin + 45}) < 0.2 && !__view.replay.playing")
    label = shown.wait("__view.tracks.find((t) => __view.track(t).status === 1)")
    shown.close()
    shown = Page(browser, replayed, f"paused=1&t={begin + 45:.1f}&sel={label}&view=elements")
    numbers = shown.wait(
        "__view.elements && __view.elements.known >= 5 && __view.elements.drawn.points >= 5 && __view.elements"
    )
    assert numbers["accepted"] > 10
    # When it jumps back, what is ahead is not known any more
    shown.press(",", ",")
    shown.wait(f"__view.elements.known < {numbers['known']}")
    shown.close()


def test_fused_file_needs_no_configuration(browser, folder):
    http = f"127.0.0.1:{free_port()}"
    with Process(folder, "web", "--listen", http, folder / "fused.jsonl") as web:
        web.wait_for_err("the page is at")
        shown = Page(browser, f"http://{http}", "paused=1")
        begin, end = shown.get("[__view.replay.begin, __view.replay.end]")
        assert end - begin == pytest.approx(SECONDS, abs=10.0)
        # When it jumps to the middle, aircraft are there, with the elements that the file holds
        shown.open(f"paused=1&t={begin + 40:.1f}")
        label = shown.wait("__view.count > 5 && __view.tracks.find((t) => __view.track(t).status === 1)")
        shown.open(f"paused=1&t={begin + 40:.1f}&sel={label}&view=elements")
        shown.wait("__view.elements && __view.elements.drawn.points >= 3")
        assert shown.said == []
        shown.close()
        assert web.stop() == 0
