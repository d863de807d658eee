"""The sequential test on differences between own positions and plots."""

import numpy as np
import pytest

from aeroskein.integrity.agreement import ALLOWED_M, Agreement

SURE = np.ones(2, dtype=np.bool_)
SIGMA_M = 70.0
V = np.array([[200.0, 0.0]])


def play(offsets: list[tuple[float, float]], seed: int | None = None, sensor: int = 0) -> tuple[Agreement, list[float]]:
    """Looks every four seconds with the given differences; strength after each."""
    rng = np.random.default_rng(seed)
    agreement, strengths = Agreement(np.array([4.0, 4.0]), 3), []
    for k, offset in enumerate(offsets):
        noise = np.zeros((1, 2)) if seed is None else rng.normal(size=(1, 2)) * SIGMA_M
        agreement.add(
            np.array([sensor]), np.array([1]), np.array([4.0 * k]), np.array([offset]) + noise,
            np.array([[SIGMA_M**2, 0.0, SIGMA_M**2]]), V, np.array([True]),
        )  # fmt: skip
        strengths.append(float(agreement.strength(np.array([1]), 4.0 * k, SURE)[0][0]))
    return agreement, strengths


def test_agreeing_looks_have_no_strength() -> None:
    assert max(play([(0.0, 0.0)] * 20)[1]) == 0.0


def test_one_wild_plot_is_not_enough_and_neither_are_two() -> None:
    assert max(play([(0.0, 0.0)] * 5 + [(0.0, 5000.0)] * 2)[1]) < 5.5


def test_a_jump_shows_by_the_third_look() -> None:
    assert max(play([(0.0, 0.0)] * 5 + [(0.0, 5000.0)] * 3)[1]) > 5.5


def test_a_slow_drift_shows_before_it_is_half_a_kilometre() -> None:
    strengths = play([(0.0, 2.0 * 4.0 * k) for k in range(100)], seed=1)[1]

    first = next(k for k, s in enumerate(strengths) if s > 5.5)
    assert 8.0 * first < 400.0


def test_a_latency_of_a_quarter_second_is_learned_and_honest() -> None:
    assert max(play([(50.0, 0.0)] * 100, seed=2)[1]) < 4.0


def test_honest_noise_stays_below_the_limit() -> None:
    assert max(max(play([(0.0, 0.0)] * 200, seed=k)[1]) for k in range(4)) < 4.5


def test_a_small_offset_within_the_allowance_has_no_strength() -> None:
    assert max(play([(0.0, 0.9 * ALLOWED_M)] * 50)[1]) == 0.0


def test_a_radar_that_is_not_sure_does_not_count_in_the_combined_mean() -> None:
    agreement, _ = play([(0.0, 0.0)] * 5)
    for k in range(5, 9):
        agreement.add(
            np.array([1]), np.array([1]), np.array([4.0 * k]), np.array([[0.0, 4000.0]]),
            np.array([[SIGMA_M**2, 0.0, SIGMA_M**2]]), V, np.array([False]),
        )  # fmt: skip

    combined, by_sensor = agreement.strength(np.array([1]), 36.0, np.array([True, False]))

    assert combined[0] == 0.0
    assert by_sensor[1, 0] > 3.0


def test_slots_grow_keep_and_are_reset() -> None:
    agreement, strengths = play([(0.0, 3000.0)] * 4)

    agreement.grow(6)
    kept = agreement.strength(np.array([1, 5]), 12.0, SURE)[0]
    agreement.reset(np.array([1]))

    assert kept[0] == pytest.approx(strengths[-1])
    assert kept[1] == 0.0
    assert agreement.strength(np.array([1]), 12.0, SURE)[0][0] == 0.0
