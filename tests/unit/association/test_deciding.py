"""Decisions over several scans."""

import numpy as np
import pytest

from aeroskein.association import Associator, Candidates
from aeroskein.association.deciding import Claims
from aeroskein.settings import EngineSettings, SensorSettings

PERIOD_S = 4.0
SETTINGS = EngineSettings(
    sensors=(
        SensorSettings(id="radar", kind="psr", lat_deg=48.0, lon_deg=11.0, height_m=0.0, period_s=PERIOD_S),
        SensorSettings(id="other", kind="psr", lat_deg=48.0, lon_deg=12.0, height_m=0.0, period_s=PERIOD_S),
    )
)
SIGMA_M = 100.0


class Scans:
    """Feeds one scan after another: where each plot lies along a line, and where the tracks are."""

    def __init__(self) -> None:
        self.associator = Associator(SETTINGS, 10)
        self.number = 0

    def next(
        self, plots_m: list[float], tracks_m: dict[int, float], local_track: list[int], taken: set[int] = frozenset(),
        spared: bool = False,
    ) -> list[int]:  # fmt: skip
        """One scan; track numbers that the plots get, -1 where none."""
        plot, track, step = [], [], []
        for i, at in enumerate(plots_m):
            for name, place in sorted(tracks_m.items()):
                plot.append(i), track.append(name), step.append([at - place, 0.0])
        pairs = Candidates.of(
            np.array(plot), np.array(track), np.array(step), np.tile([SIGMA_M**2, 0.0, SIGMA_M**2], (len(plot), 1))
        )
        n = len(plots_m)
        decision = self.associator.decide(
            np.zeros(n, dtype=np.int64), np.array(local_track), np.full(n, self.number * PERIOD_S), pairs,
            np.isin(pairs.track, list(taken)), np.full(len(plot), spared),
        )  # fmt: skip
        self.number += 1
        self.withheld = decision.withheld.tolist()
        self.contested, self.sure = decision.contested.tolist(), decision.sure.tolist()
        return [int(pairs.track[p]) if p >= 0 else -1 for p in decision.pair]

    def one_by_one(self, plots_m: list[float], tracks_m: dict[int, float], local_track: list[int]) -> list[int]:
        """One scan whose plots arrive one after the other."""
        given: list[int] = []
        for at, name in zip(plots_m, local_track, strict=True):
            given += self.next([at], tracks_m, [name], set(given) - {-1})
            self.number -= 1
        self.number += 1
        return given


def test_two_plots_share_two_tracks_though_both_prefer_the_same() -> None:
    assert Scans().next([90.0, 140.0], {7: 100.0, 8: 250.0}, [-1, -1]) == [7, 8]


def test_a_plot_outside_every_gate_gets_no_track_and_is_free() -> None:
    scans = Scans()

    assert scans.next([900.0], {7: 100.0}, [-1]) == [-1]
    assert scans.contested == [False]


def test_a_plot_that_lost_its_only_track_to_a_better_one_is_contested() -> None:
    scans = Scans()

    assert scans.next([110.0, 280.0], {7: 100.0}, [-1, -1]) == [7, -1]
    assert scans.contested == [False, True]


def test_a_track_that_is_taken_is_not_given_again() -> None:
    assert Scans().next([110.0], {7: 100.0}, [-1], taken={7}) == [-1]


def test_the_mean_of_three_scans_decides_at_first() -> None:
    scans = Scans()
    scans.next([180.0, 120.0], {7: 100.0, 8: 200.0}, [1, 2])
    scans.next([95.0, 205.0], {7: 100.0, 8: 200.0}, [1, 2])

    third = scans.next([90.0, 215.0], {7: 100.0, 8: 200.0}, [1, 2])

    assert third == [7, 8]


def test_plots_that_arrive_one_by_one_are_decided_together_from_the_second_scan_on() -> None:
    scans = Scans()

    assert scans.one_by_one([180.0, 240.0], {7: 100.0, 8: 200.0}, [1, 2]) == [8, 7]
    # The first plot lies nearer to the track of the second.
    assert scans.one_by_one([160.0, 250.0], {7: 100.0, 8: 200.0}, [1, 2]) == [7, 8]


def test_a_track_that_was_not_there_yet_is_not_held_to_have_been_far_away() -> None:
    scans = Scans()
    scans.next([150.0], {7: 100.0}, [1])

    assert scans.next([150.0], {7: 100.0, 8: 150.0}, [1]) == [8]


def test_two_radars_may_see_one_track_in_one_batch() -> None:
    pairs = Candidates.of(
        np.array([0, 1]), np.array([7, 7]), np.zeros((2, 2)), np.tile([SIGMA_M**2, 0.0, SIGMA_M**2], (2, 1))
    )

    decision = Associator(SETTINGS, 10).decide(
        np.array([0, 1]), np.array([-1, -1]), np.zeros(2), pairs, np.zeros(2, dtype=np.bool_)
    )

    assert decision.pair.tolist() == [0, 1]


