"""Primary plots, which say nothing of their height, beside tracks that have one."""

from dataclasses import replace

import numpy as np
from tests.builders import ADSB, RADAR1, START_S, Drive, Flight, adsb, engine_settings, radar

from aeroskein.plots import Plots
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
