"""Block kernels against plain 6x6 algebra."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from tests import plain_algebra as plain

from aeroskein import coordinated_turn, kalman
from aeroskein.adjoint import Adjoint

N = 7
# Stored elements that stand on both sides of a diagonal, as rows.
MIRRORED = [(kalman.ROW_OF[i, i + 1], kalman.ROW_OF[i + 1, i]) for i in (0, 2, 4)]

seeds = st.integers(0, 2**31)


def lanes(seed: int, n: int = N) -> tuple[np.random.Generator, np.ndarray, np.ndarray, np.ndarray]:
    """Random states ``(6, n)``, their covariances in full and in rows."""
    rng = np.random.default_rng(seed)
    full = plain.random_covariance(rng, n)
    x = rng.standard_normal((6, n)) * np.repeat([20_000.0, 200.0, 2.0], 2)[:, None]
    return rng, x, full, kalman.from_matrix(full)


def noise(R: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return R[:, 0, 0], R[:, 0, 1], R[:, 1, 1]


def assert_symmetric_to_the_last_bit(P: np.ndarray) -> None:
    for upper, lower in MIRRORED:
        assert np.array_equal(P[upper], P[lower])


def test_rows_become_matrices_and_back() -> None:
    _, _, full, rows = lanes(1)

    back = kalman.to_matrix(rows)

    assert np.array_equal(back, full)
    assert rows.shape == (24, N)


def test_predict_is_the_matrix_form() -> None:
    rng, x, full, P = lanes(2)
    h, q = rng.uniform(0.0, 30.0, N), rng.uniform(0.0, 4.0, N)
    wanted = [(plain.transition(h[k]), plain.jerk_noise(h[k], q[k])) for k in range(N)]
    wanted_x = np.stack([F @ x[:, k] for k, (F, _) in enumerate(wanted)], axis=1)

    kalman.predict(x, P, h, q)

    plain.close(x, wanted_x, rtol=1e-12)
    plain.close(kalman.to_matrix(P), np.stack([F @ full[k] @ F.T + Q for k, (F, Q) in enumerate(wanted)]), rtol=1e-12)


def test_predict_of_three_models_at_once_is_three_predicts() -> None:
    rng, x, _, P = lanes(3, 3 * N)
    h, q = rng.uniform(0.0, 5.0, N), np.array([[0.0], [0.04], [4.0]])
    xs, Ps = x.reshape(6, 3, N).copy(), P.reshape(24, 3, N).copy()

    kalman.predict(xs, Ps, h, q)

    for m in range(3):
        one_x, one_P = x.reshape(6, 3, N)[:, m].copy(), P.reshape(24, 3, N)[:, m].copy()
        kalman.predict(one_x, one_P, h, np.full(N, q[m, 0]))
        assert np.array_equal(xs[:, m], one_x)
        assert np.array_equal(Ps[:, m], one_P)


def test_no_time_changes_no_bit() -> None:
    _, x, _, P = lanes(4)
    before = x.copy(), P.copy()

    kalman.predict(x, P, np.zeros(N), np.full(N, 4.0))

    assert np.array_equal(x, before[0])
    assert np.array_equal(P, before[1])


@given(seeds, st.floats(0.0, 60.0), st.floats(0.0, 1.0), st.floats(0.0, 4.0))
def test_two_steps_are_one(seed: int, h: float, share: float, q: float) -> None:
    _, x, _, P = lanes(seed, 3)
    whole_x, whole_P = x.copy(), P.copy()

    kalman.predict(whole_x, whole_P, np.full(3, h), np.full(3, q))
    for part in (h * share, h - h * share):
        kalman.predict(x, P, np.full(3, part), np.full(3, q))

    plain.close(x, whole_x, rtol=1e-9, atol=1e-6)
    plain.close(P, whole_P, rtol=1e-9, atol=1e-6 * (1.0 + np.abs(whole_P).max()))


@pytest.mark.parametrize(("first", "H"), [(0, plain.POSITION), (2, plain.VELOCITY)])
def test_update_is_josephs_form(first: int, H: np.ndarray) -> None:
    rng, x, full, P = lanes(5)
    R, z = plain.random_r(rng, N), (H @ x) + rng.standard_normal((2, N)) * 60.0
    wanted = [plain.update(x[:, k], full[k], z[:, k], R[k], H) for k in range(N)]
    one_step = kalman.update_position if first == 0 else kalman.update_velocity

    gains = one_step(x, P, z[0], z[1], *noise(R), np.ones(N, dtype=bool))

    plain.close(x, np.stack([w.x for w in wanted], axis=1))
    plain.close(kalman.to_matrix(P), np.stack([w.P for w in wanted]))
    plain.close(gains.d2, [w.d2 for w in wanted])
    plain.close(gains.det, [w.det for w in wanted])


def test_update_is_filterpys() -> None:
    rng, x, full, P = lanes(6)
    R, z = plain.random_r(rng, N), x[:2] + rng.standard_normal((2, N)) * 60.0
    filters = []
    for k in range(N):
        one = KalmanFilter(6, 2)
        one.x, one.P = x[:, k].copy(), full[k].copy()
        one.update(z[:, k], R=R[k], H=plain.POSITION)
        filters.append(one)

    gains = kalman.update_position(x, P, z[0], z[1], *noise(R), np.ones(N, dtype=bool))

    plain.close(x, np.stack([f.x for f in filters], axis=1))
    plain.close(kalman.to_matrix(P), np.stack([f.P for f in filters]))
    plain.close(gains.d2, [f.mahalanobis**2 for f in filters])


def test_position_then_velocity_is_the_joint_update() -> None:
    rng, x, full, P = lanes(7)
    R, V = plain.random_r(rng, N), plain.random_r(rng, N) / 100.0
    z, v = x[:2] + rng.standard_normal((2, N)) * 30.0, x[2:4] + rng.standard_normal((2, N)) * 3.0
    H = np.vstack([plain.POSITION, plain.VELOCITY])
    joint = []
    for k in range(N):
        both = np.block([[R[k], np.zeros((2, 2))], [np.zeros((2, 2)), V[k]]])
        joint.append(plain.update(x[:, k], full[k], np.concatenate([z[:, k], v[:, k]]), both, H))

    p = kalman.update_position(x, P, z[0], z[1], *noise(R), np.ones(N, dtype=bool))
    w = kalman.update_velocity(x, P, v[0], v[1], *noise(V), np.ones(N, dtype=bool))

    plain.close(x, np.stack([j.x for j in joint], axis=1))
    plain.close(kalman.to_matrix(P), np.stack([j.P for j in joint]))
    # The likelihood of both is the product of the two.
    plain.close(p.d2 + w.d2, [j.d2 for j in joint])
    plain.close(p.det * w.det, [j.det for j in joint])


def test_a_refused_report_changes_no_bit() -> None:
    rng, x, _, P = lanes(8)
    R, ok = plain.random_r(rng, N), np.arange(N) % 2 == 0
    before = x.copy(), P.copy()

    gains = kalman.update_position(x, P, x[0] + 50.0, x[1] - 50.0, *noise(R), ok)

    assert np.array_equal(x[:, ~ok], before[0][:, ~ok])
    assert np.array_equal(P[:, ~ok], before[1][:, ~ok])
    assert (x[:, ok] != before[0][:, ok]).any(axis=0).all()
    assert not gains.a[..., ~ok].any()
    assert not gains.scale[:, ~ok].any()


@pytest.mark.parametrize("first", [0, 2])
def test_late_report_is_seen_through_the_way_back(first: int) -> None:
    rng, x, full, P = lanes(9)
    lag, R = rng.uniform(0.0, 4.0, N), plain.random_r(rng, N)
    H = [plain.lagging(lag[k], first) for k in range(N)]
    z = np.stack([H[k] @ x[:, k] for k in range(N)], axis=1) + rng.standard_normal((2, N)) * 30.0
    wanted = [plain.update(x[:, k], full[k], z[:, k], R[k], H[k]) for k in range(N)]

    i = kalman.lagged_innovation(x, P, first, z[0], z[1], *noise(R), lag)
    gains = kalman.apply(x, P, i, np.ones(N, dtype=bool))

    plain.close(x, np.stack([w.x for w in wanted], axis=1), atol=1e-8)
    plain.close(kalman.to_matrix(P), np.stack([w.P for w in wanted]), atol=1e-7)
    plain.close(gains.d2, [w.d2 for w in wanted])
    assert_symmetric_to_the_last_bit(P)


def test_late_report_without_process_noise_is_as_if_it_had_come_in_time() -> None:
    rng, x, _, P = lanes(10)
    R, h = plain.random_r(rng, N), np.full(N, 2.5)
    z = x[:2] + rng.standard_normal((2, N)) * 30.0
    in_time_x, in_time_P = x.copy(), P.copy()
    kalman.update_position(in_time_x, in_time_P, z[0], z[1], *noise(R), np.ones(N, dtype=bool))
    kalman.predict(in_time_x, in_time_P, h, np.zeros(N))

    kalman.predict(x, P, h, np.zeros(N))
    kalman.apply(x, P, kalman.lagged_innovation(x, P, 0, z[0], z[1], *noise(R), h), np.ones(N, dtype=bool))

    plain.close(x, in_time_x, atol=1e-7)
    plain.close(P, in_time_P, rtol=1e-8, atol=1e-6)


@pytest.mark.parametrize("first", [0, 2])
def test_no_lag_is_no_difference(first: int) -> None:
    rng, x, _, P = lanes(11)
    R, z = plain.random_r(rng, N), x[first : first + 2] + 10.0

    late = kalman.lagged_innovation(x, P, first, z[0], z[1], *noise(R), np.zeros(N))

    for a, b in zip(late, kalman.innovation(x, P, first, z[0], z[1], *noise(R)), strict=True):
        plain.close(a, b, rtol=1e-14)


@given(seeds)
def test_covariances_stay_symmetric_to_the_last_bit_and_positive(seed: int) -> None:
    rng, x, _, P = lanes(seed, 3)
    P[[0, 7]] += 1e8  # as where a flight begins
    P[[12, 17]] += 250.0**2

    for _ in range(40):
        h = rng.choice([0.0, 0.01, 1.0, 12.0, 300.0], 3)
        kalman.predict(x, P, h, rng.choice([0.0, 4e-4, 1.0], 3))
        R = plain.random_r(rng, 3) * rng.choice([1e-2, 1.0, 100.0])
        z = rng.standard_normal((2, 3)) * 100.0
        one_step = (kalman.update_position, kalman.update_velocity)[rng.integers(2)]
        one_step(x, P, z[0], z[1], *noise(R), rng.random(3) < 0.8)

        assert_symmetric_to_the_last_bit(P)
        full = kalman.to_matrix(P)
        sigma = np.sqrt(np.einsum("nii->ni", full))
        assert np.linalg.eigvalsh(full / (sigma[:, :, None] * sigma[:, None, :])).min() > -1e-9


# -- the backward pass ------------------------------------------------------------------------------------------------
def random_events(rng: np.random.Generator, count: int, gaps: list[float]) -> list[plain.Event]:
    """Events of one aircraft: some without a report, some with position only, some with both."""
    events = []
    for _ in range(count):
        kind = rng.integers(4)
        position = (rng.standard_normal(2) * 100.0, plain.random_r(rng, 1)[0]) if kind else None
        velocity = (rng.standard_normal(2) * 10.0, plain.random_r(rng, 1)[0] / 100.0) if kind == 3 else None
        events.append(plain.Event(float(rng.choice(gaps)), float(rng.choice([4e-4, 0.01, 1.0])), position, velocity))
    return events


def run_kernels(
    x: np.ndarray, P: np.ndarray, event: plain.Event
) -> tuple[coordinated_turn.Turned, list[tuple[int, kalman.Gains]]]:
    """One event through the kernels; a report that is missing is one that was refused."""
    q = np.array([event.q])
    turned = coordinated_turn.predict(x, P, np.array([event.h]), plain.ALONG * q, plain.ACROSS * q)
    gains = []
    for first, measured in ((0, event.position), (2, event.velocity)):
        z, R = measured if measured is not None else (np.full(2, 1e6), np.eye(2))
        i = kalman.innovation(x, P, first, z[:1], z[1:], R[:1, 0], R[:1, 1], R[1:, 1])
        gains.append((first, kalman.apply(x, P, i, np.array([measured is not None]))))
    return turned, gains


@given(seeds, st.sampled_from([[0.0], [1.0], [0.0, 0.3, 1.0, 4.0], [1.0, 20.0]]))
def test_adjoint_pass_is_rauch_tung_striebel(seed: int, gaps: list[float]) -> None:
    rng, x, full, P = lanes(seed, 1)
    events = random_events(rng, 12, gaps)
    wanted = plain.rauch_tung_striebel(plain.forward(x[:, 0] * 1e-3, full[0], events), events)
    x *= 1e-3
    filtered, updates = [], []
    for event in events:
        updates.append(run_kernels(x, P, event))
        filtered.append((x.copy(), P.copy()))

    adjoint, found = Adjoint(1), []
    for event, (turned, gains), state in zip(events[::-1], updates[::-1], filtered[::-1], strict=True):
        found.append(adjoint.smooth(*state))
        for first, gain in reversed(gains):
            adjoint.through_update(first, gain)
        adjoint.through_turn(*turned)
        adjoint.through_step(np.array([event.h]))

    sigma = [np.sqrt(np.diag(P_)) for _, P_ in wanted]
    for (got_x, got_P), (want_x, want_P), s in zip(found[::-1], wanted, sigma, strict=True):
        assert (np.abs(got_x[:, 0] - want_x) / s).max() < 1e-5
        assert (np.abs(got_P[0] - want_P) / np.outer(s, s)).max() < 1e-5


def test_adjoint_pass_is_exact_in_ordinary_flight() -> None:
    rng, x, full, P = lanes(12, 1)
    x *= 1e-2
    truth = x[:, 0].copy()
    events = []
    for _ in range(14):
        truth = plain.transition(1.0) @ truth
        z, v = truth[:2] + rng.normal(0, 10, 2), truth[2:4] + rng.normal(0, 1, 2)
        events.append(plain.Event(1.0, 0.01, (z, 100.0 * np.eye(2)), (v, np.eye(2))))
    wanted = plain.rauch_tung_striebel(plain.forward(x[:, 0], full[0], events), events)
    updates, centre = [], (x, P)
    for k, event in enumerate(events):
        updates.append(run_kernels(x, P, event))
        if k == 4:
            centre = x.copy(), P.copy()

    adjoint = Adjoint(1)
    for event, (turned, gains) in zip(events[:4:-1], updates[:4:-1], strict=True):
        for first, gain in reversed(gains):
            adjoint.through_update(first, gain)
        adjoint.through_turn(*turned)
        adjoint.through_step(np.array([event.h]))
    got_x, got_P = adjoint.smooth(*centre)

    plain.close(got_x[:, 0], wanted[4][0], rtol=1e-11)
    plain.close(got_P[0], wanted[4][1], rtol=1e-11)


def test_nothing_later_leaves_the_filter_as_it_is() -> None:
    _, x, full, P = lanes(13)

    smoothed_x, smoothed_P = Adjoint(N).smooth(x, P)

    assert np.array_equal(smoothed_x, x)
    assert np.array_equal(smoothed_P, full)


def test_part_of_an_adjoint_is_a_view() -> None:
    whole = Adjoint(5)

    whole.lanes(2).vector[:] = 1.0

    assert whole.vector[:, :2].all()
    assert not whole.vector[:, 2:].any()
