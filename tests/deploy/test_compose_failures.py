"""What the demo survives on real containers: feed, router and service killed, a network cut, and a bad line."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.deploy.bad_line import BadLineError, Line, bad_line
from tests.deploy.stack import Stack, wait_until
from tests.integration.harness import Listener, connect, seams

from aeroskein_service.keys import Keys
from aeroskein_service.service import HISTORY_S
from aeroskein_service.transport import Session

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

KEYS = Keys("atc/v1")
SENSORS = ("adsb", "radar1", "radar2")
METRES_PER_DEGREE = 111_320.0


@pytest.fixture(autouse=True)
def _flying(stack):
    """Every test starts from a demo that fuses all three sensors."""

    def all_heard() -> bool:
        recent_s = time.time() - 15.0
        points = [point for _, point in stack.points(recent_s)]
        return {name for point in points for name in point["sources"]} >= set(SENSORS)

    wait_until(all_heard, "points of all sensors")


@pytest.fixture
def session(stack) -> Iterator[Session]:
    """A look at what goes over the router, from outside."""
    with connect(f"tcp/{stack.address('router', 'core')}:7447") as opened:
        yield opened


def status_of(stack: Stack) -> dict[str, Any]:
    """The service's status as it is now."""
    with connect(f"tcp/{stack.address('router', 'core')}:7447") as opened:
        heard = Listener(opened, KEYS.status())
        found: dict[str, Any] = heard.wait_for(lambda messages: messages[-1] if messages else None, "a status")
        return found


def sensor_of(stack: Stack, sensor: str) -> dict[str, Any]:
    """The part of the status about one sensor."""
    part: dict[str, Any] = status_of(stack)["sensors"][sensor]
    return part


def latency_of(stack: Stack, sensor: str) -> float:
    """How long after its time a report of a sensor arrives: the mean of the best of ten seconds. [s]

    In the others the machine may have been busy. The first two may be of what was before.
    """
    with connect(f"tcp/{stack.address('router', 'core')}:7447") as opened:
        heard = Listener(opened, KEYS.status())
        heard.wait_for(lambda messages: len(messages) >= 12, "twelve seconds of status")
        told = [message["sensors"][sensor]["latency_s"] for message in heard.messages[2:]]
    return min(latency_s for latency_s in told if latency_s is not None)


def feed_is_at(stack: Stack, sensor: str) -> tuple[int, int]:
    """Epoch and number of the newest batch of a feed."""
    with connect(f"tcp/{stack.address('router', 'core')}:7447") as opened:
        heard = Listener(opened, KEYS.reports_below(sensor))
        newest = heard.wait_for(lambda messages: messages[-1] if messages else None, "a batch")
        return newest["epoch"], newest["seq"]


class Place(NamedTuple):
    """How far a feed is, and the service with it."""

    epoch: int
    seq: int  # of the newest batch
    batches: int  # that the service has counted


def places(stack: Stack) -> dict[str, Place]:
    """Where all feeds are: they stand still until the service has counted what was under way."""
    with connect(f"tcp/{stack.address('router', 'core')}:7447") as opened:
        heard = {sensor: Listener(opened, KEYS.reports_below(sensor)) for sensor in SENSORS}
        status = Listener(opened, KEYS.status())
        for listener in heard.values():
            listener.wait_for(bool, "a batch")
        for sensor in SENSORS:
            stack.pause(sensor)
        try:
            told = len(status.messages)

            def settled() -> Any:
                recent = [message["sensors"] for message in status.messages[told:]]
                counts = [[part[sensor]["batches"] for sensor in SENSORS] for part in recent[-2:]]
                return recent[-1] if len(recent) > 2 and counts[0] == counts[1] else None

            counted = wait_until(settled, "the service to have counted what was under way")
            newest = {sensor: listener.messages[-1] for sensor, listener in heard.items()}
        finally:
            for sensor in SENSORS:
                stack.resume(sensor)
    return {s: Place(newest[s]["epoch"], newest[s]["seq"], counted[s]["batches"]) for s in SENSORS}


def numbers_of_tracks(stack: Stack, since_s: float, until_s: float) -> dict[str, set[int]]:
    """Track numbers of every address that was published between two times."""
    found: dict[str, set[int]] = {}
    for at_s, point in stack.points(since_s):
        if at_s < until_s and point["address"]:
            found.setdefault(point["address"], set()).add(point["track_number"])
    return found


