"""Batch numbers: holes are losses, late arrivals take them back, repetitions are found."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from aeroskein_service.sequences import HOLES, LARGEST_JUMP, Sequences


def test_first_batch_seen_is_the_baseline():
    sequences = Sequences()
    assert sequences.take("k", 1, 1000)
    assert sequences.lost == 0


def test_hole_after_the_baseline_is_lost():
    sequences = Sequences()
    for seq in (5, 6, 9):
        sequences.take("k", 1, seq)
    assert sequences.lost == 2


def test_late_batch_takes_its_loss_back():
    sequences = Sequences()
    for seq in (5, 7):
        sequences.take("k", 1, seq)
    assert sequences.take("k", 1, 6)
    assert sequences.lost == 0


def test_repeated_batch_is_found_above_in_and_below_the_baseline():
    sequences = Sequences()
    for seq in (5, 7, 6, 3):
        assert sequences.take("k", 1, seq)
    assert [sequences.take("k", 1, seq) for seq in (5, 7, 6, 3)] == [False] * 4


def test_every_key_and_epoch_has_its_own_sequence():
    sequences = Sequences()
    assert all(sequences.take(key, epoch, 0) for key in ("a", "b") for epoch in (1, 2))
    assert sequences.lost == 0


def test_number_that_went_wrong_is_no_loss():
    sequences = Sequences()
    sequences.take("k", 1, 0)
    sequences.take("k", 1, LARGEST_JUMP + 1)
    assert sequences.take("k", 1, LARGEST_JUMP + 2)
    assert sequences.lost == 0


def test_losses_of_forgotten_epochs_stay_counted():
    sequences = Sequences()
    for epoch in range(200):
        sequences.take("k", epoch, 0)
        sequences.take("k", epoch, 2)
    assert sequences.lost == 200


def test_a_long_outage_is_counted_whole_though_only_its_end_is_remembered():
    sequences = Sequences()
    sequences.take("k", 1, 0)
    sequences.take("k", 1, 3 * HOLES)
    assert sequences.lost == 3 * HOLES - 1


@given(st.permutations(range(30)), st.data())
def test_lost_is_what_is_missing_above_the_first_seen(order, data):
    # Given batches 0..29 in any order, some of them repeated
    arrived = order[: data.draw(st.integers(1, 30))]
    repeated = data.draw(st.lists(st.sampled_from(arrived), max_size=10))
    sequences = Sequences()
    # When they are taken
    accepted = [sequences.take("k", 1, seq) for seq in [*arrived, *repeated]]
    # Then each counts once, and only holes between the first seen and the highest are lost
    assert accepted == [True] * len(arrived) + [False] * len(repeated)
    assert sequences.lost == len(set(range(arrived[0], max(arrived) + 1)) - set(arrived))
