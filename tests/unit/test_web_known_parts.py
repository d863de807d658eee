"""Strings found by their hashes are those that a dictionary finds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.web_samples import NOW_S, picture, show, tracks

from aeroskein_service.web import known_parts
from aeroskein_service.web.known_parts import SEARCHES, UNKNOWN, KnownParts

LENGTH = 3
parts = st.binary(min_size=LENGTH, max_size=LENGTH)
changes = st.lists(st.tuples(st.booleans(), parts, st.integers(0, 99)), max_size=40)


def found(known: KnownParts, asked: list[bytes]) -> list[int]:
    return known.find(np.frombuffer(b"".join(asked), dtype=np.uint8).reshape(-1, LENGTH)).tolist()


@given(changes, st.lists(parts, min_size=1, max_size=10))
def test_what_is_found_is_what_a_dictionary_holds(changed, asked):
    known, expected = KnownParts(), {}
    for comes, part, number in changed:
        if comes:
            known.add(part, number)
            expected[part] = number
        else:
            known.remove(part)
            expected.pop(part, None)
    asked += list(expected)
    for _ in range(SEARCHES):
        last = found(known, asked)
    assert last == [expected.get(part, UNKNOWN) for part in asked]
    assert len(known) == len(expected)


def test_collision_of_hashes_finds_nothing_wrong(monkeypatch):
    monkeypatch.setattr(known_parts, "_hashes", lambda rows: np.zeros(len(rows), dtype=np.uint64))
    known = KnownParts()
    known.add(b"abc", 1)
    assert found(known, [b"abc", b"xyz"]) == [1, UNKNOWN]


def test_forgotten_string_is_not_found_any_more():
    known = KnownParts()
    for k in range(100):
        known.add(bytes((k, 0, 0)), k)
    assert found(known, [b"\x07\0\0"]) == [7]
    known.remove(b"\x07\0\0")
    assert found(known, [b"\x07\0\0", b"\x08\0\0"]) == [UNKNOWN, 8]


@pytest.mark.parametrize("absent", [[], ["altitude_m"], ["position_cov_m2"]])
def test_points_of_the_service_are_read_field_by_field_only_once(absent):
    # Given points that the service writes, with or without a field
    shown = picture()
    gone = {name: np.full((60, 3) if "cov" in name else 60, np.nan) for name in absent}
    show(shown, tracks(60, **gone))
    assert shown.in_full == 60
    # When the same tracks come again
    show(shown, tracks(60, ground_speed_mps=np.full(60, 77.0), **gone))
    # Then they are read as columns
    assert shown.in_full == 60
    assert set(shown.records(NOW_S)["speed"].tolist()) == {770}
