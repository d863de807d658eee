"""What holds for everything the engine publishes, whatever is flown and in whatever order reports arrive."""

from __future__ import annotations

from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from tests.builders import (
    ADSB,
    RADAR1,
    RADAR2,
    START_S,
    TICK_S,
    Drive,
    Flight,
    adsb,
    by_track,
    engine_settings,
    radar,
)
from tests.engine_scenes import SENSORS, fuse, fused, moved_m, scene

from aeroskein.plots import Plots
from aeroskein.points import Flag, FusedPoints, Status
from aeroskein.reasons import Reason


# -- one run ----------------------------------------------------------------------------------------------------------
def test_every_report_is_counted_once() -> None:
    plots, drive = scene()[0], fused()

    assert drive.counts.sum(axis=1).tolist() == np.bincount(plots.sensor, minlength=3).tolist()
    assert (drive.counts[:, Reason.ACCEPTED] > 0.9 * drive.counts.sum(axis=1)).all()


def test_every_aircraft_has_one_track_with_its_address() -> None:
    plots, drive = scene()[0], fused()

    live = drive.live
    assert set(live.address.tolist()) == set(plots.address.tolist())
    assert np.array_equal(live.label, live.address)
    assert all(len(np.unique(t.address)) == 1 for t in by_track(live))
    assert len(by_track(live)) == len(np.unique(plots.address))


@pytest.mark.parametrize("product", ["live", "elements"])
def test_sequences_have_no_holes(product: str) -> None:
    for track in by_track(getattr(fused(), product)):
        assert track.seq.tolist() == list(range(len(track)))


def test_elements_are_numbered_along_each_track() -> None:
    for track in by_track(fused().elements):
        assert track.element.tolist() == list(range(len(track)))


def test_spans_follow_each_other_without_hole_or_overlap() -> None:
    for track in by_track(fused().elements):
        assert (track.span_s[1:, 0] == track.span_s[:-1, 1]).all()
        assert (track.span_s[:, 1] > track.span_s[:, 0]).all()


def test_every_second_of_a_flight_lies_in_an_element() -> None:
    drive = fused()
    stamps = {int(a): [] for a in np.unique(scene()[0].address)}
    arrived = drive.dispositions
    for d in arrived:
        used = (d.element < 0) & (d.reason == Reason.ACCEPTED)
        for address, time_s in zip(d.address[used].tolist(), d.time_s[used].tolist(), strict=True):
            stamps[address].append(time_s)

    for track in by_track(drive.elements):
        of_track = stamps[int(track.address[0])]
        assert track.span_s[0, 0] == min(of_track)
        assert track.span_s[-1, 1] > max(of_track)


def test_fused_instants_lie_inside_their_elements() -> None:
    e = fused().elements

    assert (e.time_s >= e.span_s[:, 0]).all()
    assert (e.time_s < e.span_s[:, 1]).all()


def test_live_time_never_goes_back() -> None:
    for track in by_track(fused().live):
        assert (np.diff(track.time_s) > 0.0).all()


def test_sources_are_the_accepted_reports_of_each_element() -> None:
    drive = fused()
    told: dict[tuple[int, int], np.ndarray] = {}
    refused: dict[tuple[int, int], int] = {}
    for d in drive.dispositions:
        for row in np.flatnonzero(d.element >= 0):
            key = int(d.track_number[row]), int(d.element[row])
            told.setdefault(key, np.zeros(3, dtype=int))[d.sensor[row]] += d.reason[row] == 0
            refused[key] = refused.get(key, 0) + int(d.reason[row] > 0)

    e = drive.elements
    for row in range(len(e)):
        key = int(e.track_number[row]), int(e.element[row])
        assert e.sources[row].tolist() == told.get(key, np.zeros(3, dtype=int)).tolist()
        assert e.rejected[row] == refused.get(key, 0)


def test_sources_of_all_elements_are_the_reports_that_were_buffered() -> None:
    drive = fused()

    # What the live gate alone refuses is buffered too, and what comes late for a closed element counts in none.
    buffered = drive.counts[:, Reason.ACCEPTED].sum() + drive.counts[:, Reason.OUTLIER].sum()
    in_elements = drive.elements.sources.sum() + drive.elements.rejected.sum()
    assert in_elements <= buffered
    assert in_elements >= 0.995 * buffered


