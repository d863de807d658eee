"""Frames and wishes: the bytes that go to a browser and the words that come back."""

from __future__ import annotations

import asyncio
import contextlib
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.web_samples import NOW_S, records

from aeroskein_service.codec import MessageError
from aeroskein_service.web.frames import HEAD, Head, pack_frame, unpack_frame
from aeroskein_service.web.records import RECORD, in_box
from aeroskein_service.web.requests import Play, Seek, Shown, View, read_request
from aeroskein_service.web.viewer import WHOLE_BELOW, Viewer


def test_layout_is_that_of_the_documentation():
    page = (Path(__file__).parents[2] / "docs" / "web.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \| (\w+) \|", page.split("### Record", 1)[1], re.MULTILINE)
    formats = {"<u4": "uint32", "<i4": "int32", "<f4": "float32", "<u2": "uint16", "<i2": "int16", "|u1": "uint8",
               "|i1": "int8", "|S8": "bytes8"}  # fmt: skip
    assert [(int(at), name, kind) for at, name, kind in rows] == [
        (RECORD.fields[name][1], name, formats[RECORD.fields[name][0].str]) for name in RECORD.names
    ]
    assert f"{HEAD.size} bytes" in page
    assert f"{RECORD.itemsize} bytes" in page


@given(
    frame=st.integers(0, 2**32 - 1), time_s=st.floats(0, 1e11), total=st.integers(0, 2**31), playing=st.booleans(),
    lat=st.lists(st.floats(-90, 90), max_size=5),
)  # fmt: skip
def test_frame_is_unpacked_as_it_was_packed(frame, time_s, total, playing, lat):
    head, rows = Head(frame, time_s, time_s + 1.0, total, playing=playing, speed=2.5), records(lat, lat)
    unpacked, there = unpack_frame(pack_frame(head, rows))
    assert unpacked == head
    assert there.tobytes() == rows.tobytes()


@given(st.binary(max_size=120))
def test_bytes_that_are_no_frame_are_refused(payload):
    if payload[:2] != b"\x01\x01":
        with pytest.raises(ValueError):
            unpack_frame(payload)


@given(st.one_of(st.text(max_size=200), st.binary(max_size=200)))
def test_any_words_are_a_wish_or_are_not_understood(words):
    with contextlib.suppress(MessageError):
        assert isinstance(read_request(words), View | Shown | Seek | Play)


@given(
    st.recursive(
        st.one_of(st.none(), st.booleans(), st.floats(), st.integers(), st.text()),
        lambda inner: st.one_of(st.lists(inner), st.dictionaries(st.text(), inner)),
        max_leaves=12,
    )
)
def test_any_json_is_a_wish_or_is_not_understood(value):
    for kind in ("view", "shown", "seek", "play", "other"):
        body = value if isinstance(value, dict) else {"box": value, "frame": value, "time_s": value, "on": value}
        with contextlib.suppress(MessageError):
            read_request(msgspec.json.encode({"type": kind} | body))


@pytest.mark.parametrize(
    "words",
    [
        '{"type":"view","box":[50,0,40,10]}',
        '{"type":"view","box":[0,0,91,0]}',
        '{"type":"view","box":null,"pinned":[1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17]}',
        '{"type":"view","box":null,"more":1}',
        '{"type":"play","on":true,"speed":0}',
        '{"type":"play","on":true,"speed":1e9}',
        '{"type":"seek","time_s":-1}',
        '{"type":"shown","frame":4294967296}',
        '{"type":"shutdown"}',
        "[]",
    ],
)
def test_wishes_out_of_range_are_not_understood(words):
    with pytest.raises(MessageError):
        read_request(words)


def test_box_may_cross_the_antimeridian():
    rows = records([0.0, 0.0, 0.0, 30.0], [179.0, -179.0, 0.0, 179.5])
    assert in_box(rows, (-10.0, 170.0, 10.0, -170.0)).tolist() == [True, True, False, False]


# -- what a viewer gets ------------------------------------------------------------------------------------------------
class Browser:
    """Takes what a viewer sends."""

    def __init__(self) -> None:
        self.frames: list[tuple[Head, np.ndarray]] = []

    async def __call__(self, payload: bytes) -> None:
        self.frames.append(unpack_frame(payload))


def crowd(n: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return records(rng.uniform(-60, 60, n).tolist(), rng.uniform(-180, 180, n).tolist())


def test_whole_picture_goes_out_while_it_is_small():
    browser = Browser()
    viewer = Viewer(browser)
    viewer.look(View(box=(0.0, 0.0, 1.0, 1.0)))
    asyncio.run(viewer.send(Head(1, NOW_S, NOW_S, WHOLE_BELOW), crowd(WHOLE_BELOW), 1))
    assert len(browser.frames[0][1]) == WHOLE_BELOW


def test_of_a_large_picture_only_what_is_in_view_or_pinned_or_in_distress_goes_out():
    # Given many aircraft, one of them hijacked, one pinned
    browser, rows = Browser(), crowd(5000)
    outside = np.flatnonzero(~in_box(rows, (0.0, 0.0, 30.0, 60.0)))
    rows["mode_a"][outside[3]] = 0o7500
    viewer = Viewer(browser)
    viewer.look(View(box=(0.0, 0.0, 30.0, 60.0), pinned=[int(rows["number"][outside[9]])]))
    # When a picture is sent
    asyncio.run(viewer.send(Head(1, NOW_S, NOW_S, len(rows)), rows, 1))
    # Then these two are there beside those in view
    head, sent = browser.frames[0]
    inside = in_box(sent, (0.0, 0.0, 30.0, 60.0))
    assert inside.sum() == in_box(rows, (0.0, 0.0, 30.0, 60.0)).sum()
    assert set(sent["number"][~inside].tolist()) == set(rows["number"][outside[[3, 9]]].tolist())
    assert head.total == 5000


def test_pictures_between_two_that_were_sent_count_as_skipped():
    browser = Browser()
    viewer = Viewer(browser)

    async def send() -> None:
        for tick in (1, 2, 5, 9):
            await viewer.send(Head(tick, NOW_S, NOW_S, 0), crowd(0), tick)

    asyncio.run(send())
    assert [head.skipped for head, _ in browser.frames] == [0, 0, 2, 5]


def test_browser_that_draws_slowly_gets_the_next_picture_when_it_has_drawn():
    browser = Browser()
    viewer = Viewer(browser)

    async def look() -> list[bool]:
        viewer.shown(Shown(frame=0))  # it says what it draws
        await viewer.send(Head(1, NOW_S, NOW_S, 0), crowd(0), 1)
        ready = asyncio.create_task(viewer.ready())
        await asyncio.sleep(0)
        before = ready.done()
        viewer.shown(Shown(frame=1))
        await asyncio.wait_for(ready, 5.0)
        return [before, ready.done()]

    assert asyncio.run(look()) == [False, True]


def test_program_that_never_says_what_it_draws_is_not_waited_for():
    viewer = Viewer(Browser())

    async def look() -> None:
        await viewer.send(Head(1, NOW_S, NOW_S, 0), crowd(0), 1)
        await asyncio.wait_for(viewer.ready(), 1.0)

    asyncio.run(look())
