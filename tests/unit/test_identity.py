"""Which track a report belongs to, and whether its position is believed, seen from outside the engine."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np
import pytest
from tests.builders import ADSB, RADAR1, RADAR2, START_S, Drive, Flight, adsb, distance_m, engine_settings, radar

from aeroskein.events import Dispositions
from aeroskein.plots import Plots
from aeroskein.points import Flag, Status
from aeroskein.reasons import Reason
from aeroskein.settings import SensorSettings

PRIMARY: Final = SensorSettings(
    id="primary", kind="psr", period_s=4.0, lat_deg=48.35, lon_deg=11.78, height_m=460.0, time_bias_sigma_s=0.02
)
LEVEL: Final = Flight(height_m=3000.0)


def nameless(plots: Plots, **columns: object) -> Plots:
    """The same plots without address."""
    return dataclasses.replace(plots, address=np.full(len(plots), -1, dtype=np.int32), **columns)


def moved_north(plots: Plots, metres: object) -> Plots:
    return dataclasses.replace(plots, lat_deg=plots.lat_deg + np.asarray(metres) / 111_200.0)


def moved_away(plots: Plots, metres: float) -> Plots:
    return dataclasses.replace(plots, range_m=plots.range_m + metres)


def ssr(flight: Flight, times_s: object, **columns: object) -> Plots:
    return radar(flight, times_s, range_sigma_m=30.0, azimuth_sigma_deg=0.05, **columns)  # type: ignore[arg-type]


def test_plots_with_mode_a_only_make_one_track_named_by_its_number() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))

    drive.feed(nameless(ssr(LEVEL, np.arange(1.0, 120.0, 4.0))), until_s=119.0)

    assert set(drive.live.track_number) == {1}
    assert (drive.live.label == -1).all()
    assert drive.live.status[-1] == Status.CONFIRMED
    assert set(drive.live.mode_a) == {0o1234}


def test_a_plot_without_address_joins_the_track_it_lies_on() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))
    own = adsb(LEVEL, np.arange(0.0, 60.0, 1.0), sigma_m=8.0)
    plots = nameless(ssr(LEVEL, np.arange(20.3, 60.0, 4.0)))

    drive.feed([own, plots], until_s=65.0)

    assert set(drive.live.track_number) == {1}
    assert drive.counts[1, Reason.ACCEPTED] == len(plots)


def test_a_track_takes_the_address_of_reports_that_fit_it_and_says_so_once_under_its_old_name() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))
    plots = nameless(ssr(LEVEL, np.arange(1.0, 100.0, 4.0)))
    own = adsb(LEVEL, np.arange(60.0, 100.0, 1.0), sigma_m=8.0)

    drive.feed([plots, own], until_s=100.0)

    live = drive.live
    renamed = np.flatnonzero(live.renamed_to >= 0)
    assert len(renamed) == 1
    assert live.renamed_to[renamed[0]] == LEVEL.address
    assert live.label[renamed[0]] == -1
    assert set(live.label[renamed[0] + 1 :]) == {LEVEL.address}
    assert set(live.track_number) == {1}
    np.testing.assert_array_equal(live.seq, np.arange(len(live)))


def test_two_aircraft_with_one_address_are_kept_apart_and_both_flagged() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))
    far = dataclasses.replace(LEVEL, lat_deg=49.5, lon_deg=13.0, track_deg=200.0)
    times = np.arange(0.0, 60.0, 1.0)

    drive.feed([adsb(LEVEL, times, sigma_m=8.0), adsb(far, times + 10.4, sigma_m=8.0)], until_s=75.0)

    live = drive.live.take(drive.live.time_s > START_S + 30.0)
    assert set(live.track_number) == {1, 2}
    assert set(live.address) == {LEVEL.address}
    assert set(live.label[live.track_number == 1]) == {LEVEL.address}
    assert set(live.label[live.track_number == 2]) == {-1}
    assert (live.flags & Flag.DUPLICATE_ADDRESS != 0).all()
    for number, flight, offset in ((1, LEVEL, 0.0), (2, far, 0.0)):
        points = live.take(live.track_number == number)
        lat, lon, _ = flight.at(points.time_s - START_S - offset)
        assert distance_m(points.lat_deg, points.lon_deg, lat, lon).max() < 100.0


def test_one_report_far_away_is_refused_and_begins_nothing() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))
    own = adsb(LEVEL, np.arange(0.0, 40.0, 1.0), sigma_m=8.0)
    stray = moved_north(adsb(LEVEL, [20.4]), 60_000.0)

    drive.feed([own, stray], until_s=45.0)

    assert set(drive.live.track_number) == {1}
    assert drive.counts[0, Reason.IMPLAUSIBLE] == 1


def test_false_plots_of_a_primary_radar_begin_no_track() -> None:
    rng = np.random.default_rng(4)
    n = 15 * 10
    drive = Drive.of(engine_settings(ADSB, PRIMARY))
    false = Plots.of(
        n, time_s=START_S + np.sort(rng.uniform(0, 60, n)), received_s=START_S + 61.0, sensor=1,
        range_m=rng.uniform(5e3, 1.5e5, n), azimuth_deg=rng.uniform(0, 360, n),
    )  # fmt: skip
    false = dataclasses.replace(false, received_s=false.time_s + 0.3)

    drive.feed(false, until_s=65.0)

    assert drive.engine.next_track_number == 1
    assert drive.counts[1, Reason.UNASSOCIATED] == n


def test_a_primary_radar_alone_makes_one_track_of_one_aircraft() -> None:
    drive = Drive.of(engine_settings(ADSB, PRIMARY))
    plots = nameless(radar(LEVEL, np.arange(1.0, 120.0, 4.0), PRIMARY, range_sigma_m=40.0, azimuth_sigma_deg=0.06))
    plots = dataclasses.replace(plots, altitude_m=np.full(len(plots), np.nan), mode_a=np.full(len(plots), -1, np.int16))

    drive.feed(plots, until_s=122.0)

    assert drive.engine.next_track_number == 2
    assert drive.engine.track_counts()["confirmed"] == 1
    assert np.isnan(drive.live.altitude_m).all()


def test_aircraft_with_the_same_code_keep_tracks_of_their_own() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))
    beside = dataclasses.replace(LEVEL, lat_deg=48.01, address=0x3C6445)
    times = np.arange(1.0, 100.0, 4.0)

    drive.feed([nameless(ssr(LEVEL, times, seed=1)), nameless(ssr(beside, times + 0.02, seed=2))], until_s=100.0)

    live = drive.live.take(drive.live.time_s > START_S + 20.0)
    assert set(live.track_number) == {1, 2}
    assert set(live.mode_a) == {0o1234}
    for number, flight in ((1, LEVEL), (2, beside)):
        points = live.take(live.track_number == number)
        lat, lon, _ = flight.at(points.time_s - START_S)
        assert distance_m(points.lat_deg, points.lon_deg, lat, lon).max() < 1000.0


def test_an_aircraft_that_changes_its_code_keeps_its_track() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))
    times = np.arange(1.0, 120.0, 4.0)
    code = np.where(times < 60.0, 0o1234, 0o4521).astype(np.int16)

    drive.feed(nameless(ssr(LEVEL, times), mode_a=code), until_s=120.0)

    assert set(drive.live.track_number) == {1}
    assert drive.live.mode_a[-1] == 0o4521


def test_plots_of_a_scan_are_decided_together_though_they_arrive_apart() -> None:
    coarse = dataclasses.replace(RADAR1, range_sigma_m=300.0, azimuth_sigma_deg=0.4)
    drive = Drive.of(engine_settings(ADSB, coarse))
    beside = dataclasses.replace(LEVEL, lat_deg=LEVEL.lat_deg + 0.005, address=LEVEL.address + 1)
    own = [adsb(f, np.arange(0.0, 30.0), sigma_m=8.0, seed=k) for k, f in enumerate((LEVEL, beside))]
    # Both lie 400 m too far north-east, so that the first to come is nearer to the track of the other.
    first, second = (
        moved_away(nameless(radar(flight, [20.0], delay_s=delay_s)), -400.0)
        for flight, delay_s in ((LEVEL, 0.4), (beside, 1.6))
    )
    drive.engine.want_dispositions = True

    drive.feed([*own, first, second], until_s=25.0)

    told = [e for e in drive.events if isinstance(e, Dispositions) and (e.sensor == 1).any() and (e.element < 0).all()]
    assert [e.label[e.sensor == 1].tolist() for e in told] == [[LEVEL.address, beside.address]]


def test_a_plot_without_a_name_is_not_kept_waiting_at_the_end() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1))
    drive.feed([adsb(LEVEL, np.arange(0.0, 20.5), sigma_m=8.0), nameless(ssr(LEVEL, [20.0]))], until_s=20.5)
    assert drive.counts[1].sum() == 0
    assert drive.engine.next_deadline_s() is not None

    drive.finish()

    assert drive.counts[1, Reason.ACCEPTED] == 1


@pytest.fixture(scope="module")
def honest() -> Drive:
    drive = Drive.of(engine_settings(ADSB, RADAR1, RADAR2))
    own = adsb(LEVEL, np.arange(0.0, 120.0, 1.0), sigma_m=8.0)
    seen = [ssr(LEVEL, np.arange(1.0, 120.0, 4.0)), radar(LEVEL, np.arange(3.0, 120.0, 8.0), RADAR2, sensor=2)]
    return drive.feed([own, *seen], until_s=121.0)


def test_own_positions_are_unverified_until_radars_confirm_them(honest: Drive) -> None:
    flags = honest.live.flags

    assert flags[0] & Flag.ADSB_UNVERIFIED
    assert not (flags[honest.live.time_s > START_S + 30.0] & (Flag.ADSB_UNVERIFIED | Flag.ADSB_SUSPECT)).any()


def test_own_positions_stay_unverified_where_no_radar_sees_them() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1)).feed(adsb(LEVEL, np.arange(0.0, 60.0)), until_s=61.0)

    assert (drive.live.flags & Flag.ADSB_UNVERIFIED != 0).all()


def test_own_positions_that_drift_from_the_radar_plots_become_suspect_and_the_track_follows_the_radars() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1, RADAR2))
    own = adsb(LEVEL, np.arange(0.0, 200.0, 1.0), sigma_m=8.0)
    own = moved_north(own, 10.0 * np.maximum(own.time_s - START_S - 60.0, 0.0))
    times = (np.arange(1.0, 200.0, 4.0), np.arange(3.0, 200.0, 8.0))

    drive.feed([own, ssr(LEVEL, times[0]), radar(LEVEL, times[1], RADAR2, sensor=2)], until_s=201.0)

    live = drive.live
    suspect = live.flags & Flag.ADSB_SUSPECT != 0
    first_s = live.time_s[suspect.argmax()] - START_S
    assert suspect.any()
    assert 60.0 < first_s < 60.0 + 50.0 + 30.0  # half a kilometre after 50 s, then at most 30 s
    late = live.take(live.time_s > START_S + 160.0)
    assert (late.flags & Flag.ADSB_SUSPECT != 0).all()
    lat, lon, _ = LEVEL.at(late.time_s - START_S)
    # The own positions are a kilometre off by then, and more.
    assert np.median(distance_m(late.lat_deg, late.lon_deg, lat, lon)) < 200.0


def test_tracks_say_when_they_rest_on_a_radar_that_is_not_registered_yet() -> None:
    settings = engine_settings(ADSB, RADAR1, registration=True)
    drive = Drive.of(settings).feed(ssr(LEVEL, np.arange(1.0, 40.0, 4.0)), until_s=41.0)

    assert (drive.live.flags & Flag.BIAS_UNCERTAIN != 0).all()


def test_the_ground_bit_of_the_newest_report_is_the_track_s() -> None:
    drive = Drive.of(engine_settings(ADSB))
    own = adsb(dataclasses.replace(LEVEL, speed_mps=60.0), np.arange(0.0, 20.0))
    own.flags[own.time_s >= START_S + 10.0] = 1

    drive.feed(own, until_s=21.0)

    on_ground = drive.live.flags & Flag.ON_GROUND != 0
    np.testing.assert_array_equal(on_ground, drive.live.time_s >= START_S + 10.0)