def test_live_sources_are_all_reports_that_the_live_filter_took() -> None:
    drive = fused()

    counted = drive.live.sources.sum(axis=0)
    # Reports in a batch that did not move a track's time count with its next point, if there is one.
    accepted = drive.counts[:, Reason.ACCEPTED]
    assert (counted <= accepted).all()
    assert (counted >= accepted - len(by_track(drive.live)) * 3).all()


def test_tentative_tracks_have_no_elements() -> None:
    drive = fused()

    assert (drive.elements.status != Status.TENTATIVE).all()
    for track in by_track(drive.live):
        tentative = track.status == Status.TENTATIVE
        assert 1 <= tentative.sum() <= 2
        assert not tentative[2:].any()


def test_masters_are_the_sensors_with_the_best_reports() -> None:
    e = fused().elements
    with_adsb = e.sources[:, 0] >= 3

    # Named once ADS-B has been heard for a while: in every element but the first.
    assert (e.master[with_adsb & (e.element > 0)] == 0).all()
    assert set(np.unique(e.master).tolist()) <= {0, 1, 2}


@pytest.mark.parametrize("product", ["live", "elements"])
def test_covariances_are_covariances(product: str) -> None:
    points = getattr(fused(), product)

    for cov in (points.position_cov_m2, points.velocity_cov_m2ps2):
        assert (cov[:, 0] > 0.0).all()
        assert (cov[:, 0] * cov[:, 2] > cov[:, 1] ** 2).all()


def test_angles_and_positions_are_in_range() -> None:
    for p in (fused().live, fused().elements):
        assert (p.track_angle_deg >= 0.0).all()
        assert (p.track_angle_deg < 360.0).all()
        assert (np.abs(p.lat_deg) <= 90.0).all()
        assert (np.abs(p.lon_deg) <= 180.0).all()
        assert (p.ground_speed_mps < 400.0).all()


# -- the same again ---------------------------------------------------------------------------------------------------
def assert_same_points(one: FusedPoints, other: FusedPoints, *skip: str) -> None:
    for column in fields(one):
        if column.name not in ("product", *skip):
            a, b = getattr(one, column.name), getattr(other, column.name)
            equal = np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
            assert equal, f"{column.name}: {a[:3]} {b[:3]}"


def test_the_same_input_gives_the_same_output() -> None:
    again = fuse(scene()[0])

    assert_same_points(again.elements, fused().elements)
    assert_same_points(again.live, fused().live)


def test_growing_from_four_slots_changes_nothing() -> None:
    grown = fused(capacity=4)

    assert_same_points(grown.elements, fused().elements)
    assert_same_points(grown.live, fused().live)


def test_how_a_tick_is_cut_into_batches_changes_no_element() -> None:
    plots = scene()[0]
    cut, last = Drive.of(engine_settings(*SENSORS)), int(np.ceil((plots.received_s.max() - START_S) / TICK_S))
    ticks = np.ceil((plots.received_s - START_S) / TICK_S)

    for tick in range(1, last + 1):
        cut.now_s = START_S + tick * TICK_S
        rows = np.flatnonzero(ticks == tick)
        # Each report by itself on even ticks, in threes on others.
        for part in np.split(rows, np.arange(1 if tick % 2 else 3, len(rows), 1 if tick % 2 else 3)):
            if len(part):
                cut.events += cut.engine.receive(plots.take(part), now_s=cut.now_s)
        cut.events += cut.engine.advance(now_s=cut.now_s)
    cut.finish()

    assert np.array_equal(cut.counts.sum(axis=1), fused().counts.sum(axis=1))
    assert moved_m(cut.elements, fused().elements).max() < 1e-3
    assert np.array_equal(cut.elements.span_s, fused().elements.span_s)


