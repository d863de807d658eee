"""The watches over radars and aircraft: jumps, contradicting aircraft, places."""

import numpy as np
import pytest

from aeroskein.registration.consistency import contradicting_aircraft
from aeroskein.registration.jumps import PERSIST_S, JumpWatch
from aeroskein.registration.places import BAN_S, SILENT_S, Places
from aeroskein.registration.rows import Rows, bias_jacobian


def innovations(n: int, shift: tuple[float, float], rng: np.random.Generator, aircraft: int = 10) -> tuple:
    ground = rng.uniform(30e3, 120e3, n)
    angle = rng.uniform(0, 2 * np.pi, n)
    H = bias_jacobian(ground, ground, 200 * np.cos(angle), 200 * np.sin(angle))
    spread = np.zeros((n, 2, 2))
    spread[:, 0, 0], spread[:, 1, 1] = 55.0**2, (ground * np.radians(0.075)) ** 2
    error = H[:, :, 0] * shift[0] + H[:, :, 1] * shift[1]
    error += rng.normal(size=(n, 2)) * np.sqrt(np.stack([spread[:, 0, 0], spread[:, 1, 1]], axis=-1))
    return rng.integers(0, aircraft, n), error, spread, H


def watch(shift: tuple[float, float], aircraft: int = 10) -> list:
    rng, w = np.random.default_rng(1), JumpWatch()
    out = []
    for second in range(60):
        names, error, spread, H = innovations(5, shift, rng, aircraft)
        w.add(np.full(5, float(second)), names, error, spread, H)
        out.append(w.check(float(second)))
    return out


@pytest.mark.parametrize("shift", [(120.0, 0.0), (0.0, 0.2), (-80.0, 5.0)])
def test_a_shift_is_found_with_its_size(shift: tuple[float, float]) -> None:
    found = [f for f in watch(shift) if f is not None]

    assert found[-1][1][:2] == pytest.approx(shift, abs=15.0)
    assert abs(found[-1][1][1] - shift[1]) < 0.03


def test_a_shift_must_last_before_it_is_believed() -> None:
    found = watch((300.0, 0.0))

    first = next(k for k, f in enumerate(found) if f is not None)
    assert first >= PERSIST_S


def test_noise_alone_is_no_jump() -> None:
    assert all(f is None for f in watch((0.0, 0.0)))


def test_one_aircraft_alone_cannot_make_a_radar_jump() -> None:
    assert all(f is None for f in watch((500.0, 0.0), aircraft=1))


def anchored(offsets: dict[int, tuple[float, float]], aircraft: int, wild: float, seed: int) -> Rows:
    """A minute of one biased radar; some aircraft report themselves beside where they are."""
    rng = np.random.default_rng(seed)
    n = 15 * aircraft
    name = np.tile(np.arange(aircraft), 15)
    ground = np.tile(rng.uniform(30e3, 120e3, aircraft), 15)
    heading, bearing = (np.tile(rng.uniform(0, 2 * np.pi, aircraft), 15) for _ in range(2))
    v = 200.0 * np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    u = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    axes = np.stack([u, np.stack([u[:, 1], -u[:, 0]], axis=-1)], axis=1)
    polar_v = np.einsum("nij,nj->ni", axes, v)
    H = bias_jacobian(ground, ground, polar_v[:, 0], polar_v[:, 1])
    R = np.zeros((n, 2, 2))
    R[:, 0, 0], R[:, 1, 1] = 50.0**2, (ground * np.radians(0.07)) ** 2
    error = H @ np.array([80.0, -0.2, 0.3, 0.0]) + rng.normal(size=(n, 2)) * np.sqrt(
        np.stack([R[:, 0, 0], R[:, 1, 1]], axis=-1)
    )
    error += (rng.random((n, 1)) < wild) * rng.normal(size=(n, 2)) * 3000.0
    for one, offset in offsets.items():
        error[name == one] -= np.einsum("nij,j->ni", axes[name == one], np.array(offset))
    of_aircraft = np.concatenate([polar_v[:, :, None], -axes], axis=2)
    return Rows(
        np.repeat(np.arange(15.0) * 4, aircraft), error, R, np.ones(n, dtype=np.int64), np.full(n, -1), H,
        np.zeros((n, 2, 4)), np.zeros((n, 2)), name, of_aircraft, np.zeros((n, 2)),
    )  # fmt: skip


def test_aircraft_beside_themselves_are_named() -> None:
    rows = anchored({2: (500.0, 300.0), 6: (-700.0, 0.0)}, aircraft=9, wild=0.0, seed=1)

    assert contradicting_aircraft(rows, 0.1).tolist() == [2, 6]


@pytest.mark.parametrize("seed", range(5))
def test_wild_plots_do_not_make_an_aircraft_wrong(seed: int) -> None:
    assert contradicting_aircraft(anchored({}, aircraft=9, wild=0.05, seed=seed), 0.1).tolist() == []


def test_honest_aircraft_of_a_biased_radar_are_never_wrong() -> None:
    named = [contradicting_aircraft(anchored({}, aircraft=18, wild=0.0, seed=k), 0.05).tolist() for k in range(40)]

    assert named == [[]] * 40


def test_two_aircraft_cannot_say_who_of_them_is_wrong() -> None:
    assert contradicting_aircraft(anchored({1: (900.0, 0.0)}, aircraft=2, wild=0.0, seed=1), 0.1).tolist() == []


def test_an_aircraft_keeps_its_place_and_a_silent_one_gives_it_away() -> None:
    places = Places(4, 1)
    first, _ = places.assign(np.array([11, 12, 11]), np.zeros(3, dtype=np.int64), 0.0)
    places.assign(np.array([12]), np.array([0]), SILENT_S)

    again, fresh = places.assign(np.array([12, 13, 14, 15]), np.zeros(4, dtype=np.int64), SILENT_S + 1.0)

    assert first[0] == first[2] != first[1]
    assert again[0] == first[1]
    assert sorted(again.tolist()) == [0, 1, 2, 3]
    assert len(fresh) == 3


def test_each_radar_brings_in_its_share_only() -> None:
    places = Places(4, 2)

    place, _ = places.assign(np.arange(10), np.zeros(10, dtype=np.int64), 0.0)
    other, _ = places.assign(np.array([50, 0]), np.array([1, 1]), 0.0)

    assert (place >= 0).sum() == 2
    assert (other >= 0).all()


def test_a_banned_aircraft_has_no_place_until_the_ban_ends() -> None:
    places = Places(4, 1)
    places.assign(np.array([11]), np.array([0]), 0.0)

    freed = places.ban(np.array([11]), 0.0)

    assert len(freed) == 1
    assert places.assign(np.array([11]), np.array([0]), BAN_S - 1.0)[0].tolist() == [-1]
    assert places.assign(np.array([11]), np.array([0]), BAN_S + 1.0)[0].tolist() != [-1]
