"""Small flights for the tests of the offline filters: measurements in a plane, and filterpy set up as they are."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray

from aeroskein.measurements import Measurements

Floats = NDArray[np.float64]
YAW = 4


def measurements(flight: Any, time_s: Any, position_m: Any, **changes: Any) -> Measurements:
    """Reports with sigma 10 m, 0.2 s and no velocity, but for the given changes."""
    flight, time_s = np.asarray(flight, dtype=np.int64), np.asarray(time_s, dtype=np.float64)
    position_m = np.asarray(position_m, dtype=np.float64)
    n = len(flight)
    none = np.full(n, np.nan)
    columns: dict[str, Any] = {
        "slot": flight, "time_s": time_s, "received_s": time_s, "sensor": np.zeros(n),
        "east_m": position_m[:, 0].copy(), "north_m": position_m[:, 1].copy(),
        "r_ee": np.full(n, 100.0), "r_en": np.zeros(n), "r_nn": np.full(n, 100.0),
        "v_east_mps": none, "v_north_mps": none.copy(), "velocity_variance": none.copy(),
        "time_variance": np.full(n, 0.04), "altitude_m": none.copy(), "vertical_rate_mps": none.copy(),
        "height_m": none.copy(), "stamp_s": time_s, "range_m": none.copy(), "azimuth_deg": none.copy(),
    }  # fmt: skip
    for name, value in changes.items():
        columns[name] = np.broadcast_to(np.asarray(value, dtype=np.float64), n).copy()
    return Measurements(**columns)


def turning_flights(seed: int, reports: tuple[int, ...] = (60, 35)) -> Measurements:
    """Flights at 130 m/s that go straight, turn with 3 degrees a second and go straight, noisy, unevenly reported."""
    rng = np.random.default_rng(seed)
    flight, time, position, velocity = [], [], [], []
    for number, n in enumerate(reports):
        t = np.cumsum(rng.uniform(0.6, 1.4, n))
        rate = np.where((t > 15.0) & (t < 35.0), math.radians(3.0), 0.0)
        fine = np.linspace(0.0, t[-1], 20 * n)
        yaw = 0.4 + number + np.cumsum(np.interp(fine, t, rate)) * (fine[1] - fine[0])
        east = np.cumsum(130.0 * np.sin(yaw)) * (fine[1] - fine[0])
        north = np.cumsum(130.0 * np.cos(yaw)) * (fine[1] - fine[0])
        true = np.stack([np.interp(t, fine, east), np.interp(t, fine, north)], axis=1)
        angle = np.interp(t, fine, yaw)
        speed = 130.0 * np.stack([np.sin(angle), np.cos(angle)], axis=1)
        flight.append(np.full(n, number))
        time.append(t)
        position.append(true + 0.2 * speed * rng.standard_normal((n, 1)) + 10.0 * rng.standard_normal((n, 2)))
        velocity.append(speed + rng.standard_normal((n, 2)))
    v = np.concatenate(velocity)
    return measurements(
        np.concatenate(flight), np.concatenate(time), np.concatenate(position),
        v_east_mps=v[:, 0], v_north_mps=v[:, 1], velocity_variance=1.0,
    )  # fmt: skip


def wrapped(angle: float) -> float:
    """An angle in -π..π."""
    return math.remainder(angle, 2.0 * math.pi)


def residual(a: Floats, b: Floats) -> Floats:
    """Difference of two turning states, written out for filterpy."""
    d = a - b
    d[YAW] = wrapped(d[YAW])
    return d


def mean(points: Floats, weights: Floats) -> Floats:
    """Mean of turning states about the first one, written out for filterpy."""
    result = points[0].copy()
    for point, weight in zip(points, weights, strict=True):
        result += weight * residual(point, points[0])
    result[YAW] = wrapped(result[YAW])
    return result


def add(x: Floats, dx: Floats) -> Floats:
    """A turning state and a change."""
    result = x + dx
    result[YAW] = wrapped(result[YAW])
    return result


def ukf(x: Floats, P: Floats, transition: Callable[[Floats, float], Floats], points: Any) -> UnscentedKalmanFilter:
    """Filterpy's unscented filter over a turning state."""
    sigma_points = MerweScaledSigmaPoints(6, points.alpha, points.beta, points.kappa, subtract=residual)
    made = UnscentedKalmanFilter(
        6, 2, 1.0, lambda s: s[:2], transition, sigma_points, x_mean_fn=mean, residual_x=residual, state_add=add
    )
    made.x, made.P = x.copy(), P.copy()
    return made


def velocity_of(x: Floats) -> Floats:
    """East and north velocity of one turning state."""
    return x[2] * np.array([math.sin(x[YAW]), math.cos(x[YAW])])


def acceleration_of(x: Floats) -> Floats:
    """East and north acceleration of one turning state: along its own, across speed times yaw rate."""
    sin, cos = math.sin(x[YAW]), math.cos(x[YAW])
    return x[3] * np.array([sin, cos]) + x[2] * x[5] * np.array([cos, -sin])
