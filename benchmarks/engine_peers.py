"""The engine against filters of other libraries on the same seeded reports: processor time and error, in one run.

    python -m benchmarks.engine_peers [--aircraft N] [--few N] [--plots FOLDER]

Ours is the whole engine (``receive`` and ``advance``: checks, registration, association, both products, integrity) at
batches of 2,750 reports. The peers are given more than they would have: reports already converted to each aircraft's
plane, assigned, in order of time, and they do nothing but filter. Stone Soup: its unscented filter, constant
acceleration. filterpy: three unscented filters in its IMM, and its plain Kalman filter. Errors are horizontal, of the
state after each report of the same aircraft, after 15 s. Exit status 1 when the engine is not as much faster as it
should be.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from benchmarks.bars import FOLDER, plot_bars
from benchmarks.engine_scene import (
    AZIMUTH_SIGMA_DEG,
    POSITION_SIGMA_M,
    RANGE_SIGMA_M,
    REPORTS_PER_S,
    SENSORS,
    START_S,
    VELOCITY_SIGMA_MPS,
    Traffic,
    settings,
)

from aeroskein import geodesy
from aeroskein.engine import FusionEngine
from aeroskein.plots import Array, Plots
from aeroskein.points import FusedPoints, Product
from aeroskein.radar_geometry import radar_covariance, radar_to_geodetic

# Times faster than.
GOALS: Final = {"Stone Soup UKF": 80.0, "filterpy IMM-UKF": 60.0}
WARM_S: Final = 15.0
SECONDS: Final = 32.0
# Elements have begun by then.
MEASURED_FROM_S: Final = 22.0
BATCH: Final = 2_750.0
JERK_DENSITIES: Final = (1e-4, 0.04, 4.0)


class Report(NamedTuple):
    """A report of one aircraft in its plane: position, velocity (NaN: none), covariances."""

    after_s: float
    z: Array
    R: Array


class Result(NamedTuple):
    """Processor time per report, and root mean square of the horizontal error."""

    us: float
    rms_m: float


def engine_result(aircraft: int, few: int) -> tuple[dict[str, Result], list[list[Report]], Traffic]:
    """The whole engine; also the reports of the first few aircraft in their planes."""
    traffic = Traffic(aircraft)
    engine = FusionEngine(settings(aircraft), epoch_ms=0)
    spent_s, reports, points, seen = 0.0, 0, list[FusedPoints](), list[Plots]()
    for now_s, plots in traffic.ticks(SECONDS, BATCH / (REPORTS_PER_S * aircraft)):
        started = time.process_time()
        events = engine.receive(plots, now_s=now_s) + engine.advance(now_s=now_s)
        took_s = time.process_time() - started
        if now_s > START_S + MEASURED_FROM_S:
            spent_s, reports = spent_s + took_s, reports + len(plots)
        points += [event for event in events if isinstance(event, FusedPoints)]
        seen.append(plots.take(plots.address < traffic.address[0] + few))
    us = 1e6 * spent_s / reports
    results = {}
    for name, product in (("aeroskein, live", Product.LIVE), ("aeroskein, elements", Product.ELEMENT)):
        mine = FusedPoints.concatenate([p for p in points if p.product == product])
        mine = mine.take((mine.address < traffic.address[0] + few) & (mine.time_s > START_S + WARM_S))
        rows = (mine.address - traffic.address[0]).astype(np.int64)
        place, _, _ = traffic.state(rows, mine.time_s - START_S)
        east, north = geodesy.to_plane(traffic.frames[rows], mine.lat_deg, mine.lon_deg)
        results[name] = Result(us, _rms(np.hypot(east - place[0], north - place[1])))
    return results, in_planes(Plots.concatenate(seen), traffic, few), traffic


def in_planes(plots: Plots, traffic: Traffic, few: int) -> list[list[Report]]:
    """Reports by aircraft in order of time, converted to their planes."""
    rows = (plots.address - traffic.address[0]).astype(np.int64)
    frames = traffic.frames[rows]
    lat, lon = plots.lat_deg.copy(), plots.lon_deg.copy()
    covariance = np.tile([POSITION_SIGMA_M**2, 0.0, POSITION_SIGMA_M**2], (len(plots), 1))
    for k, sensor in enumerate(SENSORS):
        at = np.flatnonzero(plots.sensor == k) if sensor.is_radar else np.zeros(0, dtype=np.int64)
        if not len(at):
            continue
        site = geodesy.frame_rows(
            *(np.array([v], dtype=float) for v in (sensor.lat_deg, sensor.lon_deg)), sensor.height_m or 0.0
        )
        fix = radar_to_geodetic(site, plots.range_m[at], plots.azimuth_deg[at], plots.altitude_m[at])
        lat[at], lon[at] = fix.lat_deg, fix.lon_deg
        covariance[at] = radar_covariance(
            site, plots.range_m[at], plots.azimuth_deg[at], fix, range_sigma_m=RANGE_SIGMA_M,
            azimuth_sigma_deg=AZIMUTH_SIGMA_DEG, height_sigma_m=8.0,
        )  # fmt: skip
    axes = geodesy.local_axes(frames, lat, lon, plots.altitude_m)
    place = geodesy.to_plane(frames, lat, lon)
    angle = np.radians(plots.track_angle_deg)
    velocity = geodesy.rotate_vector(
        axes, plots.ground_speed_mps * np.sin(angle), plots.ground_speed_mps * np.cos(angle)
    )
    noise = geodesy.rotate_covariance(axes, covariance)
    out: list[list[Report]] = [[] for _ in range(few)]
    for i in np.argsort(plots.time_s, kind="stable"):
        ee, en, nn = noise[i]
        R = np.array([[ee, en], [en, nn]])
        z = np.array([place[0][i], place[1][i], velocity[0][i], velocity[1][i]])
        out[rows[i]].append(Report(float(plots.time_s[i] - START_S), z, R))
    return out


def _rms(errors: Any) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def peer_result(
    of_aircraft: Callable[[list[Report]], list[Array]], flights: list[list[Report]], traffic: Traffic
) -> Result:
    """Run a filter over each aircraft's reports; ``of_aircraft`` gives the position after all reports but the first."""
    of_aircraft(flights[0][:4])  # imports are not what is measured
    spent_s, reports, errors = 0.0, 0, []
    for row, flight in enumerate(flights):
        started = time.process_time()
        states = of_aircraft(flight)
        spent_s += time.process_time() - started
        reports += len(flight)
        after_s = np.array([r.after_s for r in flight[1:]])
        truth, _, _ = traffic.state(np.full(len(after_s), row), after_s)
        away = np.hypot(*(np.array(states).T - truth))
        errors.append(away[after_s > WARM_S])
    return Result(1e6 * spent_s / reports, _rms(np.concatenate(errors)))