def steps(stack: Stack, since_s: float, until_s: float) -> np.ndarray:
    """How far each confirmed live point lies from where the one before it was heading.

    Shape (n, 2): in metres, and in sigmas of what the point before said about its own position and velocity.
    """
    last: dict[int, dict[str, Any]] = {}
    found = []
    for at_s, point in stack.points(since_s - 5.0):
        before = last.get(point["track_number"])
        last[point["track_number"]] = point
        if before is None or not since_s <= at_s < until_s or before["status"] == "tentative":
            continue
        seconds = point["time_s"] - before["time_s"]
        flown_m = before["ground_speed_mps"] * seconds
        angle = np.radians(before["track_angle_deg"])
        scale = np.cos(np.radians(before["lat_deg"]))
        east_m = (point["lon_deg"] - before["lon_deg"]) * METRES_PER_DEGREE * scale - flown_m * np.sin(angle)
        north_m = (point["lat_deg"] - before["lat_deg"]) * METRES_PER_DEGREE - flown_m * np.cos(angle)
        ee, en, nn = np.array(before["position_cov_m2"]) + np.array(before["velocity_cov_m2ps2"]) * seconds**2
        off_m = np.array([east_m, north_m])
        found.append((np.hypot(east_m, north_m), np.sqrt(off_m @ np.linalg.solve([[ee, en], [en, nn]], off_m))))
    return np.array(found).reshape(-1, 2)


def test_tracks_go_on_when_a_feed_is_killed_and_started_again(stack, figures):
    # Given a feed in one epoch
    begun_s, (epoch, _) = time.time() - 10.0, feed_is_at(stack, "adsb")
    # When it is killed for ten seconds and started again
    stack.kill("adsb")
    killed_s = time.time()
    time.sleep(10.0)
    before = sensor_of(stack, "adsb")
    stack.start("adsb")
    started_s = time.time()
    after = wait_until(
        lambda: found if (found := sensor_of(stack, "adsb"))["batches"] > before["batches"] + 30 else None, "batches"
    )
    # Then the new epoch is taken up without a loss, and every track has kept its number all the time
    assert feed_is_at(stack, "adsb")[0] > epoch
    assert after["lost_batches"] == before["lost_batches"] == 0
    numbers = numbers_of_tracks(stack, begun_s, time.time())
    doubled = {address: found for address, found in numbers.items() if len(found) > 1}
    assert not doubled
    without = [point for at_s, point in stack.points(killed_s + 5.0) if at_s < started_s]
    assert any(point["status"] == "confirmed" for point in without)
    first_s = next(at_s for at_s, point in stack.points(started_s) if "adsb" in point["sources"])
    figures["feed killed: first fused ADS-B report after its restart, s"] = round(first_s - started_s, 1)
    figures["feed killed: tracks over the outage, all with their number"] = len(numbers)


def test_no_batch_is_lost_when_the_router_is_killed_for_five_seconds(stack, figures):
    # Given the place of every feed in its sequence
    before = places(stack)
    # When the router is killed and comes back five seconds later
    stack.kill("router")
    time.sleep(5.0)
    back_s = time.time()
    stack.start("router")
    first_s = wait_until(lambda: next((at_s for at_s, _ in stack.points(back_s)), None), "a point")
    figures["router killed 5 s: first fused point after its restart, s"] = round(first_s - back_s, 1)

    # Then every batch that the feeds have put meanwhile is counted by the service, once
    def all_counted() -> Any:
        now = places(stack)
        done = all(now[s].batches - before[s].batches == now[s].seq - before[s].seq for s in SENSORS)
        return now if done else None

    after = wait_until(all_counted, "the service to have every batch")
    for sensor in SENSORS:
        assert after[sensor].epoch == before[sensor].epoch
        assert sensor_of(stack, sensor)["lost_batches"] == 0
        put = after[sensor].seq - before[sensor].seq
        figures[f"router killed 5 s: {sensor} batches put over the outage / lost"] = f"{put} / 0"


