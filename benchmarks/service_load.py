"""The live service under load: latency, processor time, memory and losses with so many aircraft, against its goals.

    python -m benchmarks.service_load [--quick] [--aircraft N [--seconds S] [--keys] [--more TOML]]

Processes as in an installation: a router, a generator (ADS-B at 1 Hz, radars at 4 s and 8 s, batches of 50), the
service with a processor of its own, and one or two consumers - one of the feed, which recovers losses, and with
``--keys`` one of the keys per track, which does not. Latency is from the put of a report by its sensor to the receipt
of the live point that is from it; processor time is read from /proc after a warm-up. With ``--aircraft`` one load is
run and shown without goals.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.bars import FOLDER, plot_bars
from benchmarks.goals import Row, judged
from benchmarks.load_processes import NO_PAGE, Load, Seen, run_load

# Aircraft: goals for the latency, 50 % and 99 %, must and aim. [ms]
LATENCY_GOALS = {100: ((5.0, 2.0), (25.0, 10.0)), 4_000: ((10.0, 5.0), (100.0, 50.0)), 20_000: (None, (1000.0, 300.0))}
AIRCRAFT_MUST, AIRCRAFT_AIM = 20_000, 30_000
SECONDS, QUICK_SECONDS = 40.0, 25.0


def rows_of(aircraft: int, seen: Seen, load: Load) -> list[Row]:
    """Everything about one load."""
    half, most, nearly = seen.live.percentiles_ms(load.warm_up_s, load.steady_end_s, 50, 95, 99)
    half_goal, nearly_goal = LATENCY_GOALS.get(aircraft, (None, None))
    rows = [
        Row("reports a second", seen.rate),
        Row("live latency, 50 %", half, "ms", *(half_goal or ())),
        Row("live latency, 95 %", most, "ms"),
        Row("live latency, 99 %", nearly, "ms", *(nearly_goal or ())),
        Row("service, share of a processor", seen.core["service"], ""),
        Row("service, memory", seen.rss_mb["service"], "MB"),
    ]
    if aircraft == AIRCRAFT_MUST:
        rows[4] = Row("service, share of a processor", seen.core["service"], "", 1.0, 0.67)
    rows += [Row(f"{role}, share of a processor", seen.core[role]) for role in seen.core if role != "service"]
    for name, counts in seen.points.items():
        rows += [Row(f"{name}: {what}", many) for what, many in counts.items()]
    rows += [Row("reports refused or dropped", _refused(seen), must=0.0), Row("exit status", seen.exit, must=0.0)]
    return rows


def _refused(seen: Seen) -> float:
    sensors = seen.statuses[-1]["sensors"].values() if seen.statuses else ()
    return float(sum(sensor["dropped"] + sum(sensor["rejected"].values()) for sensor in sensors))


def show(aircraft: int, seen: Seen, load: Load) -> int:
    """Print one load; returns 1 where a goal is missed."""
    missed = judged(f"{aircraft} aircraft, {load.seconds:.0f} s", rows_of(aircraft, seen, load))
    if seen.statuses:
        last = seen.statuses[-1]
        # The last status is of the end, when every open element closes; the one before is of the traffic.
        stages = seen.statuses[-3]["stages_us"] if len(seen.statuses) > 3 else last["stages_us"]
        print("  stages, us a report or element: " + ", ".join(f"{k} {v:.1f}" for k, v in stages.items()))
        for name, sensor in last["sensors"].items():
            print(f"  {name}: {sensor['accepted']} accepted, {sensor['rejected']}, {sensor['dropped']} dropped")
        print(f"  alarms: {last['alarms']}; worst tick of the generator {seen.worst_tick_ms:.0f} ms")
    return missed


def main() -> int:
    """Run the chosen loads; 1 where a goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--aircraft", type=int, help="only this load, without goals")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of the traffic, above 14")
    parser.add_argument("--keys", action="store_true", help="also follow the keys per track")
    parser.add_argument("--more", default=NO_PAGE, help="TOML to append to the service's configuration")
    parser.add_argument("--quick", action="store_true", help="only the small loads, for a short time")
    parser.add_argument("--plots", type=Path, default=FOLDER)
    args = parser.parse_args()
    if args.aircraft is not None:
        load = Load([(args.aircraft, 0.0, args.seconds)], keys=args.keys, more=args.more)
        show(args.aircraft, run_load(load), load)
        return 0
    missed, latency_ms, share = 0, dict[str, float](), dict[str, float]()
    for aircraft in (100, 4_000) if args.quick else (100, 4_000, AIRCRAFT_MUST, AIRCRAFT_AIM):
        load = Load([(aircraft, 0.0, QUICK_SECONDS if args.quick else args.seconds)], more=args.more)
        seen = run_load(load)
        missed |= show(aircraft, seen, load)
        percentiles = seen.live.percentiles_ms(load.warm_up_s, load.steady_end_s, 50, 95, 99)
        latency_ms |= {f"{aircraft:,}, {p} %": ms for p, ms in zip((50, 95, 99), percentiles, strict=True)}
        share[f"{aircraft:,}"] = seen.core["service"]
    plot_bars(args.plots / "service_latency.png", "Live latency by number of aircraft", latency_ms, "ms", log=True)
    plot_bars(args.plots / "service_share.png", "Share of a processor that the service takes", share, "")
    return missed


if __name__ == "__main__":
    sys.exit(main())
