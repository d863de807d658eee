"""The state folder: no number twice, whatever happens; files replaced whole."""

from __future__ import annotations

import json
import time
from dataclasses import fields

import numpy as np
import pytest

from aeroskein import snapshots
from aeroskein.points import FusedPoints, Product
from aeroskein_service.state_store import BLOCK, SLACK, StateError, StateStore


def wait(condition) -> None:
    """Until the writer in the background has done it."""
    ends_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < ends_s
        time.sleep(0.005)


FRESH = snapshots.pack({}, {})


def elements(labels, ends_s):
    """Element points of which only naming address and end matter here."""
    columns = {field.name: np.zeros(len(labels)) for field in fields(FusedPoints) if field.name != "product"}
    span_s = np.stack([np.zeros(len(labels)), np.array(ends_s, dtype=float)], axis=1)
    return FusedPoints(product=Product.ELEMENT, **columns | {"label": np.array(labels), "span_s": span_s})


def published(store: StateStore) -> dict[int, float]:
    snapshot = store.snapshot(FRESH)
    assert snapshot is not None
    return snapshots.unpack(snapshot)[1]


def test_without_a_folder_numbers_start_at_one_and_nothing_is_kept():
    store = StateStore("")
    store.keep(500, b"state")
    store.note_published(elements([1], [2.0]))
    store.close(500, b"state")
    assert store.first_number == 1
    assert store.snapshot(FRESH) is None


def test_clean_stop_gives_unused_numbers_back(tmp_path):
    StateStore(str(tmp_path)).close(77, snapshots.pack({"a": 1}, {3: 4.0}))
    again = StateStore(str(tmp_path))
    assert again.first_number == 77
    assert again.snapshot(FRESH) == snapshots.pack({"a": 1}, {3: 4.0})
    again.close(77, None)


def test_after_a_crash_everything_that_was_published_is_known(tmp_path):
    # Given a snapshot, and elements published before and after it
    first = StateStore(str(tmp_path))
    first.note_published(elements([0xA, -1], [10.0, 11.0]))
    first.keep(5, snapshots.pack({"radar1": 1}, {0xA: 10.0, 0xB: 3.0}))
    wait(first.wants_snapshot)
    first.note_published(elements([0xA, 0xC], [20.0, 12.0]))
    first.note_published(elements([0xA], [24.0]))
    # When it dies here, without close
    second = StateStore(str(tmp_path))
    # Then the snapshot and what came after it are both there
    snapshot = second.snapshot(FRESH)
    assert snapshots.unpack(snapshot) == ({"radar1": 1}, {0xA: 24.0, 0xB: 3.0, 0xC: 12.0})
    second.abandon()


def test_a_crash_before_the_first_snapshot_forgets_nothing(tmp_path):
    StateStore(str(tmp_path)).note_published(elements([0xA], [10.0]))
    second = StateStore(str(tmp_path))
    assert published(second) == {0xA: 10.0}
    # And so does a second one
    second.note_published(elements([0xA], [14.0]))
    assert published(StateStore(str(tmp_path))) == {0xA: 14.0}


def test_journals_are_removed_once_a_snapshot_covers_them(tmp_path):
    store = StateStore(str(tmp_path))
    store.note_published(elements([0xA], [10.0]))
    store.keep(5, FRESH)
    wait(store.wants_snapshot)
    assert published(StateStore(str(tmp_path))) == {}
    store.close(5, FRESH)
    assert not [path for path in tmp_path.iterdir() if path.suffix == ".journal" and path.stat().st_size]


def test_row_that_was_cut_off_by_a_crash_is_ignored(tmp_path):
    store = StateStore(str(tmp_path))
    store.note_published(elements([0xA, 0xB], [10.0, 11.0]))
    (journal,) = tmp_path.glob("*.journal")
    journal.write_bytes(journal.read_bytes()[:-5])
    assert published(StateStore(str(tmp_path))) == {0xA: 10.0}


def test_after_a_crash_no_reserved_number_is_used_again(tmp_path):
    first = StateStore(str(tmp_path))
    # When it dies here, without close
    second = StateStore(str(tmp_path))
    assert second.first_number == first.first_number + BLOCK
    second.close(second.first_number, None)


def test_numbers_are_reserved_before_the_block_runs_out(tmp_path):
    store = StateStore(str(tmp_path))
    used = 1 + BLOCK - SLACK + 1
    store.keep(used, None)
    # The writer works in the background.
    wait(lambda: store.covers(used + BLOCK))
    assert json.loads((tmp_path / "numbers.json").read_bytes())["next_track_number"] == used + BLOCK


def test_burst_beyond_the_block_is_seen_and_can_be_reserved_at_once(tmp_path):
    store = StateStore(str(tmp_path))
    assert not store.covers(BLOCK + 2)
    store.reserve_now(BLOCK + 2)
    assert store.covers(BLOCK + 2)
    store.close(BLOCK + 2, None)


@pytest.mark.parametrize("content", [b"", b"{}", b'{"next_track_number": "7"}', b'{"next_track_number": 0}', b"[1]"])
def test_damaged_numbers_stop_the_start_instead_of_repeating_numbers(tmp_path, content):
    (tmp_path / "numbers.json").write_bytes(content)
    with pytest.raises(StateError, match="damaged"):
        StateStore(str(tmp_path))


def test_folder_that_cannot_be_made_is_one_sentence(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(StateError, match=r"service\.state_dir: .* cannot be used"):
        StateStore(str(tmp_path / "file" / "state"))
