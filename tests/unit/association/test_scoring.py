"""Scores of candidate pairs."""

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from aeroskein.association import Candidates, mode_a_cost, velocity_factors
from aeroskein.association.scoring import GATE_BY_DOF, Scorer
from aeroskein.errors import SettingsError
from aeroskein.settings import AssociationSettings

STEP = np.array([[120.0, -60.0], [30.0, 10.0], [400.0, 300.0]])
COV = np.array([[90.0**2, 20.0**2, 70.0**2], [200.0**2, 0.0, 200.0**2], [100.0**2, 0.0, 120.0**2]])


def pairs(plot: list[int], **factors: np.ndarray) -> Candidates:
    n = len(plot)
    return Candidates.of(np.array(plot), np.arange(n), STEP[:n], COV[:n], **factors)


def mahalanobis() -> Scorer:
    return Scorer(AssociationSettings(method="mahalanobis"))


def ahp() -> Scorer:
    return Scorer(AssociationSettings(method="ahp"))


def test_gates_are_chi_square_at_99_9_percent() -> None:
    assert GATE_BY_DOF[1:] == pytest.approx(chi2.ppf(0.999, np.arange(1, 7)), abs=2e-3)


def test_differences_of_costs_are_twice_the_log_likelihood_ratio() -> None:
    candidates = pairs([0, 0, 0], altitude_step_m=np.array([10.0, -40.0, 0.0]), altitude_sigma_m=np.full(3, 25.0))

    cost = mahalanobis().score(candidates).cost

    likelihood = [
        multivariate_normal.logpdf(STEP[k], cov=[[COV[k, 0], COV[k, 1]], [COV[k, 1], COV[k, 2]]])
        - 0.5 * (candidates.altitude_step_m[k] / 25.0) ** 2
        for k in range(3)
    ]
    assert np.diff(cost) == pytest.approx(-2.0 * np.diff(likelihood), rel=1e-9)


def test_the_gate_grows_with_the_factors() -> None:
    step, sigma = np.array([90.0, 10.0, 0.0]), np.full(3, 25.0)

    alone, with_altitude = (
        mahalanobis().score(pairs([0, 1, 2])),
        mahalanobis().score(pairs([0, 1, 2], altitude_step_m=step, altitude_sigma_m=sigma)),
    )

    assert alone.limit == pytest.approx(GATE_BY_DOF[2])
    assert with_altitude.limit == pytest.approx(GATE_BY_DOF[3])
    assert alone.inside.tolist() == [True, True, False]


def test_a_track_that_lacks_a_factor_is_not_favoured_over_one_that_fits() -> None:
    altitude = {"altitude_step_m": np.array([5.0, np.nan]), "altitude_sigma_m": np.array([25.0, np.nan])}
    same = Candidates.of(np.array([0, 0]), np.array([1, 2]), STEP[[0, 0]], COV[[0, 0]], **altitude)

    cost = mahalanobis().score(same).cost

    assert cost[0] < cost[1]


def test_a_track_out_of_its_gate_does_not_keep_a_plot_from_a_vague_one() -> None:
    step, cov = np.array([[500.0, 0.0], [1000.0, 0.0]]), np.array([[50.0**2, 0.0, 50.0**2], [4e3**2, 0.0, 4e3**2]])

    score = mahalanobis().score(Candidates.of(np.array([0, 0]), np.arange(2), step, cov))

    assert score.inside.tolist() == [False, True]
    assert score.cost[1] < score.limit[1]


def test_a_course_of_359_degrees_is_near_one_of_1_degree() -> None:
    course = {"course_step_deg": np.array([358.0]), "course_sigma_deg": np.array([2.0])}

    score = mahalanobis().score(pairs([0], **course))

    assert score.cost[0] - mahalanobis().score(pairs([0])).cost[0] == pytest.approx(1.0)


def test_ahp_distance_is_the_weighted_mean_of_scaled_distances() -> None:
    factors = {
        "speed_step_mps": np.array([12.0]), "speed_sigma_mps": np.array([8.0]),
        "course_step_deg": np.array([-6.0]), "course_sigma_deg": np.array([2.0]),
        "altitude_step_m": np.array([30.0]), "altitude_sigma_m": np.array([25.0]),
    }  # fmt: skip
    one = pairs([0], **factors)

    cost = ahp().score(one).cost[0]

    S = np.array([[COV[0, 0], COV[0, 1]], [COV[0, 1], COV[0, 2]]])
    distance = np.sqrt(STEP[0] @ np.linalg.inv(S) @ STEP[0])
    assert cost == pytest.approx(np.dot([0.550, 0.142, 0.214, 0.094], [distance, 1.5, 3.0, 1.2]), abs=2e-3)


def test_ahp_shares_out_the_weight_of_missing_factors() -> None:
    S = np.array([[COV[0, 0], COV[0, 1]], [COV[0, 1], COV[0, 2]]])

    cost = ahp().score(pairs([0])).cost[0]

    assert cost == pytest.approx(np.sqrt(STEP[0] @ np.linalg.inv(S) @ STEP[0]))


def test_ahp_takes_heading_where_there_is_no_altitude() -> None:
    heading = {"heading_step_deg": np.array([9.0]), "heading_sigma_deg": np.array([3.0])}

    with_heading, without = ahp().score(pairs([0], **heading)).cost[0], ahp().score(pairs([0])).cost[0]

    share = 0.094 / (0.550 + 0.094)
    assert with_heading == pytest.approx((1 - share) * without + share * 3.0, abs=5e-3)


def test_a_contradicting_matrix_is_refused() -> None:
    bad = ((1.0, 9.0, 1 / 9, 1.0), (1 / 9, 1.0, 9.0, 1.0), (9.0, 1 / 9, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0))

    with pytest.raises(SettingsError, match="consistency"):
        Scorer(AssociationSettings(method="ahp", pairwise=bad))


def test_a_rare_code_that_agrees_is_worth_more_than_a_common_one() -> None:
    in_use = np.array([1000] * 80 + [2222] + [-1] * 10)

    common, rare, different, none = mode_a_cost(
        np.array([1000, 2222, 2222, -1]), np.array([1000, 2222, 3333, 3333]), in_use
    )

    assert rare < common < 0.0 < different
    assert none == 0.0


def test_speed_and_course_differences_have_the_sigma_of_their_direction() -> None:
    factors = velocity_factors(
        np.array([200.0]), np.array([92.0]), np.array([0.0]), np.array([[190.0, 0.0]]), np.array([[9.0, 0.0, 36.0]])
    )

    assert factors["speed_step_mps"] == pytest.approx([10.0])
    assert factors["speed_sigma_mps"] == pytest.approx([3.0])
    assert factors["course_step_deg"] == pytest.approx([2.0])
    assert factors["course_sigma_deg"] == pytest.approx([np.degrees(6.0 / 190.0)])


def test_at_walking_pace_there_is_no_course() -> None:
    factors = velocity_factors(
        np.array([5.0]), np.array([92.0]), np.array([1.0]), np.array([[5.0, 0.0]]), np.array([[1.0, 0.0, 1.0]])
    )

    assert np.isnan(factors["course_step_deg"]).all()


def test_a_factor_that_does_not_exist_is_refused() -> None:
    with pytest.raises(TypeError, match="mood"):
        pairs([0], mood=np.zeros(1))
