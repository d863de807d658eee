"""Judge one fused file against truth: the order in which the parts of this package are asked."""

from __future__ import annotations

import numpy as np

from aeroskein.evaluation.accuracy import accuracy_of, by_flight, by_phase, worst_flight, worst_point
from aeroskein.evaluation.columns import PointColumns, Truth
from aeroskein.evaluation.matching import Matches, match
from aeroskein.evaluation.residuals import residuals_of
from aeroskein.evaluation.results import Evaluation, EvaluationSettings, ProductEvaluation
from aeroskein.evaluation.spread import percentile_interval, rms_interval
from aeroskein.evaluation.truth_curve import TruthCurve
from aeroskein.plots import Array, Bools
from aeroskein.points import Product, Status

__all__ = ["evaluate"]


def evaluate(
    points: PointColumns, truth: Truth, *, name: str = "", settings: EvaluationSettings | None = None
) -> Evaluation:
    """Judge published points against truth.

    Parameters
    ----------
    points : PointColumns
        Everything one program published, both products, any order.
    truth : Truth
    name : str
        What to call it in reports.
    settings : EvaluationSettings, optional

    Returns
    -------
    Evaluation
        One part per product that occurs in the points.
    """
    settings = settings or EvaluationSettings()
    curve = TruthCurve(truth, settings.max_truth_gap_s)
    matches = match(points, curve, settings.gate_m)
    first_s = first_report_s(points, matches, curve)
    seen = np.unique(matches.flight[matches.flight >= 0])
    without = [flight for i, flight in enumerate(curve.names) if i not in set(seen.tolist())]
    return Evaluation(
        name=name,
        settings=settings,
        flights=len(curve.names),
        flights_without_points=tuple(without),
        products=tuple(
            _product(points, matches, curve, first_s, product, settings)
            for product in Product
            if points.is_product(product).any()
        ),
    )


def first_report_s(points: PointColumns, matches: Matches, curve: TruthCurve) -> Array:
    """When each flight was first heard of, as far as the published points tell, NaN if never; ``(flights,)``. [s]

    Tentative points count, and so does the start of an element's span: it reaches back to the first report.
    """
    first = np.full(len(curve.names), np.inf)
    earliest = np.fmin(points.time_s, points.span_s[:, 0])
    known = (matches.flight >= 0) & np.isfinite(earliest)
    np.minimum.at(first, matches.flight[known], earliest[known])
    return np.where(np.isfinite(first), first, np.nan)


def is_judged(points: PointColumns, matches: Matches, first_s: Array, from_s: float) -> Bools:
    """Confirmed or coasting points, late enough after the first report of their flight; shape ``(n,)``."""
    status = (points.status == int(Status.CONFIRMED)) | (points.status == int(Status.COASTING))
    if len(first_s) == 0:
        return np.zeros(len(points), dtype=np.bool_)
    settled = points.time_s >= first_s[np.maximum(matches.flight, 0)] + from_s
    return np.asarray(status & (matches.flight >= 0) & settled)


def _product(
    points: PointColumns,
    matches: Matches,
    curve: TruthCurve,
    first_s: Array,
    product: Product,
    settings: EvaluationSettings,
) -> ProductEvaluation:
    mine = points.is_product(product)
    judged = mine & is_judged(points, matches, first_s, settings.from_s)
    residuals = residuals_of(points, np.where(judged, matches.flight, -1), curve)
    flights = by_flight(residuals, curve.names)
    size, flight = residuals.horizontal_m, residuals.flight
    return ProductEvaluation(
        product=product.name.lower(),
        points=int(mine.sum()),
        judged=len(residuals),
        accuracy=accuracy_of(residuals),
        rms_interval_m=rms_interval(size, flight, resamples=settings.resamples, seed=settings.seed),
        p95_interval_m=percentile_interval(size, flight, 95.0, resamples=settings.resamples, seed=settings.seed),
        phases=by_phase(residuals, curve.phases),
        flights=flights,
        worst_rms_m=worst_flight(flights),
        worst_point_m=worst_point(flights),
        residuals=residuals,
    )