def test_killed_service_comes_back_with_new_numbers_and_repeats_no_second(stack, session, figures):
    # Given elements of tracks
    elements = Listener(session, KEYS.feed("element"), recovering=True)
    elements.wait_for(lambda messages: len(messages) > 5, "elements")
    # When the service is killed and started again
    stack.kill("fusion")
    killed_s = time.time()
    used = {point["track_number"] for _, point in stack.points()}
    published = [point for message in elements.messages for point in message["points"]]
    epoch, known = published[-1]["epoch"], {point["address"] for point in published}
    stack.start("fusion")
    # Then live points come at once, under numbers that were never used
    fresh = wait_until(
        lambda: next(((at_s, p) for at_s, p in stack.points(killed_s) if p["epoch"] != epoch), None), "a live point"
    )
    begun_s = stack.started_s("fusion")
    ready_s = next(at_s for at_s, line in stack.log("fusion", killed_s) if "service_started" in line)
    figures["service killed: started after its container, s"] = round(ready_s - begun_s, 1)
    figures["service killed: first live point after its container, s"] = round(fresh[0] - begun_s, 1)
    # Every known aircraft that is seen again gets elements
    time.sleep(5.0)
    confirmed = {p["address"] for _, p in stack.points(killed_s) if p["epoch"] != epoch and p["status"] == "confirmed"}
    flying = confirmed & known
    assert flying

    def after(messages: list[Any]) -> list[dict[str, Any]]:
        return [point for message in messages for point in message["points"] if point["epoch"] != epoch]

    elements.wait_for(lambda messages: flying <= {point["address"] for point in after(messages)}, "elements of all")
    assert not used & {point["track_number"] for point in after(elements.messages)}
    # And no second of any aircraft is published twice, or in no element as far back as sensors can repeat
    published = [point for message in elements.messages for point in message["points"]]
    joints = [seam for found in seams(published).values() for seam in found]
    gaps_s = [next_s - ended_s for ended_s, next_s in joints]
    none_s, twice_s = (sum(s for s in gaps_s if s > 0.0), -sum(s for s in gaps_s if s < 0.0))
    figures["service killed: aircraft / their seconds in no element / in two"] = (
        f"{len(flying)} / {none_s:.1f} / {twice_s:.1f}"
    )
    for ended_s, next_s in joints:
        assert ended_s <= next_s <= max(ended_s, ready_s - HISTORY_S + 1.0)


def test_reports_from_before_a_cut_come_late_and_jolt_no_track(stack, figures):
    # Given how much live points usually leave the line of flight
    now_s = time.time()
    wait_until(lambda: len(steps(stack, now_s, time.time())) > 1000, "points")
    usual = steps(stack, now_s, time.time())
    before = sensor_of(stack, "adsb")
    # When a feed's network is cut for twenty seconds
    stack.cut("adsb", "adsb")
    cut_s = time.time()
    time.sleep(20.0)
    without = steps(stack, cut_s, time.time())
    stack.join("adsb", "adsb")
    joined_s = time.time()
    # Then what it could not deliver is fetched, and what is too old for its element is counted late
    after = wait_until(
        lambda: found if (found := sensor_of(stack, "adsb"))["batches"] > before["batches"] + 150 else None, "batches"
    )
    assert after["lost_batches"] == 0
    counted = {r: n - before["rejected"].get(r, 0) for r, n in after["rejected"].items()}
    assert counted.get("late", 0) + counted.get("too_old", 0) > 0
    time.sleep(10.0)
    restored = steps(stack, joined_s, time.time())
    figures["network cut 20 s: reports late or too old"] = {r: n for r, n in counted.items() if n}
    figures["network cut 20 s: lost batches"] = 0
    for name, found in (("before", usual), ("during", without), ("after", restored)):
        for column, unit in enumerate(("m", "sigmas")):
            figures[f"network cut 20 s: points off the line of flight {name}, p50 / p99 / max {unit}"] = " / ".join(
                f"{value:.1f}" for value in (*np.percentile(found[:, column], [50, 99]), found[:, column].max())
            )
    # And no track is moved further than it had said that it might be wrong, as ever
    assert np.percentile(restored[:, 1], 99) <= 1.5 * max(np.percentile(usual[:, 1], 99), 3.0)
    times: dict[int, float] = {}
    for _, point in stack.points(cut_s):
        before_s = times.get(point["track_number"], 0.0)
        # The last point of a track that ends is at the time of the one before it.
        assert point["time_s"] > before_s or (point["status"], point["time_s"]) == ("terminated", before_s)
        times[point["track_number"]] = point["time_s"]


def test_bad_line_costs_no_batch(stack, figures):
    # Given a line with 200 ms of delay, 20 ms of jitter and 2 % loss
    usual_s, start = latency_of(stack, "adsb"), sensor_of(stack, "adsb")
    try:
        with bad_line(stack.inspect("adsb")["State"]["Pid"], Line(delay_s=0.2, jitter_s=0.02, loss=0.02)) as line:
            # When three hundred batches have come over it
            latency_s = latency_of(stack, "adsb")
            end = wait_until(
                lambda: f if (f := sensor_of(stack, "adsb"))["batches"] > start["batches"] + 300 else None, "batches"
            )
    except BadLineError as error:
        pytest.skip(str(error))
    # Then they came later, and none is missing or too late to be used
    assert latency_s > usual_s + 0.1
    assert end["lost_batches"] == start["lost_batches"]
    assert end["rejected"].get("late", 0) == start["rejected"].get("late", 0)
    figures["bad line: made by / frames / lost frames"] = f"{line.made_by} / {line.frames} / {line.lost}"
    figures["bad line: latency of the feed before / on it, s"] = f"{usual_s:.2f} / {latency_s:.2f}"
    figures["bad line: batches lost, reports late"] = "0, 0"
