"""The estimator against the same estimator in C: how far columns of numpy are from what the processor can do.

    python -m benchmarks.engine_kernel [--aircraft N]

``estimator_kernel.c`` is compiled on the spot (gcc -O3 -march=native). It has the same layout and must give the same
numbers. Compared are one report through the three-model filter, which every report passes twice (live, and in order of
time for the detector), and the closing of an element by both passes, on windows that the engine made of seeded
traffic. Only the estimator's own stages are timed, in turns, the fastest of each counts. Exit status 1 when numbers
differ or the goal is missed.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from benchmarks.bars import FOLDER, plot_bars
from benchmarks.engine_scene import REPORTS_PER_S, START_S, Traffic, settings

from aeroskein import closing, coordinated_turn, elements, estimator, gating, manoeuvre
from aeroskein.engine import FusionEngine
from aeroskein.live import LANES
from aeroskein.mode_bank import ModeBank, ModeWork
from aeroskein.plots import Array

SOURCE: Final = Path(__file__).with_name("estimator_kernel.c")
MOST_TIMES: Final = 10.0
# Relative to the size of what is compared.
SAME: Final = 1e-9
WARM_S: Final = 20.0
REPEATS: Final = 15
ELEMENTS_PER_S: Final = 0.25
COLUMNS: Final = (
    "east_m", "north_m", "r_ee", "r_en", "r_nn", "v_east_mps", "v_north_mps", "velocity_variance", "time_variance",
)  # fmt: skip


class Cost(NamedTuple):
    """Microseconds per report or element here and in C, and the largest relative difference of results."""

    ours_us: float
    kernel_us: float
    difference: float


def compiled(folder: Path) -> ctypes.CDLL:
    """The kernel, built with the compiler that is here."""
    library = folder / "estimator_kernel.so"
    command = ["gcc", "-O3", "-march=native", "-shared", "-fPIC", str(SOURCE), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


def configure(kernel: ctypes.CDLL, models: manoeuvre.ModelSet) -> None:
    """Give it the engine's own constants."""
    rest = np.array([
        models.steady, gating.GATE, elements.BOUNDARY_SIGMAS, elements.SMALLEST_HALF_WIDTH_M,
        elements.LARGEST_HALF_WIDTH_M, manoeuvre.HOVER_MPS, coordinated_turn.SLOWEST_MPS,
        coordinated_turn.TURN_SPEED_MIN_MPS, coordinated_turn.TURN_RATE_MAX_RADPS, estimator.ALONG_SHARE,
        estimator.ACROSS_SHARE, float(models.turns), coordinated_turn.SMALL_ANGLE_RAD,
        models.wander, coordinated_turn.LEAST_TURN_RAD, coordinated_turn.LEAST_UPDATE_RAD,
        coordinated_turn.MOST_UPDATE_RAD, models.held, models.negligible,
    ])  # fmt: skip
    kernel.configure(*(_pointer(a) for a in (models.rates, models.jerk, rest)))


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def _fastest_s(*works: Callable[[], Any]) -> list[float]:
    """Processor time of each, the fastest of several turns."""
    best = [np.inf] * len(works)
    for _ in range(REPEATS):
        for k, work in enumerate(works):
            started = time.process_time_ns()
            work()
            best[k] = min(best[k], 1e-9 * (time.process_time_ns() - started))
    return best


def _difference(ours: Array, theirs: Array) -> float:
    return float(np.abs(ours - theirs).max() / np.abs(ours).max())


class Scene:
    """An engine after some seconds of traffic, and the windows of the elements that it closed last."""

    def __init__(self, aircraft: int) -> None:
        self.windows: list[tuple[Any, ...]] = []
        self.engine = FusionEngine(settings(aircraft), epoch_ms=0)
        traffic, genuine = Traffic(aircraft), estimator.estimate

        def noted(window: Any, q: Array, x: Array, P: Array, t: Array, memory: Any, give_way: Any) -> Any:
            self.windows.append((window, q.copy(), x.copy(), P.copy(), t.copy(), memory.take(np.arange(len(t)))))
            return genuine(window, q, x, P, t, memory, give_way)

        for now_s, plots in traffic.ticks(WARM_S, 1.0):
            if now_s > START_S + WARM_S - 4.5:
                closing.estimate = noted  # type: ignore[attr-defined]
            self.engine.receive(plots, now_s=now_s)
            self.engine.advance(now_s=now_s)
        closing.estimate = genuine  # type: ignore[attr-defined]


