"""What the page counts about itself, in the exposition format: viewers, frames, bytes."""

from __future__ import annotations

from collections.abc import Iterable

from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from aeroskein_service.web.visits import Visits

__all__ = ["PageMetrics"]


class PageMetrics:
    """Read when somebody scrapes; nothing is counted twice."""

    def __init__(self, visits: Visits) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(_Visits(visits))
        ProcessCollector(namespace="aeroskein_web", registry=self._registry)

    def text(self) -> bytes:
        """The exposition format."""
        return generate_latest(self._registry)


class _Visits(Collector):
    def __init__(self, visits: Visits) -> None:
        self._visits = visits

    def collect(self) -> Iterable[Metric]:
        visits = self._visits
        yield GaugeMetricFamily("aeroskein_web_viewers", "Browsers that look at the page.", value=len(visits))
        yield CounterMetricFamily("aeroskein_web_frames", "Pictures sent.", value=visits.frames)
        yield CounterMetricFamily("aeroskein_web_bytes", "Bytes of pictures sent.", value=visits.bytes)
        yield CounterMetricFamily(
            "aeroskein_web_skipped", "Pictures that slow browsers did not get.", value=visits.skipped
        )
        yield CounterMetricFamily("aeroskein_web_refused", "Connections refused.", value=visits.refused)
        yield CounterMetricFamily("aeroskein_web_broken", "Messages of browsers not understood.", value=visits.broken)
