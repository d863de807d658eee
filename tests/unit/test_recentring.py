"""A track that gets a new plane keeps its state, its history and its uncertainty."""

from __future__ import annotations

import numpy as np
from tests.builders import START_S, Drive, Flight, adsb, distance_m, engine_settings

from aeroskein import geodesy, kalman
from aeroskein.measurements import COLUMNS
from aeroskein.recentring import recentre

EAST, NORTH = COLUMNS.index("east_m"), COLUMNS.index("north_m")
V = [COLUMNS.index("v_east_mps"), COLUMNS.index("v_north_mps")]
R = [COLUMNS.index(name) for name in ("r_ee", "r_en", "r_nn")]


def drive_in_a_far_plane() -> tuple[Drive, np.ndarray]:
    """Two flights; the plane of the first is then put 80 km beside it by hand, everything moved there."""
    flights = [Flight(lat_deg=48.0, lon_deg=11.5), Flight(lat_deg=48.3, lon_deg=11.6, address=0x400000)]
    drive = Drive.of(engine_settings()).feed([adsb(f, np.arange(0.5, 20.0), sigma_m=5.0) for f in flights])
    state = drive.engine._state
    slots = np.array([0])
    # From its own plane to the far one by the way back of the exact change, so that recentring must undo it.
    old = state.frames.rows[state.tracks.frame[slots]]
    state.tracks.frame[slots] = state.frames.near(np.array([48.75]), np.array([11.75]))
    new = state.frames.rows[state.tracks.frame[slots]]
    for bank in (state.live.bank, state.elements.detector):
        work = bank.take(slots)
        for model in range(3):
            moved(work.x[:, model], work.P[:, model], old, new)
        bank.put(slots, work)
    row = state.elements.states[slots].T.copy()
    moved(row[:6], row[6:], old, new)
    state.elements.states[slots] = row.T
    ring = state.buffers.rows[slots][0]
    at = np.flatnonzero(np.isfinite(ring[:, 0]))
    e, n, turn = geodesy.move_frame(old, new, ring[at, EAST], ring[at, NORTH])
    ring[at, EAST], ring[at, NORTH] = e, n
    ring[at[:, None], V] = np.einsum("nij,nj->ni", turn, ring[at[:, None], V])
    ring[at[:, None], R] = geodesy.rotate_covariance(turn, ring[at[:, None], R])
    state.buffers.rows[slots] = ring[None]
    for places in (state.elements.places_m, state.live.places_m):
        for k in (0, 2):
            e, n, _ = geodesy.move_frame(old, new, *places[slots, k : k + 2].T)
            places[0, k : k + 2] = e[0], n[0]
    return drive, old


def moved(x: np.ndarray, P: np.ndarray, old: np.ndarray, new: np.ndarray) -> None:
    """A state and its covariance in place, by full matrices."""
    e, n, turn = geodesy.move_frame(old, new, x[0], x[1])
    J = np.kron(np.eye(3), turn[0])
    P[:] = kalman.from_matrix(J @ kalman.to_matrix(P) @ J.T)
    x[2:] = J[2:, 2:] @ x[2:]
    x[0], x[1] = e, n


def seen(drive: Drive) -> tuple[np.ndarray, ...]:
    """Where the first track's reports, live state and settled state are on the globe."""
    state = drive.engine._state
    frames = state.frames.rows[state.tracks.frame[[0]]]
    ring = state.buffers.rows[np.array([0])][0]
    ring = ring[np.isfinite(ring[:, 0])]
    bank = state.live.bank.rows[0]
    settled = state.elements.states[0]
    published = np.concatenate([state.elements.places_m[0], state.live.places_m[0]])
    return (
        *geodesy.from_plane(frames, ring[:, EAST], ring[:, NORTH]),
        *geodesy.from_plane(frames, bank[0:3], bank[3:6]),
        *geodesy.from_plane(frames, settled[[0]], settled[[1]]),
        *geodesy.from_plane(frames, published[::2], published[1::2]),
    )


