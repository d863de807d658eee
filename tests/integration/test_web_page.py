"""The page in a real browser, through a real service on real Zenoh: what it shows, in the numbers that it exposes."""

from __future__ import annotations

import csv
import io
import json
import time
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from tests.integration.browser import FLEET, Page, Traffic, launched, write_picture
from tests.integration.harness import Process, connect, free_endpoint, free_port, wait_until, write_config

from aeroskein_service.keys import Keys
from aeroskein_service.transport import Router

pytestmark = pytest.mark.slow
KEYS = Keys("test/v1")
# The least contrast of a way of colouring with land and sea, by its name.
LEAST_CONTRAST = """import('/static/js/colours.js').then(({ TrafficColours, themeColours, rgb, contrast }) => {
  const theme = themeColours(), colours = new TrafficColours();
  return Object.fromEntries(['source', 'altitude', 'accuracy', 'age'].map((mode) => {
    colours.choose(mode, theme);
    const { items, colours: scale } = colours.legend(), texts = items ? items.map((item) => item.colour) : scale;
    const against = (ground) => texts.map((text) => contrast(rgb(text), rgb(ground)));
    return [mode, Math.min(...against(theme.land), ...against(theme.sea))];
  }));
})"""
DROPPED = ("**/static/js/labels.js", "**/static/map/world.bin", "**/api/search?*")
LOW_CONTRAST = Path(__file__).with_name("low_contrast.js").read_text()


@pytest.fixture(scope="module")
def browser():
    with launched() as opened:
        yield opened


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def site(browser, folder):
    """A router, a service with its page, and traffic; gives the page's address, the traffic and the service."""
    endpoint, http = free_endpoint(), f"127.0.0.1:{free_port()}"
    config = write_config(folder, endpoint, KEYS.prefix)
    layer = folder / "routes.geojson"
    layer.write_text('{"type":"LineString","coordinates":[[8,47],[13,49]]}')
    listening = f'listen = "{http}"\nlayers = ["{layer}"]'
    config.write_text(config.read_text().replace('listen = ""', listening))
    with (
        Router(listen=[endpoint]),
        connect(endpoint) as session,
        Process(folder, "run", "--config", config) as service,
    ):
        service.wait_for_err("service_started")
        traffic = Traffic(session, KEYS)
        try:
            yield f"http://{http}", traffic, service
        finally:
            traffic.close()
        assert service.stop() == 0


@pytest.fixture(scope="module")
def tab(browser, site):
    """The one page that most tests look at, each with an address of its own."""
    shown = Page(browser, site[0])
    yield shown
    shown.close()


@pytest.fixture
def page(tab):
    """Opens the page with what is to stand in its address, and waits until everybody is there."""

    def show(query: str = "") -> Page:
        tab.open(query)
        return settled(tab)

    return show


def settled(shown: Page) -> Page:
    """Wait until everybody is there and no longer tentative."""
    shown.wait(f"__view.count === {len(FLEET)} && __view.tracks.every((t) => __view.track(t).status > 0)")
    return shown


# -- the picture -------------------------------------------------------------------------------------------------------
def test_page_loads_with_no_outside_request_and_an_empty_console(page, site):
    shown = page()
    # Then it is small: the time that it takes is measured by benchmarks/web_load.py
    loaded = shown.get("performance.getEntriesByType('resource').map((r) => r.decodedBodySize)")
    assert 10 < len(loaded) < 80
    assert sum(loaded) < 700_000
    assert all(url.startswith((site[0], "data:", "blob:")) for url in shown.asked)
    assert shown.said == []
    assert shown.get("__view.faults") == []
    assert shown.get("__view.webgl") is True
    assert shown.wait("__view.mapArcs > 0")


def test_hundred_aircraft_move_and_every_frame_is_drawn(page):
    shown = page()
    # One look at a time: the picture moves while the test thinks
    look = f"({{view: {{...__view}}, fleet: {json.dumps(FLEET[::20])}.map((label) => __view.track(label))}})"
    before = shown.get(look)
    shown.wait(f"__view.frame >= {before['view']['frame']} + 4")
    after = shown.get(look)
    # Then every picture that was sent was drawn, and each aircraft has flown north at 200 m/s
    old, new = before["view"], after["view"]
    drawn, skipped = new["drawn"] - old["drawn"], new["skipped"] - old["skipped"]
    assert drawn + skipped == pytest.approx(new["frame"] - old["frame"], abs=1)
    for then, now in zip(before["fleet"], after["fleet"], strict=True):
        flown_m = (now["lat"] - then["lat"]) * 111_320.0
        assert flown_m == pytest.approx(200.0 * (new["time"] - old["time"]), abs=500.0)
        assert now["y"] < then["y"]


