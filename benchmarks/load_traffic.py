"""Traffic for load tests, encoded almost for nothing: batches of reports whose bytes are made beforehand.

Straight flights in a square, ADS-B at 1 Hz, radars every 4 s and 8 s. Every report of a sensor has the same length, so
the batch of a moment is a few columns written into ready-made records: a generator that costs next to nothing leaves
the machine to what is measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from aeroskein.geodesy import frame_rows
from aeroskein.plots import Array, Bools, Ints
from aeroskein.radar_geometry import geodetic_to_radar
from aeroskein.settings import SensorSettings

__all__ = ["BATCH", "PERIODS_S", "SITES", "Batch", "Fleet", "SensorTraffic", "sensor_settings", "sensors_toml"]

SITES: Final = {"radar1": (48.35, 11.78, 460.0), "radar2": (48.9, 12.9, 600.0)}
PERIODS_S: Final = {"adsb": 1.0, "radar1": 4.0, "radar2": 8.0}
BATCH: Final = 50
SPREAD_M: Final = 300_000.0
M_PER_DEG: Final = 111_320.0
RANGE_SIGMA_M, AZIMUTH_SIGMA_DEG, POSITION_SIGMA_M = 50.0, 0.07, 5.0
# Elevation above which radars see nothing. [rad]
CONE_RAD: Final = np.radians(60.0)

_pack: Final = msgspec.msgpack.Encoder().encode


def sensors_toml() -> str:
    """The sensors as a service's configuration has them."""
    text = '[[sensors]]\nid = "adsb"\nkind = "adsb"\n'
    for sensor, (lat, lon, height) in SITES.items():
        text += f'[[sensors]]\nid = "{sensor}"\nkind = "ssr"\nperiod_s = {PERIODS_S[sensor]}\n'
        text += f"lat_deg = {lat}\nlon_deg = {lon}\nheight_m = {height}\n"
    return text


def sensor_settings() -> tuple[SensorSettings, ...]:
    """The same sensors for an engine."""
    radars = (
        SensorSettings(id=name, kind="ssr", lat_deg=lat, lon_deg=lon, height_m=height, period_s=PERIODS_S[name])
        for name, (lat, lon, height) in SITES.items()
    )
    return (SensorSettings(id="adsb", kind="adsb"), *radars)


class Fleet:
    """Straight flights in a square around the first radar; every column is per aircraft.

    Parameters
    ----------
    n : int
        Aircraft.
    seed : int
        Of their places, speeds and noise.
    appear_s : float
        They begin within this time, not all at once: neither do their elements end at once.
    first_address : int
        The others follow it.
    """

    def __init__(self, n: int, *, seed: int = 1, appear_s: float = 8.0, first_address: int = 0x100000) -> None:
        rng = np.random.default_rng(seed)
        self.address: Ints = first_address + np.arange(n)
        self._lat: Array = 48.35 + rng.uniform(-SPREAD_M, SPREAD_M, n) / M_PER_DEG
        self._lon: Array = 11.78 + rng.uniform(-SPREAD_M, SPREAD_M, n) / (M_PER_DEG * np.cos(np.radians(48.35)))
        self.height_m: Array = rng.uniform(8_000.0, 12_000.0, n)
        self.angle_deg: Array = rng.uniform(0.0, 360.0, n)
        self.speed_mps: Array = rng.uniform(180.0, 250.0, n)
        self.appears_s: Array = rng.uniform(0.0, appear_s, n)
        self.rng = rng

    def __len__(self) -> int:
        return len(self.address)

    def at(self, rows: Ints, elapsed_s: Array) -> tuple[Array, Array]:
        """Latitude and longitude of some aircraft, each at its time since the beginning. [deg]"""
        along, angle = self.speed_mps[rows] * elapsed_s, np.radians(self.angle_deg[rows])
        lat = self._lat[rows] + along * np.cos(angle) / M_PER_DEG
        # Along a parallel a degree is shorter; half way is where the mean is.
        middle = np.radians(0.5 * (lat + self._lat[rows]))
        return lat, self._lon[rows] + along * np.sin(angle) / (M_PER_DEG * np.cos(middle))


class Batch(NamedTuple):
    """One encoded report batch, and what is in it."""

    payload: bytes
    rows: Ints
    """Aircraft, by index."""
    time_s: Array
    """Stamps. [s since the epoch]"""


