"""The three-model filter against a textbook IMM with full matrices."""

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from hypothesis import given
from hypothesis import strategies as st
from tests import plain_algebra as plain

from aeroskein import kalman, manoeuvre

N = 5
GATE = 36.0
ALL = np.ones(N, dtype=bool)
seeds = st.integers(0, 2**31)
# What leaves steady flight in four seconds, live: to a turn and to a change of speed.
T_OUT = 0.016 / 1.032 + 0.004 / 1.008


def steady(P: np.ndarray) -> np.ndarray:
    """A covariance of the steady model: no acceleration, but for what keeps it regular."""
    P = P.copy()
    P[..., 4:, :] = P[..., :, 4:] = 0.0
    P[..., 4, 4] = P[..., 5, 5] = 1e-4
    return P


def models(seed: int, n: int = N) -> tuple[np.random.Generator, list[plain.Models]]:
    """Random models of n aircraft that agree about where they are to some tens of metres."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(n):
        P = plain.random_covariance(rng, 3)
        P[0] = steady(P[0])
        middle = rng.standard_normal(6) * np.repeat([20_000.0, 150.0, 1.0], 2)
        x = middle + rng.standard_normal((3, 6)) * np.repeat([30.0, 5.0, 0.5], 2)
        x[0, 4:] = 0.0
        made.append(plain.Models(x, P, rng.dirichlet([3.0, 1.0, 1.0])))
    return rng, made


def columns(made: list[plain.Models]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As the kernels keep them: ``(6, 3, n)``, ``(24, 3, n)``, ``(3, n)``."""
    x = np.stack([m.x.T for m in made], axis=2)
    P = kalman.from_matrix(np.stack([m.P for m in made], axis=1))
    return x, P, np.stack([m.mu for m in made], axis=1)


def assert_same(got: tuple[np.ndarray, np.ndarray, np.ndarray], wanted: list[plain.Models]) -> None:
    x, P, mu = got
    plain.close(x, np.stack([m.x.T for m in wanted], axis=2), atol=1e-8)
    plain.close(kalman.to_matrix(P), np.stack([m.P for m in wanted], axis=1), atol=1e-7)
    plain.close(mu, np.stack([m.mu for m in wanted], axis=1), atol=1e-12)


def rates_over(h: float) -> np.ndarray:
    """Transition probabilities by the published rates: rate times time, levelling off at a half."""
    rates = np.array([[0.0, 0.004, 0.012], [0.01, 0.0, 0.03], [0.05, 0.15, 0.0]])
    T = rates * h / (1.0 + 2.0 * rates * h)
    return T + np.diag(1.0 - T.sum(axis=1))


def moved(m: plain.Models, h: float) -> plain.Models:
    """Predict: constant velocity under white acceleration, then constant acceleration under white jerk, twice."""
    F, x, P = plain.transition(h), np.empty((3, 6)), np.empty((3, 6, 6))
    still = np.diag([1.0, 1.0, 1.0, 1.0, 0.0, 0.0])
    x[0], P[0] = F @ still @ m.x[0], F @ still @ m.P[0] @ still @ F.T
    P[0, :4, :4] += np.kron(Q_continuous_white_noise(dim=2, dt=h, spectral_density=0.05**2), np.eye(2))
    P[0, 4:, 4:] += 1e-4 * np.eye(2)
    for i, q in ((1, 0.2**2), (2, 2.0**2)):
        x[i], P[i] = F @ m.x[i], F @ m.P[i] @ F.T + plain.jerk_noise(h, q)
    return plain.Models(x, P, m.mu)


def measured(m: plain.Models, z: np.ndarray, base: np.ndarray, tv: float, rv: float, lag: float) -> plain.Models:
    """Update by position, then velocity; the error of the time stamp acts along an uncertain velocity."""
    log_l = np.zeros(3)
    x, P = m.x.copy(), m.P.copy()
    for i in range(3):
        v = x[i, 2:4]
        done = plain.update(x[i], P[i], z[:2], base + tv * (np.outer(v, v) + P[i, 2:4, 2:4]), plain.lagging(lag, 0))
        x[i], P[i] = done.x, done.P
        log_l[i] = -0.5 * (done.d2 + np.log(done.det))
        if np.isfinite(rv):
            a = x[i, 4:]
            done = plain.update(
                x[i], P[i], z[2:], rv * np.eye(2) + tv * (np.outer(a, a) + P[i, 4:, 4:]), plain.lagging(lag, 2)
            )
            x[i], P[i] = done.x, done.P
            log_l[i] -= 0.5 * (done.d2 + np.log(done.det))
    mu = m.mu * np.exp(log_l - log_l.max())
    mu = np.maximum(mu / mu.sum(), 1e-6)
    return plain.Models(x, P, mu / mu.sum())


