"""The same settings give the same bytes, however the time is cut and whoever asks for which sensor."""

from __future__ import annotations

import itertools
import tracemalloc
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.simulation_scenes import RADAR1, SENSORS, ecef, run

from aeroskein.errors import SettingsError, UnknownSensorError
from aeroskein.plots import Plots
from aeroskein.settings import SensorSettings
from aeroskein.simulation import (
    SCENARIOS,
    SensorErrors,
    SimulationSettings,
    TruthStates,
    simulate,
    truth_by_track,
)

EVERYTHING_WRONG = (
    SensorErrors(
        sensor="adsb", duplicate_probability=0.05, correlated_sigma_m=8.0, stale_probability=0.1,
        frozen_probability=0.01, latency_sigma_s=0.1, quality="indicators", gaps_s=((5.0, 8.0),),
    ),
    SensorErrors(sensor="radar2", false_plots=3.0, outlier_probability=0.02, duplicate_probability=0.05),
)  # fmt: skip


def reports(made: SimulationSettings, chunk_s: float = 1.0, only: set[str] | None = None) -> Plots:
    """All reports of a scenario."""
    return Plots.concatenate([chunk.plots for chunk in simulate(made, SENSORS, chunk_s=chunk_s, only=only)])


def content(plots: Plots | TruthStates) -> list[bytes]:
    """Every column, byte by byte."""
    return [getattr(plots, field.name).tobytes() for field in fields(plots)]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_one_seed_gives_the_same_bytes_and_another_one_others(scenario: str) -> None:
    made = SimulationSettings(scenario=scenario, aircraft=7, duration_s=20.0, errors=EVERYTHING_WRONG)
    other = SimulationSettings(scenario=scenario, aircraft=7, duration_s=20.0, errors=EVERYTHING_WRONG, seed=2)

    assert content(reports(made)) == content(reports(made))
    assert content(reports(made)) != content(reports(other))


@settings(max_examples=15, deadline=None)
@given(chunk_s=st.floats(0.05, 50.0), seed=st.integers(0, 2**63 - 1))
def test_chunks_of_any_length_give_the_same_reports(chunk_s: float, seed: int) -> None:
    made = SimulationSettings(aircraft=5, duration_s=12.0, errors=EVERYTHING_WRONG, seed=seed)

    assert content(reports(made, chunk_s)) == content(reports(made, 12.0))


@pytest.mark.parametrize("chunk_s", [0.1, 0.7, 3.0])
def test_chunks_hold_what_arrived_in_their_time(chunk_s: float) -> None:
    made = SimulationSettings(aircraft=10, duration_s=20.0)

    before_s = made.start_s
    for chunk in simulate(made, SENSORS, chunk_s=chunk_s, truth=True):
        assert chunk.until_s > before_s
        assert chunk.truth is not None
        for column in (chunk.plots.received_s, chunk.truth.time_s):
            assert (column >= before_s - 1e-6).all()
            assert (column < chunk.until_s).all()
        before_s = chunk.until_s
    assert before_s == made.start_s + 20.0


@pytest.mark.parametrize("sensor", ["adsb", "radar1", "radar2"])
def test_one_sensor_alone_sends_what_it_sends_among_others(sensor: str) -> None:
    made = SimulationSettings(aircraft=8, duration_s=30.0, errors=EVERYTHING_WRONG)
    index = [s.id for s in SENSORS].index(sensor)

    everything = reports(made)
    alone = reports(made, only={sensor})

    assert len(alone) > 30
    assert content(everything.take(everything.sensor == index)) == content(alone)


def test_processes_that_start_at_different_times_fly_the_same_traffic() -> None:
    made = SimulationSettings(aircraft=8, duration_s=60.0, flight_s=300.0)
    early_s, late_s = 1_790_000_003.3, 1_790_000_037.9

    def samples(start_s: float) -> TruthStates:
        chunks = itertools.takewhile(
            lambda chunk: chunk.until_s <= 1_790_000_060.0,
            simulate(made, SENSORS, start_s=start_s, anchor_s=0.0, truth=True, endless=True),
        )
        return TruthStates.concatenate([chunk.truth for chunk in chunks if chunk.truth is not None])

    early, late = samples(early_s), samples(late_s)
    both = set(early.address.tolist()) & set(late.address.tolist())

    assert len(both) >= 5
    for address in both:
        a, b = early.take(early.address == address), late.take(late.address == address)
        at = [ecef(t.lat_deg, t.lon_deg, t.height_m) for t in (a, b)]
        inside = (b.time_s > a.time_s[0]) & (b.time_s < a.time_s[-1])
        between = np.column_stack([np.interp(b.time_s, a.time_s, at[0][:, k]) for k in range(3)])
        assert np.abs(between - at[1])[inside].max() < 0.1


def test_antennas_of_processes_that_start_at_different_times_turn_together() -> None:
    made = SimulationSettings(aircraft=8, duration_s=60.0, flight_s=300.0)

    def plots(start_s: float) -> Plots:
        chunks = itertools.takewhile(
            lambda chunk: chunk.until_s <= 1_790_000_060.0,
            simulate(made, (RADAR1,), start_s=start_s, anchor_s=0.0, endless=True),
        )
        return Plots.concatenate([chunk.plots for chunk in chunks])

    early, late = plots(1_790_000_003.3), plots(1_790_000_017.9)

    settled = (late.received_s > 1_790_000_030.0) & (late.received_s < 1_790_000_058.0)
    assert settled.sum() > 40
    assert np.isin(late.time_s[settled], early.time_s).all()


