"""How long the element product waits for reports that are under way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from tests.builders import ADSB, RADAR1, engine_settings

from aeroskein.lateness import Lateness
from aeroskein.plots import Array


def note(lateness: Lateness, delay_s: Array, sensor: int = 0, stamp_s: float = 1000.0) -> None:
    """Reports with one stamp and these delays."""
    time_s = np.full(len(delay_s), stamp_s)
    lateness.note(np.full(len(delay_s), sensor, dtype=np.int16), time_s, time_s + delay_s)


def listening(**fusion: float) -> Lateness:
    """Somebody who has heard a first report long ago."""
    lateness = Lateness(engine_settings(ADSB, RADAR1, **fusion))
    note(lateness, np.zeros(1), sensor=1, stamp_s=0.0)
    return lateness


def after(delays_s: Array, sensor: int = 0, **fusion: float) -> float:
    lateness = listening(**fusion)
    note(lateness, delays_s, sensor)
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


def test_the_last_of_many_sensors_is_counted_as_itself() -> None:
    sensors = [replace(ADSB, id=f"adsb{k}") for k in range(500)]
    lateness = Lateness(engine_settings(*sensors, watermark_max_s=10.0))
    note(lateness, np.zeros(1), stamp_s=0.0)

    note(lateness, np.full(100, 7.0), sensor=499)

    assert lateness.follow() == 7.125


def test_a_feed_that_recovers_is_no_longer_waited_for() -> None:
    lateness = listening()
    note(lateness, np.full(100, 3.0))
    late_s = lateness.follow()

    for _ in range(180):
        note(lateness, np.full(100, 0.2))
        lateness.follow()

    assert late_s > 3.0
    assert lateness.wait_s == 1.0


def test_reports_from_before_the_start_that_a_cache_had_are_not_waited_for() -> None:
    # Given twenty seconds of reports that all arrive when the service starts
    lateness = Lateness(engine_settings(ADSB, RADAR1))
    age_s = np.linspace(20.0, 0.01, 600)
    lateness.note(np.zeros(600, dtype=np.int16), 1000.0 - age_s, np.full(600, 1000.0))

    # When the feed then comes as it always does
    for second in range(30):
        note(lateness, np.full(30, 0.3), stamp_s=1000.0 + second)
        lateness.follow()

        # Then elements never wait longer than the watermark
        assert lateness.wait_s == 1.0
