"""Flights anywhere on the globe: across the antimeridian, over the poles, round the world, at rest."""

from __future__ import annotations

import numpy as np
import pytest
from tests.builders import ADSB, START_S, Drive, Flight, adsb, distance_m, engine_settings, radar

from aeroskein.points import FusedPoints
from aeroskein.settings import SensorSettings

SECONDS = np.arange(0.5, 60.0)


def fused(*plots: object, sensors: tuple[SensorSettings, ...] = (ADSB,), **fusion: object) -> Drive:
    return Drive.of(engine_settings(*sensors, **fusion)).feed(plots).finish()  # type: ignore[arg-type]


def off_m(points: FusedPoints, flight: Flight) -> np.ndarray:
    lat, lon, _ = flight.at(points.time_s - START_S)
    return distance_m(points.lat_deg, points.lon_deg, lat, lon)


def turned(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Size of the difference of two angles."""
    return np.abs((a - b + 180.0) % 360.0 - 180.0)


PLACES = {
    "antimeridian eastwards": Flight(lat_deg=-17.0, lon_deg=179.95, track_deg=80.0, speed_mps=240.0),
    "antimeridian westwards": Flight(lat_deg=60.0, lon_deg=-179.97, track_deg=275.0, speed_mps=240.0),
    "north pole": Flight(lat_deg=89.95, lon_deg=30.0, track_deg=0.0, speed_mps=250.0),
    "beside the south pole": Flight(lat_deg=-89.97, lon_deg=-120.0, track_deg=250.0, speed_mps=200.0),
    "equator and Greenwich": Flight(lat_deg=-0.05, lon_deg=-0.05, track_deg=45.0, speed_mps=250.0),
}


@pytest.mark.parametrize("mode", ["information", "weighted", "patent"])
@pytest.mark.parametrize("name", PLACES)
def test_flights_are_followed_everywhere(name: str, mode: str) -> None:
    flight = PLACES[name]

    drive = fused(adsb(flight, SECONDS), mode=mode)

    e = drive.elements.take(np.flatnonzero(drive.elements.span_s[:, 1] < START_S + 58.0))
    assert off_m(e, flight).max() < 2.0
    assert set(e.track_number.tolist()) == {1}
    assert (drive.counts[0, 1:] == 0).all()
    assert (e.lon_deg >= -180.0).all()
    assert (e.lon_deg < 180.0).all()
    assert np.abs(e.ground_speed_mps - flight.speed_mps).max() < 1.0
    if mode == "information":
        _, _, track_deg = flight.at(e.time_s - START_S)
        # Over the pole itself the direction has no meaning.
        assert turned(e.track_angle_deg, track_deg)[np.abs(e.lat_deg) < 89.98].max(initial=0.0) < 0.5


@pytest.mark.parametrize("name", PLACES)
def test_live_points_follow_too(name: str) -> None:
    drive = fused(adsb(PLACES[name], SECONDS))

    assert off_m(drive.live, PLACES[name]).max() < 2.0


def test_radars_on_both_sides_of_the_antimeridian_see_one_aircraft() -> None:
    east = SensorSettings(id="east", kind="ssr", period_s=4.0, lat_deg=-17.5, lon_deg=-179.2, height_m=100.0)
    west = SensorSettings(id="west", kind="ssr", period_s=4.0, lat_deg=-16.5, lon_deg=179.3, height_m=200.0)
    flight = Flight(lat_deg=-17.0, lon_deg=179.9, track_deg=90.0, speed_mps=240.0)
    plots = [radar(flight, SECONDS[k::4], s, sensor=k) for k, s in enumerate((east, west))]

    drive = fused(*plots, sensors=(east, west))

    e = drive.elements.take(np.flatnonzero(drive.elements.span_s[:, 0] > START_S + 20.0))
    assert set(drive.live.track_number.tolist()) == {1}
    assert np.median(off_m(e, flight)) < 60.0
    assert drive.elements.sources.sum(axis=0).min() >= 14


def test_a_long_flight_changes_planes_without_a_step() -> None:
    # 85 km, at the speed of the fastest.
    flight = Flight(lat_deg=52.0, lon_deg=11.0, track_deg=40.0, speed_mps=600.0)
    t = np.arange(0.5, 140.0)

    drive = fused(adsb(flight, t))

    assert len(drive.engine._state.frames.rows) == 2
    assert off_m(drive.live, flight).max() < 2.0
    e = drive.elements.take(np.flatnonzero(drive.elements.span_s[:, 1] < START_S + 136.0))
    assert off_m(e, flight).max() < 1.0
    assert set(e.track_number.tolist()) == {1}
    assert (e.span_s[1:, 0] == e.span_s[:-1, 1]).all()
    assert not drive.counts[0, 1:].any()
    _, _, track_deg = flight.at(e.time_s - START_S)
    assert turned(e.track_angle_deg, track_deg).max() < 0.1
    # The covariance goes on shrinking as it did, element by element.
    size = np.trace(e.position_cov_m2[:, [0, 1, 1, 2]].reshape(-1, 2, 2), axis1=1, axis2=2)[10:]
    assert (np.diff(size) < 0.0).all()
    assert (np.abs(np.diff(size, 2)) < 0.02 * size[2:]).all()


def test_neighbours_share_a_plane() -> None:
    flights = [Flight(lat_deg=48.0 + 0.01 * k, address=0x400000 + k) for k in range(3)]

    drive = fused(*(adsb(f, SECONDS[:10]) for f in flights))

    assert len(drive.engine._state.frames.rows) == 1


def test_a_hovering_aircraft_stays_where_it_is() -> None:
    hovering = Flight(speed_mps=0.0, height_m=500.0)
    plots = adsb(hovering, SECONDS, sigma_m=5.0, ground_speed_mps=0.0, track_angle_deg=0.0)

    for mode in ("information", "weighted", "patent"):
        drive = fused(plots, mode=mode)

        assert off_m(drive.elements, hovering).max() < 15.0
        assert drive.elements.ground_speed_mps.max() < 3.0
        assert not drive.elements.rejected.any()
        assert drive.counts[0, 0] == len(plots)


def test_a_standing_aircraft_that_repeats_its_place_is_believed() -> None:
    standing = Flight(speed_mps=0.0, height_m=500.0)

    drive = fused(adsb(standing, SECONDS, ground_speed_mps=0.0, track_angle_deg=0.0))

    assert drive.counts[0, 0] == len(SECONDS)
    assert off_m(drive.elements, standing).max() < 1.0


@pytest.mark.parametrize("period_s", [4.0, 12.0])
def test_a_slow_radar_alone_makes_a_track(period_s: float) -> None:
    far = SensorSettings(id="far", kind="ssr", period_s=period_s, lat_deg=48.35, lon_deg=11.78, height_m=460.0)
    flight = Flight(lat_deg=48.6, lon_deg=12.2, track_deg=70.0, speed_mps=250.0)
    plots = radar(
        flight, np.arange(0.5, 30.0 * period_s, period_s), far, sensor=0, range_sigma_m=50.0, azimuth_sigma_deg=0.07
    )  # fmt: skip

    drive = fused(plots, sensors=(far,))

    assert set(drive.live.track_number.tolist()) == {1}
    assert drive.counts[0, 0] >= 0.9 * len(plots)
    e = drive.elements
    settled = e.span_s[:, 0] > START_S + 10.0 * period_s
    assert np.sqrt(np.mean(off_m(e, flight)[settled] ** 2)) < 150.0
    assert (np.diff(e.span_s, axis=1)[3:] == 8.0).all()
    assert np.abs(e.ground_speed_mps[settled] - 250.0).max() < 25.0
