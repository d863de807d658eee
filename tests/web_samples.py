"""Fused points on their way to the page, and pictures made of them, for the tests of the page."""

from __future__ import annotations

from typing import Any

import numpy as np
from tests.wire_samples import NOW_S, SENSORS, fused_points

from aeroskein.points import FusedPoints, Product
from aeroskein_service.codec import PointEncoder, encode_feed
from aeroskein_service.messages import CONTENT_TYPES, Encoding
from aeroskein_service.web.live_picture import LivePicture
from aeroskein_service.web.records import Records, blank
from aeroskein_service.web.sensor_table import SensorTable


class Clock:
    """A clock that is set."""

    def __init__(self, now_s: float = NOW_S) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s


def tracks(n: int, product: Product = Product.LIVE, **columns: Any) -> FusedPoints:
    """Points of as many tracks, each with an address of its own."""
    rows = np.arange(n)
    return fused_points(
        n, product, **({"label": 0x400000 + rows, "address": 0x400000 + rows, "time_s": np.full(n, NOW_S)} | columns)
    )


def messages(
    points: FusedPoints, encoding: Encoding = "msgpack", epoch: int = 1000, published_s: float = NOW_S, lot: int = 50
) -> list[tuple[bytes, str]]:
    """The messages of the feed that carry these points, with their encoding."""
    encoder, content_type = PointEncoder(SENSORS, epoch, encoding), CONTENT_TYPES[encoding]
    payloads = encoder.encode(points, published_s)
    return [
        (encode_feed(payloads[start : start + lot], content_type, epoch=epoch, seq=start), content_type)
        for start in range(0, len(payloads), lot)
    ]


def picture(clock: Clock | None = None, sensors: SensorTable | None = None) -> LivePicture:
    """An empty picture."""
    return LivePicture(sensors or SensorTable(), clock or Clock())


def show(shown: LivePicture, points: FusedPoints, **options: Any) -> None:
    """Let a picture see points."""
    for payload, encoding in messages(points, **options):
        shown.note("feed", payload, encoding)
    shown.drain()


def records(lat_deg: list[float], lon_deg: list[float], **columns: Any) -> Records:
    """Records at these places; named columns as in ``RECORD``."""
    made = blank(len(lat_deg))
    made["number"] = np.arange(1, len(lat_deg) + 1)
    made["lat"] = np.rint(np.array(lat_deg) * 1e7).astype(np.int64)
    made["lon"] = np.rint(np.array(lon_deg) * 1e7).astype(np.int64)
    for name, values in columns.items():
        made[name] = values
    return made
