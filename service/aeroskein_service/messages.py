"""The messages of the contract as types: what a report, a fused point and a registration state look like on the wire.

Types only, for msgspec; ``docs/messages.md`` explains the fields. Bulk work does not go through these types: reports
become columns in ``report_columns``, fused points bytes in ``point_encoder``.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec

__all__ = [
    "BATCH_REPORTS",
    "CONTENT_TYPES",
    "FEED_POINTS",
    "FLAG_NAMES",
    "FUSED_FIELDS",
    "JSON",
    "MSGPACK",
    "STATUS_NAMES",
    "VERSION",
    "Encoding",
    "Feed",
    "FusedPoint",
    "NonNegative",
    "RegistrationMessage",
    "Report",
    "ReportBatch",
]

VERSION: Final = 1
# More reports than this in one batch are refused: a micro-batch of the worker must stay short.
BATCH_REPORTS: Final = 500
# Points in one feed message: 50 points are 24 kB, below one Zenoh batch of 64 kB.
FEED_POINTS: Final = 50

Encoding = Literal["msgpack", "json"]
MSGPACK: Final = "application/msgpack"
JSON: Final = "application/json"
# What stands beside a payload, by the name in the configuration.
CONTENT_TYPES: Final[dict[Encoding, str]] = {"msgpack": MSGPACK, "json": JSON}

STATUS_NAMES: Final = ("tentative", "confirmed", "coasting", "terminated")
# In order of the bits of ``aeroskein.points.Flag``.
FLAG_NAMES: Final = (
    "coasted",
    "guarded",
    "bias_uncertain",
    "adsb_unverified",
    "adsb_suspect",
    "duplicate_address",
    "on_ground",
)

NonNegative = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
# Wide enough to say "out of range" about, narrow enough for an int8 column.
_Category = Annotated[int, msgspec.Meta(ge=0, le=127)]


class Report(msgspec.Struct, gc=False, omit_defaults=True):
    """One target report; absent and null mean the same."""

    time_s: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    range_m: float | None = None
    azimuth_deg: float | None = None
    elevation_deg: float | None = None
    altitude_m: float | None = None
    height_m: float | None = None
    ground_speed_mps: float | None = None
    track_angle_deg: float | None = None
    vertical_rate_mps: float | None = None
    heading_deg: float | None = None
    position_sigma_m: float | None = None
    velocity_sigma_mps: float | None = None
    local_track: NonNegative | None = None
    nac_p: _Category | None = None
    nac_v: _Category | None = None
    nic: _Category | None = None
    sil: _Category | None = None
    address: str | None = None
    callsign: str | None = None
    mode_a: str | None = None
    on_ground: bool | None = None
    simulated: bool | None = None
    spi: bool | None = None


class ReportBatch(msgspec.Struct, gc=False):
    """Reports of one sensor, as it sends them; ``sensor`` may be left out, the key names it."""

    version: int
    epoch: NonNegative
    seq: NonNegative
    reports: list[Report]
    sensor: str | None = None
    sent_s: float | None = None


class FusedPoint(msgspec.Struct, gc=False):
    """One fused point as a consumer reads it."""

    version: int
    product: Literal["live", "element"]
    track: str
    track_number: int
    address: str | None
    callsign: str | None
    mode_a: str | None
    epoch: int
    seq: int
    time_s: float
    published_s: float
    lat_deg: float | None
    lon_deg: float | None
    altitude_m: float | None
    height_m: float | None
    ground_speed_mps: float | None
    track_angle_deg: float | None
    vertical_rate_mps: float | None
    position_cov_m2: tuple[float, float, float] | None
    velocity_cov_m2ps2: tuple[float, float, float] | None
    status: str
    element: int | None
    span_s: tuple[float, float] | None
    master: str | None
    sources: dict[str, int]
    rejected: int
    input_received_s: float | None
    flags: list[str]
    renamed_to: str | msgspec.UnsetType = msgspec.UNSET


FUSED_FIELDS: Final = tuple(FusedPoint.__struct_fields__)


class Feed(msgspec.Struct, gc=False):
    """Up to ``FEED_POINTS`` fused points of one product and service."""

    version: int
    epoch: int
    seq: int
    points: list[FusedPoint]


class RegistrationMessage(msgspec.Struct, gc=False):
    """Registration state of one radar: what it reports too much."""

    version: int
    sensor: str
    time_s: float
    state: str
    range_bias_m: float | None
    azimuth_bias_deg: float | None
    time_bias_s: float | None
    range_gain: float | None
    range_bias_sigma_m: float | None
    azimuth_bias_sigma_deg: float | None
    time_bias_sigma_s: float | None
    range_gain_sigma: float | None
    samples: int
    aircraft: int
