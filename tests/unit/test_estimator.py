"""The element estimator is a plain fixed-lag smoother over the same reports, behind gates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests import plain_algebra as plain
from tests.builders import measurements

from aeroskein import kalman
from aeroskein.buffers import ReportBuffers
from aeroskein.closed import Estimate
from aeroskein.estimator import estimate
from aeroskein.gating import GateMemory
from aeroskein.reasons import Reason
from aeroskein.rings import Rings
from aeroskein.windows import REPORT, Window, gather

NAN = np.nan
SENSORS = 2
GATE = 36.0
seeds = st.integers(0, 2**31)


@dataclass(frozen=True)
class Report:
    """One report of one aircraft; ``v`` absent: position only."""

    time_s: float
    z: tuple[float, float]
    R: tuple[float, float, float] = (100.0, 0.0, 100.0)
    v: tuple[float, float] = (NAN, NAN)
    rv: float = NAN
    tv: float = 0.0
    sensor: int = 0


@dataclass
class Start:
    """State at the settled time."""

    x: np.ndarray
    P: np.ndarray
    t: float = 0.0


def start(speed_mps: float = 200.0) -> Start:
    """Flying east from the origin."""
    return Start(np.array([0.0, 0.0, speed_mps, 0.0, 0.0, 0.0]), np.diag([100.0, 100.0, 4.0, 4.0, 0.04, 0.04]))


def window_of(lanes: list[list[Report]], settled: float, until: float, centre: float, next_settled: float) -> Window:
    """The reports of several aircraft, one list each."""
    buffers = ReportBuffers(len(lanes), max(8, *(len(lane) for lane in lanes)), np.float64)
    for slot, lane in enumerate(lanes):
        if lane:
            c = np.array([(*r.z, *r.R, *r.v, r.rv, r.tv, r.sensor, r.time_s) for r in lane]).T
            reports = measurements(
                len(lane), slot=slot, east_m=c[0], north_m=c[1], r_ee=c[2], r_en=c[3], r_nn=c[4], v_east_mps=c[5],
                v_north_mps=c[6], velocity_variance=c[7], time_variance=c[8], sensor=c[9], time_s=c[10],
            )  # fmt: skip
            assert buffers.add(reports, np.full(len(lane), -np.inf)).all()
    n = len(lanes)
    return gather(buffers.rows, np.arange(n), *(np.full(n, v) for v in (settled, until, centre, next_settled)))


def run(
    lanes: list[list[Report]],
    starts: list[Start],
    centre: float,
    until: float,
    next_settled: float | None = None,
    q: float = 0.01,
    memory: GateMemory | None = None,
) -> tuple[Estimate, Window]:
    """Close one element of each lane. Lanes of the result stand in the order in which they were given."""
    window = window_of(lanes, starts[0].t, until, centre, centre if next_settled is None else next_settled)
    order = window.lanes
    x = np.stack([starts[i].x for i in order], axis=1)
    P = kalman.from_matrix(np.stack([starts[i].P for i in order]))
    t = np.array([starts[i].t for i in order])
    gates = (memory or GateMemory.empty(len(lanes), SENSORS)).take(order)
    e = estimate(window, np.full(window.kind.shape, q), x, P, t, gates)
    return e, window


def alone(reports: list[Report], begin: Start, centre: float, until: float, **more: float) -> tuple[Estimate, Window]:
    return run([reports], [begin], centre, until, **more)


def plain_smoother(
    reports: list[Report], begin: Start, centre: float, until: float, q: float = 0.01
) -> tuple[np.ndarray, np.ndarray, list[bool]]:
    """Filter event by event, gate, smooth: the state at the centre, and which reports were used."""
    used: list[bool] = []
    events: list[plain.Event] = []
    x, P, t = begin.x, begin.P, begin.t
    at = [(r.time_s, 0, r) for r in sorted(reports, key=lambda r: r.time_s) if begin.t < r.time_s <= until]
    where = 0
    for time, is_mark, r in sorted([*at, (centre, 1, None)], key=lambda e: e[:2]):
        step = plain.Event(time - t, q)
        t = time
        x, P = plain.forward(x, P, [step])[0][2:]
        if is_mark:
            where = len(events)
            events.append(step)
            continue
        v = x[2:4]
        R = np.array([[r.R[0], r.R[1]], [r.R[1], r.R[2]]]) + r.tv * (np.outer(v, v) + P[2:4, 2:4])
        after = plain.update(x, P, np.array(r.z), R, plain.POSITION)
        used.append(after.d2 <= GATE)
        if used[-1]:
            step = step._replace(position=(np.array(r.z), R))
            x, P = after.x, after.P
            a = x[4:]
            V = r.rv * np.eye(2) + r.tv * (np.outer(a, a) + P[4:, 4:])
            if np.isfinite(r.rv):
                after = plain.update(x, P, np.array(r.v), V, plain.VELOCITY)
                if after.d2 <= GATE:
                    step = step._replace(velocity=(np.array(r.v), V))
                    x, P = after.x, after.P
        events.append(step)
    smoothed = plain.rauch_tung_striebel(plain.forward(begin.x, begin.P, events), events)
    return (*smoothed[where], used)


def flight(seed: int, seconds: float = 14.0, outliers: float = 0.0) -> list[Report]:
    """ADS-B once a second with velocity, a radar every four seconds, of an aircraft that flies east and wanders."""
    rng = np.random.default_rng(seed)
    reports = []
    for time in np.concatenate([np.arange(0.7, seconds, 1.0), np.arange(2.2, seconds, 4.0)]):
        radar = round(time % 1.0, 3) == 0.2
        sigma = 60.0 if radar else 10.0
        wrong = 800.0 if rng.random() < outliers else 0.0
        z = (200.0 * time + rng.normal(0, sigma) + wrong, 0.2 * time**2 + rng.normal(0, sigma) - wrong)
        v = (NAN, NAN) if radar else (200.0 + rng.normal(), 0.4 * time + rng.normal())
        R = (sigma**2, 0.3 * sigma**2, sigma**2)
        reports.append(Report(float(time), z, R, v, NAN if radar else 1.0, 0.0001 if radar else 0.04, int(radar)))
    return [reports[i] for i in rng.permutation(len(reports))]


@given(seeds)
@settings(max_examples=30)
def test_estimate_is_the_plain_smoothers(seed: int) -> None:
    reports, begin = flight(seed), start()

    e, _ = alone(reports, begin, centre=4.0, until=12.0)

    x, P, used = plain_smoother(reports, begin, 4.0, 12.0)
    assert all(used)
    plain.close(e.x[:, 0], x, atol=1e-5)
    plain.close(e.P[0], P, rtol=1e-7, atol=1e-9)


@given(seeds)
@settings(max_examples=30)
def test_estimate_is_the_plain_smoothers_with_refused_reports_too(seed: int) -> None:
    reports, begin = flight(seed, outliers=0.25), start()

    e, window = alone(reports, begin, centre=5.0, until=11.0)

    x, P, used = plain_smoother(reports, begin, 5.0, 11.0)
    is_report = window.kind[:, 0] == REPORT
    found = (e.reason[is_report, 0] == 0).tolist()
    if _believed_after_all(used, window.sensor_index[is_report, 0].tolist()):
        return  # then gates open again, which the plain smoother knows nothing of
    assert found == used
    plain.close(e.x[:, 0], x, atol=1e-5)
    plain.close(e.P[0], P, rtol=1e-7, atol=1e-9)


def _believed_after_all(used: list[bool], sensor: list[int]) -> bool:
    """Whether a sensor was refused more than four times in a row."""
    runs = dict.fromkeys(sensor, 0)
    for ok, which in zip(used, sensor, strict=True):
        runs[which] = 0 if ok else runs[which] + 1
        if runs[which] > 4:
            return True
    return False


@given(seeds, st.sampled_from([0.0, 1.0]))
@settings(max_examples=10)
def test_window_after_window_is_one_long_run(seed: int, share: float) -> None:
    # A mark for the settled time of its own, or the centre.
    reports, begin = flight(seed, 30.0), start()
    state, memory = begin, GateMemory.empty(1, SENSORS)
    for centre in (2.0, 6.0, 10.0, 14.0):
        settled = centre - share
        e, _ = run([reports], [state], centre, centre + 6.0, settled, memory=memory)

        whole, _ = alone(reports, begin, centre, centre + 6.0)
        # A step that a mark divides turns the least bit differently.
        plain.close(e.x, whole.x, atol=1e-3)
        plain.close(e.P, whole.P, rtol=1e-3, atol=1e-3)
        state = Start(e.settled_x[:, 0], kalman.to_matrix(e.settled_covariance)[0], settled)
        memory = e.settled_memory


def test_settled_state_is_the_filters_at_that_time() -> None:
    reports, begin = flight(3), start()

    e, _ = alone(reports, begin, centre=6.0, until=12.0, next_settled=3.5)

    until_then, _ = alone(reports, begin, centre=3.5, until=3.5)
    plain.close(e.settled_x, until_then.x, atol=1e-9)
    plain.close(kalman.to_matrix(e.settled_covariance), until_then.P, atol=1e-9)
    only_before, _ = alone(reports, begin, centre=6.0, until=6.0)
    # A step that a mark divides turns the least bit differently.
    plain.close(e.filtered_x, only_before.x, atol=1e-3)
    # What comes later than the centre makes it better.
    assert (np.diag(e.P[0]) < np.diag(kalman.to_matrix(e.filtered_covariance)[0])).all()


def test_aircraft_side_by_side_are_aircraft_alone() -> None:
    lanes = [flight(seed, seconds, 0.1) for seed, seconds in ((1, 12.0), (2, 14.0), (3, 3.0), (4, 9.0))]
    starts = [start(200.0 + i) for i in range(4)]

    together, window = run(lanes, starts, 4.0, 12.0)

    for place, lane in enumerate(window.lanes):
        one, w = alone(lanes[lane], starts[lane], 4.0, 12.0)
        plain.close(together.x[:, place], one.x[:, 0], rtol=1e-13)
        plain.close(together.P[place], one.P[0], rtol=1e-12)
        events = w.kind.shape[0]
        assert np.array_equal(together.reason[:events, place], one.reason[:, 0])
        assert np.array_equal(together.half_width_m[:events, place], one.half_width_m[:, 0], equal_nan=True)


def test_without_reports_the_state_is_predicted() -> None:
    begin = start()

    e, _ = alone([], begin, centre=10.0, until=16.0, q=0.5)

    x, P = plain.coordinated_turn(begin.x, begin.P, 10.0, 0.5 * plain.ALONG, 0.5 * plain.ACROSS)
    plain.close(e.x[:, 0], x)
    plain.close(e.P[0], P)


def test_a_report_at_the_settled_time_is_in_the_state_already() -> None:
    begin = start()
    twice = [Report(0.0, (500.0, 500.0))]

    e, window = alone(twice, begin, centre=2.0, until=6.0)

    assert not (window.kind == REPORT).any()
    assert window.reported.sum() == 1
    assert not e.reason.any()
    plain.close(e.x[:, 0], plain.transition(2.0) @ begin.x)


# -- gates ------------------------------------------------------------------------------------------------------------
def verdict(z: tuple[float, float], begin: Start | None = None, **report: object) -> Reason:
    """What becomes of a single report one second later, while the state is at (200, 0)."""
    e, window = alone([Report(1.0, z, **report)], begin or start(), centre=1.5, until=4.0)
    return Reason(int(e.reason[window.kind == REPORT][0]))


def test_reports_within_six_sigma_between_narrow_lines_are_accepted() -> None:
    # Report 10 m, axis 10 m and what it may have flown: 14.6 m; the lines stand 150 m apart from the axis at least.
    assert verdict((200.0, 85.0)) is Reason.ACCEPTED
    assert verdict((200.0, 92.0)) is Reason.OUTLIER


@pytest.mark.parametrize("z", [(200.0, 160.0), (200.0, -160.0), (360.0, 0.0), (40.0, 0.0)])
def test_reports_beyond_the_lines_are_outside(z: tuple[float, float]) -> None:
    assert verdict(z) is Reason.OUTSIDE_BOUNDARY


def test_an_inaccurate_report_within_the_gate_but_beyond_the_lines_is_outside() -> None:
    # 5 sigma are inside the gate of 6, and outside the lines at 4.
    assert verdict((200.0, 500.0), R=(1e4, 0.0, 1e4)) is Reason.OUTSIDE_BOUNDARY
    assert verdict((200.0, 380.0), R=(1e4, 0.0, 1e4)) is Reason.ACCEPTED


def test_lines_lie_along_the_flight() -> None:
    # The report is precise across the flight to the north-east and vague along it.
    e, n = np.array([1.0, 1.0]) / np.sqrt(2.0), np.array([-1.0, 1.0]) / np.sqrt(2.0)
    begin = Start(np.array([0.0, 0.0, 150.0, 150.0, 0.0, 0.0]), start().P)
    cov = 400.0**2 * np.outer(e, e) + 10.0**2 * np.outer(n, n)
    R, at = (cov[0, 0], cov[0, 1], cov[1, 1]), np.array([150.0, 150.0])

    assert verdict(tuple(at + 1200.0 * e), begin, R=R) is Reason.ACCEPTED
    assert verdict(tuple(at + 1700.0 * e), begin, R=R) is Reason.OUTSIDE_BOUNDARY
    assert verdict(tuple(at + 160.0 * n), begin, R=R) is Reason.OUTSIDE_BOUNDARY


def test_where_sigmas_are_large_the_lines_stand_three_kilometres_apart_from_the_axis() -> None:
    assert verdict((200.0, 4_500.0), R=(1e6, 0.0, 1e6)) is Reason.OUTSIDE_BOUNDARY
    # Four sigma are believed however wide: so a flight may begin with a slow radar, its speed still unknown.
    assert verdict((200.0, 3_900.0), R=(1e6, 0.0, 1e6)) is Reason.ACCEPTED


def test_where_an_aircraft_hovers_the_boundary_is_a_disc() -> None:
    hovering = start(5.0)
    R = (40.0**2, 0.0, 10.0**2)  # 4 sigma are 165 m to the east; to the north the least, 150 m

    assert verdict((5.0, 160.0), hovering, R=(1600.0, 0.0, 1600.0)) is Reason.ACCEPTED
    assert verdict((5.0 + 115.0, 115.0), hovering, R=(1600.0, 0.0, 1600.0)) is Reason.ACCEPTED
    assert verdict((5.0 + 130.0, 130.0), hovering, R=(1600.0, 0.0, 1600.0)) is Reason.OUTSIDE_BOUNDARY
    # Were it flying east, 160 m to the north would be beyond the lines; in the disc it is a mere outlier.
    assert verdict((5.0, 160.0), hovering, R=R) is Reason.OUTLIER


def test_half_width_is_four_sigma_of_report_and_axis_within_its_limits() -> None:
    def width(sigma_m: float) -> float:
        e, window = alone([Report(1.0, (200.0, 0.0), (50.0, 0.0, sigma_m**2))], start(), centre=1.5, until=4.0)
        return float(e.half_width_m[window.kind == REPORT][0])

    begin = start()
    axis = plain.coordinated_turn(begin.x, begin.P, 1.0, 0.01 * plain.ALONG, 0.01 * plain.ACROSS)[1][1, 1]
    assert width(10.0) == 150.0
    assert width(100.0) == pytest.approx(4.0 * np.sqrt(1e4 + axis))
    assert width(2000.0) == 3000.0


def test_a_wrong_velocity_is_left_out_while_its_position_counts() -> None:
    good = Report(1.0, (205.0, 3.0))
    wrong = Report(1.0, (205.0, 3.0), v=(-200.0, 0.0), rv=1.0)

    e, window = alone([wrong], start(), centre=2.0, until=6.0)

    without, _ = alone([good], start(), centre=2.0, until=6.0)
    assert e.reason[window.kind == REPORT].tolist() == [0]
    plain.close(e.x, without.x, rtol=1e-12)


def ghost(seconds: int, sensor: int = 1, R: float = 100.0) -> list[Report]:
    """A source that says with confidence that the aircraft is 1 km further north."""
    return [Report(t + 0.5, (200.0 * (t + 0.5), 1000.0), (R, 0.0, R), sensor=sensor) for t in range(seconds)]


def test_a_source_that_is_refused_four_times_is_believed() -> None:
    e, window = alone(ghost(7), start(), centre=6.9, until=8.0)

    assert (e.reason[window.kind == REPORT] == 0).tolist() == [False] * 4 + [True] * 3
    assert e.x[1, 0] == pytest.approx(1000.0, abs=30.0)


def test_it_is_believed_across_windows_too() -> None:
    first, _ = alone(ghost(7), start(), centre=2.9, until=3.0)
    state = Start(first.settled_x[:, 0], kalman.to_matrix(first.settled_covariance)[0], 2.9)

    e, window = run([ghost(7)], [state], 6.9, 8.0, memory=first.settled_memory)

    assert (e.reason[window.kind == REPORT] == 0).tolist() == [False, True, True, True]


def test_it_is_not_believed_against_a_source_at_least_as_good() -> None:
    true = [Report(float(t), (200.0 * t, 0.0), sensor=0) for t in range(1, 12)]

    e, window = alone(true + ghost(11), start(), centre=6.0, until=12.0)

    is_report = window.kind[:, 0] == REPORT
    refused = e.reason[is_report, 0] != 0
    assert np.array_equal(refused, window.sensor_index[is_report, 0] == 1)
    assert abs(e.x[1, 0]) < 10.0


def test_nothing_to_close_is_nothing() -> None:
    window = gather(Rings(0, 8), np.arange(0), *(np.zeros(0) for _ in range(4)))

    e = estimate(
        window, np.zeros((0, 0)), np.zeros((6, 0)), np.zeros((24, 0)), np.zeros(0), GateMemory.empty(0, SENSORS)
    )  # fmt: skip

    assert e.x.shape == (6, 0)
