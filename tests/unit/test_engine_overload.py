"""What the engine offers a machine that is too slow: elements a few at a time, live points thinned, nothing else."""

from __future__ import annotations

import numpy as np
from tests.builders import START_S, Drive, Flight, adsb, engine_settings
from tests.engine_scenes import SENSORS, scene

from aeroskein import ageing
from aeroskein.engine import FusionEngine
from aeroskein.plots import Plots
from aeroskein.points import FusedPoints, Product, Status


def full(engine: FusionEngine, until_s: float, most: int | None) -> list[FusedPoints]:
    """Element points of the mixed scene, closed no more than ``most`` at a time."""
    plots, passes = scene()[0], []
    for tick in range(int(until_s)):
        now_s = START_S + tick
        batch = plots.take(np.flatnonzero((plots.received_s > now_s - 1.0) & (plots.received_s <= now_s)))
        engine.receive(batch, now_s=now_s)
        while True:
            events = engine.advance(now_s=now_s, most=most)
            points = [e for e in events if isinstance(e, FusedPoints) and e.product is Product.ELEMENT]
            if points:
                passes.append(FusedPoints.concatenate(points))
            deadline_s = engine.next_deadline_s()
            if deadline_s is None or deadline_s > now_s:
                break
    return passes


def test_elements_closed_a_few_at_a_time_are_the_same_elements() -> None:
    settings = engine_settings(*SENSORS)

    at_once = full(FusionEngine(settings, epoch_ms=1), 40.0, None)
    by_twos = full(FusionEngine(settings, epoch_ms=1), 40.0, 2)

    assert max(len(points) for points in at_once) > 2
    assert max(len(points) for points in by_twos) == 2
    all_at_once, all_by_twos = FusedPoints.concatenate(at_once), FusedPoints.concatenate(by_twos)
    order = [np.lexsort((p.element, p.track_number)) for p in (all_at_once, all_by_twos)]
    assert all_at_once.track_number[order[0]].tolist() == all_by_twos.track_number[order[1]].tolist()
    assert all_at_once.element[order[0]].tolist() == all_by_twos.element[order[1]].tolist()
    np.testing.assert_allclose(all_at_once.lat_deg[order[0]], all_by_twos.lat_deg[order[1]], atol=1e-9)


def test_elements_that_are_due_longest_close_first() -> None:
    engine = FusionEngine(engine_settings(), epoch_ms=1)
    # The aircraft that is known first begins last.
    began = (4.5, 2.5, 0.5)
    plots = [adsb(Flight(address=1 + k), np.arange(start, 20.0)) for k, start in enumerate(began)]
    engine.receive(Plots.concatenate(plots), now_s=START_S + 20.0)

    addresses: list[int] = []
    for _ in range(3):
        for event in engine.advance(now_s=START_S + 20.0, most=1):
            if isinstance(event, FusedPoints) and event.product is Product.ELEMENT:
                addresses += event.address.tolist()

    assert addresses == [3, 2, 1]


def test_thinned_live_points_are_apart_and_leave_no_hole_and_elements_do_not_feel_it() -> None:
    reports = adsb(Flight(), np.arange(0.5, 30.0))
    every, thinned = Drive.of(), Drive.of()
    thinned.engine.thin_live(2.0)

    every.feed(reports).finish()
    thinned.feed(reports).finish()

    assert np.diff(every.live.time_s).max() < 1.5
    assert np.diff(thinned.live.time_s).min() > 2.0
    assert thinned.live.seq.tolist() == list(range(len(thinned.live)))
    assert thinned.elements.lat_deg.tolist() == every.elements.lat_deg.tolist()
    # What was accepted between two points is counted in the later one.
    assert thinned.live.sources.sum() >= every.live.sources.sum() - 2


def test_thinning_ends_when_it_is_told_to() -> None:
    drive = Drive.of()
    drive.engine.thin_live(4.0)
    drive.feed(adsb(Flight(), np.arange(0.5, 10.0)))
    thinned = len(drive.live)

    drive.engine.thin_live(0.0)
    drive.feed(adsb(Flight(), np.arange(10.5, 20.0)))

    assert thinned <= 3
    assert len(drive.live) - thinned == 10


def test_the_end_in_parts_gives_the_same_elements_as_the_end_at_once() -> None:
    at_once, in_parts = Drive.of(engine_settings(*SENSORS)), Drive.of(engine_settings(*SENSORS))
    plots = scene()[0]
    at_once.feed(plots, until_s=30.0).finish()
    in_parts.feed(plots, until_s=30.0)

    parts = 0
    while True:
        events = in_parts.engine.finish(now_s=in_parts.now_s, most=3)
        in_parts.events += events
        if not any(isinstance(e, FusedPoints) and e.product is Product.ELEMENT for e in events):
            break
        parts += 1

    assert parts > 1
    one, other = (
        np.array(sorted(np.stack([d.elements.track_number, d.elements.element, d.elements.lat_deg], axis=1).tolist()))
        for d in (at_once, in_parts)
    )
    np.testing.assert_allclose(one, other, atol=1e-9, rtol=0.0)


def test_a_whole_feed_that_falls_silent_coasts_and_ends_in_parts() -> None:
    """The tracks of the other feeds would wait for all of it; and nobody is forgotten."""
    many = ageing.MOST + 500
    engine = FusionEngine(engine_settings(), epoch_ms=1)
    rng = np.random.default_rng(1)
    columns = {"sensor": 0, "address": np.arange(1, many + 1), "altitude_m": 9_000.0, "height_m": 9_000.0}
    lat, lon = rng.uniform(46.0, 50.0, many), rng.uniform(8.0, 14.0, many)
    for second in range(6):
        time_s = START_S + second
        plots = Plots.of(many, time_s=time_s, received_s=time_s, lat_deg=lat, lon_deg=lon, **columns)
        engine.receive(plots, now_s=time_s)

    coasting, ended = [], []
    for tick in range(160):
        now_s = START_S + 5.0 + 0.25 * tick
        for event in engine.advance(now_s=now_s):
            if isinstance(event, FusedPoints) and event.product is Product.LIVE:
                over = event.status == Status.TERMINATED
                coasting.append(event.track_number[~over])
                ended.append(event.track_number[over])

    assert max(map(len, coasting)) == max(map(len, ended)) == ageing.MOST
    everybody = set(range(1, many + 1))
    assert set(np.concatenate(coasting).tolist()) == everybody
    assert sorted(np.concatenate(ended).tolist()) == sorted(everybody)