def transition(h: float, q: float) -> tuple[Array, Array]:
    """F and Q of constant acceleration with white jerk; states px py vx vy ax ay."""
    f = np.array([[1.0, h, 0.5 * h * h], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    c = np.array([[h**5 / 20, h**4 / 8, h**3 / 6], [h**4 / 8, h**3 / 3, h**2 / 2], [h**3 / 6, h**2 / 2, h]])
    return np.kron(f, np.eye(2)), q * np.kron(c, np.eye(2))


def begin(report: Report) -> tuple[Array, Array]:
    """State and covariance from a first report."""
    known = np.isfinite(report.z[2])
    x = np.concatenate([report.z[:2], report.z[2:] if known else np.zeros(2), np.zeros(2)])
    P = np.diag([0.0, 0.0, *([1.0, 1.0] if known else [250.0**2] * 2), 9.0, 9.0])
    P[:2, :2] = report.R
    return x, P


def full_noise(report: Report) -> Array:
    """Covariance of all that is measured: of position alone, or of position and velocity."""
    if np.isnan(report.z[2]):
        return report.R
    return np.block([[report.R, np.zeros((2, 2))], [np.zeros((2, 2)), VELOCITY_SIGMA_MPS**2 * np.eye(2)]])


def stone_soup_ukf(flight: list[Report]) -> list[Array]:
    """Stone Soup's unscented predictor and updater."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantAcceleration
    from stonesoup.predictor.kalman import UnscentedKalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import UnscentedKalmanUpdater

    epoch, order = datetime(2026, 9, 21, tzinfo=UTC), [0, 2, 4, 1, 3, 5]  # its states: x vx ax y vy ay
    model = CombinedLinearGaussianTransitionModel([ConstantAcceleration(JERK_DENSITIES[1])] * 2)
    predictor, updater = UnscentedKalmanPredictor(model), UnscentedKalmanUpdater(None)
    x, P = begin(flight[0])
    state: Any = GaussianState(
        x[order][:, None], P[np.ix_(order, order)], timestamp=epoch + timedelta(seconds=flight[0].after_s)
    )
    out = []
    for report in flight[1:]:
        R = full_noise(report)
        mapping = (0, 3) if len(R) == 2 else (0, 3, 1, 4)
        when = epoch + timedelta(seconds=report.after_s)
        detection = Detection(report.z[: len(R), None], timestamp=when, measurement_model=LinearGaussian(6, mapping, R))
        state = updater.update(SingleHypothesis(predictor.predict(state, timestamp=when), detection))
        out.append(np.array([float(state.mean[0, 0]), float(state.mean[3, 0])]))
    return out


def filterpy_imm_ukf(flight: list[Report]) -> list[Array]:
    """filterpy's IMM over three of its unscented filters."""
    from filterpy.kalman import IMMEstimator, MerweScaledSigmaPoints, UnscentedKalmanFilter

    def fly(x: Array, dt: float) -> Array:
        out: Array = transition(dt, 0.0)[0] @ x
        return out

    x, P = begin(flight[0])
    filters = []
    for _ in JERK_DENSITIES:
        points = MerweScaledSigmaPoints(6, alpha=0.1, beta=2.0, kappa=-3.0)
        ukf = UnscentedKalmanFilter(6, 4, 1.0, hx=None, fx=fly, points=points)
        ukf.x, ukf.P = x.copy(), P.copy()
        filters.append(ukf)
    stay = np.array([[0.984, 0.004, 0.012], [0.01, 0.96, 0.03], [0.05, 0.14, 0.81]])
    imm = IMMEstimator(filters, np.array([0.8, 0.15, 0.05]), stay)
    out, last_s = [], flight[0].after_s
    for report in flight[1:]:
        h, R = max(report.after_s - last_s, 1e-3), full_noise(report)
        last_s = report.after_s
        m = len(R)
        for ukf, q in zip(filters, JERK_DENSITIES, strict=True):
            ukf._dt, ukf.Q, ukf.R = h, transition(h, q)[1], R
            ukf.hx = lambda x, m=m: x[:m]
        imm.predict()
        imm.update(report.z[:m])
        out.append(imm.x[:2].copy())
    return out


def filterpy_kf(flight: list[Report]) -> list[Array]:
    """filterpy's plain Kalman filter."""
    from filterpy.kalman import KalmanFilter

    kf = KalmanFilter(6, 4)
    kf.x, kf.P = begin(flight[0])
    out, last_s = [], flight[0].after_s
    for report in flight[1:]:
        F, Q = transition(report.after_s - last_s, JERK_DENSITIES[1])
        last_s, R = report.after_s, full_noise(report)
        kf.predict(F=F, Q=Q)
        kf.update(report.z[: len(R)], R=R, H=np.eye(6)[: len(R)])
        out.append(kf.x[:2].copy())
    return out


def main() -> int:
    """Print the table; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.engine_peers", description=__doc__.partition("\n")[0])
    parser.add_argument("--aircraft", type=int, default=5000, help="of the engine's traffic")
    parser.add_argument("--few", type=int, default=16, help="aircraft that the peers filter, and whose errors count")
    parser.add_argument("--plots", type=Path, default=FOLDER)
    options = parser.parse_args()
    results, flights, traffic = engine_result(options.aircraft, options.few)
    for name, of_aircraft in (
        ("filterpy KF", filterpy_kf), ("filterpy IMM-UKF", filterpy_imm_ukf), ("Stone Soup UKF", stone_soup_ukf),
    ):  # fmt: skip
        try:
            results[name] = peer_result(of_aircraft, flights, traffic)
        except ImportError:
            print(f"    {name} is not installed: not compared (make bench installs it)")
    ours = results["aeroskein, live"].us
    print(f"{'':22s} {'us a report':>12s} {'times ours':>11s} {'RMS error':>10s}")
    for name, result in results.items():
        print(f"{name:22s} {result.us:12.1f} {result.us / ours:10.1f}x {result.rms_m:8.2f} m")
    missed = 0
    for name, goal in GOALS.items():
        if name in results and results[name].us / ours < goal:
            print(f"    MISSED: {results[name].us / ours:.0f} times faster than {name}, at least {goal:.0f}")
            missed += 1
    plot_bars(
        options.plots / "engine_peers.png",
        "Processor time per report",
        {n: r.us for n, r in results.items()},
        "us",
        log=True,
    )
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