# -- other orders of arrival ------------------------------------------------------------------------------------------
@cache
def fused_with_delays(low_s: float, high_s: float, share: float = 1.0) -> tuple[Plots, Drive]:
    """Flights that begin one after the other; a share of the reports with uniform delays, the others with none."""
    plots, rng = scene()[0], np.random.default_rng(1)
    began = dict(zip(np.unique(plots.address).tolist(), START_S + 2.7 * np.arange(100), strict=False))
    plots = plots.take(np.array([t >= began[a] for t, a in zip(plots.time_s, plots.address.tolist(), strict=True)]))
    delayed = rng.random(len(plots)) < share
    plots.received_s = plots.time_s + np.where(delayed, rng.uniform(low_s, high_s, len(plots)), 0.01)
    return plots, fuse(plots)


def test_arrival_within_the_watermark_moves_no_element_by_a_millimetre() -> None:
    orderly, shuffled = (fused_with_delays(*d)[1].elements for d in ((0.01, 0.02), (0.0, 0.99)))

    assert moved_m(orderly, shuffled).max() < 1e-3
    assert np.array_equal(np.sort(orderly.span_s, axis=0), np.sort(shuffled.span_s, axis=0))


def test_what_closes_when_ten_seconds_begin_is_not_applied_in_them_whoever_reports_just_then() -> None:
    teacher, learner, other = Flight(), Flight(lat_deg=48.36, lon_deg=11.9, address=1), Flight(lat_deg=50.0, address=2)
    # The teacher's first element closes at 10.0 s, when nobody reports; or when somebody far away does.
    common = [adsb(teacher, np.arange(1.0, 30.0), delay_s=0.3), radar(learner, np.arange(1.2, 30.0, 4.0), delay_s=0.1)]
    quiet, busy = fuse_plots(*common), fuse_plots(*common, adsb(other, 9.95))

    a, b = (d.elements.take(np.flatnonzero(d.elements.address == 1)) for d in (quiet, busy))
    assert np.array_equal(a.lat_deg, b.lat_deg)
    assert np.array_equal(a.lon_deg, b.lon_deg)


def fuse_plots(*plots: Plots) -> Drive:
    return Drive.of(engine_settings(ADSB, RADAR1)).feed(plots).finish()


def test_a_tenth_of_the_reports_up_to_four_seconds_late_moves_elements_by_less_than_a_metre() -> None:
    orderly, late = (fused_with_delays(*d)[1].elements for d in ((0.01, 0.02), (0.0, 4.0, 0.1)))

    moved = moved_m(*(e.take(np.flatnonzero(e.element >= 2)) for e in (orderly, late)))
    # What misses an element's look-ahead counts for the next one only: a fifth of a standard deviation, no more.
    assert np.quantile(moved, 0.95) < 1.0


def test_reports_up_to_four_seconds_late_are_used() -> None:
    plots, drive = fused_with_delays(0.0, 4.0)

    gated = drive.counts[:, Reason.OUTLIER].sum()
    assert drive.counts[:, Reason.LATE].sum() == 0
    assert drive.elements.sources.sum() >= 0.99 * (len(plots) - gated)


def test_reports_far_too_late_are_refused_as_late() -> None:
    plots, drive = fused_with_delays(12.0, 14.0, 0.05)

    assert drive.counts[:, Reason.LATE].sum() > 0.03 * len(plots)
    assert drive.counts.sum() == len(plots)


# -- the other modes --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("mode", ["weighted", "patent"])
def test_modes_differ_in_position_only(mode: str) -> None:
    e, wanted = fused(mode).elements, fused().elements

    assert np.array_equal(e.span_s, wanted.span_s)
    assert np.array_equal(e.seq, wanted.seq)
    assert (e.time_s >= e.span_s[:, 0]).all()
    assert (e.time_s <= e.span_s[:, 1]).all()
    assert np.array_equal(e.flags & Flag.COASTED != 0, e.sources.sum(axis=1) == 0)
    assert np.isnan(e.position_cov_m2).all() == (mode == "patent")
    assert (np.abs(e.ground_speed_mps - wanted.ground_speed_mps) < 60.0).all()


@pytest.mark.parametrize("mode", ["information", "weighted", "patent"])
def test_live_points_do_not_depend_on_the_mode(mode: str) -> None:
    assert_same_points(fused(mode).live, fused().live)


def test_live_product_can_be_switched_off() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1, RADAR2, live=False)).feed(scene()[0]).finish()

    assert_same_points(drive.elements, fused().elements)
    assert not any(isinstance(e, FusedPoints) and e.product.name == "LIVE" for e in drive.events)
