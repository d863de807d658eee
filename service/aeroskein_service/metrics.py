"""The status as Prometheus metrics: read when somebody scrapes, from the last second's finished status.

Nothing is counted twice and the worker pays nothing for it. Labels are sensor, reason and stage, never the aircraft.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from prometheus_client import CollectorRegistry, GCCollector, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

__all__ = ["CONTENT_TYPE", "Metrics"]

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class Metrics:
    """A registry of its own over a function that gives the last status.

    Parameters
    ----------
    status : callable
        Gives the last status message, None before the first.
    connected : callable
        Whether the router is there.
    """

    def __init__(self, status: Callable[[], Mapping[str, Any] | None], connected: Callable[[], bool]) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(_StatusCollector(status, connected))
        ProcessCollector(namespace="aeroskein", registry=self._registry)
        GCCollector(registry=self._registry)

    def text(self) -> bytes:
        """The exposition format."""
        return generate_latest(self._registry)


class _StatusCollector(Collector):
    def __init__(self, status: Callable[[], Mapping[str, Any] | None], connected: Callable[[], bool]) -> None:
        self._status = status
        self._connected = connected

    def collect(self) -> Iterable[Metric]:
        yield GaugeMetricFamily("aeroskein_router_connected", "1 while the router is there.", value=self._connected())
        status = self._status()
        if status is None:
            return
        yield GaugeMetricFamily("aeroskein_start_time_seconds", "When the service started.", value=status["started_s"])
        yield from _sensor_metrics(status["sensors"])
        for name, count in status["tracks"].items():
            yield GaugeMetricFamily(f"aeroskein_tracks_{name}", f"Tracks that are {name}.", value=count)
        for name, count in status["points"].items():
            yield CounterMetricFamily(f"aeroskein_points_{name}", f"Published {name} points.", value=count)
        stages = GaugeMetricFamily(
            "aeroskein_stage_seconds", "Time per report or element of each stage.", labels=["stage"]
        )
        for stage, spent_us in status["stages_us"].items():
            stages.add_metric([stage], spent_us * 1e-6)
        yield stages
        yield GaugeMetricFamily("aeroskein_alarms", "Alarms that are on.", value=len(status["alarms"]))


_PER_SENSOR = (
    (CounterMetricFamily, "aeroskein_reports_accepted", "accepted", "Reports that were used."),
    (CounterMetricFamily, "aeroskein_batches", "batches", "Batches that arrived."),
    (CounterMetricFamily, "aeroskein_batches_dropped", "dropped", "Batches dropped from a full inbox."),
    (GaugeMetricFamily, "aeroskein_batches_lost", "lost_batches", "Batches missing in the sensors' sequences."),
    (GaugeMetricFamily, "aeroskein_inbox_batches", "inbox", "Batches that wait for the worker."),
    (GaugeMetricFamily, "aeroskein_report_latency_seconds", "latency_s", "Mean age of reports on arrival."),
    (GaugeMetricFamily, "aeroskein_last_report_time_seconds", "last_report_s", "When the newest report arrived."),
)


def _sensor_metrics(sensors: Mapping[str, Mapping[str, Any]]) -> Iterable[Metric]:
    for family, name, field, text in _PER_SENSOR:
        metric = family(name, text, labels=["sensor"])
        for sensor, state in sensors.items():
            if state[field] is not None:
                metric.add_metric([sensor], state[field])
        yield metric
    rejected = CounterMetricFamily(
        "aeroskein_reports_rejected", "Reports that were not used.", labels=["sensor", "reason"]
    )
    for sensor, state in sensors.items():
        for reason, count in state["rejected"].items():
            rejected.add_metric([sensor, reason], count)
    yield rejected
