"""The life of a track: begins, is confirmed, coasts, ends, comes back; and the engine's own, across a restart."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.builders import (
    ADSB,
    RADAR1,
    START_S,
    Drive,
    Flight,
    adsb,
    by_track,
    distance_m,
    engine_settings,
    radar,
)  # fmt: skip

from aeroskein.engine import FusionEngine
from aeroskein.errors import SnapshotError, UnknownSensorError
from aeroskein.plots import Plots
from aeroskein.points import Flag, FusedPoints, Product, Status
from aeroskein.reasons import Reason
from aeroskein.selection import Selection
from aeroskein.settings import EngineSettings, RegistrationSettings, TrackSettings

FLIGHT = Flight()


def seconds(start: float, end: float, step: float = 1.0) -> np.ndarray:
    return np.arange(start, end, step)


def statuses(drive: Drive) -> list[tuple[float, str]]:
    """When the (only) track's status changed, and to what."""
    return [(round(float(c.time_s[0]) - START_S, 2), Status(int(c.status[0])).name.lower()) for c in drive.changes]


def flagged(points: FusedPoints, flag: Flag) -> list[bool]:
    return ((points.flags & flag) != 0).tolist()


# -- beginning --------------------------------------------------------------------------------------------------------
def test_a_track_is_tentative_until_its_third_report() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 6.0)))

    assert statuses(drive) == [(0.5, "tentative"), (2.5, "confirmed")]
    assert drive.live.status[:3].tolist() == [Status.TENTATIVE, Status.TENTATIVE, Status.CONFIRMED]


def test_elements_reach_back_to_the_first_report() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 20.0)))

    e = drive.elements
    assert e.span_s[0, 0] == START_S + 0.5
    assert e.sources[0, 0] == 4


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_a_short_flight_has_elements_if_it_was_confirmed(count: int) -> None:
    drive = Drive.of().feed(adsb(FLIGHT, 0.5 + seconds(0, count)), until_s=60.0)

    elements = [e for e in drive.events if isinstance(e, FusedPoints) and e.product.name == "ELEMENT"]
    assert bool(elements) == (count >= 3)
    if elements:
        assert drive.elements.sources.sum() == count


def test_the_input_may_end_before_an_element_does() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 4.0))).finish()

    e = drive.elements
    assert e.span_s[0, 0] == START_S + 0.5
    assert e.span_s[-1, 1] > START_S + 3.5
    assert e.sources.sum() == 4


def test_a_track_that_begins_with_an_outlier_does_not_carry_it_along() -> None:
    plots = adsb(FLIGHT, seconds(0.5, 30.0), sigma_m=5.0)
    plots.lat_deg[0] += 0.02

    drive = Drive.of().feed(plots).finish()

    e = drive.elements
    truth = FLIGHT.at(e.time_s - START_S)
    assert np.abs(e.lat_deg - truth[0]).max() < 5e-4
    assert e.span_s[0, 0] == START_S + 1.5


# -- coasting and the end ---------------------------------------------------------------------------------------------
def test_a_silent_track_coasts_once_a_second_and_then_ends() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 10.0)), until_s=45.0)

    assert statuses(drive) == [(0.5, "tentative"), (2.5, "confirmed"), (12.75, "coasting"), (39.75, "terminated")]
    live = drive.live
    coasted = live.take(np.flatnonzero(live.status == Status.COASTING))
    assert all(flagged(coasted, Flag.COASTED))
    # Last heard at 9.5 s: from 12.75 s on a prediction every second.
    assert (coasted.time_s - START_S).tolist() == (12.75 + seconds(0, 28)).tolist()
    assert live.status[-1] == Status.TERMINATED
    assert (live.status == Status.TERMINATED).sum() == 1
    assert not any(flagged(live.take(np.flatnonzero(live.status == Status.CONFIRMED)), Flag.COASTED))


