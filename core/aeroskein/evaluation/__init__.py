"""How good is it? Published points against truth, as numbers.

    points, truth ─► truth_curve (truth at any instant) ─► matching (whose point is it) ─► residuals (error of each)
                  ─► accuracy, continuity, timing, sets, requirement rows ─► results (a tree of values, ready for JSON)

Nothing here is used by the fusion itself, and nothing here uses it: not even its geodesy (see ``geometry``).
"""

from aeroskein.evaluation.columns import PointColumns, Truth
from aeroskein.evaluation.judge import evaluate
from aeroskein.evaluation.results import Evaluation, EvaluationSettings, ProductEvaluation, as_dict
from aeroskein.evaluation.sensors import SensorReports, Site
from aeroskein.evaluation.truth_curve import TruthCurve

__all__ = [
    "Evaluation",
    "EvaluationSettings",
    "PointColumns",
    "ProductEvaluation",
    "SensorReports",
    "Site",
    "Truth",
    "TruthCurve",
    "as_dict",
    "evaluate",
]
