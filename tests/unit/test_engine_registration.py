"""Registration seen from outside the engine: what it finds, whose plots it corrects, and what it says of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.builders import ADSB, RADAR1, START_S, Drive, Flight, adsb, distance_m, engine_settings, radar

from aeroskein.plots import Plots
from aeroskein.points import Flag, FusedPoints, Product

SECONDS = 100.0
RANGE_BIAS_M, AZIMUTH_BIAS_DEG = 150.0, -0.4


def traffic() -> list[Plots]:
    """Ten aircraft with ADS-B all around a radar that measures too much range and too little azimuth."""
    rng = np.random.default_rng(5)
    parts = []
    for k in range(10):
        flight = Flight(
            lat_deg=48.35 + 0.4 * np.cos(k), lon_deg=11.78 + 0.6 * np.sin(k), track_deg=rng.uniform(0.0, 360.0),
            height_m=5000.0 + 300.0 * k, address=0x3C0000 + k,
        )  # fmt: skip
        parts.append(adsb(flight, np.arange(0.1 * k, SECONDS), sigma_m=8.0, seed=k))
        seen = radar(
            flight, np.arange(0.37 * k, SECONDS, 4.0), seed=k, range_sigma_m=50.0, azimuth_sigma_deg=0.07,
        )  # fmt: skip
        seen.range_m += RANGE_BIAS_M
        seen.azimuth_deg = (seen.azimuth_deg + AZIMUTH_BIAS_DEG) % 360.0
        parts.append(seen)
    return parts


def test_a_radar_is_registered_while_it_runs_and_its_points_say_until_when_they_are_unsure() -> None:
    drive = Drive.of(engine_settings(ADSB, RADAR1, registration=True)).feed(traffic(), until_s=SECONDS)

    (state,) = drive.engine.registration()
    assert state.state == "converged"
    assert state.aircraft == 10
    assert abs(state.range_bias_m - RANGE_BIAS_M) < min(4.0 * state.range_bias_sigma_m, 40.0)
    assert abs(state.azimuth_bias_deg - AZIMUTH_BIAS_DEG) < min(4.0 * state.azimuth_bias_sigma_deg, 0.05)
    live = drive.live
    unsure = live.flags & Flag.BIAS_UNCERTAIN != 0
    assert unsure[(live.time_s > START_S + 8.0) & (live.time_s < START_S + 12.0)].all()
    assert not unsure[live.time_s > START_S + 90.0].any()


@pytest.mark.parametrize("who", ["service", "sensor"])
def test_only_plots_of_a_radar_that_does_not_correct_itself_are_corrected(who: str) -> None:
    sensor = dataclasses.replace(RADAR1, correction=who)
    flight = Flight(height_m=5000.0)
    drive = Drive.of(engine_settings(ADSB, sensor, registration=True))
    state = drive.engine.control_registration("radar1", "set", range_bias_m=800.0)
    # From the next full ten seconds on: the plots come later.
    drive.feed(radar(flight, np.arange(21.0, 60.0, 4.0)), until_s=60.0)

    assert state.range_bias_m == drive.engine.registration()[0].range_bias_m == 800.0
    live = FusedPoints.concatenate(
        [e for e in drive.events if isinstance(e, FusedPoints) and e.product == Product.LIVE]
    )
    lat, lon, _ = flight.at(live.time_s - START_S)
    off_m = np.median(distance_m(live.lat_deg, live.lon_deg, lat, lon))
    assert (off_m > 600.0) == (who == "service")


def test_biases_are_in_force_at_once_after_a_restart() -> None:
    settings = engine_settings(ADSB, RADAR1, registration=True)
    before = Drive.of(settings)
    before.engine.control_registration("radar1", "set", range_bias_m=120.0, azimuth_bias_deg=0.3)

    after = Drive.of(settings)
    after.engine.restore(before.engine.snapshot())

    assert [dataclasses.replace(s, time_s=0.0) for s in after.engine.registration()] == [
        dataclasses.replace(s, time_s=0.0) for s in before.engine.registration()
    ]