def test_coasting_points_fly_on_and_grow_uncertain() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 20.0)), until_s=48.0)

    live = drive.live
    coasted = live.take(np.flatnonzero(live.status == Status.COASTING))
    lat, lon, _ = FLIGHT.at(coasted.time_s - START_S)
    # Straight on, as the flight really goes on here.
    assert np.hypot(*((coasted.lat_deg - lat) * 111e3, (coasted.lon_deg - lon) * 74e3)).max() < 30.0
    assert (np.diff(coasted.position_cov_m2[:, 0]) > 0.0).all()
    assert not coasted.sources.any()


def test_elements_without_reports_are_predicted_and_flagged() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, np.concatenate([seconds(0.5, 20.0), seconds(40.5, 60.0)])), until_s=75.0)

    e = drive.elements
    empty = e.sources.sum(axis=1) == 0
    assert empty.sum() >= 4
    assert flagged(e, Flag.COASTED) == empty.tolist()
    assert (e.span_s[1:, 0] == e.span_s[:-1, 1]).all()
    lat, _, _ = FLIGHT.at(e.time_s - START_S)
    assert np.abs(e.lat_deg - lat).max() * 111e3 < 50.0


def test_an_aircraft_that_is_heard_again_goes_on_with_its_number() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, np.concatenate([seconds(0.5, 10.0), seconds(25.5, 35.0)])))

    live = drive.live
    assert set(live.track_number.tolist()) == {1}
    assert statuses(drive)[-2:] == [(12.75, "coasting"), (25.5, "confirmed")]
    assert (np.diff(live.time_s) > 0.0).all()
    assert live.seq.tolist() == list(range(len(live)))


def test_a_late_report_of_a_coasting_track_does_not_turn_its_time_back() -> None:
    # Last heard at 9.5 s, predicted for 12.75 and 13.75 s; then something from 9.2 s arrives, and again silence.
    plots = [adsb(FLIGHT, seconds(0.5, 10.0)), adsb(FLIGHT, 9.2, delay_s=4.6)]

    drive = Drive.of().feed(plots, until_s=25.0)

    live = drive.live
    assert drive.counts[0, Reason.ACCEPTED] == 11
    assert (np.diff(live.time_s) > 0.0).all()
    assert live.time_s[-1] > START_S + 15.0


def test_a_track_keeps_its_number_while_one_sensor_is_silent() -> None:
    plots = [adsb(FLIGHT, seconds(0.5, 15.0)), radar(FLIGHT, seconds(1.2, 60.0, 4.0))]

    drive = Drive.of().feed(plots, until_s=60.0)

    assert set(drive.live.track_number.tolist()) == {1}
    assert not (drive.live.status == Status.COASTING).any()
    masters = drive.elements.master
    assert masters[1] == 0
    assert masters[-1] == 1


def test_an_ended_aircraft_begins_anew_under_a_new_number() -> None:
    plots = adsb(FLIGHT, np.concatenate([seconds(0.5, 10.0), seconds(50.5, 60.0)]))

    drive = Drive.of().feed(plots).finish()

    first, second = by_track(drive.live)
    assert (first.track_number[0], second.track_number[0]) == (1, 2)
    assert first.status[-1] == Status.TERMINATED
    assert second.label[0] == first.label[0] == FLIGHT.address
    assert second.seq[0] == 0
    elements = by_track(drive.elements)
    assert elements[1].span_s[0, 0] == START_S + 50.5
    assert elements[1].element[0] == 0


# Straight over the radar: 44 s of its flight it is in the cone of silence.
OVERHEAD = Flight(lat_deg=47.989, lon_deg=11.78, track_deg=0.0, speed_mps=220.0, height_m=9000.0)
SEEN = np.setdiff1d(seconds(1.0, 320.0, 4.0), seconds(161.0, 205.0, 4.0))