def test_nothing_moves_on_the_globe() -> None:
    drive, _ = drive_in_a_far_plane()
    before = seen(drive)

    slots = recentre(drive.engine._state)

    assert slots.tolist() == [0]
    for k in range(0, 8, 2):
        after = seen(drive)
        assert distance_m(before[k], before[k + 1], after[k], after[k + 1]).max() < (
            0.01 if k == 0 else 1e-5
        )  # rings round


def test_the_new_plane_is_the_nearest() -> None:
    drive, own = drive_in_a_far_plane()
    state = drive.engine._state

    recentre(state)

    assert np.array_equal(state.frames.rows[state.tracks.frame[0]], own[0])
    e, n, _, _ = state.live.bank.steady(np.array([0]))
    assert np.hypot(e, n)[0] < 22_000.0


def test_covariances_and_velocities_turn_with_the_plane() -> None:
    drive, _ = drive_in_a_far_plane()
    wanted = Drive.of(engine_settings()).feed(
        [
            adsb(f, np.arange(0.5, 20.0), sigma_m=5.0)
            for f in (Flight(), Flight(lat_deg=48.3, lon_deg=11.6, address=0x400000))
        ]
    )

    recentre(drive.engine._state)

    one, other = drive.engine._state, wanted.engine._state
    # There and back again; the Jacobian is that of the live state's place, the same for reports some kilometres off.
    np.testing.assert_allclose(one.live.bank.rows[0], other.live.bank.rows[0], rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(one.elements.states[0], other.elements.states[0], rtol=1e-4, atol=2e-3)
    rings = [engine.buffers.rows[np.array([0])] for engine in (one, other)]
    np.testing.assert_allclose(*rings, rtol=1e-4, atol=5e-3)


def test_accelerations_turn_too() -> None:
    drive, _ = drive_in_a_far_plane()
    state = drive.engine._state
    far = state.frames.rows[state.tracks.frame[[0]]]
    state.elements.states[0, 4:6] = 3.0, -2.0
    east, north, _, _ = state.live.bank.steady(np.array([0]))

    recentre(state)

    _, _, turn = geodesy.move_frame(far, state.frames.rows[state.tracks.frame[[0]]], east, north)
    np.testing.assert_allclose(state.elements.states[0, 4:6], turn[0] @ [3.0, -2.0], rtol=1e-12)
    assert abs(turn[0, 0, 1]) > 1e-3


def test_covariances_stay_symmetric_to_the_last_bit() -> None:
    drive, _ = drive_in_a_far_plane()

    recentre(drive.engine._state)

    P = drive.engine._state.elements.states[0, 6:]
    for i in (0, 2, 4):
        assert P[kalman.ROW_OF[i, i + 1]] == P[kalman.ROW_OF[i + 1, i]]


def test_tracks_near_their_origin_stay() -> None:
    drive = Drive.of(engine_settings()).feed(adsb(Flight(), np.arange(0.5, 10.0)))
    before = drive.engine._state.live.bank.rows.copy()

    assert recentre(drive.engine._state).tolist() == []
    assert np.array_equal(drive.engine._state.live.bank.rows, before)


def test_elements_go_on_as_if_nothing_had_happened() -> None:
    drive, _ = drive_in_a_far_plane()
    recentre(drive.engine._state)
    rest = [adsb(f, np.arange(20.5, 40.0), sigma_m=5.0, seed=1) for f in (
        Flight(lat_deg=48.0, lon_deg=11.5), Flight(lat_deg=48.3, lon_deg=11.6, address=0x400000))]  # fmt: skip

    drive.feed(rest).finish()

    e = drive.elements.take(np.flatnonzero(drive.elements.address == 0x3C6444))
    late = e.take(np.flatnonzero(e.span_s[:, 0] > START_S + 20.0))
    lat, lon, _ = Flight(lat_deg=48.0, lon_deg=11.5).at(late.time_s - START_S)
    assert distance_m(late.lat_deg, late.lon_deg, lat, lon).max() < 12.0
    assert not e.rejected.any()
