"""The report log keeps half a minute of reports, in order, in few pieces."""

import numpy as np
from tests.builders import START_S

from aeroskein.plots import Plots
from aeroskein.report_log import KEEP_S, ReportLog
from aeroskein.selection import Selection


def kept(step_s: float, seconds: float) -> tuple[ReportLog, np.ndarray]:
    """One report of each of two aircraft every so often; the log, and when the last half minute's were added."""
    log, times = ReportLog(), np.arange(0.0, seconds, step_s)
    for after_s in times:
        plots = Plots.of(2, time_s=START_S + after_s, address=[1, 2], lat_deg=48.0, lon_deg=11.0)
        log.add(START_S + after_s, plots, plots.lat_deg, plots.lon_deg)
    return log, times[times >= times[-1] - KEEP_S]


def test_nothing_of_the_last_half_minute_is_missing_and_little_of_what_was_before() -> None:
    for step_s in (0.013, 0.4, 3.0):
        log, times = kept(step_s, 100.0)

        found = log.select(Selection(addresses=frozenset({2}))).time_s - START_S

        assert (np.diff(found) > 0.0).all()
        assert np.isin(times.round(6), found.round(6)).all()
        assert found[0] >= times[0] - 1.0 - step_s


def test_who_asks_looks_at_seconds_not_at_batches() -> None:
    """A sensor sends dozens of batches a second; a look at each of them would hold up the fusion."""
    log, times = kept(0.005, 60.0)
    log.select(Selection())

    assert len(times) > 5_000
    assert len(log._seconds) + len(log._open) <= KEEP_S + 3


def test_a_clock_that_goes_back_loses_nothing() -> None:
    log = ReportLog()
    for now_s in (START_S + 5.0, START_S + 5.2, START_S - 100.0, START_S + 5.4):
        plots = Plots.of(1, time_s=now_s, lat_deg=48.0, lon_deg=11.0)
        log.add(now_s, plots, plots.lat_deg, plots.lon_deg)

    assert len(log.select(Selection())) == 4