def test_an_aircraft_over_a_lone_radar_keeps_its_number_through_the_cone_of_silence() -> None:
    drive = Drive.of(engine_settings(RADAR1)).feed(radar(OVERHEAD, SEEN, sensor=0))

    assert "terminated" not in dict(statuses(drive)).values()
    assert len(by_track(drive.live)) == 1


def test_so_does_one_that_only_a_primary_radar_sees() -> None:
    psr = replace(RADAR1, kind="psr")
    plots = radar(
        OVERHEAD, SEEN, psr, sensor=0, address=-1, mode_a=-1, altitude_m=np.nan, range_sigma_m=50.0,
        azimuth_sigma_deg=0.07,
    )  # fmt: skip

    drive = Drive.of(engine_settings(psr)).feed(plots)

    (live,) = by_track(drive.live)
    late = live.take(np.flatnonzero(live.time_s > START_S + 280.0))
    lat, lon, _ = OVERHEAD.at(late.time_s - START_S)
    assert distance_m(late.lat_deg, late.lon_deg, lat, lon).max() < 500.0


def test_an_aircraft_that_does_not_come_out_of_the_cone_of_silence_ends() -> None:
    drive = Drive.of(engine_settings(RADAR1)).feed(radar(OVERHEAD, SEEN[SEEN < 180.0], sensor=0), until_s=320.0)

    ((ended_s, _),) = [c for c in statuses(drive) if c[1] == "terminated"]
    assert 210.0 < ended_s < 260.0


def test_elements_of_an_ended_track_reach_past_its_last_report() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 10.0)), until_s=60.0)

    e = drive.elements
    assert e.span_s[-1, 1] > START_S + 9.5
    assert e.sources.sum() == 10
    assert e.span_s[-1, 1] < START_S + 9.5 + 30.0


def test_a_long_silence_that_passes_in_one_step_is_not_filled_with_elements() -> None:
    drive = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 10.0)))

    drive.events += drive.engine.advance(now_s=START_S + 3600.0)

    assert drive.elements.span_s[-1, 1] < START_S + 9.5 + 35.0
    assert drive.live.status[-1] == Status.TERMINATED


def test_slots_are_used_again_long_after() -> None:
    drive = Drive.of(engine_settings(capacity=1))
    for k in range(4):
        flight = Flight(address=0x400000 + k)
        drive.feed(adsb(flight, 100.0 * k + seconds(0.5, 6.0)), until_s=100.0 * k + 99.0)

    assert drive.engine._state.tracks.capacity == 1
    assert [int(t.track_number[0]) for t in by_track(drive.live)] == [1, 2, 3, 4]
    assert [t.seq[0] for t in by_track(drive.live)] == [0, 0, 0, 0]


def test_numbers_begin_where_the_service_says() -> None:
    drive = Drive.of(engine_settings(), first_track_number=700).feed(adsb(FLIGHT, seconds(0.5, 3.0)))

    assert drive.live.track_number[0] == 700
    assert drive.engine.next_track_number == 701


def test_confirmation_and_end_can_be_set() -> None:
    settings = EngineSettings(
        sensors=(ADSB, RADAR1), registration=RegistrationSettings(enabled=False),
        tracks=TrackSettings(confirm_reports=5, terminate_s=8.0, coast_min_s=4.0, capacity=8),
    )  # fmt: skip

    drive = Drive.of(settings).feed(adsb(FLIGHT, seconds(0.5, 10.0)), until_s=30.0)

    assert statuses(drive) == [(0.5, "tentative"), (4.5, "confirmed"), (13.75, "coasting"), (17.75, "terminated")]


def test_the_engine_says_when_it_has_something_to_do() -> None:
    engine = FusionEngine(engine_settings(), epoch_ms=1)
    assert engine.next_deadline_s() is None
    drive = Drive(engine).feed(adsb(FLIGHT, seconds(0.5, 8.0)))

    deadline = engine.next_deadline_s()

    assert deadline is not None
    assert drive.now_s < deadline <= drive.now_s + 1.0


