"""The three divergence checks, each alone, and what a rejected result falls back to."""

from typing import Any

import numpy as np
import pytest
from tests.filter_scenes import measurements, turning_flights

from aeroskein.adsb_filter import pipeline
from aeroskein.adsb_filter.divergence import ACROSS, CORRECTION, SPIKES, across_m, diverged
from aeroskein.adsb_filter.pipeline import filter_flights
from aeroskein.adsb_filter.prepare import FilterSummary
from aeroskein.adsb_filter.record import Filtered
from aeroskein.adsb_filter.settings import AdsbFilterSettings

SETTINGS = AdsbFilterSettings()
N = 40


def flight() -> Any:
    """Northwards at 200 m/s, without noise."""
    return measurements(np.zeros(N), np.arange(float(N)), np.stack([np.zeros(N), 200.0 * np.arange(N)], axis=1))


def result_at(position_m: np.ndarray) -> Filtered:
    result = Filtered.empty(N)
    result.position_m[:], result.velocity_mps[:], result.accepted[:] = position_m, [0.0, 200.0], True
    return result


def verdict(position_m: np.ndarray, accepted: Any = True) -> int:
    result = result_at(position_m)
    result.accepted[:] = accepted
    return int(diverged(result, flight(), np.zeros(N, dtype=np.bool_), SETTINGS)[0])


def truth() -> np.ndarray:
    return np.stack([np.zeros(N), 200.0 * np.arange(N)], axis=1)


def test_a_good_result_stands() -> None:
    assert verdict(truth() + 10.0 * np.random.default_rng(1).standard_normal((N, 2))) == 0


def test_corrections_are_measured_in_sigmas() -> None:
    # Along the flight one sigma is 41 m (10 m, and 0.2 s at 200 m/s); across it is 10 m.
    assert verdict(truth() + np.array([0.0, 100.0])) == 0
    assert verdict(truth() + np.array([100.0, 0.0])) == CORRECTION


def test_refused_reports_count_with_the_gates_value() -> None:
    mostly_refused = np.arange(N) % 4 == 0

    assert verdict(truth(), mostly_refused) == CORRECTION


def test_one_point_too_far_across_rejects_the_result() -> None:
    position_m = truth()
    position_m[20:23, 0] = [30.0, 210.0, 30.0]

    assert verdict(position_m) == ACROSS


def test_a_point_far_along_is_not_across() -> None:
    position_m = truth()
    position_m[20, 1] += 120.0

    assert verdict(position_m) == 0


def test_spikes_that_were_not_there_reject_the_result() -> None:
    position_m = truth()
    position_m[20, 1] += 350.0

    assert verdict(position_m) == SPIKES


def test_spikes_that_were_there_before_do_not() -> None:
    seen = flight()
    seen.north_m[20] += 350.0
    result = result_at(np.stack([seen.east_m, seen.north_m], axis=1))

    assert diverged(result, seen, np.zeros(N, dtype=np.bool_), SETTINGS)[0] == 0


def test_distance_across_is_measured_from_the_way_between_neighbours() -> None:
    reported = np.array([[0.0, 0.0], [100.0, 100.0], [200.0, 200.0]])
    estimates = reported + np.array([[0.0, 0.0], [10.0, -10.0], [0.0, 0.0]])

    across = across_m(np.zeros(3, dtype=np.int64), reported, np.ones(3, dtype=np.bool_), estimates)

    np.testing.assert_allclose(across, [0.0, np.hypot(10.0, 10.0), 0.0], atol=1e-12)


def test_a_result_that_diverges_falls_back_to_the_reports() -> None:
    # A filter that believes an aircraft cannot turn, and takes every report in: it must lose the turn.
    stubborn = AdsbFilterSettings(linear_sigma_mps2=1e-6, outlier_sigmas=1e6)
    seen = turning_flights(2, (80,))
    summary = FilterSummary()

    result, guarded = filter_flights(seen, seen, np.zeros(80, dtype=np.bool_), stubborn, "linear", False, summary)

    assert summary.fallbacks == {"original": 1}
    assert guarded.all()
    np.testing.assert_array_equal(result.position_m, np.stack([seen.east_m, seen.north_m], axis=1))


def test_a_smoothed_result_that_is_rejected_falls_back_to_the_filtered_one(monkeypatch: pytest.MonkeyPatch) -> None:
    candidates = [("smoothed", result_at(truth() + 500.0)), ("filtered", result_at(truth() + 1.0))]
    monkeypatch.setattr(pipeline, "_results", lambda *_: candidates)
    summary = FilterSummary()

    result, guarded = filter_flights(flight(), flight(), np.zeros(N, dtype=np.bool_), SETTINGS, "imm", True, summary)

    assert summary.fallbacks == {"filtered": 1}
    assert guarded.all()
    np.testing.assert_array_equal(result.position_m, truth() + 1.0)


def test_flights_fall_back_one_by_one() -> None:
    settings = AdsbFilterSettings(linear_sigma_mps2=1e-6, outlier_sigmas=1e6)
    seen = turning_flights(2, (80, 12))

    _, guarded = filter_flights(seen, seen, np.zeros(92, dtype=np.bool_), settings, "linear", False, FilterSummary())

    assert guarded.tolist() == [True] * 80 + [False] * 12
