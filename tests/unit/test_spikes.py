"""A published track never turns back on itself like a needle."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.builders import ADSB, Drive, Flight, adsb, engine_settings

from aeroskein.evaluation.geometry import ecef, up_vector
from aeroskein.evaluation.roughness import is_spike
from aeroskein.plots import Plots
from aeroskein.points import Flag
from aeroskein.spikes import held, turns_back

SIGMA_M = 80.0
METRES = st.floats(-500.0, 500.0)


def test_no_spike_is_seen_in_a_turn_in_noise_or_at_the_beginning() -> None:
    before = np.array([[0.0, 0.0, 800.0, 0.0], [0.0, 0.0, 8.0, 0.0], [np.nan, np.nan, 0.0, 0.0]]).T
    place = np.array([[300.0, 400.0], [0.0, 0.0], [-500.0, 0.0]]).T

    assert not turns_back(before, place).any()
    assert (held(before, place) == 0.0).all()


@given(*[METRES] * 6)
def test_what_is_held_does_not_turn_back_and_keeps_what_lies_beside(a: float, b: float, c: float, d: float, e: float,
                                                                    f: float) -> None:  # fmt: skip
    before, place = np.array([[a, b, c, d]]).T, np.array([[e, f]]).T

    shift = held(before, place)

    assert not turns_back(before, place + shift).any()
    assert shift.any() == turns_back(before, place).any()
    # Along the leg only, and forwards.
    leg = before[2:] - before[:2]
    assert abs(leg[0] * shift[1] - leg[1] * shift[0]) <= 1e-9 * max(1.0, float(np.abs(leg).max() * np.abs(shift).max()))
    assert (leg * shift).sum() >= 0.0


@pytest.mark.parametrize("held_back", [False, True])
def test_live_points_wait_for_aircraft_further_back_than_thought(
    held_back: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not held_back:
        monkeypatch.setattr("aeroskein.live.NEIGHBOUR_S", -1.0)
    drive = Drive.of(engine_settings(replace(ADSB, position_sigma_m=SIGMA_M))).feed(pairs_of_reports())

    live = drive.live
    place = ecef(up_vector(live.lat_deg, live.lon_deg), np.zeros(len(live)))
    spikes = is_spike(live.slot, live.time_s, place)
    guarded = (live.flags & Flag.GUARDED) != 0

    assert (bool(spikes.any()), bool(guarded.any())) == ((False, True) if held_back else (True, False))
    # It says that it is off by what was held back: more than its neighbours do.
    trace = live.position_cov_m2[:, 0] + live.position_cov_m2[:, 2]
    assert not guarded.any() or trace[guarded].min() > np.median(trace)


def pairs_of_reports() -> Plots:
    """Two coarse reports a quarter of a second apart, every four seconds, without velocity."""
    after_s = np.sort(np.concatenate([np.arange(1.0, 240.0, 4.0), np.arange(1.25, 240.0, 4.0)]))
    return adsb(
        Flight(speed_mps=100.0), after_s, sigma_m=SIGMA_M, ground_speed_mps=np.nan, track_angle_deg=np.nan
    )  # fmt: skip