# -- input that is not used -------------------------------------------------------------------------------------------
def test_every_refusal_is_counted_under_its_reason_and_harms_nothing_else() -> None:
    good = adsb(FLIGHT, seconds(0.5, 30.0))
    row = good.take(np.array([20]))

    def bad(**columns: object) -> Plots:
        changed = row.take(np.array([0]))
        for name, value in columns.items():
            getattr(changed, name)[:] = value
        return changed

    late = good.take(np.array([3]))
    late.lat_deg[:] += 1e-5
    late.received_s[:] = START_S + 25.0
    jump = bad(lat_deg=row.lat_deg + 5.0, time_s=row.time_s + 0.1)
    off = bad(lat_deg=row.lat_deg + 0.02, time_s=row.time_s + 0.2)
    stale = bad(time_s=row.time_s + 0.05)
    everything = [
        good, bad(lat_deg=95.0), bad(time_s=START_S - 20.0), bad(time_s=row.received_s + 6.0),
        bad(lat_deg=np.nan, lon_deg=np.nan), row, stale, late, jump, off,
    ]  # fmt: skip

    drive = Drive.of().feed(everything).finish()

    counts = {Reason(r).name: int(n) for r, n in enumerate(drive.counts[0]) if n}
    assert counts == {
        "ACCEPTED": 30, "BAD_VALUE": 1, "NO_POSITION": 1, "TOO_OLD": 1, "FUTURE": 1, "LATE": 1, "DUPLICATE": 1,
        "STALE": 1, "IMPLAUSIBLE": 1, "OUTLIER": 1,
    }  # fmt: skip
    e = drive.elements
    lat, _, _ = FLIGHT.at(e.time_s - START_S)
    assert np.abs(e.lat_deg - lat).max() * 111e3 < 2.0
    assert e.sources.sum() == 30


def test_too_many_reports_of_one_aircraft_are_refused_as_overload() -> None:
    plots = adsb(FLIGHT, np.linspace(0.5, 1.5, 300))

    drive = Drive.of().feed(plots)

    refused = drive.counts[0, Reason.OVERLOAD]
    assert 0 < refused < 300
    assert drive.counts.sum() == 300