def test_picture_is_that_of_the_reports(page, site):
    shown = page()
    track, sent = shown.get(f"__view.track('{FLEET[7]}')"), site[1].report(FLEET[7], time.time())
    assert (track["callsign"], track["code"]) == (sent["callsign"], sent["mode_a"])
    assert track["lon"] == pytest.approx(sent["lon_deg"], abs=1e-4)
    assert track["altitude"] == pytest.approx(sent["altitude_m"], abs=10.0)
    assert track["speed"] == pytest.approx(200.0, abs=3.0)
    assert track["sigma"] < 30.0


def test_no_symbol_is_outside_the_numbers_and_labels_do_not_exceed_what_was_asked(page):
    shown = page("density=10")
    shown.wait("__view.labels === 10")
    assert shown.get("__view.count") == len(FLEET)


def test_aircraft_in_distress_is_labelled_whatever_is_switched_off(page, site):
    shown = page("labels=0&q=nobody")
    shown.wait("__view.labels === 0 && __view.passed === 0")
    site[1].changes[FLEET[3]] = {"mode_a": "7700"}
    try:
        shown.wait("__view.labels === 1 && __view.passed === 1")
        assert shown.get(f"__view.track('{FLEET[3]}').code") == "7700"
    finally:
        del site[1].changes[FLEET[3]]
    shown.wait("__view.labels === 0")


# -- select, search, filter --------------------------------------------------------------------------------------------
def test_click_selects_and_tells_the_details(page):
    shown = page()
    shown.press("0")
    shown.wait("__view.resting")
    at = shown.get(f"__view.track('{FLEET[50]}')")
    box = shown.page.locator("#map-overlay").bounding_box()
    shown.page.mouse.click(box["x"] + at["x"], box["y"] + at["y"])
    chosen = shown.wait("__view.selected.length === 1 && __view.selected[0]")
    point = shown.wait("__view.details && __view.details.point")
    assert point["track"] == chosen
    assert point["sources"] == {"adsb": 1}
    assert shown.get("document.querySelector('#details .title').textContent") == point["callsign"]
    shown.press("Escape")
    assert shown.get("__view.selected") == []


def test_search_finds_by_callsign_address_and_code(page):
    shown = page()
    for text in ("SKN042", "skn042", "40002A", f"{0o1000 + 42:04o}"):
        shown.press("/")
        shown.page.keyboard.type(text)
        # Enter does not wait for what is shown while one types
        shown.press("Enter")
        shown.wait(f"__view.selected[0] === '{FLEET[42]}' && __view.resting")
        assert shown.get("__view.centre.lon") == pytest.approx(8.0 + 0.05 * 42, abs=0.2), text
        shown.get("document.activeElement.blur()")
        shown.press("Escape")
        assert shown.get("__view.selected") == []


def test_search_shows_what_it_has_found_and_arrows_choose(page):
    shown = page()
    shown.press("/")
    shown.page.keyboard.type("SKN04")
    items = shown.page.locator("#search-found li")
    items.nth(9).wait_for()
    assert items.count() == 10
    shown.press("ArrowDown", "ArrowDown", "Enter")
    shown.wait(f"__view.selected[0] === '{FLEET[42]}'")


def test_request_that_the_network_drops_is_made_again(browser, site):
    # Given a network that drops the first request for a module, for the map and for a search
    dropped: set[str] = set()

    def drop_first(route):
        path = urlsplit(route.request.url).path
        if path in dropped:
            route.continue_()
        else:
            dropped.add(path)
            route.abort()

    shown = Page(browser, site[0], before=lambda page: [page.route(url, drop_first) for url in DROPPED])
    # Then the page is there all the same, and finds
    settled(shown)
    shown.wait("__view.mapArcs > 0")
    shown.press("/")
    shown.page.keyboard.type("SKN042")
    shown.press("Enter")
    shown.wait(f"__view.selected[0] === '{FLEET[42]}'")
    assert len(dropped) == len(DROPPED)
    shown.close()


