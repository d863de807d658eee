"""Judge one fused file against truth: the order in which the parts of this package are asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aeroskein.evaluation.accuracy import accuracy_of, by_flight, by_phase, worst_flight, worst_point
from aeroskein.evaluation.columns import PointColumns, Truth
from aeroskein.evaluation.continuity import INTERVALS_S, continuity_of, span_cover
from aeroskein.evaluation.figures import SensorEvaluation
from aeroskein.evaluation.gospa import gospa_of
from aeroskein.evaluation.identity import identity_of
from aeroskein.evaluation.instants import picture_of
from aeroskein.evaluation.matching import Matches, match
from aeroskein.evaluation.measures import common_measures, interval_measures
from aeroskein.evaluation.requirements import rows_of
from aeroskein.evaluation.residuals import residuals_of
from aeroskein.evaluation.results import Evaluation, EvaluationSettings, ProductEvaluation
from aeroskein.evaluation.roughness import roughness_of
from aeroskein.evaluation.sensors import SensorReports, evaluate_sensors, reported_of
from aeroskein.evaluation.spread import percentile_interval, rms_interval
from aeroskein.evaluation.timing import timing_of
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.evaluation.windows import Windows, is_held, windows_of
from aeroskein.points import Flag, Product

__all__ = ["evaluate"]


@dataclass(slots=True, eq=False)
class _Case:
    """What every part of one evaluation shares."""

    settings: EvaluationSettings
    curve: TruthCurve
    windows: Windows
    sensors: tuple[SensorEvaluation, ...]


def evaluate(
    points: PointColumns,
    truth: Truth | TruthCurve,
    *,
    reports: SensorReports | None = None,
    name: str = "",
    settings: EvaluationSettings | None = None,
) -> Evaluation:
    """Judge published points against truth.

    Parameters
    ----------
    points : PointColumns
        Everything one program published, both products, in the order in which it was published.
    truth : Truth or TruthCurve
        A curve that was made once can be used for several files.
    reports : SensorReports, optional
        The raw reports behind the points: they are judged too, and tell when each flight was first and last seen.
    name : str
        What to call it in reports.
    settings : EvaluationSettings, optional

    Returns
    -------
    Evaluation
        One part per product that occurs in the points.
    """
    settings = settings or EvaluationSettings()
    curve = truth if isinstance(truth, TruthCurve) else TruthCurve(truth, settings.max_truth_gap_s)
    matches = match(points, curve, settings.gate_m)
    reported = None if reports is None else reported_of(reports, curve)
    windows = windows_of(points, matches, curve, settings.from_s, reported)
    sensors = () if reports is None else evaluate_sensors(reports, curve, windows)
    case = _Case(settings, curve, windows, sensors)
    seen = set(np.unique(matches.flight).tolist())
    return Evaluation(
        name=name,
        settings=settings,
        flights=len(curve.names),
        flights_without_points=tuple(flight for i, flight in enumerate(curve.names) if i not in seen),
        phases=curve.phases,
        products=tuple(
            _product(points, matches, product, case) for product in Product if points.is_product(product).any()
        ),
        sensors=sensors,
    )


def _product(points: PointColumns, matches: Matches, product: Product, case: _Case) -> ProductEvaluation:
    settings, curve, windows = case.settings, case.curve, case.windows
    mine = points.is_product(product)
    points, flight = points.take(mine), matches.flight[mine]
    held = is_held(points)
    judged = held & windows.contain(flight, points.time_s)
    residuals = residuals_of(points, np.where(judged, flight, -1), curve)
    picture = picture_of(points, held, curve, windows, step_s=settings.step_s, cutoff_m=settings.cutoff_m)
    timing = timing_of(points)
    identity = identity_of(points, held, flight, picture, curve, windows, settings.step_s)
    continuity = tuple(continuity_of(points, flight, windows, curve, interval_s) for interval_s in INTERVALS_S)
    hours = len(np.unique(picture.truth_step)) * settings.step_s / 3600.0
    common = common_measures(residuals, timing, identity, hours)
    by_column = interval_measures(points, flight, residuals, continuity, windows, curve)
    flights = by_flight(residuals, curve.names)
    accuracy = accuracy_of(residuals)
    size, resamples, seed = residuals.horizontal_m, settings.resamples, settings.seed
    return ProductEvaluation(
        product=product.name.lower(),
        points=len(points),
        judged=len(residuals),
        accuracy=accuracy,
        rms_interval_m=rms_interval(size, residuals.flight, resamples=resamples, seed=seed),
        p95_interval_m=percentile_interval(size, residuals.flight, 95.0, resamples=resamples, seed=seed),
        coasted=accuracy_of(residuals.take((residuals.flags & int(Flag.COASTED)) != 0)),
        phases=by_phase(residuals, curve.phases),
        flights=flights,
        worst_rms_m=worst_flight(flights),
        worst_point_m=worst_point(flights),
        roughness=roughness_of(points, held, residuals),
        timing=timing,
        continuity=continuity,
        span_cover=span_cover(points, flight, windows) if product is Product.ELEMENT else None,
        gospa=gospa_of(picture, settings.cutoff_m),
        identity=identity,
        requirements=rows_of({column: common | own for column, own in by_column.items()}),
        ratio_to_sensor=_ratios(accuracy.horizontal_m.rms, case.sensors),
        residuals=residuals,
    )


def _ratios(rms_m: float | None, sensors: tuple[SensorEvaluation, ...]) -> dict[str, float]:
    """RMS of the product over the RMS of each sensor's raw reports, where both are known."""
    return {s.sensor: rms_m / s.horizontal_m.rms for s in sensors if rms_m is not None and s.horizontal_m.rms}
