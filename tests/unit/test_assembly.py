"""States in the plane become points on the globe: checked by PROJ and by going there and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.builders import ADSB, GEOD, distance_m, engine_settings

from aeroskein import geodesy
from aeroskein.assembly import PlaneState, assemble
from aeroskein.frames import FrameTable
from aeroskein.points import FusedPoints, Product, Status
from aeroskein.tracks import TrackTable

NAN = np.nan


def point(
    lat0: float, lon0: float, x: tuple[float, float, float, float], height_m: float = 9000.0, altitude_m: float = NAN,
    cov: tuple[float, float, float] = (100.0, 30.0, 400.0),
) -> FusedPoints:  # fmt: skip
    """One point, its track's plane near the given place."""
    tracks, frames = TrackTable(engine_settings(ADSB), 42), FrameTable()
    slots = tracks.open(np.array([0x3C6444], dtype=np.int32), np.array([True]))
    tracks.frame[slots] = frames.near(np.array([lat0]), np.array([lon0]))
    one = np.ones(1)
    state = PlaneState(
        5.0 * one, np.array(x)[:, None], np.array(cov)[:, None], 0.01 * np.array(cov)[:, None],
        altitude_m * one, height_m * one, 3.0 * one,
    )  # fmt: skip
    return assemble(
        Product.ELEMENT, slots, state, tracks, frames, seq=np.array([7]), element=np.array([3]),
        span_s=np.array([[3.0, 7.0]]), master=np.array([0], dtype=np.int16), sources=np.array([[4]], dtype=np.int32),
        rejected=np.array([1], dtype=np.int32), input_received_s=NAN * one,
        status=np.array([Status.CONFIRMED], dtype=np.uint8), flags=np.array([0], dtype=np.uint16),
    )  # fmt: skip


def place(lat0: float, lon0: float, e: float, n: float) -> tuple[float, float]:
    """Latitude and longitude of plane coordinates."""
    frames = geodesy.frame_rows(*geodesy.snap_origin(np.array([lat0]), np.array([lon0])))
    lat, lon = geodesy.from_plane(frames, np.array([e]), np.array([n]))
    return float(lat[0]), float(lon[0])


places = st.tuples(st.floats(-89.5, 89.5), st.floats(-180.0, 180.0))
offsets_m = st.floats(-60_000.0, 60_000.0)
speeds = st.tuples(st.floats(-250.0, 250.0), st.floats(-250.0, 250.0)).filter(lambda v: np.hypot(*v) > 20.0)


@given(places, offsets_m, offsets_m, speeds)
def test_speed_and_track_angle_are_how_the_point_moves_over_the_globe(
    origin: tuple[float, float], e: float, n: float, v: tuple[float, float]
) -> None:
    p = point(*origin, (e, n, *v), height_m=9000.0)

    before, after = (place(*origin, e + s * v[0], n + s * v[1]) for s in (-0.5, 0.5))
    length = GEOD.inv(before[1], before[0], after[1], after[0])[2]
    middle, _, _ = GEOD.inv(p.lon_deg[0], p.lat_deg[0], after[1], after[0])
    # 9 km up a second is 0.14 % longer than on the ground; the radius of the earth differs by 0.7 %.
    assert p.ground_speed_mps[0] == pytest.approx(length * (1.0 + 9000.0 / 6.371e6), rel=3e-5)
    assert abs((p.track_angle_deg[0] - middle + 180.0) % 360.0 - 180.0) < 0.02
    assert 0.0 <= p.track_angle_deg[0] < 360.0
    assert distance_m(p.lat_deg, p.lon_deg, *place(*origin, e, n))[0] < 1e-3


@given(places, offsets_m, offsets_m)
def test_covariance_is_that_of_small_displacements(origin: tuple[float, float], e: float, n: float) -> None:
    cov = (100.0, 30.0, 400.0)

    p = point(*origin, (e, n, 100.0, 0.0), height_m=0.0, cov=cov)

    # Where one sigma of the plane's ellipse lies on the globe, in metres east and north of the point.
    root = np.linalg.cholesky(np.array([[cov[0], cov[1]], [cov[1], cov[2]]]))
    steps = []
    for step in (root[:, 0], root[:, 1]):
        there = place(*origin, e + step[0], n + step[1])
        azimuth, _, length = GEOD.inv(p.lon_deg[0], p.lat_deg[0], there[1], there[0])
        steps.append(length * np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))]))
    wanted = sum(np.outer(s, s) for s in steps)
    got = p.position_cov_m2[0]
    assert got.tolist() == pytest.approx([wanted[0, 0], wanted[0, 1], wanted[1, 1]], abs=0.2)
    assert (0.01 * got).tolist() == pytest.approx(p.velocity_cov_m2ps2[0].tolist(), rel=1e-9)


def test_speed_is_that_at_the_aircrafts_height() -> None:
    ground, high = point(48.0, 11.5, (0.0, 0.0, 200.0, 0.0), 0.0), point(48.0, 11.5, (0.0, 0.0, 200.0, 0.0), 12_000.0)

    assert high.ground_speed_mps[0] / ground.ground_speed_mps[0] == pytest.approx(1.0 + 12_000.0 / 6.38e6, rel=1e-5)


def test_where_no_height_is_known_the_altitude_scales_the_speed() -> None:
    by_altitude = point(48.0, 11.5, (0.0, 0.0, 200.0, 0.0), height_m=NAN, altitude_m=12_000.0)
    unknown = point(48.0, 11.5, (0.0, 0.0, 200.0, 0.0), height_m=NAN)

    assert by_altitude.ground_speed_mps[0] == point(48.0, 11.5, (0.0, 0.0, 200.0, 0.0), 12_000.0).ground_speed_mps[0]
    assert np.isnan(by_altitude.height_m[0])
    assert unknown.ground_speed_mps[0] == point(48.0, 11.5, (0.0, 0.0, 200.0, 0.0), 0.0).ground_speed_mps[0]


@pytest.mark.parametrize(
    ("v", "angle_deg"), [((0.0, 100.0), 0.0), ((100.0, 0.0), 90.0), ((0.0, -100.0), 180.0), ((-100.0, 0.0), 270.0)]
)
def test_track_angles_run_clockwise_from_north(v: tuple[float, float], angle_deg: float) -> None:
    assert point(48.0, 11.5, (0.0, 0.0, *v)).track_angle_deg[0] == pytest.approx(angle_deg)


@pytest.mark.parametrize("west_mps", [1e-20, 1e-16, 1e-14, 1e-12, 1e-9])
def test_an_angle_just_below_north_is_never_360(west_mps: float) -> None:
    angle_deg = point(0.0, 0.0, (0.0, 0.0, -west_mps, 100.0)).track_angle_deg[0]

    assert 0.0 <= angle_deg < 360.0
    assert min(angle_deg, 360.0 - angle_deg) < 1e-6


def test_a_null_covariance_stays_null() -> None:
    assert np.isnan(point(48.0, 11.5, (0.0, 0.0, 100.0, 0.0), cov=(NAN, NAN, NAN)).position_cov_m2).all()


def test_identity_and_numbers_are_passed_on() -> None:
    p = point(48.0, 11.5, (0.0, 0.0, 100.0, 0.0))

    assert (p.track_number[0], p.address[0], p.label[0], p.renamed_to[0]) == (42, 0x3C6444, 0x3C6444, -1)
    assert (p.seq[0], p.element[0], p.time_s[0], p.vertical_rate_mps[0]) == (7, 3, 5.0, 3.0)
    assert p.span_s.tolist() == [[3.0, 7.0]]
    assert p.product is Product.ELEMENT