def test_filters_dim_and_never_hide(page):
    shown = page()
    shown.press("f")
    shown.page.get_by_label("Lowest flight level").fill("200")
    shown.page.get_by_label("Highest flight level").fill("250")
    passing = sum(200 * 30.48 <= 3000.0 + 80.0 * k <= 250 * 30.48 for k in range(len(FLEET)))
    shown.wait(f"Math.abs(__view.passed - {passing}) <= 1")
    assert shown.get("__view.count") == len(FLEET)
    shown.page.get_by_text("Clear all filters").click()
    shown.wait(f"__view.passed === {len(FLEET)}")


@pytest.mark.parametrize(
    ("query", "passing"),
    [
        ("bbox=40,8.98,60,9.27", 6),
        ("sensor=adsb", 100),
        ("sensor=radar1", 0),
        ("status=tentative", 0),
        ("q=SKN00", 10),
        ("emergency=1", 0),
        (f"sel={FLEET[5]}&isolate=1", 1),
    ],
)
def test_filter_in_the_address_filters(page, query, passing):
    shown = page(query)
    shown.wait(f"__view.passed === {passing}")


# -- table -------------------------------------------------------------------------------------------------------------
def test_table_sorts_filters_and_exports(page):
    shown = page("table=1&sort=level&down=1&inview=0&q=SKN0")
    labels = shown.wait("__view.table.rows === 100 && __view.table.labels")
    assert labels == list(reversed(FLEET))
    with shown.page.expect_download() as download:
        shown.page.get_by_role("button", name="CSV").click()
    rows = list(csv.DictReader(io.StringIO(Path(download.value.path()).read_text())))
    assert [row["track"] for row in rows] == labels
    assert float(rows[0]["ground_speed_mps"]) == pytest.approx(200.0, abs=3.0)
    shown.page.get_by_role("button", name="Callsign").click()
    shown.wait(f"__view.table.labels[0] === '{FLEET[0]}'")


def test_address_bar_holds_the_view_and_gives_it_back(page):
    shown = page()
    shown.press("v", "c", "g", "t", "x")
    shown.get("document.activeElement.blur()")
    # Somebody is in view, who can be stepped to
    shown.wait("__view.labels > 0 && __view.resting && location.search.includes('zoom=')")
    shown.press("n")
    shown.wait("location.search.includes('sel=')")
    query = shown.get("location.search.slice(1)")
    given = parse_qs(query)
    assert (given["vector"], given["color"], given["grid"], given["table"]) == (["120"], ["altitude"], ["1"], ["1"])
    selected, centre = shown.get("[__view.selected, __view.centre]")
    # When a colleague opens the same
    other = page(query)
    other.wait("__view.resting && __view.table.rows > 0")
    assert other.get("__view.selected") == selected
    assert other.get("__view.centre") == pytest.approx(centre, abs=0.01)
    assert parse_qs(other.get("__view.query")) == given


# -- elements and sensors ----------------------------------------------------------------------------------------------
def test_element_view_shows_elements_with_their_reports_and_points(page):
    shown = page(f"sel={FLEET[10]}&view=elements")
    steps = "document.querySelectorAll('#elements .story li').length"
    numbers = shown.wait(f"__view.elements && __view.elements.known >= 5 && {{...__view.elements, steps: {steps}}}")
    drawn = numbers["drawn"]
    assert numbers["track"] == FLEET[10]
    assert numbers["masters"] == ["adsb"]
    assert drawn["divisions"] == drawn["elements"] + 1 == drawn["points"] + 1
    assert drawn["boundaries"] == 2 * drawn["elements"]
    assert drawn["ellipses"] == drawn["points"] + 1
    # Every step of the story has its number in the drawing, except what is not there: nothing was refused
    assert drawn["badges"] == numbers["steps"] - 1
    assert (drawn["live"], drawn["rejected"]) == (1, 0)
    assert drawn["accepted"] == pytest.approx(2 * drawn["elements"], abs=2)
    assert 0.0 < numbers["sigma"] < 30.0
    assert numbers["residuals"]["adsb"] < 30.0
    assert numbers["charts"]["across"] == numbers["accepted"]
    # The same on the map where it is near enough, and by keyboard
    shown.press("o")
    shown.get("document.querySelector('#elements canvas').focus()")
    shown.press("ArrowLeft")
    chosen = shown.get("__view.elements.chosen")
    shown.press("ArrowLeft")
    assert shown.get("__view.elements.chosen") == chosen - 1
    assert f"element {chosen - 1}:" in shown.get("__view.elements.said")


