"""Beliefs in own positions, in a small world of two radars."""

import numpy as np
import pytest
from benchmarks.integrity_scene import START_S, Run, World, settings

from aeroskein.integrity import Belief, Integrity, Looks, OwnPositions
from aeroskein.plots import Array, Ints

RANGE_M = 370_000.0


def play(world: World, seconds: int) -> Run:
    run = Run(world)
    for s in range(1, seconds + 1):
        run.second(float(s))
    return run


def test_a_track_is_unverified_until_radars_have_seen_it() -> None:
    run = play(World(aircraft=12, seed=1), 2)

    assert (run.integrity.belief(np.arange(12)) == Belief.UNVERIFIED).all()


def test_honest_aircraft_in_cover_are_verified_within_half_a_minute() -> None:
    run = play(World(aircraft=12, seed=1), 30)

    assert (run.integrity.belief(np.arange(12)) == Belief.VERIFIED).all()
    assert run.integrity.trusted(np.arange(12)).all()
    assert run.integrity.alarms() == []


def test_a_ghost_in_cover_becomes_suspect_and_nobody_else() -> None:
    run = play(World(aircraft=13, seed=2, ghosts=(12,), ghost_from_s=40.0, range_max_m=RANGE_M), 75)

    assert run.first_suspect(12) - 40.0 <= 20.0
    assert {a for _, a, b in run.changes if b == Belief.SUSPECT} == {12}
    assert run.integrity.alarms() == ["own positions of 1 aircraft are suspect"]


def test_where_no_cover_is_known_a_silent_radar_proves_nothing() -> None:
    # No instrumented range, and nothing learned yet.
    run = play(World(aircraft=1, seed=2, ghosts=(0,), ghost_from_s=0.0), 60)

    assert run.integrity.belief(np.array([0])).tolist() == [Belief.UNVERIFIED]


def test_a_radar_that_fails_altogether_makes_nobody_suspect() -> None:
    run = Run(World(aircraft=12, seed=3, range_max_m=RANGE_M))
    for s in range(1, 120):
        run.world.detection = 0.97 if s < 50 else 0.0
        run.second(float(s))

    assert not [a for _, a, b in run.changes if b == Belief.SUSPECT]


@pytest.mark.parametrize("silent", [(0, 50), (50, 110)])
def test_what_a_radar_did_not_see_while_it_was_off_was_not_missed(silent: tuple[int, int]) -> None:
    run = Run(World(aircraft=24, seed=3, range_max_m=RANGE_M))
    for s in range(1, 150):
        run.world.detection = 0.0 if silent[0] <= s < silent[1] else 0.97
        run.second(float(s))

    assert not [a for _, a, b in run.changes if b == Belief.SUSPECT]


@pytest.mark.parametrize("told", [True, False])
def test_plots_that_are_lost_on_their_way_make_nobody_suspect(told: bool) -> None:
    run = Run(World(aircraft=24, seed=3, range_max_m=RANGE_M))
    for s in range(1, 150):
        overloaded = 50 <= s < 110
        run.world.detection = 0.2 if overloaded else 0.97
        for sensor in (0, 1, 2) if told and overloaded else ():
            run.integrity.lost(sensor)
        run.second(float(s))

    assert any(b == Belief.SUSPECT for _, _, b in run.changes) != told


def drifting(seed: int, honest_again_s: float = np.inf) -> World:
    def displaced(aircraft: Ints, s: float) -> Array:
        size = 10.0 * (s - 60.0) if 60.0 <= s < honest_again_s else 0.0
        return np.where((aircraft == 3)[:, None], np.array([0.6, 0.8]) * size, 0.0)

    return World(aircraft=12, seed=seed, displaced=displaced)


@pytest.mark.parametrize("seed", [4, 5])
def test_a_drifting_aircraft_becomes_suspect(seed: int) -> None:
    run = play(drifting(seed), 130)

    assert run.first_suspect(3) - 60.0 <= 50.0 + 30.0
    assert {a for _, a, b in run.changes if b == Belief.SUSPECT} == {3}
    assert not run.integrity.trusted(np.array([3]))[0]


def test_an_aircraft_that_is_honest_again_comes_back_but_not_at_once() -> None:
    run = play(drifting(4, honest_again_s=130.0), 300)

    back = [s for s, a, b in run.changes if a == 3 and b == Belief.VERIFIED and s > 130.0]
    assert len(back) == 1
    assert back[0] > 150.0


def test_a_radar_that_turned_its_north_is_doubted_not_the_aircraft() -> None:
    run = play(World(seed=1, radar_shift_deg=lambda k, s: 0.5 if k == 0 and s > 80.0 else 0.0), 150)

    assert not [a for _, a, b in run.changes if b == Belief.SUSPECT]
    assert any("radar1" in a for _, a in run.alarms)