def filter_cost(kernel: ctypes.CDLL, bank: ModeBank) -> Cost:
    """One report a lane through the three-model filter."""
    configure(kernel, bank.models)
    slots = np.flatnonzero(np.isfinite(bank.time_s))
    slots = slots[: len(slots) // 8 * 8]
    n, rng = len(slots), np.random.default_rng(3)
    # As times of today round them.
    h = (bank.time_s[slots] + rng.uniform(0.2, 1.5, n)) - bank.time_s[slots]
    east, north, v_east, v_north = bank.steady(slots)
    noise = rng.normal(0.0, 1.0, (4, n)) * np.array([[10.0], [10.0], [1.0], [1.0]])
    reports = np.stack([
        east + h * v_east + noise[0], north + h * v_north + noise[1], np.full(n, 100.0), np.zeros(n), np.full(n, 100.0),
        v_east + noise[2], v_north + noise[3], np.ones(n), np.full(n, 1e-4),
    ])  # fmt: skip
    parts = np.array_split(np.arange(n), -(-n // LANES))
    sensor, usable = np.zeros(n, dtype=np.int64), np.ones(n, dtype=np.bool_)
    begun = bank.take(slots)
    columns = [np.ascontiguousarray(reports[:, part]) for part in parts]
    works: list[ModeWork] = []

    def fresh() -> None:
        works[:] = [bank.take(slots[part]) for part in parts]

    def ours() -> None:
        for part, work, column in zip(parts, works, columns, strict=True):
            lag = work.predict(work.time_s + h[part])
            work.update(tuple(column), sensor[part], lag, usable[part])

    x, P, mu = begun.x.copy(), begun.P.copy(), begun.mu.copy()

    def theirs() -> None:
        kernel.imm_step(ctypes.c_long(n), *(_pointer(a) for a in (x, P, mu, h, reports)))

    fresh()
    ours()
    theirs()
    pairs = [(np.concatenate([getattr(w, name) for w in works], axis=-1), there)
             for name, there in (("x", x), ("P", P), ("mu", mu))]  # fmt: skip
    difference = max(_difference(here, there) for here, there in pairs)
    # The same reports again and again: what is computed is the same, and the states converge, so nothing overflows.
    spent = _fastest_s(ours, theirs)
    return Cost(1e6 * spent[0] / n, 1e6 * spent[1] / n, difference)


def closing_cost(kernel: ctypes.CDLL, scene: Scene) -> Cost:
    """Both passes over the windows of closing elements."""
    spent, counted, worst = [0.0, 0.0], 0, 0.0
    largest = sorted(scene.windows, key=lambda w: -len(w[0].lanes))[:4]
    for window, q, x, P, t, memory in largest:
        n, K = len(t), len(window.kind)
        # Lanes in eights: the last one again.
        rows = np.minimum(np.arange(-(-n // 8) * 8), n - 1)
        kind = np.where(window.kind > 2, 3, window.kind).astype(np.int8)
        packed = [np.ascontiguousarray(a[..., rows]) for a in (
            kind, window.time_s, q, np.stack([getattr(window, name) for name in COLUMNS]), x, P, t,
        )]  # fmt: skip
        out_x, out_P = np.empty((6, len(rows))), np.empty((36, len(rows)))

        def ours(case: tuple[Any, ...] = (window, q, x, P, t, memory)) -> Any:
            w, q, x, P, t, memory = case
            return estimator.estimate(w, q, x.copy(), P.copy(), t.copy(), memory.take(np.arange(len(t))))

        def theirs(n: int = len(rows), K: int = K, given: tuple[Any, ...] = (*packed, out_x, out_P)) -> None:
            kernel.close_elements(ctypes.c_long(n), ctypes.c_long(K), *(_pointer(a) for a in given))

        estimate = ours()
        theirs()
        # Opening a gate again after four refusals in a row is rare and not in the kernel.
        same = (estimate.reason > 0).sum(axis=0) < gating.MISSES_TO_OPEN
        worst = max(worst, _difference(estimate.x[:, same], out_x[:, :n][:, same]))
        worst = max(worst, _difference(estimate.P.reshape(n, 36).T[:, same], out_P[:, :n][:, same]))
        for k, s in enumerate(_fastest_s(ours, theirs)):
            spent[k] += s
        counted += n
    return Cost(1e6 * spent[0] / counted, 1e6 * spent[1] / counted, worst)


def _row(name: str, ours_us: float, kernel_us: float) -> str:
    return f"{name:30s} {ours_us:7.2f} us {kernel_us:7.3f} us {ours_us / kernel_us:6.1f}x"


def main() -> int:
    """Print the table; 1 when a goal is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.engine_kernel", description=__doc__.partition("\n")[0])
    parser.add_argument("--aircraft", type=int, default=2000)
    parser.add_argument("--plots", type=Path, default=FOLDER)
    options = parser.parse_args()
    scene = Scene(options.aircraft)
    with tempfile.TemporaryDirectory() as folder:
        kernel = compiled(Path(folder))
        state = scene.engine._state
        costs = {
            "report, live filter": filter_cost(kernel, state.live.bank),
            "report, detector": filter_cost(kernel, state.elements.detector),
            "element, both passes": closing_cost(kernel, scene),
        }
    print(f"{'':30s} {'numpy':>10s} {'C':>10s} {'ratio':>7s}   largest difference")
    for name, cost in costs.items():
        print(_row(name, cost.ours_us, cost.kernel_us) + f"   {cost.difference:.1e}")
    share = ELEMENTS_PER_S / REPORTS_PER_S
    ours_us, kernel_us = (
        live + detector + share * e for live, detector, e in list(zip(*costs.values(), strict=True))[:2]
    )
    ratio = ours_us / kernel_us
    print(_row("report, all in", ours_us, kernel_us) + f"   (at most {MOST_TIMES:.0f}x)")
    bars = {f"{name}, {of}": us for name, cost in costs.items() for of, us in (("numpy", cost[0]), ("C", cost[1]))}
    bars |= {"report, all in, numpy": ours_us, "report, all in, C": kernel_us}
    plot_bars(options.plots / "engine_kernel.png", "Processor time of the estimator, numpy and C", bars, "us", log=True)
    same = all(cost.difference < SAME for cost in costs.values())
    if not same:
        print("MISSED: the numbers are not the same")
    if ratio > MOST_TIMES:
        print(f"MISSED: {ratio:.1f} times slower than C, at most {MOST_TIMES:.0f}")
    return int(not same or ratio > MOST_TIMES)


if __name__ == "__main__":
    sys.exit(main())
