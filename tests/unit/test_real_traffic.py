"""Recorded traffic: rows become reports in SI units, nothing disappears silently, and radars see what was recorded."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.simulation_scenes import ADSB, quiet

from aeroskein.plots import ON_GROUND, SIMULATED, Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation import SimulationSettings
from aeroskein_service import recording
from aeroskein_service.real_traffic import RecordedTraffic
from aeroskein_service.recording import NoRecordingError, load_recording

RADAR = SensorSettings(id="radar1", kind="ssr", lat_deg=48.7, lon_deg=2.35, height_m=100.0, period_s=4.0)
FIRST_S = 1_633_608_001.0


def row(second: int, icao24: str = "3985a4", **changes: Any) -> dict[str, Any]:
    """A state vector of an aircraft that flies east at 200 m/s and 10,000 ft."""
    made = {
        "timestamp": (FIRST_S + second) * 1000.0, "icao24": icao24, "latitude": 48.9,
        "longitude": 2.0 + second * 200.0 / 73_300.0, "altitude": 10_000.0, "groundspeed": 388.8, "track": 90.0,
        "vertical_rate": -640.0, "callsign": "AFR19BH", "squawk": "642", "onground": False,
    }  # fmt: skip
    return made | changes


def written(folder: Path, rows: list[dict[str, Any]]) -> Path:
    path = folder / "sample.json.gz"
    path.write_bytes(gzip.compress(json.dumps(rows).encode()))
    return path


def played(traffic: RecordedTraffic, start_s: float = 1_800_000_000.0, seconds: float = 100.0) -> Plots:
    chunks = traffic.chunks(start_s=start_s, end_s=start_s + seconds, chunk_s=0.5)
    return Plots.concatenate([chunk.plots for chunk in chunks])


def test_rows_become_si_units(tmp_path: Path) -> None:
    read = load_recording(written(tmp_path, [row(0)]))

    assert read.altitude_m[0] == pytest.approx(3048.0)
    assert read.ground_speed_mps[0] == pytest.approx(200.0, abs=0.05)
    assert read.vertical_rate_mps[0] == pytest.approx(-3.2512)
    assert read.time_s[0] == FIRST_S
    assert read.address[read.slot[0]] == 0x3985A4
    assert read.callsign[0] == b"AFR19BH"
    assert read.mode_a[0] == 0o0642


def test_rows_without_position_or_address_are_counted(tmp_path: Path) -> None:
    rows = [row(0), row(1, latitude=None), row(2, icao24="ground"), row(3)]

    traffic = RecordedTraffic(load_recording(written(tmp_path, rows)), (ADSB,), SimulationSettings())

    assert "2 recorded rows have no position or address and are no reports" in traffic.notes()


def test_missing_values_stay_missing(tmp_path: Path) -> None:
    gone = row(0, altitude=None, groundspeed=None, vertical_rate=None, squawk=None, callsign=None)

    read = load_recording(written(tmp_path, [gone, row(1)]))

    assert np.isnan([read.altitude_m[0], read.ground_speed_mps[0], read.track_angle_deg[0]]).all()
    assert np.isnan(read.vertical_rate_mps[0])
    assert read.mode_a[0] == -1
    assert read.callsign[0] == b""


def test_rows_are_played_in_order_shifted_to_the_start(tmp_path: Path) -> None:
    rows = [row(second) for second in (3, 0, 2, 1, 4)]
    traffic = RecordedTraffic(load_recording(written(tmp_path, rows)), (ADSB,), SimulationSettings())

    plots = played(traffic)

    # What is under way when the recording ends is not played any more.
    assert np.unique(plots.time_s - 1_800_000_000.0).tolist() == [0.0, 1.0, 2.0, 3.0]
    assert (np.diff(plots.received_s) >= 0.0).all()
    assert (plots.received_s >= plots.time_s).all()


def test_a_recording_that_is_over_begins_again_for_all_alike(tmp_path: Path) -> None:
    # Given a recording of ten seconds that began long ago
    traffic = RecordedTraffic(
        load_recording(written(tmp_path, [row(s) for s in range(11)])), (ADSB,), SimulationSettings()
    )
    begun_s = 1_800_000_000.0
    # When a feed starts four seconds after the hundredth repetition began
    chunks = traffic.chunks(start_s=begun_s + 1004.0, end_s=begun_s + 2000.0, chunk_s=0.5, anchor_s=begun_s)
    times = Plots.concatenate([chunk.plots for chunk in chunks]).time_s
    # Then it plays what is left of that round
    assert times.tolist() == [begun_s + 1000.0 + second for second in range(4, 10)]


def test_recorded_reports_are_not_marked_as_simulated_but_radar_plots_are(tmp_path: Path) -> None:
    rows = [row(second, onground=second == 3) for second in range(30)]
    traffic = RecordedTraffic(load_recording(written(tmp_path, rows)), (ADSB, RADAR), SimulationSettings())

    plots = played(traffic)

    adsb, radar = plots.take(plots.sensor == 0), plots.take(plots.sensor == 1)
    assert set(adsb.flags[adsb.time_s != 1_800_000_003.0].tolist()) == {0}
    assert set(adsb.flags[adsb.time_s == 1_800_000_003.0].tolist()) == {ON_GROUND}
    assert set(radar.flags.tolist()) == {SIMULATED}
    assert any("SIMULATED" in sentence for sentence in traffic.notes())


def test_radars_see_the_recorded_positions(tmp_path: Path) -> None:
    made = SimulationSettings(errors=(quiet("radar1"),), geometric_minus_pressure_m=0.0)
    traffic = RecordedTraffic(load_recording(written(tmp_path, [row(s) for s in range(60)])), (ADSB, RADAR), made)

    radar = played(traffic)
    radar = radar.take(radar.sensor == 1)

    pymap3d = pytest.importorskip("pymap3d")
    lon_deg = 2.0 + (radar.time_s - 1_800_000_000.0) * 200.0 / 73_300.0
    azimuth, _, slant = pymap3d.geodetic2aer(48.9, lon_deg, 3048.0, 48.7, 2.35, 100.0)
    assert len(radar) >= 13
    assert np.abs(radar.range_m - slant).max() < 2.0
    assert np.abs(radar.azimuth_deg - azimuth).max() < 0.01
    assert np.abs(radar.altitude_m - 3048.0).max() < 3.9
    assert set(radar.mode_a.tolist()) == {0o642}


def test_radars_do_not_see_what_is_on_the_ground_or_in_a_long_gap(tmp_path: Path) -> None:
    flying = [row(second) for second in [*range(20), *range(80, 100)]]
    taxiing = [row(second, icao24="400001", onground=True) for second in range(100)]
    made = SimulationSettings(errors=(quiet("radar1"),))
    traffic = RecordedTraffic(load_recording(written(tmp_path, flying + taxiing)), (RADAR,), made)

    plots = played(traffic)

    elapsed = plots.time_s - 1_800_000_000.0
    assert set(plots.address.tolist()) == {0x3985A4}
    assert not ((elapsed > 20.0) & (elapsed < 80.0)).any()
    assert (elapsed < 20.0).sum() >= 3
    assert (elapsed > 80.0).sum() >= 3


def test_a_stale_position_does_not_stop_the_aircraft_for_the_radar(tmp_path: Path) -> None:
    rows = [row(second) for second in range(40)]
    for second in range(11, 20):
        rows[second]["longitude"] = rows[10]["longitude"]
    made = SimulationSettings(errors=(quiet("radar1"),))
    traffic = RecordedTraffic(load_recording(written(tmp_path, rows)), (ADSB, RADAR), made)

    plots = played(traffic)

    adsb, radar = plots.take(plots.sensor == 0), plots.take(plots.sensor == 1)
    assert (adsb.lon_deg == rows[10]["longitude"]).sum() >= 9
    ranges = radar.range_m[np.argsort(radar.time_s)]
    assert len(np.unique(ranges)) == len(ranges)
    assert np.abs(np.diff(ranges)).min() > 50.0


def test_a_radar_out_of_sight_is_named(tmp_path: Path) -> None:
    far = SensorSettings(id="radar9", kind="ssr", lat_deg=10.0, lon_deg=2.0, height_m=0.0)

    traffic = RecordedTraffic(load_recording(written(tmp_path, [row(0), row(1)])), (far,), SimulationSettings())

    assert any("radar9 stands" in sentence for sentence in traffic.notes())


def test_without_the_sample_one_sentence_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "_SAMPLE", Path("no", "such", "file"))

    with pytest.raises(NoRecordingError, match=r"pip install --no-deps traffic==2\.13"):
        load_recording()


@pytest.mark.real_data
def test_the_sample_is_read_whole() -> None:
    try:
        read = load_recording()
    except NoRecordingError as missing:
        pytest.skip(str(missing))

    assert len(read.time_s) == 284_505
    assert len(read.address) == 213
    assert read.unusable == 0
    assert (np.diff(read.time_s) >= 0.0).all()
    assert np.isnan(read.altitude_m).sum() == 50_665