def test_navigation_disturbed_for_most_is_an_alarm_for_the_region() -> None:
    def displaced(aircraft: Ints, s: float) -> Array:
        return np.where((aircraft < 16)[:, None] & (s > 80.0), np.array([900.0, 600.0]), 0.0)

    run = play(World(seed=1, displaced=displaced), 140)

    assert any("satellite navigation" in a for _, a in run.alarms)


def test_a_track_far_from_any_radar_is_unverified_again_after_a_while() -> None:
    run = play(World(aircraft=12, seed=1), 30)
    every = np.arange(12)
    far = np.full(12, 10.0)

    run.integrity.check(START_S + 400.0, every, far, far, far)

    assert (run.integrity.belief(every) == Belief.UNVERIFIED).all()


def test_a_slot_given_to_a_new_track_begins_unverified() -> None:
    run = play(World(aircraft=12, seed=1), 30)

    run.integrity.reset(np.array([5]))
    run.integrity.grow(20)

    beliefs = run.integrity.belief(np.arange(20))
    assert beliefs[5] == Belief.UNVERIFIED
    assert (np.delete(beliefs, 5)[:11] == Belief.VERIFIED).all()
    assert (beliefs[12:] == Belief.UNVERIFIED).all()


def test_tracks_whose_plane_moved_wait_for_the_next_own_position() -> None:
    run = play(World(aircraft=12, seed=1), 30)

    run.integrity.moved(np.arange(12))
    changed = run.integrity.check(START_S + 31.0, np.arange(12), *(np.full(12, v) for v in (48.3, 11.7, 8000.0)))

    assert len(changed) == 0


def test_sensors_without_radars_need_nothing() -> None:
    integrity = Integrity(settings(), 4)

    assert integrity.alarms() == []
    assert integrity.belief(np.array([0])).tolist() == [Belief.UNVERIFIED]


def test_a_ghost_heard_before_anything_is_known_of_cover_is_found_as_soon_as_cover_is() -> None:
    world = World(aircraft=41, seed=1, ghosts=(40,), ghost_from_s=0.0)

    run = play(world, 60)

    assert run.first_suspect(40) <= 15.0
    assert {a for _, a, b in run.changes if b == Belief.SUSPECT} == {40}


def test_what_a_radar_saw_before_its_cover_was_known_there_was_not_missed() -> None:
    # Low aircraft: whether cover holds them is proven late, and they are seen all the time.
    run = Run(World(aircraft=60, seed=1))
    run.height = run.rng.uniform(300.0, 2500.0, 60)
    most = 0.0
    for s in range(1, 60):
        before = run.integrity.missed(np.arange(60))
        run.second(float(s))
        most = max(most, float((run.integrity.missed(np.arange(60)) - before).max()))

    # One turn of each radar, at a detection of 0.97 at most.
    assert most <= 2 * 3.6


def beside_its_flight(wild_s: tuple[float, ...], seconds: int) -> Integrity:
    """Radars see one aircraft 280 m beside its own positions; some of these are 2.2 km off, the next is lost."""
    own_cov = np.array([[1e3, 0.0, 1e2]])
    integrity, slot = Integrity(settings(None), 1), np.zeros(1, dtype=np.int64)
    for s in np.arange(1.0, seconds):
        time_s = START_S + np.array([s])
        east = 200.0 * s - 2_200.0 * (s in wild_s)
        if s - 1.0 not in wild_s:
            integrity.own(OwnPositions(slot, time_s, np.array([[east, 0.0]]), np.array([[200.0, 0.0]]), own_cov))
        for sensor, turn_s, variance in ((1, 4, 120.0**2), (2, 8, 300.0**2)):
            # Both look within the second in which the wild position is the newest.
            look_s = s + 0.3 * sensor
            if s % turn_s == 0.0:
                place = np.array([[200.0 * look_s + 280.0, 0.0]])
                polar = (np.array([90e3]), np.array([10.0]), np.array([9e3]))
                cov = variance * np.array([[1.0, 0.0, 1.0]])
                integrity.looks(Looks(np.array([sensor]), slot, START_S + np.array([look_s]), place, cov, *polar))
        integrity.check(START_S + s, slot, np.array([48.0]), np.array([11.0]), np.array([9e3]))
    return integrity


def test_one_wild_own_position_that_two_radars_look_at_makes_nobody_suspect() -> None:
    assert beside_its_flight((40.0,), 60).belief(np.array([0]))[0] == Belief.VERIFIED


def test_a_jump_that_lasts_is_no_slip() -> None:
    def displaced(aircraft: Ints, s: float) -> Array:
        return np.where((aircraft == 3)[:, None] & (s >= 60.0), np.array([1_300.0, 1_800.0]), 0.0)

    run = play(World(aircraft=12, seed=4, displaced=displaced), 100)

    assert run.first_suspect(3) - 60.0 <= 30.0