def test_refused_report_is_shown_with_its_reason(page, site):
    # Given an aircraft one of whose reports lies two kilometres beside its track
    traffic, address = site[1], FLEET[20]
    shown = page(f"sel={address}&view=elements")
    shown.wait("__view.elements && __view.elements.known >= 3")
    true, sent = traffic.report(address, time.time()), traffic.batches
    traffic.changes[address] = {"lon_deg": true["lon_deg"] + 0.03}
    wait_until(lambda: traffic.batches > sent, "a report beside the track")
    del traffic.changes[address]
    # Then it is among the refused ones
    reasons = shown.wait("__view.elements.rejected > 0 && __view.elements.reasons")
    assert set(reasons) <= {"outlier", "outside_boundary"}


def test_sensors_panel_tells_rates_and_silence(page):
    shown = page("panel=sensors")
    shown.wait("__view.words?.rates?.sensors.adsb.accepted_per_s > 50")
    text = shown.page.locator("#side").inner_text()
    assert "reporting" in text
    assert "none yet" in text  # the radar has not sent anything
    assert "Time of each stage" in text


def test_silent_sensor_brings_an_amber_banner(page):
    # Given a radar that is configured and sends nothing
    shown = page()
    banner = shown.wait("__view.banner.kind === 'warning' && __view.banner")
    assert "no report from radar1" in banner["text"]


# -- appearance --------------------------------------------------------------------------------------------------------
def test_theme_follows_the_system_and_the_user(page):
    shown = page()
    for theme, other in (("dark", "light"), ("light", "dark")):
        shown.page.emulate_media(color_scheme=theme)
        shown.wait(f"document.documentElement.dataset.theme === '{theme}'")
        shown.press("x")
        assert shown.get("document.documentElement.dataset.theme") == other
        shown = page()


def test_layers_of_the_operator_are_on_the_map(page):
    shown = page()
    shown.wait("__view.layers.includes('routes')")


def test_everything_can_be_reached_by_keyboard(page):
    shown = page()
    for key, opened in (("s", "sensors"), ("f", "filters"), ("d", "display"), ("?", "help")):
        shown.press(key)
        assert shown.get("new URLSearchParams(__view.query).get('panel')") == opened
        assert shown.get("document.querySelector('#side').hidden") is False
    shown.press("Escape", "t")
    shown.wait("__view.table.rows > 0")
    # Tab reaches the rows of the table, and Enter selects one
    shown.get("document.querySelector('#table tbody tr').focus()")
    shown.press("ArrowDown", "Enter")
    label = shown.wait("__view.selected.length === 1 && __view.selected[0]")
    assert label in FLEET
    # The map moves and zooms
    shown.get("document.querySelector('#map-overlay').focus()")
    before = shown.get("__view.centre")
    shown.press("ArrowUp", "ArrowRight", "+")
    after = shown.get("__view.centre")
    assert after["lat"] > before["lat"]
    assert after["lon"] > before["lon"]
    assert after["zoom"] == pytest.approx(before["zoom"] + 0.5)
    # Tab goes through every control in order
    seen = set()
    for _ in range(12):
        shown.press("Tab")
        seen.add(shown.get("document.activeElement.id || document.activeElement.textContent"))
    assert len(seen) > 6


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_symbols_stand_out_from_the_map_in_every_colour(page, theme):
    shown = page(f"theme={theme}")
    least = shown.get(LEAST_CONTRAST)
    assert set(least) == {"source", "altitude", "accuracy", "age"}
    assert min(least.values()) >= 3.0, least


def test_text_of_every_panel_has_contrast_in_both_themes(page):
    for theme in ("dark", "light"):
        shown = page(f"theme={theme}&panel=sensors&table=1&sel={FLEET[0]}")
        shown.wait("__view.table.rows > 0 && __view.details")
        low = shown.get(LOW_CONTRAST)
        assert low == [], theme
        write_picture(shown, f"panels-{theme}")
