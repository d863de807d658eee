"""The published ADS-B filter in full: linear, unscented or IMM, smoothed on request, checked for divergence.

    prepare: regularise ─► indicators ─► start ─► linear | turning ─► divergence ─► publish

``prepare`` and ``pipeline`` know the order; every published step is one file, listed with its tests in
docs/adsb-filter.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
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

# Loaded when it is asked for: a service only wants to know the settings.
_HOMES: Final = {
    "aeroskein.adsb_filter.calibration": ("SourceErrors", "estimate_source_errors"),
    "aeroskein.adsb_filter.pipeline": ("filter_reports",),
    "aeroskein.adsb_filter.prepare": ("FilterSummary",),
    "aeroskein.adsb_filter.settings": ("AdsbFilterSettings", "Model"),
}
_HOME_OF: Final = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)
