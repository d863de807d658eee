"""From the engine's events to Zenoh: every fused point on its track's key and in the feed, states and dispositions.

The per-track keys are put with DROP, so that no slow consumer ever holds up fusion; ``seq`` shows a loss. While nobody
subscribes to any of them they are not put at all, which saves more than encoding costs. Who needs every point follows
``feed/<product>/<instance>``, whose last batches are kept and fetched again when they are missed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

import numpy as np

from aeroskein.events import Dispositions, RegistrationState
from aeroskein.points import FusedPoints, Product
from aeroskein.reasons import Reason
from aeroskein_service.codec import PointEncoder, encode_feed, encode_message, encode_registration
from aeroskein_service.keys import Keys, track_label
from aeroskein_service.messages import FEED_POINTS, JSON, VERSION
from aeroskein_service.stage_clock import StageClock
from aeroskein_service.transport import FeedPublisher, Publisher, Session

__all__ = ["Outlet"]

_NAMES: Final = {product: product.name.lower() for product in Product}


class Outlet:
    """Where everything leaves the service.

    Parameters
    ----------
    session : Session
        The service's own.
    keys : Keys
        Spells the keys.
    instance : str
        This service's name on its keys.
    encoder : PointEncoder
        Turns points into bytes.
    epoch_ms : int
        The service's start.
    sensor_ids : iterable of str
        By index.
    clock : StageClock
        Gets what encoding and putting cost.
    """

    def __init__(
        self,
        session: Session,
        keys: Keys,
        instance: str,
        encoder: PointEncoder,
        *,
        epoch_ms: int,
        sensor_ids: Iterable[str],
        clock: StageClock,
    ) -> None:
        self._session = session
        self._keys = keys
        self._status_key = keys.status(instance)
        self._encoder = encoder
        self._encoding = encoder.content_type
        self._epoch_ms = epoch_ms
        self._clock = clock
        self._feed_seq = dict.fromkeys(Product, 0)
        self._feeds = {
            product: FeedPublisher(session, keys.feed(name, instance), self._encoding)
            for product, name in _NAMES.items()
        }
        self._tracks = {
            product: Publisher(session, self._encoding, _key_speller(keys, name)) for product, name in _NAMES.items()
        }
        self._sensor_ids = list(sensor_ids)
        # What somebody subscribes to: products on the keys of tracks, and dispositions by sensor.
        self._followed = dict.fromkeys(Product, False)
        self._watched = dict.fromkeys(range(len(self._sensor_ids)), False)
        for product, name in _NAMES.items():
            session.watched_publisher(keys.fused(name, "*"), partial(self._followed.__setitem__, product))
        for index, sensor in enumerate(self._sensor_ids):
            session.watched_publisher(keys.dispositions(sensor), partial(self._watched.__setitem__, index))

    @property
    def dispositions_wanted(self) -> bool:
        """Whether somebody follows ``debug/dispositions`` of any sensor."""
        return any(self._watched.values())

    def points(self, points: FusedPoints, *, published_s: float) -> None:
        """Put points of one product, each on its key and all in the feed."""
        if not len(points):
            return
        with self._clock.measure("encode", len(points)):
            payloads = self._encoder.encode(points, published_s=published_s)
        with self._clock.measure("publish", len(points)):
            if self._followed[points.product]:
                codes = np.where(points.label >= 0, points.label, -1 - points.track_number)
                self._tracks[points.product].put(codes.tolist(), payloads)
            feed = self._feeds[points.product]
            for start in range(0, len(payloads), FEED_POINTS):
                seq = self._feed_seq[points.product]
                self._feed_seq[points.product] += 1
                feed.put(
                    encode_feed(payloads[start : start + FEED_POINTS], self._encoding, epoch=self._epoch_ms, seq=seq)
                )

    def registration(self, state: RegistrationState) -> None:
        """Put one radar's registration state."""
        self._session.put(
            self._keys.registration(state.sensor), encode_registration(state, self._encoding), self._encoding
        )

    def dispositions(self, rows: Dispositions) -> None:
        """Put what became of reports, for the sensors somebody follows."""
        for index in np.unique(rows.sensor).tolist():
            if self._watched[index]:
                sensor = self._sensor_ids[index]
                message = {
                    "version": VERSION,
                    "sensor": sensor,
                    "dispositions": _disposition_rows(rows, np.flatnonzero(rows.sensor == index)),
                }
                self._session.put(
                    self._keys.dispositions(sensor), encode_message(message, self._encoding), self._encoding
                )

    def status(self, message: dict[str, object]) -> None:
        """Put the status; it is always JSON."""
        self._session.put(self._status_key, encode_message(message, JSON), JSON)


def _key_speller(keys: Keys, product: str) -> Callable[[int], str]:
    """Spells the key of a code: an address, or -1 minus a track number."""
    return lambda code: keys.fused(product, track_label(code, -1 - code))


def _disposition_rows(rows: Dispositions, of: np.ndarray) -> list[dict[str, object]]:
    """One dictionary a report; only while somebody looks, so a loop is no harm."""
    made: list[dict[str, object]] = []
    for row in of.tolist():
        number, label, address = (int(v[row]) for v in (rows.track_number, rows.label, rows.address))
        reason, element = Reason(int(rows.reason[row])), int(rows.element[row])
        made.append(
            {
                "time_s": float(rows.time_s[row]),
                "received_s": float(rows.received_s[row]),
                "address": f"{address:06X}" if address >= 0 else None,
                "track": track_label(label, number) if number >= 0 else None,
                "element": element if element >= 0 else None,
                "reason": None if reason is Reason.ACCEPTED else reason.wire_name,
            }
        )
    return made