def test_truth_by_track_is_the_truth_of_the_chunks_in_another_order(monkeypatch: pytest.MonkeyPatch) -> None:
    # Small pieces, so that there is more than one.
    monkeypatch.setattr("aeroskein.simulation.simulator.TRUTH_ROWS", 700)
    made = SimulationSettings(aircraft=20, duration_s=20.0)

    parts = list(truth_by_track(made, SENSORS))
    chunks = simulate(made, SENSORS, truth=True)
    direct = TruthStates.concatenate([chunk.truth for chunk in chunks if chunk.truth is not None])

    assert len(parts) > 2
    assert content(TruthStates.concatenate(parts)) == content(direct.by_track())


def test_truth_by_track_is_ordered_by_address_then_time() -> None:
    made = SimulationSettings(aircraft=20, duration_s=60.0, flight_s=120.0)

    truth = TruthStates.concatenate(list(truth_by_track(made, SENSORS)))

    assert (np.diff(truth.address) >= 0).all()
    assert (np.diff(truth.time_s)[np.diff(truth.address) == 0] > 0.0).all()
    assert truth.time_s.min() == made.start_s


def test_twenty_thousand_aircraft_fit_in_bounded_memory() -> None:
    made = SimulationSettings(aircraft=20_000, duration_s=600.0)
    chunks = simulate(made, SENSORS, chunk_s=2.0)

    tracemalloc.start()
    try:
        counts = [len(chunk.plots) for chunk in itertools.islice(chunks, 4)]
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    assert counts[-1] > 45_000
    assert peak < 250e6


def test_every_aircraft_has_an_address_of_its_own() -> None:
    made = SimulationSettings(aircraft=20_000, duration_s=2.0, truth_period_s=2.0)

    (chunk,) = simulate(made, (), chunk_s=2.0, truth=True)

    assert chunk.truth is not None
    assert len(np.unique(chunk.truth.address)) == len(chunk.truth) == 20_000
    assert chunk.truth.address.max() < 2**24


def test_errors_for_a_sensor_that_does_not_exist_are_refused() -> None:
    with pytest.raises(UnknownSensorError, match="radar9"):
        simulate(SimulationSettings(errors=(SensorErrors(sensor="radar9"),)), SENSORS)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"scenario": "loop"}, "simulation.scenario"),
        ({"aircraft": 0}, "simulation.aircraft"),
        ({"duration_s": 0.0}, "simulation.duration_s"),
        ({"duration_s": float("nan")}, "simulation.duration_s"),
        ({"flight_s": 10.0}, "simulation.flight_s"),
        ({"lat_deg": 91.0, "lon_deg": 0.0}, "simulation.lat_deg"),
        ({"lat_deg": 48.0}, "simulation.lat_deg"),
        ({"truth_period_s": 0.0}, "simulation.truth_period_s"),
        ({"seed": -1}, "simulation.seed"),
    ],
)
def test_a_setting_that_cannot_work_is_named(change: dict[str, object], key: str) -> None:
    with pytest.raises(SettingsError) as raised:
        SimulationSettings(**change)  # type: ignore[arg-type]

    assert raised.value.key == key


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"miss_probability": 1.5}, "simulation.errors.adsb.miss_probability"),
        ({"outlier_min_m": 10.0, "outlier_max_m": 5.0}, "simulation.errors.adsb.outlier_max_m"),
        ({"delay_min_s": 3.0}, "simulation.errors.adsb.delay_max_s"),
        ({"gaps_s": ((10.0, 5.0),)}, "simulation.errors.adsb.gaps_s"),
        ({"azimuth_bias_deg": 200.0}, "simulation.errors.adsb.azimuth_bias_deg"),
    ],
)
def test_an_error_that_cannot_be_is_named(change: dict[str, object], key: str) -> None:
    with pytest.raises(SettingsError) as raised:
        SensorErrors(sensor="adsb", **change)  # type: ignore[arg-type]

    assert raised.value.key == key


def test_the_area_lies_in_the_middle_of_the_radars_also_across_the_antimeridian() -> None:
    east = SensorSettings(id="r1", kind="ssr", lat_deg=-10.0, lon_deg=179.0, height_m=0.0)
    west = SensorSettings(id="r2", kind="ssr", lat_deg=-12.0, lon_deg=-177.0, height_m=0.0)

    assert SimulationSettings().centre_deg((east, west)) == pytest.approx((-11.0, -179.0))
    assert SimulationSettings(lat_deg=1.0, lon_deg=2.0).centre_deg((east, west)) == (1.0, 2.0)


def test_a_scenario_without_radars_is_flown_somewhere() -> None:
    plots, truth = run(SENSORS[0], aircraft=3, duration_s=10.0)

    assert len(plots) > 15
    assert np.abs(truth.lat_deg - 48.1).max() < 5.0


def test_nobody_in_the_air_is_no_error() -> None:
    plots, truth = run(*SENSORS, aircraft=1, duration_s=200.0, flight_s=120.0, scenario="cruise", chunk_s=1.0)

    assert np.diff(np.unique(truth.time_s)).max() > 20.0
    assert len(np.unique(truth.address)) == 2
    assert len(plots) > 150
