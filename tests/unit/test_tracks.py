"""Tracks: numbers, slots, names and status."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.builders import ADSB, RADAR1, RADAR2

from aeroskein.plots import Plots
from aeroskein.points import Status
from aeroskein.settings import EngineSettings, TrackSettings
from aeroskein.tracks import TrackTable

NOW_S = 1000.0


def table(capacity: int = 4, first_number: int = 1, **tracks: float) -> TrackTable:
    settings = EngineSettings(sensors=(ADSB, RADAR1, RADAR2), tracks=TrackSettings(capacity=capacity, **tracks))
    return TrackTable(settings, first_number)


def opened(tracks: TrackTable, *addresses: int, owns: bool = True) -> list[int]:
    n = len(addresses)
    capacity = tracks.room_for(n)
    if capacity > tracks.capacity:
        tracks.grow(capacity)
    return tracks.open(np.array(addresses, dtype=np.int32), np.full(n, owns)).tolist()


def owner(tracks: TrackTable, *addresses: int) -> list[int]:
    return tracks.owner(np.array(addresses, dtype=np.int32)).tolist()


def heard(tracks: TrackTable, slot: int, *, sensor: int, at_s: float) -> None:
    tracks.note(np.array([slot]), Plots.of(1, sensor=sensor, time_s=at_s, received_s=at_s), np.array([at_s]))


def test_numbers_go_on_from_the_first() -> None:
    tracks = table(first_number=500)

    slots = opened(tracks, 10, 11) + opened(tracks, 12)

    assert tracks.number[slots].tolist() == [500, 501, 502]
    assert tracks.next_number == 503


def test_a_slot_is_used_again_and_its_number_is_not() -> None:
    tracks = table(capacity=1)
    first = opened(tracks, 10)
    tracks.terminate(np.array(first), NOW_S)
    tracks.release(np.array(first))

    second = opened(tracks, 10)

    assert second == first
    assert tracks.number[second[0]] == 2
    assert tracks.capacity == 1


def test_a_new_track_in_an_old_slot_is_blank() -> None:
    tracks = table(capacity=1)
    slot = opened(tracks, 10)[0]
    fresh = {name: np.copy(column[slot]) for name, column in vars(tracks).items() if isinstance(column, np.ndarray)
             and not name.startswith("_") and name != "number"}  # fmt: skip
    raw = Plots.of(1, sensor=1, received_s=NOW_S, mode_a=7, callsign=b"OLD")
    tracks.note(np.array([slot]), raw, np.array([NOW_S]))
    tracks.status[slot], tracks.flags[slot], tracks.frame[slot] = Status.CONFIRMED, 3, 9
    tracks.terminate(np.array([slot]), NOW_S)
    tracks.release(np.array([slot]))

    opened(tracks, 10)

    for name, value in fresh.items():
        assert np.array_equal(getattr(tracks, name)[slot], value), name


def test_an_address_belongs_to_one_track() -> None:
    tracks = table()
    slots = opened(tracks, 30, 10, 20)

    assert owner(tracks, 10, 20, 30, 40) == [slots[1], slots[2], slots[0], -1]


def test_a_track_without_a_name_of_its_own_owns_nothing() -> None:
    tracks = table()
    slot = opened(tracks, 10, owns=False)[0]

    assert owner(tracks, 10) == [-1]
    assert tracks.address[slot] == 10
    assert tracks.label[slot] == -1


def test_the_address_of_an_ended_track_is_free_again() -> None:
    tracks = table()
    first = opened(tracks, 10)[0]

    tracks.terminate(np.array([first]), NOW_S)
    assert owner(tracks, 10) == [-1]
    second = opened(tracks, 10)[0]

    assert second != first
    assert owner(tracks, 10) == [second]


def test_an_ended_track_keeps_its_slot_until_it_is_released() -> None:
    tracks = table(capacity=2)
    ended = opened(tracks, 10)[0]
    tracks.terminate(np.array([ended]), NOW_S)

    assert tracks.room_for(1) == 2
    assert tracks.room_for(2) == 3
    assert tracks.used[ended]
    assert ended not in tracks.active


def test_a_track_that_learns_its_address_goes_on_under_its_number() -> None:
    tracks = table()
    slot = opened(tracks, -1, owns=False)[0]

    tracks.name(np.array([slot]), np.array([0x3C6444], dtype=np.int32))

    assert owner(tracks, 0x3C6444) == [slot]
    assert tracks.find("3C6444") == slot
    assert tracks.find("T000001") is None
    assert tracks.number[slot] == 1


def test_tracks_are_found_by_their_key() -> None:
    tracks = table(first_number=7)
    named, nameless = opened(tracks, 0x00ABCD)[0], opened(tracks, -1, owns=False)[0]

    assert tracks.find("00ABCD") == named
    assert tracks.find("00abcd") == named
    assert tracks.find("T000008") == nameless
    # A track with an address is found by that only.
    assert tracks.find("T000007") is None


@pytest.mark.parametrize(
    "label", ["", "T", "-1", "0x00AB", " 00ABCD", "T²", "T-00001", "00ABCDE", "ABCD", "T" + "9" * 30]
)
def test_what_is_no_key_finds_no_track(label: str) -> None:
    tracks = table()
    opened(tracks, 0x00ABCD)
    opened(tracks, -1, owns=False)

    assert tracks.find(label) is None


@pytest.mark.parametrize("ended_slot", [0, 1])
def test_the_newest_track_of_a_name_is_found(ended_slot: int) -> None:
    tracks = table(capacity=2)
    slots = opened(tracks, 10, 11)
    tracks.terminate(np.array([slots[1 - ended_slot]]), NOW_S)
    tracks.release(np.array([slots[1 - ended_slot]]))
    address = 10 + ended_slot
    tracks.terminate(np.array([slots[ended_slot]]), NOW_S)
    again = opened(tracks, address)[0]

    assert again != slots[ended_slot]
    assert tracks.find(f"{address:06X}") == again


def test_growth_keeps_everything() -> None:
    small, large = table(capacity=1), table(capacity=8)
    for tracks in (small, large):
        for address in (30, 10, 20):
            slot = opened(tracks, address)[0]
            raw = Plots.of(1, sensor=1, received_s=NOW_S + address, mode_a=address, callsign=f"C{address}".encode())
            tracks.note(np.array([slot]), raw, np.array([NOW_S]))

    assert small.capacity >= 3
    for name, column in vars(large).items():
        if isinstance(column, np.ndarray) and not name.startswith("_"):
            assert np.array_equal(getattr(small, name)[:3], column[:3]), name
    assert owner(small, 10, 20, 30) == owner(large, 10, 20, 30)


def test_the_newest_report_counts_whatever_the_order() -> None:
    tracks = table()
    slot = opened(tracks, 10)[0]
    slots = np.full(3, slot)
    raw = Plots.of(3, sensor=[0, 1, 0], time_s=[5.0, 7.0, 6.0], received_s=[9.0, 8.0, 7.0], mode_a=[-1, 5, -1],
                   callsign=[b"ABC", b"", b""])  # fmt: skip

    tracks.note(slots, raw, raw.time_s)

    assert tracks.reports[slot] == 3
    assert (tracks.newest_s[slot], tracks.received_s[slot]) == (7.0, 9.0)
    assert tracks.sensor_received_s[slot].tolist() == [9.0, 8.0, -np.inf]
    assert (tracks.mode_a[slot], tracks.callsign[slot]) == (5, b"ABC")


@pytest.mark.parametrize(
    ("heard_s", "wait_s"),
    [
        ({0: 0.0}, 3.0),  # one and a half seconds would be too nervous
        ({1: 0.0}, 6.0),
        ({2: 0.0}, 12.0),
        ({0: 1.0, 1: 1.0}, 3.0),
        ({0: 3.1, 1: 2.0}, 6.0),  # ADS-B has fallen silent, the radar has not
        ({0: 20.0, 1: 10.1, 2: 5.0}, 12.0),
        ({0: 3.1, 1: 10.1, 2: 20.1}, 0.0),  # nobody is left
    ],
)
def test_how_long_a_track_waits_follows_its_fastest_live_sensor(heard_s: dict[int, float], wait_s: float) -> None:
    tracks = table()
    slot = opened(tracks, 10)[0]
    for sensor, ago in heard_s.items():
        heard(tracks, slot, sensor=sensor, at_s=NOW_S - ago)

    assert tracks.expected_wait_s(np.array([slot]), NOW_S).tolist() == [wait_s]


actions = st.lists(st.tuples(st.sampled_from(["open", "end", "release"]), st.integers(0, 9)), max_size=40)


@given(actions)
def test_numbers_are_never_used_again_and_owners_are_always_alive(steps: list[tuple[str, int]]) -> None:
    tracks, numbers = table(capacity=2), []
    ended: list[int] = []
    for action, which in steps:
        if action == "open" and owner(tracks, which) == [-1]:
            slot = opened(tracks, which)[0]
            numbers.append(int(tracks.number[slot]))
            assert slot not in ended
        elif action == "end" and owner(tracks, which) != [-1]:
            ended += owner(tracks, which)
            tracks.terminate(np.array(owner(tracks, which)), NOW_S)
        elif action == "release" and ended:
            tracks.release(np.array([ended.pop(which % len(ended))]))

        active = tracks.active
        assert numbers == list(range(1, len(numbers) + 1))
        assert len(set(tracks.address[active].tolist())) == len(active)
        assert sorted(owner(tracks, *tracks.address[active].tolist())) == sorted(active.tolist())
        assert tracks.room_for(1) >= tracks.used.sum()
