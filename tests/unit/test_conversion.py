"""Reports become measurements in the plane of their track, with the sigmas that they claim."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.builders import ADSB, RADAR1, START_S, Flight, adsb, distance_m, engine_settings, radar

from aeroskein import conversion, geodesy
from aeroskein.conversion import Located, SensorTable
from aeroskein.measurements import Measurements
from aeroskein.plots import Plots
from aeroskein.settings import SensorSettings

TABLE = SensorTable(engine_settings(ADSB, RADAR1))
NAN = np.nan


def located(plots: Plots, height_m: float = NAN, height_sigma_m: float = 10.0, table: SensorTable = TABLE) -> Located:
    n = len(plots)
    return conversion.locate(plots, table, np.full(n, height_m), np.full(n, height_sigma_m), np.zeros((n, 4)))


def measured(plots: Plots, frames: np.ndarray, height_m: float) -> Measurements:
    n = len(plots)
    where = located(plots, height_m)
    return conversion.measure(plots, plots, where, np.zeros(n, dtype=np.int64), frames, TABLE, np.full(n, 0.2))


# -- sigmas -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("nac_p", "sigma_m"),
    # Half of the widths of DO-260B, 95 %: 0.05 NM, 0.1 NM, 0.3 NM ...
    [
        (11, 1.2),
        (10, 4.1),
        (9, 12.3),
        (8, 37.8),
        (7, 75.7),
        (6, 226.96),
        (5, 378.3),
        (1, 7565.4),
        (0, 10.0),
        (-1, 10.0),
    ],
)
def test_position_sigma_follows_the_accuracy_category(nac_p: int, sigma_m: float) -> None:
    plots = Plots.of(1, nac_p=nac_p)

    assert conversion.position_sigma_m(plots, TABLE)[0] == pytest.approx(sigma_m, rel=0.03)


@pytest.mark.parametrize(("nac_v", "sigma_mps"), [(1, 4.1), (2, 1.2), (3, 0.5), (4, 0.5), (0, 1.0), (-1, 1.0)])
def test_velocity_sigma_follows_the_accuracy_category(nac_v: int, sigma_mps: float) -> None:
    plots = Plots.of(1, nac_v=nac_v)

    assert conversion.velocity_sigma_mps(plots, TABLE)[0] == pytest.approx(sigma_mps, rel=0.03)


def test_a_sigma_in_the_report_overrides_everything() -> None:
    plots = Plots.of(1, nac_p=9, nac_v=1, position_sigma_m=33.0, velocity_sigma_mps=2.2)

    assert conversion.position_sigma_m(plots, TABLE)[0] == 33.0
    assert conversion.velocity_sigma_mps(plots, TABLE)[0] == 2.2


def test_no_sigma_is_unbelievably_small() -> None:
    plots = Plots.of(1, position_sigma_m=1e-6, velocity_sigma_mps=1e-6)

    assert conversion.position_sigma_m(plots, TABLE)[0] == 1.0
    assert conversion.velocity_sigma_mps(plots, TABLE)[0] == 0.5


def test_each_sensor_has_its_own_configured_sigma() -> None:
    wam = SensorSettings(id="wam", kind="wam", position_sigma_m=25.0, velocity_sigma_mps=3.0)
    table = SensorTable(engine_settings(ADSB, wam))
    plots = Plots.of(2, sensor=[1, 0])

    assert conversion.position_sigma_m(plots, table).tolist() == [25.0, 10.0]
    assert conversion.velocity_sigma_mps(plots, table).tolist() == [3.0, 1.0]
    assert table.time_sigma_s.tolist() == [0.2, 0.05]


# -- places -----------------------------------------------------------------------------------------------------------
def test_own_positions_are_taken_as_they_are() -> None:
    plots = adsb(Flight(), [0.0, 10.0])

    where = located(plots, 9000.0)

    assert np.array_equal(where.lat_deg, plots.lat_deg)
    assert np.array_equal(where.lon_deg, plots.lon_deg)
    assert where.covariance.tolist() == [[100.0, 0.0, 100.0]] * 2
    assert where.feasible.all()


@given(
    st.floats(0.0, 360.0, exclude_max=True), st.floats(0.2, 3.0), st.floats(300.0, 12_000.0)
)  # fmt: skip
def test_plots_lie_where_the_aircraft_is(bearing_deg: float, away_deg: float, height_m: float) -> None:
    lat = 48.35 + away_deg * np.cos(np.radians(bearing_deg))
    flight = Flight(lat_deg=lat, lon_deg=11.78 + away_deg * np.sin(np.radians(bearing_deg)), height_m=height_m)

    where = located(radar(flight, [0.0, 30.0]), height_m)

    lat, lon, _ = flight.at([0.0, 30.0])
    assert distance_m(where.lat_deg, where.lon_deg, lat, lon).max() < 0.01
    assert where.feasible.all()


def test_plots_err_as_range_and_azimuth_do() -> None:
    # Due east at 100 km a range error is an error to the east, and 0.07 degrees are 122 m to the north.
    flight = Flight(lat_deg=48.35, lon_deg=13.13, height_m=9000.0)

    ee, en, nn = located(radar(flight, 0.0), 9000.0, height_sigma_m=0.0).covariance[0]

    assert np.sqrt(ee) == pytest.approx(50.0, rel=0.02)
    assert np.sqrt(nn) == pytest.approx(np.radians(0.07) * 100_000.0, rel=0.02)
    assert abs(en) < 0.05 * np.sqrt(ee * nn)


def test_what_registration_has_left_widens_the_covariance() -> None:
    plots = radar(Flight(lat_deg=48.35, lon_deg=13.13), 0.0)
    left = np.array([[120.0, 0.1, 0.0, 0.0]])

    ee, _, nn = conversion.locate(plots, TABLE, np.array([9000.0]), np.zeros(1), left).covariance[0]

    assert np.sqrt(ee) == pytest.approx(np.hypot(50.0, 120.0), rel=0.02)
    assert np.sqrt(nn) == pytest.approx(np.hypot(np.radians(0.07), np.radians(0.1)) * 100_000.0, rel=0.02)


def test_a_plot_without_height_is_uncertain_near_the_radar_and_good_far_away() -> None:
    near, far = Flight(lat_deg=48.35, lon_deg=11.95), Flight(lat_deg=48.35, lon_deg=14.0)

    errors = [located(radar(f, 0.0), NAN) for f in (near, far)]

    for flight, where in zip((near, far), errors, strict=True):
        lat, lon, _ = flight.at(0.0)
        off = float(distance_m(where.lat_deg, where.lon_deg, lat, lon)[0])
        assert off < 3.0 * np.sqrt(where.covariance[0, 0])
    assert np.sqrt(errors[0].covariance[0, 0]) > 1000.0
    assert np.sqrt(errors[1].covariance[0, 0]) < 300.0


def test_a_slant_range_below_the_height_is_impossible() -> None:
    plots = Plots.of(2, sensor=1, range_m=[3_000.0, 30_000.0], azimuth_deg=10.0)

    assert located(plots, 9000.0).feasible.tolist() == [False, True]


def test_overhead_a_plot_without_height_is_possible() -> None:
    plots = Plots.of(1, sensor=1, range_m=3_000.0, azimuth_deg=10.0)

    where = located(plots, NAN)

    assert where.feasible.all()
    assert distance_m(where.lat_deg, where.lon_deg, 48.35, 11.78)[0] < 3_100.0
    assert np.isfinite(where.covariance).all()


# -- the plane --------------------------------------------------------------------------------------------------------
places = st.tuples(st.floats(-89.0, 89.0), st.floats(-180.0, 180.0))


@given(places, st.floats(0.0, 360.0, exclude_max=True), st.floats(20.0, 300.0), st.floats(0.0, 15_000.0))
def test_velocity_in_the_plane_is_how_fast_the_place_in_the_plane_changes(
    place: tuple[float, float], track_deg: float, speed_mps: float, height_m: float
) -> None:
    flight = Flight(*place, track_deg=track_deg, speed_mps=speed_mps, height_m=height_m)
    frames = geodesy.frame_rows(*geodesy.snap_origin(np.array([place[0]]), np.array([place[1]])))
    lat, lon, _ = flight.at([0.0, 2.0])

    m = measured(adsb(flight, 1.0), frames, height_m)

    e, n = geodesy.to_plane(frames, lat, lon)
    assert m.v_east_mps[0] == pytest.approx((e[1] - e[0]) / 2.0, abs=2e-3 * speed_mps)
    assert m.v_north_mps[0] == pytest.approx((n[1] - n[0]) / 2.0, abs=2e-3 * speed_mps)
    # At its height an aircraft moves faster than its foot point.
    moved = np.hypot(*(np.diff(c)[0] for c in (e, n))) / 2.0
    assert np.hypot(m.v_east_mps[0], m.v_north_mps[0]) == pytest.approx(moved, rel=1e-3)


def test_radars_give_no_velocity() -> None:
    plots = radar(Flight(), 0.0, ground_speed_mps=200.0, track_angle_deg=60.0)

    m = measured(plots, geodesy.frame_rows(48.0, 11.5), 9000.0)

    assert np.isnan([m.v_east_mps[0], m.v_north_mps[0], m.velocity_variance[0]]).all()


def test_a_report_without_velocity_has_no_velocity_variance() -> None:
    m = measured(adsb(Flight(), 0.0, ground_speed_mps=NAN, track_angle_deg=NAN), geodesy.frame_rows(48.0, 11.5), 9000.0)

    assert np.isnan(m.velocity_variance[0])


def test_covariances_turn_with_the_meridians() -> None:
    # 2 degrees of longitude from the origin at latitude 60 the meridians converge by 1.73 degrees.
    flight = Flight(lat_deg=60.0, lon_deg=12.0)
    plots = adsb(flight, 0.0)
    where = located(plots, 0.0)
    where.covariance[:] = [100.0, 0.0, 10_000.0]
    frames = geodesy.frame_rows(60.0, 10.0)

    m = conversion.measure(plots, plots, where, np.zeros(1, dtype=np.int64), frames, TABLE, np.array([0.2]))

    angle = 0.5 * np.degrees(np.arctan2(2.0 * m.r_en[0], m.r_nn[0] - m.r_ee[0]))
    assert abs(angle) == pytest.approx(2.0 * np.sin(np.radians(60.0)), rel=0.01)
    assert m.trace_m2[0] == pytest.approx(10_100.0, rel=2e-3)


def test_measurements_keep_what_was_reported_beside_what_was_corrected() -> None:
    raw = radar(Flight(), 0.0, received_s=START_S + 1.5)
    corrected = raw.take(np.arange(1))
    corrected.time_s = raw.time_s - 0.3
    corrected.range_m = raw.range_m - 80.0
    where = located(corrected, 9000.0)

    m = conversion.measure(
        raw, corrected, where, np.array([7]), geodesy.frame_rows(48.0, 11.5), TABLE, np.array([0.1])
    )  # fmt: skip

    assert (m.time_s[0], m.stamp_s[0]) == (START_S - 0.3, START_S)
    assert (m.range_m[0], m.azimuth_deg[0]) == (raw.range_m[0], raw.azimuth_deg[0])
    assert (m.slot[0], m.sensor[0], m.received_s[0]) == (7, 1.0, START_S + 1.5)
    assert m.time_variance[0] == pytest.approx(0.01)
    assert m.altitude_m[0] == raw.altitude_m[0]


def test_rows_are_taken_together() -> None:
    where = located(adsb(Flight(), [0.0, 1.0, 2.0]), 9000.0).take(np.array([2, 0]))

    assert len(where.lat_deg) == len(where.covariance) == len(where.feasible) == 2