def test_a_plot_between_two_tracks_is_unsure_until_its_pairing_is_established() -> None:
    scans = Scans()

    sure = []
    for _ in range(4):
        scans.next([100.0, 300.0], {7: 100.0, 8: 300.0}, [1, 2])
        sure.append(scans.sure)

    assert sure == [[False, False]] * 3 + [[True, True]]


def test_a_plot_with_one_track_in_its_gate_is_sure() -> None:
    scans = Scans()
    scans.next([100.0], {7: 100.0, 8: 900.0}, [-1])

    assert scans.sure == [True]


def settled() -> Scans:
    scans = Scans()
    for _ in range(4):
        assert scans.next([100.0, 300.0], {7: 100.0, 8: 300.0}, [1, 2]) == [7, 8]
    return scans


def test_an_established_pairing_survives_one_bad_scan() -> None:
    scans = settled()

    assert scans.next([290.0, 110.0], {7: 100.0, 8: 300.0}, [1, 2]) == [7, 8]


def test_a_swap_needs_three_better_scans_in_a_row() -> None:
    scans = settled()

    given = [scans.next([300.0, 100.0], {7: 100.0, 8: 300.0}, [1, 2]) for _ in range(6)]

    swapped = [g == [8, 7] for g in given]
    assert swapped[-1]
    assert not any(swapped[:2])
    assert swapped == sorted(swapped)


def test_while_a_pairing_is_held_its_track_goes_to_nobody_else() -> None:
    scans = settled()

    given = scans.next([290.0, 110.0, 105.0], {7: 100.0, 8: 300.0}, [1, 2, 3])

    assert given == [7, 8, -1]


def test_a_target_not_seen_for_long_is_forgotten() -> None:
    scans = settled()
    scans.number += 20

    assert scans.next([300.0], {7: 100.0, 8: 300.0}, [1]) == [8]


def test_the_same_number_of_another_radar_is_another_target() -> None:
    scans = settled()

    partner = scans.associator.partner(np.array([0, 1]), np.array([1, 1]))

    assert partner.tolist() == [7, -1]


def test_a_claim_holds_for_its_scan_and_sensor() -> None:
    claims = Claims(np.array([4.0, 8.0]), 3)
    claims.note(np.array([0]), np.array([2]), np.array([100.0]))

    taken = claims.taken(np.array([0, 0, 0, 1]), np.array([2, 2, 1, 2]), np.array([101.0, 104.0, 101.0, 101.0]))

    assert taken.tolist() == [True, False, False, False]


def test_claims_grow_and_are_reset() -> None:
    claims = Claims(np.array([4.0]), 1)
    claims.note(np.array([0]), np.array([0]), np.array([100.0]))

    claims.grow(3)
    kept = claims.taken(np.array([0, 0]), np.array([0, 2]), np.array([100.0, 100.0]))
    claims.reset(np.array([0]))

    assert kept.tolist() == [True, False]
    assert not claims.taken(np.array([0]), np.array([0]), np.array([100.0]))[0]


@pytest.mark.parametrize(("kind", "velocity", "scans", "least"), [
    ("random", True, 1, 99.9), ("crossing", True, 1, 99.5), ("formation", True, 1, 98.0), ("formation", True, 3, 99.4),
])  # fmt: skip
@pytest.mark.parametrize("method", ["mahalanobis", "ahp"])
def test_most_plots_find_their_own_track(kind: str, velocity: bool, scans: int, least: float, method: str) -> None:
    from benchmarks.association import accuracy

    tally = accuracy(kind, 100, velocity, scans, method, 15)

    assert tally.share >= least
    assert tally.alone <= 0.006 * (tally.right + tally.wrong)


def test_a_plot_between_two_tracks_that_can_spare_it_is_given_to_none_and_begins_none() -> None:
    scans = Scans()

    assert scans.next([110.0], {7: 0.0, 8: 230.0}, [-1], spared=True) == [-1]
    assert scans.withheld == [True]


def test_a_plot_between_two_tracks_that_need_it_goes_to_the_nearer() -> None:
    scans = Scans()

    assert scans.next([110.0], {7: 0.0, 8: 230.0}, [-1]) == [7]
    assert scans.withheld == [False]


def test_plots_that_could_not_be_exchanged_are_not_withheld() -> None:
    assert Scans().next([10.0, 440.0], {7: 0.0, 8: 450.0}, [-1, -1], spared=True) == [7, 8]


def test_a_target_that_the_radar_numbers_is_decided_by_its_scans_and_not_withheld() -> None:
    assert Scans().next([110.0], {7: 0.0, 8: 230.0}, [5], spared=True) == [7]