def reports(rng: np.random.Generator, made: list[plain.Models], lag: np.ndarray) -> dict[str, np.ndarray]:
    """A report for each aircraft, near where it is."""
    at = np.stack([plain.transition(-lag[k]) @ m.x[1] for k, m in enumerate(made)], axis=1)
    R = plain.random_r(rng, len(made)) / 4.0
    return {
        "z": at[:4] + rng.standard_normal((4, len(made))) * np.array([20.0, 20.0, 3.0, 3.0])[:, None],
        "base": np.stack([R[:, 0, 0], R[:, 0, 1], R[:, 1, 1]]),
        "time_variance": rng.uniform(0.0, 0.04, len(made)),
        "velocity_variance": np.where(np.arange(len(made)) % 2 == 0, 4.0, np.nan),
    }


def test_predict_is_the_textbook_one() -> None:
    rng, made = models(1)
    h = rng.uniform(0.05, 12.0, N)

    got = manoeuvre.predict(*columns(made), h)

    assert_same(got, [moved(plain.interact(m, rates_over(h[k])), h[k]) for k, m in enumerate(made)])


def flying(acceleration_variance: float, turn_share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A flight north at 200 m/s whose turn model, 30 m beside, has that much of the probability."""
    x = np.zeros((6, 3, 1))
    x[3], x[0, 1] = 200.0, 30.0
    variances = np.repeat([900.0, 4.0, 0.0], 2)[None].repeat(3, axis=0)
    variances[1:, 4:] = 0.01
    variances[1, 2:] += acceleration_variance * np.repeat([25.0, 1.0], 2)
    P = kalman.from_matrix(np.stack([np.diag(v) for v in variances])[:, None])
    return x, P, np.array([[0.99 - turn_share], [turn_share], [0.01]])


def test_steady_flight_takes_nothing_from_a_turn_that_hardly_anything_speaks_for() -> None:
    h = np.array([4.0])
    x, P, mu = manoeuvre.predict(*flying(4.0, 0.04), h, manoeuvre.LIVE)
    steady_x, steady_P, _ = manoeuvre.predict(*flying(0.0, 0.04), h, manoeuvre.LIVE)
    likely_x, likely_P, _ = manoeuvre.predict(*flying(4.0, 0.9), h, manoeuvre.LIVE)

    assert np.array_equal(x[:, 0], steady_x[:, 0])
    assert np.array_equal(P[:, 0], steady_P[:, 0])
    # The probability goes over all the same.
    assert mu[0, 0] == pytest.approx(0.95 * (1 - T_OUT) + 0.04 * 0.02 / 1.04 + 0.01 * 0.05 / 1.1, rel=1e-12)
    # A turn that is likely hands over where it is, and what it does not know.
    assert likely_x[0, 0, 0] > 2.0
    assert likely_P[12, 0, 0] > 5.0 * P[12, 0, 0]


def test_a_change_of_speed_lies_along_the_flight() -> None:
    h = np.array([4.0])
    x, P, mu = flying(0.0, 0.04)
    mu[:, 0] = [0.0, 0.0, 1.0]
    moved = P.copy()
    kalman.move(x.copy()[:, 2], moved[:, 2], h)

    grown = manoeuvre.predict(x, P, mu, h, manoeuvre.LIVE)[1][:, 2] - moved[:, 2]

    full = kalman.to_matrix(grown)[0]
    across, along = full[0::2, 0::2], full[1::2, 1::2]
    white = Q_continuous_white_noise(dim=2, dt=4.0, spectral_density=0.15**2)
    plain.close(across[:2, :2], white)
    assert not across[2].any()
    plain.close(along[:2, :2] - white, plain.jerk_noise(4.0, 0.2**2)[1:4:2, 1:4:2])
    plain.close(along[2, 2], 4.0 * 0.2**2)


def test_no_time_changes_no_bit() -> None:
    _, made = models(2)
    before = columns(made)

    after = manoeuvre.predict(*(c.copy() for c in before), np.zeros(N))

    for a, b in zip(after, before, strict=True):
        assert np.array_equal(a, b)


@given(st.floats(0.0, 1e5))
def test_transition_probabilities_are_probabilities(h: float) -> None:
    T = manoeuvre.transition(np.array([h]))[:, :, 0]

    assert (T >= 0.0).all()
    plain.close(T.sum(axis=1), 1.0, rtol=1e-15)
    plain.close(T, rates_over(h), rtol=1e-12)


@pytest.mark.parametrize("late", [False, True])
def test_update_is_the_textbook_one(late: bool) -> None:
    rng, made = models(3)
    lag = rng.uniform(0.1, 4.0, N) if late else np.zeros(N)
    r = reports(rng, made, lag)
    wanted = []
    for k, m in enumerate(made):
        base = r["base"][[0, 1, 1, 2], k].reshape(2, 2)
        wanted.append(measured(m, r["z"][:, k], base, r["time_variance"][k], r["velocity_variance"][k], lag[k]))
    x, P, mu = columns(made)

    mu, ok, _, _ = manoeuvre.step(x, P, mu, **r, lag=lag if late else None, usable=ALL, gate=1e9)

    assert ok.all()
    assert_same((x, P, mu), wanted)


@given(seeds)
def test_probabilities_add_up_to_one(seed: int) -> None:
    rng, made = models(seed, 3)
    x, P, mu = columns(made)

    for _ in range(5):
        x, P, mu = manoeuvre.predict(x, P, mu, rng.uniform(0.0, 8.0, 3))
        z = np.vstack([x[:2, 0], x[2:4, 0]]) + rng.standard_normal((4, 3)) * rng.choice([1.0, 300.0])
        r = reports(rng, made, np.zeros(3)) | {"z": z}
        mu, _, _, _ = manoeuvre.step(x, P, mu, **r, lag=None, usable=np.ones(3, dtype=bool), gate=GATE)

        # One part in a million of a position 50 km from its origin would be 5 cm.
        assert np.abs(mu.sum(axis=0) - 1.0).max() < 1e-12
        assert (mu > 0.9e-6).all()


def test_what_no_model_expects_is_refused_and_changes_nothing() -> None:
    rng, made = models(4)
    x, P, mu = columns(made)
    before = x.copy(), P.copy(), mu.copy()
    r = reports(rng, made, np.zeros(N))
    r["z"][:2] += 5_000.0

    mu, ok, nearest, _ = manoeuvre.step(x, P, mu, **r, lag=None, usable=ALL, gate=GATE)

    assert not ok.any()
    assert (nearest > GATE).all()
    for now, then in zip((x, P, mu), before, strict=True):
        assert np.array_equal(now, then)


def test_a_velocity_that_no_model_expects_is_left_out_while_the_position_counts() -> None:
    rng, made = models(5)
    r = reports(rng, made, np.zeros(N)) | {"velocity_variance": np.full(N, 1.0)}
    x, P, mu = columns(made)
    without = x.copy(), P.copy(), mu.copy()
    absent = r | {"velocity_variance": np.full(N, np.nan)}
    wanted_mu, _, _, _ = manoeuvre.step(*without, **absent, lag=None, usable=ALL, gate=GATE)
    r["z"] = r["z"] + np.array([0.0, 0.0, 400.0, 0.0])[:, None]

    mu, ok, _, _ = manoeuvre.step(x, P, mu, **r, lag=None, usable=ALL, gate=GATE)

    assert ok.all()
    for got, wanted in zip((x, P, mu), (*without[:2], wanted_mu), strict=True):
        assert np.array_equal(got, wanted)


def test_lanes_that_are_not_usable_are_left_alone() -> None:
    rng, made = models(6)
    x, P, mu = columns(made)
    before, usable = (x.copy(), P.copy(), mu.copy()), np.arange(N) != 2

    mu, ok, _, _ = manoeuvre.step(
        x, P, mu, **reports(rng, made, np.zeros(N)), lag=None, usable=usable, gate=GATE
    )  # fmt: skip

    assert np.array_equal(ok, usable)
    for now, then in zip((x, P, mu), before, strict=True):
        assert np.array_equal(now[..., 2], then[..., 2])
        assert not np.array_equal(now[..., 1], then[..., 1])


def test_mixture_has_the_moments_of_its_models() -> None:
    _, made = models(7)

    x, P = manoeuvre.mixture(*columns(made))

    wanted = [plain.combined(m) for m in made]
    plain.close(x, np.stack([w[0] for w in wanted], axis=1))
    plain.close(kalman.to_matrix(P), np.stack([w[1] for w in wanted]))


def test_three_equal_models_begin_a_flight() -> None:
    rng = np.random.default_rng(8)
    x, P = rng.standard_normal((6, N)), kalman.from_matrix(plain.random_covariance(rng, N))

    xs, Ps, mu = manoeuvre.initial(x, P)

    for m in range(3):
        assert np.array_equal(xs[:, m], x)
        assert np.array_equal(Ps[:, m], P)
    plain.close(mu.sum(axis=0), 1.0)


def densities(turn_rate_rad: float) -> list[float]:
    """Density of jerk over 20 s straight and 8 s of turning at 120 m/s, seen once a second by good ADS-B."""
    rng, x = np.random.default_rng(9), np.array([0.0, 0.0, 0.0, 120.0])
    P = np.diag([100.0, 100.0, 1.0, 1.0, 9.0, 9.0])[None]
    state = manoeuvre.initial(np.append(x, [0.0, 0.0])[:, None], kalman.from_matrix(P))
    one, found = np.ones(1), []
    for second in range(28):
        state = manoeuvre.predict(*state, one)
        angle = turn_rate_rad * (second >= 20)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        x = np.concatenate([x[:2] + x[2:], turn @ x[2:]])
        z = x + rng.standard_normal(4) * [5.0, 5.0, 0.7, 0.7]
        mu, _, _, _ = manoeuvre.step(
            *state, z=z[:, None], base=np.array([[25.0], [0.0], [25.0]]), time_variance=0.0 * one,
            velocity_variance=0.5 * one, lag=None, usable=one > 0, gate=GATE,
        )  # fmt: skip
        state = (*state[:2], mu)
        found.append(float(manoeuvre.jerk_density(state[2])[0]))
    return found


def test_rolling_into_a_turn_shows_within_three_seconds_and_passes() -> None:
    found = densities(np.radians(3.0))

    straight, rolling, turning = found[10:20], max(found[20:23]), found[-1]
    assert min(straight) >= 0.02**2
    assert max(straight) < 0.05
    assert rolling > 10.0 * max(straight)
    assert turning < 0.5 * rolling