class SensorTraffic:
    """The batches of one sensor, in order.

    Parameters
    ----------
    fleet : Fleet
        What is seen.
    sensor : {"adsb", "radar1", "radar2"}
        Which sensor this is.
    began_s : float
        The beginning, on the clock of the stamps; also the epoch of the batches. [s since the epoch]
    """

    def __init__(self, fleet: Fleet, sensor: str, began_s: float) -> None:
        self._fleet, self._sensor, self._began_s = fleet, sensor, began_s
        self._period_s = PERIODS_S[sensor]
        # Aircraft in the order in which they are measured within a period: measurement j is of aircraft j modulo n.
        phase = fleet.rng.uniform(0.0, 1.0, len(fleet))
        self._order = np.argsort(phase)
        self._phase = phase[self._order]
        self._done = self._seq = 0
        self._record, self._raw = _records(self._example(), len(fleet))
        self._fill_constant()

    def batches(self, until_s: float) -> Iterator[Batch]:
        """What was measured since the last call and before a time since the beginning."""
        turn, share = divmod(until_s / self._period_s, 1.0)
        upto = int(turn) * len(self._fleet) + int(np.searchsorted(self._phase, share))
        turns, places = np.divmod(np.arange(self._done, upto), len(self._fleet))
        self._done = max(self._done, upto)
        rows, when = self._order[places], (turns + self._phase[places]) * self._period_s
        there = when >= self._fleet.appears_s[rows]
        rows, when = rows[there], when[there]
        if len(rows):
            records, seen = self._measured(rows, when)
            records, rows, when = records[seen], rows[seen], when[seen]
            for start in range(0, len(rows), BATCH):
                part = slice(start, start + BATCH)
                yield Batch(self._payload(records[part]), rows[part], self._began_s + when[part])

    def _example(self) -> dict[str, float | int | str]:
        common: dict[str, float | int | str] = {"time_s": 0.0, "address": "000000", "altitude_m": 0.0}
        if self._sensor != "adsb":
            return common | {"range_m": 0.0, "azimuth_deg": 0.0}
        own = dict.fromkeys(("lat_deg", "lon_deg", "height_m", "ground_speed_mps", "track_angle_deg"), 0.0)
        return common | own | {"nac_p": 9, "nac_v": 2, "nic": 8, "sil": 3}

    def _fill_constant(self) -> None:
        fleet, records = self._fleet, self._raw.view(self._record)[:, 0]
        records["address"] = [f"{address:06X}".encode() for address in fleet.address.tolist()]
        records["altitude_m"] = fleet.height_m
        if self._sensor == "adsb":
            records["height_m"], records["ground_speed_mps"] = fleet.height_m, fleet.speed_mps
            records["track_angle_deg"] = fleet.angle_deg

    def _measured(self, rows: Ints, when: Array) -> tuple[NDArray[Any], Bools]:
        """The reports, and which of them there are: right above itself a radar sees nothing."""
        # By rows of bytes: numpy would not copy what lies between the fields.
        fleet, records = self._fleet, self._raw[rows].view(self._record)[:, 0]
        lat, lon = fleet.at(rows, when)
        noise = fleet.rng.standard_normal((2, len(rows)))
        records["time_s"] = self._began_s + when
        seen = np.ones(len(rows), dtype=np.bool_)
        if self._sensor == "adsb":
            records["lat_deg"] = lat + noise[0] * POSITION_SIGMA_M / M_PER_DEG
            records["lon_deg"] = lon + noise[1] * POSITION_SIGMA_M / (M_PER_DEG * np.cos(np.radians(lat)))
        else:
            site = frame_rows(*(np.array([value]) for value in SITES[self._sensor]))
            slant, azimuth, _ = geodetic_to_radar(site, lat, lon, fleet.height_m[rows])
            records["range_m"] = slant + noise[0] * RANGE_SIGMA_M
            records["azimuth_deg"] = (azimuth + noise[1] * AZIMUTH_SIGMA_DEG) % 360.0
            seen = fleet.height_m[rows] < np.sin(CONE_RAD) * slant
        return records, seen

    def _payload(self, records: NDArray[Any]) -> bytes:
        head = {
            "version": 1,
            "sensor": self._sensor,
            "epoch": int(self._began_s * 1000.0),
            "seq": self._seq,
            "reports": list[int](),
        }
        self._seq += 1
        # The empty list's marker makes room for the list that follows.
        return _pack(head)[:-1] + b"\xdc" + len(records).to_bytes(2, "big") + records.tobytes()


def _records(example: Mapping[str, float | int | str], n: int) -> tuple[np.dtype[Any], NDArray[np.uint8]]:
    """``n`` encoded reports like the example, a row each, and the type by which floats and texts are written."""
    raw = _pack(example)
    names, formats, offsets = [], [], []
    for name, value in example.items():
        if not isinstance(value, int):
            names.append(name)
            formats.append(">f8" if isinstance(value, float) else f"S{len(value)}")
            offsets.append(raw.index(_pack(name)) + len(_pack(name)) + 1)
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": len(raw)})
    return dtype, np.tile(np.frombuffer(raw, dtype=np.uint8), (n, 1))