def test_a_sensor_can_be_switched_off_and_on() -> None:
    drive = Drive.of()
    plots = [adsb(FLIGHT, seconds(0.5, 60.0)), radar(FLIGHT, seconds(1.2, 60.0, 4.0))]
    both = Plots.concatenate(plots)
    parts = [both.take(np.flatnonzero((both.time_s - START_S) // 20.0 == k)) for k in range(3)]

    drive.feed(parts[0], until_s=20.0)
    assert drive.engine.control_sensor("radar1", on=False) is False
    drive.feed(parts[1], until_s=40.0)
    assert drive.engine.control_sensor("radar1", on=True) is True
    drive.feed(parts[2], until_s=60.0).finish()

    assert drive.counts[1, Reason.SENSOR_OFF] == len(parts[1].time_s[parts[1].sensor == 1])
    assert drive.counts[0, Reason.SENSOR_OFF] == 0
    e = drive.elements
    off = (e.span_s[:, 0] > START_S + 20.0) & (e.span_s[:, 1] < START_S + 40.0)
    assert not e.sources[off, 1].any()
    assert e.sources[~off, 1].sum() > 0


def test_an_unknown_sensor_is_named() -> None:
    with pytest.raises(UnknownSensorError, match="radar9"):
        Drive.of().engine.control_sensor("radar9", on=False)


# -- restart ----------------------------------------------------------------------------------------------------------
def test_after_a_restart_no_element_starts_before_what_was_published() -> None:
    plots = adsb(FLIGHT, seconds(0.5, 80.0), sigma_m=5.0)
    before, after = (plots.take(np.flatnonzero((plots.time_s < START_S + 40.0) == early)) for early in (True, False))
    first = Drive.of().feed(before)
    snapshot = first.engine.snapshot()
    published_s = first.elements.span_s[-1, 1]

    # The reports of the last seconds come once more, as from a recovering publisher.
    again = before.take(np.flatnonzero(before.time_s > START_S + 30.0))
    again.received_s[:] = START_S + 40.1
    second = Drive.of(engine_settings(), first_track_number=1000)
    second.now_s = first.now_s
    second.engine.restore(snapshot)
    second.feed([again, after]).finish()

    e = second.elements
    assert e.span_s[0, 0] >= published_s
    assert e.span_s[0, 0] == published_s
    assert (e.span_s[1:, 0] == e.span_s[:-1, 1]).all()
    assert e.track_number[0] == 1000
    assert e.element[0] == 0


def test_a_snapshot_of_a_snapshot_is_the_same() -> None:
    snapshot = Drive.of().feed(adsb(FLIGHT, seconds(0.5, 30.0))).engine.snapshot()

    other = FusionEngine(engine_settings(), epoch_ms=1)
    other.restore(snapshot)

    assert json.loads(other.snapshot())["published_until_s"] == json.loads(snapshot)["published_until_s"]
    assert list(json.loads(snapshot)["published_until_s"]) == ["3C6444"]


@pytest.mark.parametrize(
    "data",
    [b"", b"\xff\x00", b"[]", b"{}", b'{"version":2,"registration":{},"published_until_s":{}}',
     b'{"version":1,"registration":[],"published_until_s":{}}',
     b'{"version":1,"registration":{},"published_until_s":{"xyz":1}}',
     b'{"version":1,"registration":{},"published_until_s":{"3C6444":NaN}}',
     b'{"version":1,"registration":{},"published_until_s":{"3C6444":null}}'],
)  # fmt: skip
def test_what_is_no_snapshot_is_refused_in_one_sentence(data: bytes) -> None:
    with pytest.raises(SnapshotError, match="snapshot"):
        FusionEngine(engine_settings(), epoch_ms=1).restore(data)


def test_status_counts_follow_the_tracks() -> None:
    drive = Drive.of().feed([adsb(FLIGHT, seconds(0.5, 10.0)), adsb(Flight(lat_deg=48.5, address=7), [9.0])])
    assert drive.engine.track_counts() == {"tentative": 1, "confirmed": 1, "coasting": 0}

    drive.feed(Plots.of(0), until_s=14.0)

    assert drive.engine.track_counts() == {"tentative": 1, "confirmed": 0, "coasting": 1}


def test_an_empty_call_is_nothing() -> None:
    engine = FusionEngine(engine_settings(), epoch_ms=1)

    assert engine.receive(Plots.of(0), now_s=START_S) == []
    assert engine.advance(now_s=START_S) == []
    assert engine.finish(now_s=START_S) == []
    assert len(engine.tracks(Selection())) == 0


def test_a_handful_of_elements_waits_for_others_where_it_is_asked_to() -> None:
    patient, prompt = Drive.of(), Drive.of()
    for drive in (patient, prompt):
        drive.feed([adsb(Flight(), np.arange(0.5, 30.0))], until_s=8.0)
    closed = {0.0: list[float](), 0.9: list[float]()}
    for drive, wait_s in ((prompt, 0.0), (patient, 0.9)):
        reports = adsb(Flight(), np.arange(8.5, 30.0))
        for tick in range(33, 121):
            now_s = START_S + 0.25 * tick
            drive.engine.receive(reports.take(np.abs(reports.received_s - now_s + 0.125) < 0.125), now_s=now_s)
            events = drive.engine.advance(now_s=now_s, few_wait_s=wait_s)
            closed[wait_s] += [now_s for e in events if isinstance(e, FusedPoints) and e.product == Product.ELEMENT]

    assert len(closed[0.9]) == len(closed[0.0]) > 3
    assert np.allclose(np.subtract(closed[0.9], closed[0.0]), 1.0, atol=0.26)
