"""How long the element product waits for reports that are under way."""

from __future__ import annotations

import numpy as np
from tests.builders import ADSB, RADAR1, engine_settings

from aeroskein.lateness import Lateness


def after(delays_s: object, sensor: int = 0, **fusion: float) -> float:
    lateness = Lateness(engine_settings(ADSB, RADAR1, **fusion))
    delay_s = np.atleast_1d(np.asarray(delays_s, dtype=np.float64))
    lateness.note(np.full(len(delay_s), sensor, dtype=np.int16), delay_s)
    return lateness.follow()


def test_a_feed_within_the_watermark_leaves_it_as_it_is() -> None:
    assert after(np.random.default_rng(1).uniform(0.0, 1.0, 1000)) == 1.0


def test_the_wait_is_what_95_percent_of_a_late_feed_keep_to() -> None:
    delay_s = np.random.default_rng(1).uniform(0.0, 3.0, 10_000)

    assert np.quantile(delay_s, 0.95) <= after(delay_s) <= np.quantile(delay_s, 0.95) + 0.25


def test_the_wait_has_a_limit_and_can_be_kept_at_the_watermark() -> None:
    assert after(np.full(1000, 9.0)) == 4.0
    assert after(np.full(1000, 9.0), watermark_max_s=0.0) == 1.0


def test_a_slow_radar_s_delays_and_a_handful_of_reports_move_nothing() -> None:
    assert after(np.full(1000, 3.0), sensor=1) == 1.0
    assert after(np.full(20, 3.0)) == 1.0


def test_a_feed_that_recovers_is_no_longer_waited_for() -> None:
    lateness = Lateness(engine_settings(ADSB, RADAR1))
    none = np.zeros(100, dtype=np.int16)
    lateness.note(none, np.full(100, 3.0))
    late_s = lateness.follow()

    for _ in range(180):
        lateness.note(none, np.full(100, 0.2))
        lateness.follow()

    assert late_s > 3.0
    assert lateness.wait_s == 1.0
