"""Primary plots, which say nothing of their height, beside tracks that have one."""

from dataclasses import replace

import numpy as np
from tests.builders import ADSB, RADAR1, START_S, Drive, Flight, adsb, engine_settings, radar

from aeroskein.plots import Array, Plots
from aeroskein.points import FusedPoints
from aeroskein.reasons import Reason

PRIMARY = replace(RADAR1, kind="psr")
# Side by side east of the radar, 10 and 12 km away over ground, 11 km high. Taken for 5 km high, the nearer one's plots
# would lie two kilometres beyond the farther one.
NEAR = Flight(lat_deg=48.3, lon_deg=11.915, track_deg=0.0, speed_mps=200.0, height_m=11_000.0, address=0x3C0001)
FAR = replace(NEAR, lon_deg=11.942, address=0x3C0002)


def plots_of(flight: Flight) -> Plots:
    return radar(flight, np.arange(12.0, 52.0, 4.0), PRIMARY, address=-1, mode_a=-1, altitude_m=np.nan)


def labels_of(plots: Plots) -> list[int]:
    """The tracks that nameless plots were given to while both aircraft reported themselves."""
    own = [adsb(flight, np.arange(0.5, 54.0)) for flight in (NEAR, FAR)]
    drive = Drive.of(engine_settings(ADSB, PRIMARY))
    drive.engine.want_dispositions = True
    drive.feed([*own, plots])
    found: list[int] = []
    for told in drive.dispositions:
        mine = (told.sensor == 1) & (told.element < 0) & (told.reason != Reason.UNASSOCIATED)
        found += told.label[mine].tolist()
    return found


def test_a_primary_plot_near_its_radar_finds_the_track_at_whose_height_it_fits() -> None:
    assert labels_of(plots_of(NEAR)) == [NEAR.address] * 10
    assert labels_of(plots_of(FAR)) == [FAR.address] * 10


def test_an_aircraft_that_two_primary_radars_see_is_placed_as_well_as_if_its_height_were_known() -> None:
    other = replace(PRIMARY, id="other", lat_deg=48.6, lon_deg=11.2)
    rng_m, azimuth_deg = 50.0, 0.07
    flight = replace(NEAR, lat_deg=48.1, lon_deg=12.1)
    plots = [
        radar(
            flight, np.arange(1.0 + k, 120.0, 4.0), site, sensor=k, seed=k, address=-1, mode_a=-1, altitude_m=np.nan,
            range_sigma_m=rng_m, azimuth_sigma_deg=azimuth_deg,
        )
        for k, site in enumerate((PRIMARY, other))
    ]  # fmt: skip

    live = Drive.of(engine_settings(PRIMARY, other)).feed(plots).live

    late = live.take(np.flatnonzero(live.time_s > START_S + 60.0))
    lat, lon, _ = flight.at(late.time_s - START_S)
    off_m = np.hypot((late.lat_deg - lat) * 111e3, (late.lon_deg - lon) * 74e3)
    assert len(np.unique(live.track_number)) == 1
    assert np.sqrt(np.mean(off_m**2)) < 150.0
    # Nobody has said how high it is.
    assert np.isnan(late.height_m).all()


def overhead(false: tuple[float, float] | None = None) -> Plots:
    """Plots of an airliner that flies over the only radar, blind above 45 degrees, and one that is nobody's."""
    flight = Flight(lat_deg=48.05, lon_deg=11.79, track_deg=0.0, speed_mps=240.0, height_m=11_000.0)
    plots = radar(
        flight, np.arange(1.0, 280.0, 4.0), PRIMARY, sensor=0, address=-1, mode_a=-1, altitude_m=np.nan,
        range_sigma_m=50.0, azimuth_sigma_deg=0.07,
    )  # fmt: skip
    plots = plots.take(np.flatnonzero(plots.range_m > 10_500.0 * np.sqrt(2.0)))
    if false is None:
        return plots
    odd = plots.take(np.array([0]))
    odd.time_s[:] = odd.received_s[:] = START_S + 145.0
    odd.range_m[:], odd.azimuth_deg[:] = false
    return Plots.concatenate([plots, odd])


def off_m(live: FusedPoints) -> Array:
    flight = Flight(lat_deg=48.05, lon_deg=11.79, track_deg=0.0, speed_mps=240.0, height_m=11_000.0)
    lat, lon, _ = flight.at(live.time_s - START_S)
    return np.hypot((live.lat_deg - lat) * 111e3, (live.lon_deg - lon) * 74e3)


def test_an_airliner_over_the_only_radar_keeps_its_track_and_its_place() -> None:
    live = Drive.of(engine_settings(PRIMARY)).feed([overhead()]).live

    late = live.take(np.flatnonzero(live.time_s > START_S + 100.0))
    assert len(np.unique(live.track_number)) == 1
    assert np.sqrt(np.mean(off_m(late) ** 2)) < 600.0


def test_what_is_off_while_the_height_is_not_known_is_in_the_covariance() -> None:
    live = Drive.of(engine_settings(PRIMARY)).feed([overhead()]).live

    early = live.take(np.flatnonzero((live.time_s > START_S + 15.0) & (live.time_s < START_S + 100.0)))
    variance = early.position_cov_m2[:, 0] + early.position_cov_m2[:, 2]
    assert np.mean(off_m(early) ** 2 / variance) < 2.0


def test_a_plot_from_the_cone_of_silence_is_not_that_of_a_track_that_went_silent_in_it() -> None:
    live = Drive.of(engine_settings(PRIMARY)).feed([overhead(false=(11_900.0, 350.0))]).live

    after = live.take(np.flatnonzero(live.time_s > START_S + 146.0))
    assert len(np.unique(live.track_number)) == 1
    assert off_m(after).max() < 1000.0
