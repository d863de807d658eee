"""One closed element becomes one fused point: each mode against a computation by hand."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from tests.builders import ADSB, RADAR1, measurements

from aeroskein.buffers import ReportBuffers
from aeroskein.closed import Closed, Estimate
from aeroskein.fusion import Fused, fuse
from aeroskein.gating import GateMemory
from aeroskein.reasons import Reason
from aeroskein.settings import EngineSettings, FusionSettings, PatentSettings
from aeroskein.windows import REPORT, gather

START_S, END_S = 100.0, 104.0
CENTRE_S = 102.0
EAST = (0.0, 0.0, 200.0, 0.0, 0.0, 0.0)
P = np.diag([25.0, 36.0, 1.0, 2.0, 0.1, 0.1])

Row = tuple[float, float, float]
"""Time, east and north of a report."""


def modes(mode: str, **patent: object) -> EngineSettings:
    return EngineSettings(
        sensors=(ADSB, RADAR1), fusion=FusionSettings(mode=mode), patent=PatentSettings(**patent)  # type: ignore[arg-type]
    )  # fmt: skip


def closed(
    rows: list[Row],
    x: tuple[float, ...] = EAST,
    refused: tuple[int, ...] = (),
    sigmas: float = 1.0,
    filtered: tuple[float, ...] | None = None,
    before: tuple[float, ...] = (np.nan,) * 4,
    **columns: object,
) -> Closed:
    """An element from 100 to 104 s; reports in order of time, those of the given numbers refused as outliers.

    Each report came ``sigmas`` away from its prediction.
    """
    buffers = ReportBuffers(1, max(8, len(rows)), np.float64)
    rows = sorted(rows)
    if rows:
        t, e, n = np.array(rows).T
        made = measurements(len(rows), **({"time_s": t, "east_m": e, "north_m": n} | columns))
        assert buffers.add(made, np.full(len(rows), -np.inf)).all()
    centre = np.array([CENTRE_S])
    window = gather(buffers.rows, np.arange(1), np.array([90.0]), np.array([110.0]), centre, centre)
    reason = np.zeros(window.kind.shape, dtype=np.uint8)
    reports = np.flatnonzero(window.kind[:, 0] == REPORT)
    reason[reports[list(refused)], 0] = Reason.OUTLIER
    state, covariance = np.array(x)[:, None], np.zeros((24, 1))
    width = np.where(window.kind == REPORT, 150.0 + 10.0 * np.arange(len(window.kind))[:, None], np.nan)
    distance2 = np.full(window.kind.shape, sigmas**2)
    forward = state if filtered is None else np.array(filtered)[:, None]
    e = Estimate(
        state, P[None], forward, covariance, state, covariance, GateMemory.empty(1, 2), reason, width, distance2
    )
    return Closed(
        np.array([0]), np.array([5]), np.array([[START_S, END_S]]), centre, e, window, np.array(before)[:, None]
    )


def place(fused: Fused) -> tuple[float, float]:
    return float(fused.position_m[0, 0]), float(fused.position_m[1, 0])


# -- information ------------------------------------------------------------------------------------------------------
def test_information_is_the_estimate_at_the_centre() -> None:
    fused = fuse(closed([(101.0, -190.0, 4.0)], (3.0, 4.0, 200.0, 5.0, 0.0, 0.0)), modes("information"))

    assert (place(fused), fused.time_s[0]) == ((3.0, 4.0), CENTRE_S)
    assert fused.position_cov[:, 0].tolist() == [25.0, 0.0, 36.0]
    assert fused.velocity_mps is not None
    assert fused.velocity_cov is not None
    assert (fused.velocity_mps[:, 0].tolist(), fused.velocity_cov[:, 0].tolist()) == ([200.0, 5.0], [1.0, 0.0, 2.0])


FILTERED = (1.0, 30.0, 200.0, 0.0, 0.0, 0.0)
EVERY_SECOND = np.arange(99.0, 106.0)


def beside(offset_m: float, sigmas: float = 1.0, **more: object) -> Fused:
    """An element whose reports all lie so far to the north of the smoothed flight east."""
    rows = [(float(t), 200.0 * (t - CENTRE_S), offset_m) for t in EVERY_SECOND]
    sigma = {"r_ee": np.full(len(rows), 100.0), "r_nn": np.full(len(rows), 100.0), "r_en": np.zeros(len(rows))}
    return fuse(closed(rows, EAST, sigmas=sigmas, filtered=FILTERED, **sigma, **more), modes("information"))


def test_a_smoothed_flight_with_its_reports_on_one_side_is_held_back() -> None:
    held, stands = beside(45.0), beside(35.0)

    assert (held.guarded.tolist(), place(held)) == ([True], (1.0, 30.0))
    assert (stands.guarded.tolist(), place(stands)) == ([False], (0.0, 0.0))


def test_reports_on_both_sides_are_noise() -> None:
    rows = [(float(t), 200.0 * (t - CENTRE_S), 45.0 * (-1) ** k) for k, t in enumerate(EVERY_SECOND)]

    assert not fuse(closed(rows, EAST), modes("information")).guarded.any()


def test_reports_that_surprise_on_average_hold_the_smoothed_state_back() -> None:
    assert beside(0.0, sigmas=3.1).guarded.all()
    assert not beside(0.0, sigmas=2.9).guarded.any()
    # Refused reports say nothing of the state, and two do not make an average.
    assert not beside(0.0, sigmas=3.1, refused=(0, 1, 2, 3, 4)).guarded.any()


@pytest.mark.parametrize(("filtered_east_m", "guarded"), [(-40.0, True), (-1200.0, False)])
def test_a_smoothed_place_that_makes_the_track_turn_back_is_held_back(filtered_east_m: float, guarded: bool) -> None:
    before = (-1700.0, 0.0, -900.0, 0.0)  # eight hundred metres to the east, then two hundred back

    fused = fuse(
        closed([], (-1100.0, 20.0, 200.0, 0.0, 0.0, 0.0), filtered=(filtered_east_m, *FILTERED[1:]), before=before),
        modes("information"),
    )

    # Where the filtered place turns back too, nothing is gained by it.
    assert fused.guarded.tolist() == [guarded]
    assert place(fused)[0] == (filtered_east_m if guarded else -1100.0)


@pytest.mark.parametrize("mode", ["information", "weighted", "patent"])
def test_only_reports_of_the_span_count(mode: str) -> None:
    rows = [(99.9, -420.0, 0.0), (100.0, -400.0, 0.0), (103.9, 380.0, 0.0), (104.0, 400.0, 0.0)]

    fused = fuse(closed(rows), modes(mode))

    # The span is closed at its start and open at its end.
    assert fused.accepted.sum() == 2
    assert fused.reason.sum() == 0


def test_refused_reports_are_told_with_their_reason() -> None:
    c = closed([(101.0, -200.0, 0.0), (102.5, 100.0, 900.0), (103.0, 200.0, 0.0)], refused=(1,))

    for mode in ("information", "weighted"):
        fused = fuse(c, modes(mode))
        assert fused.accepted.sum() == 2
        assert fused.reason[fused.reason > 0].tolist() == [Reason.OUTLIER]


def test_the_boundary_lines_hold_all_reports_of_the_element() -> None:
    # Widths grow by 10 m with every event; the last one inside the span counts, the one behind it does not.
    c = closed([(100.5, -300.0, 0.0), (103.0, 200.0, 0.0), (106.0, 800.0, 0.0)])

    assert fuse(c, modes("information")).half_width_m.tolist() == [170.0]
    assert fuse(c, modes("patent", half_width_m=400.0)).half_width_m.tolist() == [400.0]


# -- weighted ---------------------------------------------------------------------------------------------------------
def test_weighted_is_the_inverse_variance_mean_of_places_and_times() -> None:
    rows = [(101.0, -205.0, 8.0), (101.5, -90.0, -30.0), (103.0, 210.0, 2.0)]
    variance = np.array([100.0, 3600.0, 100.0])
    c = closed(rows, r_ee=variance, r_nn=2.0 * variance, r_en=0.5 * variance, time_variance=[0.04, 0.0, 0.01])

    fused = fuse(c, modes("weighted"))

    # By hand: the time stamp's part lies along the flight to the east, 200 m/s.
    ree = variance + np.array([0.04, 0.0, 0.01]) * 200.0**2
    share = 1.0 / (ree + 2.0 * variance)
    share /= share.sum()
    t, e, n = np.array(rows).T
    assert fused.time_s[0] == pytest.approx(share @ t, abs=1e-9)
    assert place(fused) == pytest.approx((share @ e, share @ n), abs=1e-9)
    wanted = [share**2 @ ree, share**2 @ (0.5 * variance), share**2 @ (2.0 * variance)]
    assert fused.position_cov[:, 0].tolist() == pytest.approx(wanted)
    assert fused.velocity_mps is None


def test_weighted_leaves_refused_reports_out() -> None:
    good = [(101.0, -205.0, 8.0), (103.0, 210.0, 2.0)]

    fused = fuse(closed([*good, (102.0, 0.0, 5000.0)], refused=(1,)), modes("weighted"))

    wanted = fuse(closed(good), modes("weighted"))
    assert place(fused) == pytest.approx(place(wanted))
    assert fused.time_s[0] == pytest.approx(wanted.time_s[0])


def test_weighted_point_lies_on_the_flight_at_its_time() -> None:
    # All reports exact: whatever their weights, the mean place belongs to the mean time.
    times = np.array([100.2, 100.9, 103.7])
    c = closed([(t, 200.0 * (t - CENTRE_S), 0.0) for t in times], r_ee=[10.0, 900.0, 50.0])

    fused = fuse(c, modes("weighted"))

    assert place(fused)[0] == pytest.approx(200.0 * (fused.time_s[0] - CENTRE_S), abs=1e-6)


# -- patent -----------------------------------------------------------------------------------------------------------
def smallest_circle(points: np.ndarray) -> np.ndarray:
    """Centre of the smallest circle by trying every pair and every triple."""
    best, best_radius = points[0], np.inf
    candidates = [points.mean(axis=0)] if len(points) == 1 else [0.5 * (a + b) for a, b in combinations(points, 2)]
    for a, b, c in combinations(points, 3):
        M = 2.0 * np.array([b - a, c - a])
        if abs(np.linalg.det(M)) > 1e-9:
            candidates.append(np.linalg.solve(M, [b @ b - a @ a, c @ c - a @ a]))
    for centre in candidates:
        radius = np.linalg.norm(points - centre, axis=1).max()
        if radius < best_radius - 1e-12:
            best, best_radius = centre, radius
    return best


def on_axis(x: tuple[float, ...], point: np.ndarray, times: np.ndarray) -> float:
    """Time of the place on the polyline through the flight at the given times that is nearest to a point."""
    h = times - CENTRE_S
    s = np.array(x)
    at = s[:2] + h[:, None] * s[2:4] + 0.5 * h[:, None] ** 2 * s[4:6]
    fine = np.linspace(times[0], times[-1], 400_001)
    path = np.stack([np.interp(fine, times, at[:, k]) for k in (0, 1)], axis=1)
    return float(fine[np.linalg.norm(path - point, axis=1).argmin()])


reports = st.lists(
    st.tuples(st.floats(100.0, 103.99), st.floats(-380.0, 380.0), st.floats(-500.0, 500.0)), min_size=1, max_size=9
)


@given(reports)
@settings(max_examples=40)
def test_patent_is_the_centre_of_the_smallest_circle_at_its_time_on_the_axis(rows: list[Row]) -> None:
    fused = fuse(closed(rows), modes("patent"))

    points = np.array([r[1:] for r in rows])
    centre = smallest_circle(points)
    assert np.linalg.norm(fused.position_m[:, 0] - centre) < 1e-6 * (1.0 + np.ptp(points))
    assert fused.time_s[0] == pytest.approx(on_axis(EAST, centre, np.arange(100.0, 104.5)), abs=2e-5)
    assert np.isnan(fused.position_cov).all()
    assert fused.velocity_mps is None


def test_patent_circle_is_scipys() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-380.0, 380.0, (12, 2))
    # Smallest r with |p - c|² <= r² for all p.
    found = minimize(
        lambda v: v[2], [0.0, 0.0, 1000.0], method="SLSQP", tol=1e-14,
        constraints={"type": "ineq", "fun": lambda v: (v[2] ** 2 - ((points - v[:2]) ** 2).sum(axis=1)) / 1e5},
    )  # fmt: skip

    fused = fuse(closed([(101.0 + 0.1 * k, *p) for k, p in enumerate(points)]), modes("patent"))

    assert place(fused) == pytest.approx(tuple(found.x[:2]), abs=0.01)


TURN = (0.0, 0.0, 120.0, 0.0, 0.0, 6.3)  # three degrees a second to the left, at 120 m/s


def test_patent_time_follows_the_polyline_in_a_turn() -> None:
    rows = [(101.0, -110.0, 90.0), (103.5, 170.0, 60.0)]

    polyline, chord = (fuse(closed(rows, TURN), modes("patent", axis=a)) for a in ("polyline", "chord"))

    centre = np.array([30.0, 75.0])
    assert place(polyline) == pytest.approx(tuple(centre))
    assert polyline.time_s[0] == pytest.approx(on_axis(TURN, centre, np.arange(100.0, 104.5)), abs=2e-5)
    assert chord.time_s[0] == pytest.approx(on_axis(TURN, centre, np.array([100.0, 104.0])), abs=2e-5)


def test_a_chord_cuts_the_corner_and_a_polyline_does_not() -> None:
    # The arc's middle lies 12.6 m beside the chord of its ends: 545 m beyond the middle is 557 m beyond the chord.
    beyond = [(102.0, 0.0, -545.0)]

    assert fuse(closed(beyond, TURN), modes("patent", axis="polyline")).accepted.any()
    assert not fuse(closed(beyond, TURN), modes("patent", axis="chord")).accepted.any()


@pytest.mark.parametrize(("offset_m", "accepted"), [(549.0, True), (-549.0, True), (551.0, False), (-551.0, False)])
def test_patent_takes_what_lies_between_the_lines_550_metres_off(offset_m: float, accepted: bool) -> None:
    fused = fuse(closed([(102.0, 0.0, 0.0), (102.5, 100.0, offset_m)]), modes("patent"))

    assert fused.accepted.sum() == 1 + accepted
    assert (Reason.OUTSIDE_BOUNDARY in fused.reason) is not accepted
    assert place(fused) == pytest.approx((50.0, offset_m / 2.0) if accepted else (0.0, 0.0))


@pytest.mark.parametrize(("east_m", "accepted"), [(940.0, True), (960.0, False), (-940.0, True), (-960.0, False)])
def test_patent_refuses_what_lies_far_along_the_axis(east_m: float, accepted: bool) -> None:
    # The element is 800 m long.
    fused = fuse(closed([(102.0, 0.0, 0.0), (102.5, east_m, 0.0)]), modes("patent"))

    assert fused.accepted.sum() == 1 + accepted


@pytest.mark.parametrize("x", [(0.0,) * 6, (0.0, 0.0, 0.5, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 3.0, 0.0, 0.0)])
@pytest.mark.parametrize("axis", ["polyline", "chord"])
def test_patent_boundary_holds_for_an_aircraft_that_hovers(x: tuple[float, ...], axis: str) -> None:
    rows = [(101.0, 20.0, 0.0), (102.0, -20.0, 0.0), (103.0, 0.0, 2000.0), (103.5, -2000.0, 0.0)]

    fused = fuse(closed(rows, x), modes("patent", axis=axis))

    assert fused.accepted.sum() == 2
    assert place(fused) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert START_S <= fused.time_s[0] <= END_S


def test_patent_looks_at_places_only() -> None:
    # What the statistical gate refuses but what lies between the lines takes part, as published.
    fused = fuse(closed([(101.0, -200.0, 0.0), (103.0, 200.0, 300.0)], refused=(1,)), modes("patent"))

    assert fused.accepted.sum() == 2
    assert place(fused) == pytest.approx((0.0, 150.0))


def test_the_fused_time_stays_inside_the_element() -> None:
    fused = fuse(closed([(101.0, 900.0, 0.0)]), modes("patent"))

    assert fused.time_s[0] == END_S


# -- all modes --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("mode", ["information", "weighted", "patent"])
def test_an_element_without_reports_is_predicted(mode: str) -> None:
    fused = fuse(closed([], (7.0, 8.0, 200.0, 0.0, 0.0, 0.0)), modes(mode))

    assert (place(fused), fused.time_s[0]) == ((7.0, 8.0), CENTRE_S)
    assert not fused.accepted.any()
    if mode == "weighted":
        assert fused.position_cov[:, 0].tolist() == [25.0, 0.0, 36.0]


@pytest.mark.parametrize("mode", ["information", "weighted", "patent"])
def test_an_element_whose_reports_were_all_refused_is_predicted(mode: str) -> None:
    fused = fuse(closed([(102.0, 0.0, 3000.0)], refused=(0,)), modes(mode))

    assert place(fused) == (0.0, 0.0)
    assert not fused.accepted.any()
    assert (fused.reason > 0).sum() == 1
