"""What decoding and encoding cost: microseconds of processor time per report and per point, printed.

    .venv/bin/python benchmarks/bench_codec.py

The first line is a fixed piece of work (msgspec alone, decoding reports to dictionaries): on a busy or slower machine,
compare ratios to it. Encoding dictionaries with msgspec stands beside the templates that the service uses.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import msgspec
import numpy as np

from aeroskein.plots import Plots
from aeroskein.points import FusedPoints, Product, Status
from aeroskein_service.codec import PointEncoder, decode_batch, encode_batch, encode_feed, gather, open_batch
from aeroskein_service.messages import FEED_POINTS, JSON, MSGPACK

NOW_S = 1_790_000_000.0
SENSORS = ("adsb", "radar1", "radar2")
ROUNDS = 7


def adsb(n: int) -> Plots:
    """Reports as an ADS-B receiver sends them."""
    rows = np.arange(n)
    return Plots.of(
        n,
        time_s=NOW_S + rows * 0.02,
        address=0x3C0000 + rows,
        callsign=[f"DLH{row}".encode() for row in rows],
        lat_deg=48.0 + rows * 0.001,
        lon_deg=11.0 + rows * 0.002,
        altitude_m=10_000.0 + rows,
        height_m=10_090.0 + rows,
        ground_speed_mps=230.5,
        track_angle_deg=91.2,
        vertical_rate_mps=-0.3,
        nac_p=9,
        nac_v=2,
        nic=8,
        sil=3,
    )


def points(n: int, product: Product) -> FusedPoints:
    """Confirmed tracks with every field, of which every tenth has no height."""
    rows = np.arange(n)
    live = product == Product.LIVE
    sources = np.zeros((n, len(SENSORS)), dtype=np.int32)
    sources[rows, rows % 3 if live else 0] = 1 if live else 4
    return FusedPoints(
        product=product,
        slot=rows,
        track_number=rows + 1,
        label=(0x3C0000 + rows).astype(np.int32),
        address=(0x3C0000 + rows).astype(np.int32),
        mode_a=np.full(n, 0o1000, dtype=np.int16),
        callsign=np.array([f"DLH{row}" for row in rows], dtype="S8"),
        seq=rows + 1000,
        time_s=NOW_S + rows * 0.01,
        lat_deg=48.0 + rows * 0.001,
        lon_deg=11.0 + rows * 0.002,
        altitude_m=10_000.0 + rows,
        height_m=np.where(rows % 10 == 0, np.nan, 10_090.0 + rows),
        ground_speed_mps=np.full(n, 230.5),
        track_angle_deg=np.full(n, 91.2),
        vertical_rate_mps=np.full(n, -0.3),
        position_cov_m2=np.tile([25.0, 1.0, 24.0], (n, 1)),
        velocity_cov_m2ps2=np.tile([0.5, 0.0, 0.4], (n, 1)),
        status=np.full(n, Status.CONFIRMED, dtype=np.uint8),
        element=np.full(n, -1 if live else 7),
        span_s=np.full((n, 2), np.nan) if live else np.tile([NOW_S - 4.0, NOW_S], (n, 1)),
        master=np.full(n, 0, dtype=np.int16),
        sources=sources,
        rejected=np.zeros(n, dtype=np.int32),
        input_received_s=np.full(n, NOW_S if live else np.nan),
        flags=np.zeros(n, dtype=np.uint16),
        renamed_to=np.full(n, -1, dtype=np.int32),
    )


def cost_us(work: Callable[[], object], units: int) -> float:
    """Least processor time of some rounds, by unit. [us]"""
    repeats = max(1, 5000 // units)
    best = np.inf
    for _ in range(ROUNDS):
        start = time.process_time()
        for _ in range(repeats):
            work()
        best = min(best, (time.process_time() - start) / repeats)
    return float(best / units * 1e6)


def decoding(n: int, encoding: str) -> None:
    """Report batches to columns."""
    payload = encode_batch(
        adsb(n), sensor_id="adsb", epoch=1, seq=2, sent_s=NOW_S, encoding="json" if encoding == JSON else "msgpack"
    )
    decoder = msgspec.json.Decoder() if encoding == JSON else msgspec.msgpack.Decoder()
    kind = encoding.removeprefix("application/")
    print(
        f"{kind:8} {n:5} reports  msgspec to dictionaries {cost_us(lambda: decoder.decode(payload), n):6.2f} us/report"
    )

    def decode() -> object:
        return decode_batch(payload, encoding, sensor_id="adsb", sensor_index=0, received_s=NOW_S)

    print(f"{kind:8} {n:5} reports  decode_batch, checked   {cost_us(decode, n):6.2f} us/report")


def gathering(batches: int, reports: int) -> None:
    """What the worker does with everything that has arrived."""
    payload = encode_batch(adsb(reports), sensor_id="adsb", epoch=1, seq=2, sent_s=NOW_S)

    def work() -> object:
        opened = [open_batch(payload, MSGPACK, sensor_id="adsb", packed=True) for _ in range(batches)]
        return gather(opened, sensors=[0] * batches, received_s=[NOW_S] * batches)

    n = batches * reports
    print(f"msgpack  {n:5} reports  {batches} batches, gathered    {cost_us(work, n):6.2f} us/report")


def encoding(n: int, product: Product) -> None:
    """Columns to fused points."""
    rows = points(n, product)
    binary, text = PointEncoder(SENSORS, 1), PointEncoder(SENSORS, 1, "json")
    messages = binary.messages(rows, NOW_S)
    dictionaries = [msgspec.to_builtins(message) for message in messages]
    pack = msgspec.msgpack.Encoder().encode
    payloads = binary.encode(rows, NOW_S)
    name = f"{product.name.lower():8} {n:5} points "

    def show(what: str, work: Callable[[], object], units: int = n) -> None:
        print(f"{name}  {what:24}{cost_us(work, units):6.2f} us/point")

    show(f"template, {len(payloads[0])} bytes", lambda: binary.encode(rows, NOW_S))
    show("dictionaries, alone", lambda: [pack(d) for d in dictionaries])
    show("structs, all of it", lambda: [pack(message) for message in binary.messages(rows, NOW_S)])
    show("JSON, all of it", lambda: text.encode(rows, NOW_S))
    feed = payloads[:FEED_POINTS]
    show("feed of encoded points", lambda: encode_feed(feed, MSGPACK, epoch=1, seq=1), len(feed))


def main() -> None:
    """Print all of it."""
    for n in (1, 50, 500):
        decoding(n, MSGPACK)
    decoding(50, JSON)
    gathering(11, 50)
    for n in (1, 50, 1000):
        encoding(n, Product.LIVE)
    encoding(1000, Product.ELEMENT)


if __name__ == "__main__":
    main()
