"""Answers to questions over Zenoh: tracks, reports, elements, and the operator's controls.

The worker calls this between two turns, so an answer is a consistent picture and the engine is never shared. Whatever
is wrong with a question becomes one sentence that names the parameter; it never reaches the engine half understood.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import structlog

from aeroskein.engine import FusionEngine
from aeroskein.errors import AeroskeinError
from aeroskein.selection import Selection
from aeroskein_service.codec import (
    PointEncoder,
    encode_message,
    encode_reports_reply,
    encode_tracks_reply,
    reports_of,
)
from aeroskein_service.control import Controls, QuestionError
from aeroskein_service.keys import Keys
from aeroskein_service.messages import VERSION, Report
from aeroskein_service.selecting import parse_selection
from aeroskein_service.transport import Question

__all__ = ["Desk"]

LIMIT: Final = 5000  # tracks or reports in one reply, about 2.5 MB; ``limit=`` asks for another number
LARGEST_LIMIT: Final = 100_000


class Desk:
    """Answers questions with the engine.

    Parameters
    ----------
    engine : FusionEngine
        Only used inside ``answer``.
    encoder : PointEncoder
        Also says which encoding replies have.
    """

    def __init__(self, engine: FusionEngine, encoder: PointEncoder) -> None:
        self._engine = engine
        self._encoder = encoder
        self._encoding = encoder.content_type
        self._sensor_ids = tuple(sensor.id for sensor in engine.settings.sensors)
        self._controls = Controls(engine)
        self._log = structlog.get_logger("aeroskein.queries")
        self._answers: dict[str, Callable[[Mapping[str, str], float], bytes]] = {}

    def keys(self, keys: Keys) -> list[str]:
        """The keys this desk answers on; call once."""
        self._answers = {
            keys.query("tracks"): self._tracks,
            keys.query("reports"): self._reports,
            keys.query("elements"): self._elements,
        }
        for sensor in self._sensor_ids:
            self._answers[keys.control("registration", sensor)] = self._registration_of(sensor)
            self._answers[keys.control("sensor", sensor)] = self._sensor_of(sensor)
        return list(self._answers)

    def answer(self, question: Question, *, now_s: float) -> None:
        """Reply to one question, or refuse it with a sentence."""
        try:
            payload = self._answers[question.key](question.parameters, now_s)
        except AeroskeinError as error:
            question.refuse(str(error))
        except Exception:
            # A question must never end the fusion; what went wrong stands in the log.
            self._log.exception("question_failed", key=question.key, parameters=question.parameters)
            question.refuse("the service could not answer, its log says why")
        else:
            question.reply(payload, self._encoding)

    # -- tracks, reports, elements -----------------------------------------------------------------------------------
    def _tracks(self, parameters: Mapping[str, str], now_s: float) -> bytes:
        selection, limit = self._selection(parameters)
        points = self._engine.tracks(selection)
        truncated = len(points) > limit
        if truncated:
            points = points.take(np.arange(limit))
        return encode_tracks_reply(
            self._encoder.encode(points, published_s=now_s), self._encoding, time_s=now_s, truncated=truncated
        )

    def _reports(self, parameters: Mapping[str, str], now_s: float) -> bytes:
        selection, limit = self._selection(parameters)
        plots = self._engine.reports(selection)
        truncated = len(plots) > limit
        if truncated:
            # The newest say most about what is going on.
            newest = np.argsort(plots.received_s, kind="stable")[-limit:] if limit else np.zeros(0, dtype=np.int64)
            plots = plots.take(np.sort(newest))
        by_sensor: dict[str, list[Report]] = {}
        for index in np.unique(plots.sensor).tolist():
            by_sensor[self._sensor_ids[index]] = reports_of(plots.take(plots.sensor == index))
        return encode_reports_reply(by_sensor, self._encoding, time_s=now_s, truncated=truncated)

    def _elements(self, parameters: Mapping[str, str], now_s: float) -> bytes:
        _only(parameters, "track")
        label = parameters.get("track", "")
        if not label:
            raise QuestionError("track: expected an address or a key such as T000123, for example track=3C6444")
        records = self._engine.elements(label.upper())
        if records is None:
            raise QuestionError(f"track: there is no track {label!r} now")
        message = {
            "version": VERSION,
            "time_s": now_s,
            "track": label.upper(),
            "elements": [record.content for record in records],
        }
        return encode_message(message, self._encoding)

    def _selection(self, parameters: Mapping[str, str]) -> tuple[Selection, int]:
        conditions = dict(parameters)
        limit = conditions.pop("limit", None)
        return parse_selection(conditions, self._sensor_ids), LIMIT if limit is None else _limit(limit)

    # -- controls ----------------------------------------------------------------------------------------------------
    def _registration_of(self, sensor: str) -> Callable[[Mapping[str, str], float], bytes]:
        return lambda parameters, _now_s: encode_message(
            self._controls.registration(sensor, parameters), self._encoding
        )

    def _sensor_of(self, sensor: str) -> Callable[[Mapping[str, str], float], bytes]:
        return lambda parameters, now_s: encode_message(
            self._controls.sensor(sensor, parameters, now_s=now_s), self._encoding
        )


def _limit(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) > LARGEST_LIMIT:
        raise QuestionError(f"limit: expected a whole number up to {LARGEST_LIMIT}, got {text!r}")
    return int(text)


def _only(parameters: Mapping[str, str], *names: str) -> None:
    for name in parameters:
        if name not in names:
            raise QuestionError(f"{name}: unknown parameter, expected {' or '.join(names)}")
