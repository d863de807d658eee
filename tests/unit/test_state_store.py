"""The state folder: no number twice, whatever happens; files replaced whole."""

from __future__ import annotations

import json
import time

import pytest

from aeroskein_service.state_store import BLOCK, SLACK, StateError, StateStore


def test_without_a_folder_numbers_start_at_one_and_nothing_is_kept():
    store = StateStore("")
    store.keep(500, b"state")
    store.close(500, b"state")
    assert store.first_number == 1
    assert store.snapshot() is None


def test_clean_stop_gives_unused_numbers_back(tmp_path):
    StateStore(str(tmp_path)).close(77, b"state")
    again = StateStore(str(tmp_path))
    assert again.first_number == 77
    assert again.snapshot() == b"state"
    again.close(77, None)


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
    ends_s = time.monotonic() + 10.0
    while not store.covers(used + BLOCK) and time.monotonic() < ends_s:
        time.sleep(0.005)
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
