"""Input that is taken in the midst of closing elements: live points need not wait, and the elements are the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from tests.builders import START_S, Flight, adsb, engine_settings
from tests.engine_scenes import SENSORS, scene

from aeroskein.engine import FusionEngine
from aeroskein.events import Event, Rejections
from aeroskein.plots import Plots
from aeroskein.points import FusedPoints, Product, Status
from aeroskein.reasons import Reason

UNTIL_S = 40


def run(plots: Plots, *, in_the_midst: bool) -> list[Event]:
    """Elements are closed every second; the next second's reports come one by one, afterwards or in the midst of it."""
    engine, events = FusionEngine(engine_settings(*SENSORS, capacity=2), epoch_ms=1), list[Event]()
    for second in range(UNTIL_S):
        arriving = np.flatnonzero((plots.received_s > START_S + second) & (plots.received_s <= START_S + second + 1.0))
        waiting = [plots.take(arriving[k : k + 1]) for k in range(len(arriving))]

        def take_one(now_s: float = START_S + second + 0.5, waiting: list[Plots] = waiting) -> list[Event]:
            return engine.receive(waiting.pop(0), now_s=now_s) if waiting else []

        def give_way(
            happened: list[Event], take_one: Callable[[], list[Event]] = take_one, told: list[Event] = events
        ) -> None:
            told += happened
            happened.clear()
            told += take_one()

        events += engine.advance(now_s=START_S + second, give_way=give_way if in_the_midst else None)
        while waiting:
            events += take_one()
    return events


def points(events: list[Event], product: Product) -> FusedPoints:
    return FusedPoints.concatenate([e for e in events if isinstance(e, FusedPoints) and e.product is product])


def test_elements_are_the_same_whether_reports_come_after_a_pass_or_in_its_midst() -> None:
    one, other = (points(run(scene()[0], in_the_midst=midst), Product.ELEMENT) for midst in (False, True))

    assert len(one) > 30
    a, b = (p.take(np.lexsort((p.element, p.track_number))) for p in (one, other))
    for name in ("track_number", "element", "time_s", "lat_deg", "lon_deg", "altitude_m", "sources", "rejected"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    np.testing.assert_array_equal(a.position_cov_m2, b.position_cov_m2)


def test_live_points_keep_their_order_even_of_a_track_that_coasts_and_comes_back() -> None:
    plots = scene()[0]
    gone = (plots.address == plots.address.max()) & (plots.time_s > START_S + 15.0) & (plots.time_s < START_S + 28.0)
    live = points(run(plots.take(np.flatnonzero(~gone)), in_the_midst=True), Product.LIVE)

    assert (live.status == Status.COASTING).any()
    for track in np.unique(live.track_number):
        mine = live.take(np.flatnonzero(live.track_number == track))
        assert mine.seq.tolist() == list(range(len(mine)))
        assert (np.diff(mine.time_s) > 0.0).all()


def test_a_report_behind_what_a_pass_is_settling_counts_as_late() -> None:
    engine = FusionEngine(engine_settings(), epoch_ms=1)
    times = np.arange(0.5, 20.0)
    engine.receive(adsb(Flight(), times), now_s=START_S + 20.0)
    refused: list[int] = []

    def give_way(happened: list[Event]) -> None:
        if refused:
            return
        late = adsb(Flight(), np.array([1.0]))
        late.received_s[:] = START_S + 20.0
        for event in engine.receive(late, now_s=START_S + 20.0):
            if isinstance(event, Rejections):
                refused.append(int(event.counts[:, Reason.LATE].sum()))

    closed = points(engine.advance(now_s=START_S + 20.0, most=1, give_way=give_way), Product.ELEMENT)

    assert refused == [1]
    assert len(closed) == 1
    assert closed.sources.sum() == np.count_nonzero(times < closed.span_s[0, 1] - START_S)
