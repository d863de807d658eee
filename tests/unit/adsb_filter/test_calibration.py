"""Errors of data sources from straight flight, on flights whose errors are known."""

import numpy as np
import pytest
from tests.filter_scenes import measurements

from aeroskein.adsb_filter.calibration import estimate_source_errors
from aeroskein.measurements import Measurements


def flights(seed: int, sigma_p: float, sigma_t: float, speed: float = 200.0, turn_radps: float = 0.0) -> Measurements:
    """Ten flights of 300 reports on different courses."""
    rng = np.random.default_rng(seed)
    n, parts = 300, 10
    time_s = np.tile(np.arange(float(n)), parts)
    yaw = np.repeat(rng.uniform(-3.0, 3.0, parts), n) + turn_radps * time_s
    if turn_radps == 0.0:
        position = speed * time_s[:, None] * np.stack([np.sin(yaw), np.cos(yaw)], axis=1)
    else:
        position = speed / turn_radps * np.stack([-np.cos(yaw), np.sin(yaw)], axis=1)
    ahead = np.stack([np.sin(yaw), np.cos(yaw)], axis=1)
    position += sigma_t * speed * rng.standard_normal((n * parts, 1)) * ahead
    position += sigma_p * rng.standard_normal((n * parts, 2))
    return measurements(np.repeat(np.arange(parts), n), time_s, position)


@pytest.mark.parametrize(("sigma_p", "sigma_t"), [(10.0, 0.2), (5.0, 0.05), (40.0, 0.4)])
def test_both_errors_are_found(sigma_p: float, sigma_t: float) -> None:
    (found,) = estimate_source_errors(flights(1, sigma_p, sigma_t), 1)

    assert found.position_sigma_m == pytest.approx(sigma_p, rel=0.08)
    assert found.time_sigma_s == pytest.approx(sigma_t, rel=0.12)


def test_a_source_without_jitter_has_none() -> None:
    (found,) = estimate_source_errors(flights(2, 10.0, 0.0), 1)

    assert found.time_sigma_s < 0.02


def test_outliers_hardly_matter() -> None:
    seen = flights(3, 10.0, 0.2)
    seen.north_m[::100] += 3000.0

    (found,) = estimate_source_errors(seen, 1)

    assert found.position_sigma_m == pytest.approx(10.0, rel=0.15)


def test_turning_flight_says_nothing() -> None:
    (found,) = estimate_source_errors(flights(4, 10.0, 0.2, turn_radps=0.03), 1)

    assert found.windows < 8
    assert np.isnan(found.position_sigma_m)


def test_each_source_has_its_own_errors() -> None:
    fine, coarse = flights(5, 5.0, 0.1), flights(6, 30.0, 0.4)
    coarse.sensor[:] = 1.0
    coarse.slot = coarse.slot + 10
    both = Measurements(**{name: np.concatenate([getattr(fine, name), getattr(coarse, name)]) for name in fields(fine)})

    first, second = estimate_source_errors(both, 2)

    assert first.position_sigma_m == pytest.approx(5.0, rel=0.08)
    assert second.position_sigma_m == pytest.approx(30.0, rel=0.08)


def fields(made: Measurements) -> list[str]:
    return list(type(made).__slots__)


def test_a_source_without_reports_has_no_errors() -> None:
    found = estimate_source_errors(flights(7, 10.0, 0.2), 2)[1]

    assert np.isnan(found.position_sigma_m)
    assert found.windows == 0
