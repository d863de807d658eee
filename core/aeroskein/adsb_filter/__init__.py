"""The published ADS-B filter in full: linear, unscented or IMM, smoothed on request, checked for divergence.

    prepare: regularise ─► indicators ─► start ─► linear | turning ─► divergence ─► publish

``prepare`` and ``pipeline`` know the order; every published step is one file, listed with its tests in
docs/adsb-filter.md.
"""

from aeroskein.adsb_filter.calibration import SourceErrors, estimate_source_errors
from aeroskein.adsb_filter.pipeline import filter_reports
from aeroskein.adsb_filter.prepare import FilterSummary
from aeroskein.adsb_filter.settings import AdsbFilterSettings, Model

__all__ = [
    "AdsbFilterSettings",
    "FilterSummary",
    "Model",
    "SourceErrors",
    "estimate_source_errors",
    "filter_reports",
]
