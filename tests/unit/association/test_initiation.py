"""Tracks from plots without identity."""

import numpy as np
import pytest

from aeroskein.association import FreePlots, Initiated, Initiator
from aeroskein.association.clutter import PRIOR_DENSITY, ClutterMap
from aeroskein.geodesy import frame_rows, from_plane
from aeroskein.settings import EngineSettings, SensorSettings

PERIOD_S = 4.0
FRAME = frame_rows(np.array([48.0]), np.array([11.0]))
SETTINGS = EngineSettings(
    sensors=(
        SensorSettings(
            id="radar", kind="psr", lat_deg=48.0, lon_deg=11.0, height_m=0.0, period_s=PERIOD_S, range_sigma_m=100.0,
            azimuth_sigma_deg=0.15,
        ),
    )
)  # fmt: skip


def plots(
    scan: int, places: list[tuple[float, float]], *, mode_a: list[int] | None = None,
    local_track: list[int] | None = None, contested: bool = False,
) -> FreePlots:  # fmt: skip
    """Plots of one scan at places in metres east and north of the radar, named 100 * scan + k."""
    n = len(places)
    at = np.array(places, dtype=np.float64).reshape(n, 2)
    lat, lon = from_plane(FRAME, at[:, 0], at[:, 1])
    none = np.full(n, -1)
    return FreePlots(
        100 * scan + np.arange(n), np.zeros(n, dtype=np.int64), np.full(n, 1e9 + scan * PERIOD_S), lat, lon,
        none if mode_a is None else np.array(mode_a), none if local_track is None else np.array(local_track),
        np.full(n, contested),
    )  # fmt: skip


def flight(scan: int, speed: float = 200.0) -> tuple[float, float]:
    return 40_000.0 + speed * PERIOD_S * scan, 30_000.0


def feed(initiator: Initiator, scans: range, **changes: object) -> list[Initiated]:
    return [initiator.add(plots(k, [flight(k)], **changes)) for k in scans]  # type: ignore[arg-type]


def test_three_plots_of_a_flight_make_a_track() -> None:
    made = feed(Initiator(SETTINGS), range(3))

    assert [len(m) for m in made] == [0, 0, 1]
    assert made[2].plots[0, :4].tolist() == [200, 100, 0, -1]
    assert made[2].v_east_mps[0] == pytest.approx(200.0, abs=1.0)
    assert (made[2].lat_deg[0], made[2].lon_deg[0]) == (
        plots(2, [flight(2)]).lat_deg[0],
        plots(2, [flight(2)]).lon_deg[0],
    )


def test_one_missed_scan_is_allowed() -> None:
    initiator = Initiator(SETTINGS)

    made = [initiator.add(plots(k, [flight(k)])) for k in (0, 1, 3)]

    assert [len(m) for m in made] == [0, 0, 1]


def test_two_missed_scans_are_not() -> None:
    initiator = Initiator(SETTINGS)

    made = [initiator.add(plots(k, [flight(k)])) for k in (0, 1, 4)]

    assert sum(len(m) for m in made) == 0


def test_what_stands_still_is_ground() -> None:
    initiator = Initiator(SETTINGS)

    made = [initiator.add(plots(k, [(40_000.0 + 20.0 * (k % 2), 30_000.0)])) for k in range(12)]

    assert sum(len(m) for m in made) == 0


def test_what_would_be_too_fast_is_no_flight() -> None:
    initiator = Initiator(SETTINGS)

    made = [initiator.add(plots(k, [flight(k, speed=900.0)])) for k in range(8)]

    assert sum(len(m) for m in made) == 0


def test_plots_that_zigzag_are_no_flight() -> None:
    initiator = Initiator(SETTINGS)

    made = [initiator.add(plots(k, [(40_000.0 + 1_200.0 * (k % 2), 30_000.0 + 900.0 * (k % 3))])) for k in range(8)]

    assert sum(len(m) for m in made) == 0


def test_different_codes_are_not_joined() -> None:
    initiator = Initiator(SETTINGS)

    made = [initiator.add(plots(k, [flight(k)], mode_a=[512 + k])) for k in range(6)]

    assert sum(len(m) for m in made) == 0


def test_numbers_of_the_radar_keep_neighbours_apart() -> None:
    initiator = Initiator(SETTINGS)

    for k in range(4):
        east, north = flight(k)
        made = initiator.add(plots(k, [(east, north), (east, north + 400.0)], local_track=[5, 6]))
        if len(made):
            break

    assert sorted((row[row >= 0] % 100).tolist() for row in made.plots) == [[0] * (k + 1), [1] * (k + 1)]


def test_beside_an_existing_track_more_is_asked() -> None:
    made = feed(Initiator(SETTINGS), range(7), contested=True)

    assert [len(m) for m in made] == [0, 0, 0, 0, 0, 1, 0]


def test_a_plot_belongs_to_one_track_only() -> None:
    initiator = Initiator(SETTINGS)
    used: list[int] = []

    for k in range(8):
        east, north = flight(k)
        made = initiator.add(plots(k, [(east, north), (east + 500.0, north + 300.0), (east - 400.0, north + 500.0)]))
        used += made.plots[made.plots >= 0].tolist()

    assert len(used) == len(set(used)) > 0


def test_a_whole_recording_at_once_gives_the_tracks_of_single_scans() -> None:
    scans = [plots(k, [flight(k)]) for k in range(3)]
    together = FreePlots(*(np.concatenate([getattr(s, name) for s in scans]) for name in FreePlots.__slots__))

    made = Initiator(SETTINGS).add(together)

    assert made.plots[0, :4].tolist() == [200, 100, 0, -1]


def test_hours_of_false_plots_make_no_track() -> None:
    rng, initiator = np.random.default_rng(3), Initiator(SETTINGS)

    made = 0
    for k in range(900):
        radius, angle = 150_000.0 * np.sqrt(rng.random(10)), rng.uniform(0, 2 * np.pi, 10)
        made += len(initiator.add(plots(k, list(zip(radius * np.sin(angle), radius * np.cos(angle), strict=True)))))

    assert made == 0
    assert initiator.tentative_count() < 20


def test_clutter_density_is_that_of_the_plots() -> None:
    rng, clutter = np.random.default_rng(4), ClutterMap(PERIOD_S)

    for k in range(200):
        clutter.add(rng.uniform(-100e3, 100e3, (40, 2)), k * PERIOD_S)

    density = clutter.density(np.array([[20e3, -30e3], [400e3, 400e3]]))
    assert density[0] == pytest.approx(40.0 / 200e3**2, rel=0.35)
    assert density[1] < 0.7 * density[0]
    assert clutter.plots_per_hour() == pytest.approx(40 * 900, rel=0.1)


def test_where_nothing_false_was_seen_a_little_is_assumed() -> None:
    clutter = ClutterMap(PERIOD_S)

    assert clutter.density(np.zeros((1, 2))) == pytest.approx([PRIOR_DENSITY])
