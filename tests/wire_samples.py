"""Reports, batches and fused points for tests of everything that crosses the boundary, and Hypothesis strategies."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from hypothesis import strategies as st

from aeroskein.points import FusedPoints, Product
from aeroskein_service.batch_columns import DecodedBatch, decode_batch

NOW_S = 1_790_000_000.0
SENSORS = ("adsb", "radar1", "radar2")


def adsb_report(**changes: Any) -> dict[str, Any]:
    """A complete ADS-B report; a change to None leaves the field out."""
    report: dict[str, Any] = {
        "time_s": NOW_S,
        "address": "3C6444",
        "callsign": "DLH4AB",
        "mode_a": "1000",
        "lat_deg": 48.1,
        "lon_deg": 11.5,
        "altitude_m": 10_000.0,
        "height_m": 10_090.0,
        "ground_speed_mps": 230.0,
        "track_angle_deg": 91.5,
        "vertical_rate_mps": -0.5,
        "nac_p": 9,
        "nac_v": 2,
        "nic": 8,
        "sil": 3,
    } | changes
    return {name: value for name, value in report.items() if value is not None}


def radar_report(**changes: Any) -> dict[str, Any]:
    """A complete radar report; a change to None leaves the field out."""
    report: dict[str, Any] = {
        "time_s": NOW_S,
        "mode_a": "1000",
        "local_track": 17,
        "range_m": 80_000.0,
        "azimuth_deg": 271.25,
        "altitude_m": 10_000.0,
    } | changes
    return {name: value for name, value in report.items() if value is not None}


def batch(reports: list[Any], /, **changes: Any) -> dict[str, Any]:
    """A batch of these reports; a change to None leaves the field out."""
    content = {"version": 1, "sensor": "adsb", "epoch": 1_790_000_000_000, "seq": 17, "sent_s": NOW_S + 0.1}
    content |= {"reports": reports} | changes
    return {name: value for name, value in content.items() if value is not None}


def decode(content: Any, encoding: str = "application/msgpack", **changes: Any) -> DecodedBatch:
    """Encode a batch and decode it as the service does; bytes go as they are."""
    if not isinstance(content, bytes):
        encoder = msgspec.json if "json" in encoding else msgspec.msgpack
        content = encoder.encode(content)
    arguments: dict[str, Any] = {"sensor_id": "adsb", "sensor_index": 0, "received_s": NOW_S + 0.2} | changes
    return decode_batch(content, encoding, **arguments)


def fused_points(n: int = 1, product: Product = Product.LIVE, **columns: Any) -> FusedPoints:
    """Fused points with every field; named columns replace the usual values."""
    rows = np.arange(n)
    live = product == Product.LIVE
    usual: dict[str, Any] = {
        "slot": rows,
        "track_number": rows + 123,
        "label": np.full(n, 0x3C6444),
        "address": np.full(n, 0x3C6444),
        "mode_a": np.full(n, 0o7000),
        "callsign": np.full(n, b"DLH4AB"),
        "seq": rows + 7,
        "time_s": NOW_S + rows,
        "lat_deg": np.full(n, 48.1),
        "lon_deg": np.full(n, 11.5),
        "altitude_m": np.full(n, 10_000.0),
        "height_m": np.full(n, 10_090.0),
        "ground_speed_mps": np.full(n, 230.0),
        "track_angle_deg": np.full(n, 91.5),
        "vertical_rate_mps": np.full(n, -0.5),
        "position_cov_m2": np.tile([25.0, 1.5, 24.0], (n, 1)),
        "velocity_cov_m2ps2": np.tile([0.5, -0.1, 0.4], (n, 1)),
        "status": np.full(n, 1),
        "element": np.full(n, -1) if live else rows + 41,
        "span_s": np.full((n, 2), np.nan) if live else np.tile([NOW_S - 4.0, NOW_S], (n, 1)),
        "master": np.full(n, 0),
        "sources": np.tile([4, 1, 0], (n, 1)),
        "rejected": np.full(n, 2),
        "input_received_s": np.full(n, NOW_S + 0.4 if live else np.nan),
        "flags": np.full(n, 0),
        "renamed_to": np.full(n, -1),
    }
    types = {
        "label": np.int32, "address": np.int32, "mode_a": np.int16, "callsign": "S8", "status": np.uint8,
        "master": np.int16, "sources": np.int32, "rejected": np.int32, "flags": np.uint16, "renamed_to": np.int32,
    }  # fmt: skip
    made = usual | columns
    return FusedPoints(
        product=product, **{name: np.asarray(value, dtype=types.get(name)) for name, value in made.items()}
    )


# -- strategies --------------------------------------------------------------------------------------------------------
def _within(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, exclude_max=high == 360.0)


_ANY_REPORT = {
    "address": st.integers(0, 0xFFFFFF).map("{:06X}".format),
    "callsign": st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=8),
    "mode_a": st.integers(0, 0o7777).map("{:04o}".format),
    "local_track": st.integers(0, 2**63 - 1),
    "elevation_deg": _within(-90.0, 90.0),
    "altitude_m": _within(-2000.0, 50_000.0),
    "height_m": _within(-2000.0, 50_000.0),
    "vertical_rate_mps": _within(-350.0, 350.0),
    "heading_deg": _within(0.0, 360.0),
    "nac_p": st.integers(0, 11),
    "nac_v": st.integers(0, 4),
    "nic": st.integers(0, 11),
    "sil": st.integers(0, 3),
    "position_sigma_m": _within(1e-3, 1e5),
    "velocity_sigma_mps": _within(1e-3, 1e3),
    "on_ground": st.just(True),
    "simulated": st.just(True),
    "spi": st.just(True),
}
_TIME = {"time_s": _within(0.0, 1e11)}
_GEOGRAPHIC = st.fixed_dictionaries(
    _TIME | {"lat_deg": _within(-90.0, 90.0), "lon_deg": _within(-180.0, 180.0)}, optional=_ANY_REPORT
)
_POLAR = st.fixed_dictionaries(
    _TIME | {"range_m": _within(0.0, 1e6), "azimuth_deg": _within(0.0, 360.0)}, optional=_ANY_REPORT
)
_VELOCITY = st.one_of(
    st.just({}),
    st.fixed_dictionaries({"ground_speed_mps": _within(0.0, 2200.0), "track_angle_deg": _within(0.0, 360.0)}),
)
good_reports: st.SearchStrategy[dict[str, Any]] = st.tuples(st.one_of(_GEOGRAPHIC, _POLAR), _VELOCITY).map(
    lambda pair: pair[0] | pair[1]
)
"""Reports with nothing wrong in them, with any set of fields."""
