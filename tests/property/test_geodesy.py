"""Properties of the fusion plane that hold everywhere on the globe."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from aeroskein import ellipsoid, geodesy

latitudes = st.floats(-90.0, 90.0)
longitudes = st.floats(-180.0, 180.0)
offsets_m = st.floats(-400_000.0, 400_000.0)


@given(latitudes, longitudes, st.floats(-1000.0, 100_000.0))
def test_geodetic_to_earth_centred_and_back_is_exact(lat: float, lon: float, height: float) -> None:
    here = ellipsoid.to_ecef(np.array([lat]), np.array([lon]), np.array([height]))

    back = ellipsoid.to_ecef(*ellipsoid.from_ecef(here))

    assert np.abs(back - here).max() < 2e-6


@given(latitudes, longitudes, offsets_m, offsets_m)
def test_plane_to_geodetic_and_back_is_exact(lat: float, lon: float, e: float, n: float) -> None:
    frames = geodesy.frame_rows(lat, lon)

    back = geodesy.to_plane(frames, *geodesy.from_plane(frames, np.array([e]), np.array([n])))

    assert np.abs(np.concatenate(back) - [e, n]).max() < 1e-6


@given(latitudes, longitudes)
def test_every_origin_is_a_place_on_earth_near_its_position(lat: float, lon: float) -> None:
    origin = geodesy.snap_origin(np.array([lat]), np.array([lon]))

    e, n = geodesy.to_plane(geodesy.frame_rows(*origin), np.array([lat]), np.array([lon]))

    assert -90.0 <= origin[0][0] <= 90.0
    assert -180.0 <= origin[1][0] < 180.0
    assert np.hypot(e, n)[0] < 22_000.0


@given(latitudes, longitudes, offsets_m, offsets_m, latitudes, longitudes)
def test_there_and_back_between_frames_changes_nothing(
    lat: float, lon: float, e: float, n: float, dlat: float, dlon: float
) -> None:
    old = geodesy.frame_rows(lat, lon)
    new = geodesy.frame_rows(np.clip(lat + dlat / 90.0, -90.0, 90.0), lon + dlon / 180.0)

    out = geodesy.move_frame(old, new, np.array([e]), np.array([n]))
    back = geodesy.move_frame(new, old, out[0], out[1])

    assert np.abs(np.concatenate(back[:2]) - [e, n]).max() < 1e-6
    assert np.abs(out[2] @ back[2] - np.eye(2)).max() < 1e-9
