"""The cases of the accuracy benchmark: every scene by name, and what it is flown for.

Sensor errors are those of the numerical study in docs/algorithm.md: ADS-B once a second with 10 m and a stamp jitter of
0.2 s, velocity to 1 m/s, 3 % lost, 0.2 % outliers of 150 to 3000 m; radar 1 every 4 s with 50 m and 0.07 degrees, radar
2 every 8 s with 100 m and 0.15 degrees. Each case names what differs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from benchmarks.accuracy_measures import Judge
from benchmarks.accuracy_outcomes import Want
from benchmarks.accuracy_scenes import SENSORS, Fused, Scene, Sky

from aeroskein.plots import Ints, Plots
from aeroskein.points import FusedPoints
from aeroskein.reasons import Reason
from aeroskein.settings import SensorSettings
from aeroskein.simulation import SensorErrors

__all__ = ["CASES", "GAPS_S", "LATE_SHARE", "Case", "in_gaps"]

# Three losses of ADS-B for a minute each. [s]
GAPS_S: Final = ((100.0, 160.0), (220.0, 280.0), (340.0, 400.0))
# What a gap looks like a few seconds after its beginning: until then the last reports still count. [s]
INTO_GAP_S: Final = 3.0
# Biases of the radars where they must be registered: range m, azimuth deg, time s.
BIAS: Final = {"radar1": (80.0, 0.15, 0.3), "radar2": (-60.0, -0.18, 0.4)}
# One aircraft in so many has late ADS-B, by so much. [s]
LATE_SHARE: Final = 20
LATE_S: Final = 0.3

ADSB, RADAR1, RADAR2 = SENSORS
COARSE: Final = replace(ADSB, position_sigma_m=30.0, time_sigma_s=0.4)

Extra = Callable[[Scene, Sky, Fused, Judge], dict[str, float]]


@dataclass(frozen=True, slots=True)
class Case:
    """A scene, what it is compared with, and figures that need more than errors."""

    scene: Scene
    want: Want
    extra: Extra | None = None


def in_gaps() -> tuple[tuple[float, float], ...]:
    """Spans that count as inside a gap. [s]"""
    return tuple((start + INTO_GAP_S, end) for start, end in GAPS_S)


# -- changes that the simulator has no setting for ---------------------------------------------------------------------


def _up_to_four_seconds_late(plots: Plots, flight: Ints) -> Plots:
    """Every report arrives within four seconds of its stamp, in any order."""
    rng = np.random.default_rng(4)
    plots.received_s = plots.time_s + rng.uniform(0.0, 4.0, len(plots))
    return plots


def _without_quality(plots: Plots, flight: Ints) -> Plots:
    plots.nac_p = np.zeros_like(plots.nac_p)
    plots.nac_v = np.zeros_like(plots.nac_v)
    return plots


def _some_late(plots: Plots, flight: Ints) -> Plots:
    """ADS-B of one aircraft in twenty states the time of its position 0.3 s too late."""
    late = np.where((plots.sensor == 0) & (flight % LATE_SHARE == 0), LATE_S, 0.0)
    plots.time_s = plots.time_s + late
    plots.received_s = plots.received_s + late
    return plots


# -- figures that need more than errors --------------------------------------------------------------------------------


def _use_of_reports(scene: Scene, sky: Sky, fused: Fused, judge: Judge) -> dict[str, float]:
    """Which share of the reports was refused for coming late, and which share no element counts."""
    late = sum(fused.report.share(reason) for reason in (Reason.LATE, Reason.TOO_OLD, Reason.OVERLOAD))
    used = float(fused.element.sources.sum() + fused.element.rejected.sum()) / len(sky.plots)
    return {"late": late, "not_in_elements": 1.0 - used}


def _steps(scene: Scene, sky: Sky, fused: Fused, judge: Judge) -> dict[str, float]:
    """The largest change of error between neighbouring points at a loss or return of ADS-B, in sigmas of both."""
    step, time_s = _normalised_steps(fused.element, judge)
    since = time_s - judge.start_s
    near = np.zeros(len(step), dtype=np.bool_)
    for start, end in GAPS_S:
        near |= (np.abs(since - start) <= 10.0) | (np.abs(since - end) <= 10.0)
    return {"step_max": float(step[near].max()), "step_p99": float(np.percentile(step[near], 99.0))}


def _normalised_steps(points: FusedPoints, judge: Judge) -> tuple[np.ndarray, np.ndarray]:
    """Change of the error from each point to the next, in sigmas of both points together, and its time."""
    from aeroskein.evaluation import PointColumns

    errors = judge.errors(PointColumns.from_fused(points)).residuals
    cov = points.position_cov_m2[errors.row]
    joined = errors.flight[1:] == errors.flight[:-1]
    change = (errors.error_m[1:] - errors.error_m[:-1])[joined]
    both = (cov[1:] + cov[:-1])[joined]
    ee, en, nn = both.T
    square = (nn * change[:, 0] ** 2 - 2 * en * change[:, 0] * change[:, 1] + ee * change[:, 1] ** 2) / (
        ee * nn - en**2
    )
    return np.sqrt(square), errors.time_s[1:][joined]


def _latency(scene: Scene, sky: Sky, fused: Fused, judge: Judge) -> dict[str, float]:
    """RMS of the late aircraft and of the others after eight minutes."""
    from aeroskein.evaluation import PointColumns

    errors = judge.errors(PointColumns.from_fused(fused.element)).residuals
    after = errors.time_s - judge.start_s >= 480.0
    late = errors.flight % LATE_SHARE == 0
    size = errors.horizontal_m
    return {
        "late_rms": float(np.sqrt(np.mean(size[after & late] ** 2))),
        "others_rms": float(np.sqrt(np.mean(size[after & ~late] ** 2))),
    }


# -- the cases ---------------------------------------------------------------------------------------------------------


def _adsb(**errors: object) -> tuple[SensorErrors, ...]:
    return (SensorErrors(sensor="adsb", **errors),)  # type: ignore[arg-type]


def _times(factor: float) -> tuple[SensorErrors, ...]:
    """ADS-B that is worse by a factor than the engine is told, in position, velocity and time."""
    return _adsb(position_sigma_m=10.0 * factor, velocity_sigma_mps=factor, time_sigma_s=0.2 * factor)


def _told(factor: float) -> tuple[SensorSettings, ...]:
    """What the references know of it."""
    true = replace(ADSB, position_sigma_m=10.0 * factor, velocity_sigma_mps=factor, time_sigma_s=0.2 * factor)
    return (true, RADAR1, RADAR2)


def _biased() -> tuple[SensorErrors, ...]:
    return tuple(
        SensorErrors(sensor=name, range_bias_m=r, azimuth_bias_deg=a, time_bias_s=t) for name, (r, a, t) in BIAS.items()
    )


def _around(lat_deg: float, lon_deg: float) -> tuple[SensorSettings, ...]:
    """The same sensors elsewhere."""
    return (
        ADSB,
        replace(RADAR1, lat_deg=lat_deg - 0.1, lon_deg=lon_deg),
        replace(RADAR2, lat_deg=lat_deg - 0.3, lon_deg=(lon_deg + 180.7) % 360.0 - 180.0),
    )


_BIASES: Final = tuple((name, *values) for name, values in BIAS.items())
_TURNS: Final = ("enroute", "terminal")
_STALE: Final = _adsb(stale_probability=0.12, frozen_probability=0.001, frozen_s=60.0)

_CASES: Final = (
    Case(Scene(name="base", raw=True), Want(lag_s=6.0, zero_lag=True, circle=True, libraries=True)),
    Case(Scene(name="adsb alone", sensors=(ADSB,)), Want(lag_s=6.0)),
    Case(Scene(name="no velocity", raw=True, errors=_adsb(velocity=False)), Want(lag_s=6.0, zero_lag=True)),
    Case(Scene(name="coarse", families=_TURNS, sensors=(COARSE, RADAR1, RADAR2)), Want(lag_s=6.0)),
    Case(Scene(name="coarse alone", families=_TURNS, sensors=(COARSE,)), Want(lag_s=6.0)),
    Case(
        Scene(name="gaps", families=_TURNS, duration_s=430.0, errors=_adsb(gaps_s=GAPS_S)),
        Want(lag_s=6.0, zero_lag=True),
        _steps,
    ),
    Case(
        Scene(
            name="gaps 2", families=_TURNS, duration_s=430.0, errors=_adsb(gaps_s=GAPS_S), fusion=(("lookahead", 2),)
        ),
        Want(lag_s=10.0),
        _steps,
    ),
    # What heights and altitudes differ by nobody can know without ADS-B: its own case. Errors hang together while
    # a radar turns a few times: of sixteen flights the share inside 95 % would scatter by one percent (sigma).
    Case(
        Scene(name="radars", sensors=(RADAR1, RADAR2), height_offset_m=0.0, flights=96), Want(lag_s=12.0, zero_lag=True)
    ),
    Case(Scene(name="radars, heights off", families=_TURNS, sensors=(RADAR1, RADAR2), height_offset_m=90.0), Want()),
    Case(Scene(name="outliers", families=_TURNS, errors=_adsb(outlier_probability=0.05)), Want(lag_s=6.0)),
    Case(
        Scene(
            name="late adsb", families=("cruise", *_TURNS, "hold"), flights=40, duration_s=720.0,
            errors=_biased(), registered=True, change=_some_late,
        ),
        Want(),
        _latency,
    ),
    Case(
        Scene(name="registered", families=_TURNS, duration_s=600.0, errors=_biased(), registered=True,
              from_s=300.0),
        Want(lag_s=6.0, bias=_BIASES),
    ),
    Case(Scene(name="registering", families=_TURNS, registered=True), Want(lag_s=6.0)),
    Case(
        Scene(name="lateness", families=_TURNS, change=_up_to_four_seconds_late), Want(lag_s=6.0), _use_of_reports
    ),
    Case(
        Scene(name="slow", families=("hover", "approach", "climb", "acceleration")), Want(lag_s=6.0, zero_lag=True)
    ),
    Case(
        Scene(name="pole", families=_TURNS, sensors=_around(89.6, 25.0), place_deg=(89.6, 25.0)), Want(lag_s=6.0)
    ),
    Case(
        Scene(name="antimeridian", families=_TURNS, sensors=_around(-17.0, 179.9), place_deg=(-17.0, 179.9)),
        Want(lag_s=6.0),
    ),
    Case(
        Scene(
            name="correlated", families=_TURNS, raw=True,
            errors=_adsb(position_sigma_m=5.0, correlated_sigma_m=8.0, correlated_time_s=120.0),
        ),
        Want(lag_s=6.0),
    ),
    Case(Scene(name="sigma doubled", families=_TURNS, errors=_times(2.0)), Want(lag_s=6.0, sensors=_told(2.0))),
    Case(Scene(name="sigma halved", families=_TURNS, errors=_times(0.5)), Want(lag_s=6.0, sensors=_told(0.5))),
    Case(
        Scene(name="nacp 0", families=_TURNS, errors=_adsb(quality="indicators"), change=_without_quality),
        Want(lag_s=6.0),
    ),
    Case(
        Scene(name="stale", families=_TURNS, errors=_STALE),
        Want(lag_s=6.0),
    ),
)  # fmt: skip

CASES: Final = {case.scene.name: case for case in _CASES}
"""Every case by the name of its scene."""
