"""Weights by pairwise comparison: the published matrix, and what is refused."""

import numpy as np
import pytest
from scipy.linalg import eig

from aeroskein.ahp import PairwiseWeights, pairwise_weights, renormalise
from aeroskein.errors import SettingsError
from aeroskein.settings import AssociationSettings

MATRIX = [[1, 4, 3, 5], [1 / 4, 1, 1 / 2, 2], [1 / 3, 2, 1, 2], [1 / 5, 1 / 2, 1 / 2, 1]]


def _random_reciprocal(rng: np.random.Generator, size: int, contradiction: float) -> np.ndarray:
    importance = rng.normal(size=size)
    noise = np.triu(rng.normal(size=(size, size)) * contradiction, 1)
    return np.exp(importance[:, None] - importance[None, :] + noise - noise.T)


def test_distance_weighs_more_than_half_in_the_default_matrix() -> None:
    made = pairwise_weights(MATRIX)

    assert made.weights == pytest.approx([0.550, 0.142, 0.214, 0.094], abs=5e-4)
    assert made.consistency_ratio == pytest.approx(0.021, abs=5e-4)


def test_default_setting_is_that_matrix() -> None:
    assert np.array_equal(pairwise_weights(AssociationSettings().pairwise).weights, pairwise_weights(MATRIX).weights)


@pytest.mark.parametrize("seed", range(20))
def test_weights_are_the_principal_eigenvector(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = _random_reciprocal(rng, int(rng.integers(3, 8)), 0.1)

    made = pairwise_weights(matrix)

    # Two independent ways: scipy's eigenvectors, and powers of the matrix.
    values, vectors = eig(matrix)
    principal = np.abs(vectors[:, values.real.argmax()])
    powered = np.linalg.matrix_power(matrix / len(matrix), 200).sum(axis=1)
    assert made.weights == pytest.approx(principal / principal.sum(), rel=1e-9)
    assert made.weights == pytest.approx(powered / powered.sum(), rel=1e-9)
    assert made.largest_eigenvalue == pytest.approx(values.real.max(), rel=1e-12)


def test_comparisons_that_agree_give_back_their_weights() -> None:
    weights = np.array([0.5, 0.3, 0.15, 0.05])

    made = pairwise_weights(weights[:, None] / weights[None, :])

    assert made.weights == pytest.approx(weights, rel=1e-12)
    assert made.largest_eigenvalue == pytest.approx(4.0)
    assert made.consistency_ratio == pytest.approx(0.0, abs=1e-12)


def test_consistency_index_follows_from_the_eigenvalue() -> None:
    made = pairwise_weights(MATRIX)

    assert made.consistency_index == pytest.approx((made.largest_eigenvalue - 4) / 3)
    assert made.consistency_ratio == pytest.approx(made.consistency_index / 0.90)


@pytest.mark.parametrize("matrix", [[[1.0]], [[1.0, 9.0], [1 / 9, 1.0]]])
def test_one_or_two_factors_cannot_contradict(matrix: list[list[float]]) -> None:
    made = pairwise_weights(matrix)

    assert made.consistency_ratio == 0.0
    assert made.weights.sum() == pytest.approx(1.0)


def test_a_matrix_typed_with_two_digits_is_accepted() -> None:
    made: PairwiseWeights = pairwise_weights([[1, 3, 5], [0.33, 1, 2], [0.2, 0.5, 1]])

    assert made.weights.sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        ([], "square"),
        ([[1, 2], [0.5, 1], [1, 1]], "square"),
        ([[1, 2], [0.5]], "square"),
        (np.ones((11, 11)).tolist(), "square"),
        ([[1, -2], [-0.5, 1]], "above 0, got -2"),
        ([[1, 0], [0, 1]], "above 0, got 0"),
        ([[1, float("nan")], [1, 1]], "above 0, got nan"),
        ([[1, float("inf")], [1, 1]], "above 0, got inf"),
        ([[1, 3], [0.5, 1]], "row 2 column 1 to be 1 / 3, got 0.5"),
        ([[2, 1], [1, 1]], "row 1 column 1 to be 1 / 2, got 2"),
        ([[1, 9, 1 / 9], [1 / 9, 1, 9], [9, 1 / 9, 1]], "consistency ratio below 0.1"),
    ],
)
def test_a_matrix_that_cannot_work_is_refused_by_name(matrix: list[list[float]], said: str) -> None:
    with pytest.raises(SettingsError) as caught:
        pairwise_weights(matrix)

    assert caught.value.key == "association.pairwise"
    assert said in caught.value.expected


def test_a_contradictory_matrix_stops_the_settings() -> None:
    contradictory = (
        (1.0, 9.0, 1 / 9, 1.0),
        (1 / 9, 1.0, 9.0, 1.0),
        (9.0, 1 / 9, 1.0, 1.0),
        (1.0, 1.0, 1.0, 1.0),
    )

    with pytest.raises(SettingsError, match="consistency ratio"):
        AssociationSettings(pairwise=contradictory)


def test_missing_factors_leave_their_weight_to_the_others() -> None:
    shares = renormalise(np.array([0.5, 0.3, 0.2]), np.array([[True, True, True], [True, False, True]]))

    assert shares[0] == pytest.approx([0.5, 0.3, 0.2])
    assert shares[1] == pytest.approx([5 / 7, 0.0, 2 / 7])


def test_without_any_factor_there_are_no_weights() -> None:
    shares = renormalise(np.array([0.5, 0.5]), np.array([[False, False]]))

    assert np.isnan(shares).all()
