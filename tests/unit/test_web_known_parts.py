"""Strings found by their hashes are those that a dictionary finds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.web_samples import NOW_S, picture, show, tracks

from aeroskein_service.web import known_parts
from aeroskein_service.web.known_parts import LONGEST, UNKNOWN, KnownParts, padded

parts = st.binary(min_size=1, max_size=20) | st.binary(min_size=250, max_size=LONGEST)
changes = st.lists(st.tuples(st.integers(0, 30), st.none() | parts), max_size=40)


def found(known: KnownParts, asked: list[bytes]) -> list[int]:
    data = b"".join(asked) + bytes(LONGEST)
    lengths = np.array([len(part) for part in asked])
    return known.find(padded(data, np.cumsum(lengths) - lengths, lengths), lengths).tolist()


@given(changes, st.lists(parts, min_size=1, max_size=10))
def test_what_is_found_is_what_was_put(changed, asked):
    known, held = KnownParts(), {}
    for place, part in changed:
        if part is None:
            known.forget(place)
            held.pop(place, None)
        elif part not in held.values():
            known.put([place], [part])
            held[place] = part
    places = {part: place for place, part in held.items()}
    asked += list(held.values())
    assert found(known, asked) == [places.get(part, UNKNOWN) for part in asked]
    assert [part in known for part in asked] == [part in places for part in asked]


def test_collision_of_hashes_finds_nothing_wrong(monkeypatch):
    monkeypatch.setattr(known_parts, "_hashes", lambda words, _lengths: np.zeros(len(words), dtype=np.uint64))
    known = KnownParts()
    known.put([0], [b"abc"])
    assert found(known, [b"abc", b"xyz", b"ab", b"abc\0"]) == [0, UNKNOWN, UNKNOWN, UNKNOWN]


def test_string_that_is_too_long_is_not_found():
    known = KnownParts()
    known.put([0, 1], [b"a" * (LONGEST + 1), b"b"])
    assert found(known, [b"a" * (LONGEST + 1), b"a" * LONGEST, b"b"]) == [UNKNOWN, UNKNOWN, 1]


def test_place_holds_the_newest_string():
    known = KnownParts()
    known.put(range(100), [bytes((k, 7)) for k in range(100)])
    known.put([7], [b"other"])
    assert found(known, [b"\x07\x07", b"other", b"\x08\x07"]) == [UNKNOWN, 7, 8]
    known.forget(7)
    assert found(known, [b"other", b"\x08\x07"]) == [UNKNOWN, 8]


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
