"""What the engine answers: tracks, buffered reports, and the elements of one track with everything in them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from tests.builders import ADSB, RADAR1, START_S, Drive, Flight, adsb, distance_m, engine_settings, radar

from aeroskein.plots import Plots
from aeroskein.points import FusedPoints, Product, Status
from aeroskein.selection import Selection

EAST = Flight(lat_deg=48.0, lon_deg=11.0, track_deg=90.0, address=0x3C6444)
NORTH = Flight(lat_deg=47.5, lon_deg=12.0, track_deg=0.0, speed_mps=120.0, height_m=3000.0, address=0x4CA2D6)


def seconds(start: float, end: float, step: float = 1.0) -> np.ndarray:
    return np.arange(start, end, step)


@cache
def flown() -> Drive:
    """Two flights for 100 s, the first seen by the radar too; one of its positions is wrong."""
    east = adsb(EAST, seconds(0.5, 100.0), sigma_m=5.0)
    east.lat_deg[70] += 0.02
    plots = [east, radar(EAST, seconds(1.2, 100.0, 4.0), range_sigma_m=50.0), adsb(NORTH, seconds(0.7, 100.0))]
    return Drive.of().feed(plots, until_s=100.0)


# -- tracks -----------------------------------------------------------------------------------------------------------
def test_tracks_are_the_latest_live_states() -> None:
    drive = flown()

    tracks = drive.engine.tracks(Selection())

    assert tracks.product is Product.LIVE
    assert sorted(tracks.address.tolist()) == [EAST.address, NORTH.address]
    for row in range(2):
        last = drive.live.take(np.flatnonzero(drive.live.track_number == tracks.track_number[row]))
        assert tracks.time_s[row] == last.time_s[-1]
        assert tracks.lat_deg[row] == pytest.approx(last.lat_deg[-1], abs=1e-12)
        assert tracks.seq[row] == last.seq[-1]


def test_asking_changes_nothing() -> None:
    drive = Drive.of().feed(adsb(EAST, seconds(0.5, 10.0)))

    first = drive.engine.tracks(Selection())
    second = drive.engine.tracks(Selection())
    drive.feed(adsb(EAST, [10.5]))

    assert np.array_equal(first.seq, second.seq)
    assert drive.live.seq.tolist() == list(range(11))


@pytest.mark.parametrize(
    ("selection", "found"),
    [
        (Selection(addresses=frozenset({0x3C6444})), {0x3C6444}),
        (Selection(addresses=frozenset({1})), set()),
        (Selection(callsign="TEST1"), {0x3C6444, 0x4CA2D6}),
        (Selection(sensors=frozenset({1})), {0x3C6444}),
        (Selection(sensors=frozenset({0, 1})), {0x3C6444, 0x4CA2D6}),
        (Selection(speed_mps=(100.0, 150.0)), {0x4CA2D6}),
        (Selection(altitude_m=(8000.0, 12_000.0)), {0x3C6444}),
        (Selection(bbox=(47.9, 10.0, 48.1, 13.0)), {0x3C6444}),
        (Selection(bbox=(47.9, 13.0, 48.1, 10.0)), set()),
        (Selection(time_s=(START_S, START_S + 50.0)), set()),
        (Selection(time_s=(START_S + 99.0, START_S + 100.0), speed_mps=(150.0, 250.0)), {0x3C6444}),
    ],
)
def test_tracks_are_selected_by_dimension(selection: Selection, found: set[int]) -> None:
    assert set(flown().engine.tracks(selection).address.tolist()) == found


def test_ended_tracks_stay_visible_for_a_minute() -> None:
    drive = Drive.of().feed(adsb(EAST, seconds(0.5, 10.0)), until_s=40.0)
    assert drive.engine.tracks(Selection()).status.tolist() == [Status.TERMINATED]

    drive.feed(Plots.of(0), until_s=99.0)
    assert len(drive.engine.tracks(Selection())) == 1
    drive.feed(Plots.of(0), until_s=101.0)

    assert len(drive.engine.tracks(Selection())) == 0


# -- reports ----------------------------------------------------------------------------------------------------------
def test_reports_of_the_last_thirty_seconds_are_there() -> None:
    reports = flown().engine.reports(Selection())

    ages = START_S + 100.0 - reports.time_s
    assert ages.min() < 1.0
    assert 30.0 <= ages.max() < 31.0
    assert (reports.sensor == 0).sum() in (60, 61, 62)
    assert (reports.sensor == 1).sum() in (7, 8)


def test_reports_are_given_as_they_came() -> None:
    raw = radar(EAST, seconds(1.2, 100.0, 4.0), range_sigma_m=50.0)

    reports = flown().engine.reports(Selection(sensors=frozenset({1})))

    assert np.isin(reports.time_s, raw.time_s).all()
    assert np.isnan(reports.lat_deg).all()
    assert np.isfinite(reports.range_m).all()


def test_radar_reports_are_selected_by_where_they_are() -> None:
    here = Selection(sensors=frozenset({1}), bbox=(47.9, 11.0, 48.1, 12.0))
    elsewhere = Selection(sensors=frozenset({1}), bbox=(47.4, 11.0, 47.6, 12.0))

    assert len(flown().engine.reports(here)) >= 7
    assert len(flown().engine.reports(elsewhere)) == 0


def test_refused_reports_can_be_asked_for_too() -> None:
    drive = Drive.of().feed(adsb(EAST, seconds(0.5, 10.0)))
    jump = adsb(Flight(lat_deg=20.0, address=EAST.address), [10.2])

    drive.feed(jump)

    assert len(drive.engine.reports(Selection(bbox=(19.0, 11.0, 21.0, 12.0)))) == 1


# -- elements ---------------------------------------------------------------------------------------------------------
def test_the_last_twenty_elements_are_kept() -> None:
    drive = flown()

    records = drive.engine.elements("3C6444")

    assert records is not None
    points = drive.elements.take(np.flatnonzero(drive.elements.address == EAST.address))
    assert [r.content["element"] for r in records] == points.element[-20:].tolist()
    assert [r.content["seq"] for r in records] == points.seq[-20:].tolist()
    assert [r.content["span_s"] for r in records] == points.span_s[-20:].tolist()


def test_a_track_that_does_not_exist_has_no_elements() -> None:
    assert flown().engine.elements("000001") is None
    assert flown().engine.elements("nonsense") is None
    assert Drive.of().feed(adsb(EAST, [0.5])).engine.elements("3C6444") == []


def content(element: int) -> dict:
    records = flown().engine.elements("3C6444")
    assert records is not None
    return next(r.content for r in records if r.content["element"] == element)


def test_the_axis_runs_along_the_flight_from_division_point_to_division_point() -> None:
    c = content(15)

    lat, lon = np.array(c["axis"]).T
    true_lat, true_lon, _ = EAST.at(np.array(c["axis_time_s"]) - START_S)
    assert c["axis_time_s"] == pytest.approx(np.linspace(*c["span_s"], 5).tolist())
    assert distance_m(lat, lon, true_lat, true_lon).max() < 15.0
    assert c["division_points"] == [c["axis"][0], c["axis"][-1]]


def test_division_points_of_neighbours_meet() -> None:
    for element in range(10, 15):
        end, start = content(element)["division_points"][1], content(element + 1)["division_points"][0]
        assert content(element)["span_s"][1] == content(element + 1)["span_s"][0]
        assert distance_m(*end, *start)[0] < 10.0


def test_boundary_lines_lie_half_a_width_beside_the_axis() -> None:
    c = content(15)

    assert 150.0 <= c["half_width_m"] <= 3000.0
    for line, side in zip(c["boundary_lines"], (1.0, -1.0), strict=True):
        off = distance_m(*np.array(line).T, *np.array(c["axis"]).T)
        assert off == pytest.approx(c["half_width_m"], rel=2e-3)
        # The first line lies to the left of an eastbound flight: north of it.
        assert ((np.array(line)[:, 0] - np.array(c["axis"])[:, 0]) * side > 0.0).all()


def test_reports_of_an_element_are_told_with_their_verdicts() -> None:
    c = content(17)  # 68.5 to 72.5 s

    times = [r["time_s"] - START_S for r in c["reports"]]
    assert c["span_s"] == [START_S + 68.5, START_S + 72.5]
    assert sorted(times) == pytest.approx([68.5, 69.2, 69.5, 70.5, 71.5], abs=1e-3)
    wrong = [r for r in c["reports"] if not r["accepted"]]
    assert [(r["sensor"], r["reason"]) for r in wrong] == [("adsb", "outside_boundary")]
    assert wrong[0]["time_s"] - START_S == pytest.approx(70.5, abs=1e-3)
    assert {r["sensor"] for r in c["reports"]} == {"adsb", "radar1"}
    for r in c["reports"]:
        assert r["accepted"] == (r["reason"] is None)


def test_places_of_reports_are_where_they_were_reported() -> None:
    reports = [r for r in content(12)["reports"] if r["sensor"] == "adsb"]

    sent = adsb(EAST, seconds(0.5, 100.0), sigma_m=5.0)
    for r in reports:
        row = np.abs(sent.time_s - r["time_s"]).argmin()
        assert distance_m(r["lat_deg"], r["lon_deg"], sent.lat_deg[row], sent.lon_deg[row])[0] < 0.02


def test_each_element_shows_its_fused_point() -> None:
    drive = flown()
    points = drive.elements.take(np.flatnonzero(drive.elements.address == EAST.address))
    p, c = points.take(np.array([17])), content(17)["point"]

    assert (c["time_s"], c["lat_deg"], c["lon_deg"]) == (p.time_s[0], p.lat_deg[0], p.lon_deg[0])
    assert c["ground_speed_mps"] == pytest.approx(p.ground_speed_mps[0], rel=1e-6)
    assert c["sources"] == {"adsb": 3, "radar1": 1}
    assert c["rejected"] == p.rejected[0] == 1
    assert (c["master"], c["status"]) == ("adsb", "confirmed")


def test_elements_of_other_tracks_do_not_mix_in() -> None:
    records = flown().engine.elements("4CA2D6")

    assert records is not None
    assert all(r["sensor"] == "adsb" for record in records for r in record.content["reports"])
    assert all(47.0 < lat < 47.8 for record in records for lat, _ in record.content["axis"])


# -- heights ----------------------------------------------------------------------------------------------------------
def element_points(*plots: Plots, settings: tuple = (ADSB, RADAR1)) -> FusedPoints:
    return Drive.of(engine_settings(*settings)).feed(plots).finish().elements


def test_altitude_and_height_are_both_given_where_both_are_reported() -> None:
    e = element_points(adsb(EAST, seconds(0.5, 30.0)))

    assert np.abs(e.altitude_m - 8950.0).max() < 1.0
    assert np.abs(e.height_m - 9000.0).max() < 1.0
    assert np.abs(e.vertical_rate_mps).max() < 0.5


def test_height_is_unknown_where_nobody_gives_it() -> None:
    e = element_points(adsb(EAST, seconds(0.5, 30.0), height_m=np.nan), radar(EAST, seconds(1.2, 30.0, 4.0)))

    assert np.abs(e.altitude_m - 8950.0).max() < 1.0
    assert np.isnan(e.height_m).all()


def test_altitude_is_unknown_where_nobody_gives_it() -> None:
    e = element_points(adsb(EAST, seconds(0.5, 30.0), altitude_m=np.nan))

    assert np.isnan(e.altitude_m).all()
    assert np.abs(e.height_m - 9000.0).max() < 1.0


def test_a_flight_without_any_altitude_is_fused_without() -> None:
    e = element_points(adsb(EAST, seconds(0.5, 30.0), altitude_m=np.nan, height_m=np.nan, vertical_rate_mps=np.nan))

    assert np.isnan(e.altitude_m).all()
    assert np.isnan(e.height_m).all()
    assert np.isfinite(e.lat_deg).all()


def test_a_climb_is_followed_at_the_centres() -> None:
    t = seconds(0.5, 40.0)
    e = element_points(adsb(EAST, t, altitude_m=3000.0 + 12.0 * t, height_m=3060.0 + 12.0 * t, vertical_rate_mps=12.0))

    wanted = 3000.0 + 12.0 * (e.time_s - START_S)
    assert np.abs(e.altitude_m - wanted).max() < 2.0
    assert np.abs(e.vertical_rate_mps - 12.0).max() < 0.5
    assert np.abs(e.height_m - e.altitude_m - 60.0).max() < 1.0


def test_radar_plots_use_the_height_learned_from_own_positions() -> None:
    # Overhead: at 12 km a height wrong by 300 m moves a plot by hundreds of metres.
    near = Flight(lat_deg=48.35, lon_deg=11.94, track_deg=90.0, height_m=10_000.0, speed_mps=100.0)
    t = seconds(0.5, 60.0)
    own = adsb(near, t, altitude_m=9700.0)
    plots = radar(near, seconds(1.2, 60.0, 4.0), altitude_m=9700.0)

    drive = Drive.of().feed([own, plots]).finish()

    e = drive.elements
    late = e.span_s[:, 0] > START_S + 30.0
    lat, lon, _ = near.at(e.time_s[late] - START_S)
    assert distance_m(e.lat_deg[late], e.lon_deg[late], lat, lon).max() < 2.0
    assert e.sources[late, 1].sum() >= 6
    assert not e.rejected[late].any()
