"""Radars that apply their registration themselves."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.registration_scene import START_S, Scene, comparisons, engine_settings, two_radars

from aeroskein.registration import Comparisons, Registration


def scene_and_registration() -> tuple[Scene, Registration]:
    radars = two_radars(np.random.default_rng(1))
    radars[0].settings = replace(radars[0].settings, correction="sensor")
    return Scene(radars, aircraft=20, duration_s=300.0, seed=1), Registration(engine_settings(radars))


def run(scene: Scene, registration: Registration, obedient: bool) -> np.ndarray:
    """Play; an obedient radar 1 applies what was published ten seconds ago. Gives what it applied last."""
    rows = comparisons(scene)
    applied = np.zeros(4)
    for k in range(300):
        if obedient and k % 10 == 0:
            published = registration.estimates()[0][1]
        part = rows.take((rows.time_s >= START_S + k) & (rows.time_s < START_S + k + 1))
        registration.update(corrected(part, applied))
        registration.advance(now_s=START_S + k + 1.0)
        if obedient and k % 10 == 9:
            applied = published
    return applied


def corrected(rows: Comparisons, applied: np.ndarray) -> Comparisons:
    own = rows.sensor == 1
    return replace(
        rows,
        range_m=rows.range_m - own * applied[0],
        azimuth_deg=np.mod(rows.azimuth_deg - own * applied[1], 360.0),
        time_s=rows.time_s - own * applied[2],
    )


def test_an_obedient_radar_is_given_its_whole_bias() -> None:
    scene, registration = scene_and_registration()

    applied = run(scene, registration, obedient=True)

    radar = scene.radars[0]
    assert applied[:3] == pytest.approx([radar.range_m, radar.azimuth_deg, radar.time_s], abs=12.0)
    assert abs(applied[1] - radar.azimuth_deg) < 0.012
    assert abs(applied[2] - radar.time_s) < 0.12
    assert registration.alarms() == []


def test_its_plots_are_not_corrected_a_second_time() -> None:
    scene, registration = scene_and_registration()
    run(scene, registration, obedient=True)

    range_m, azimuth_deg, time_s = registration.correct(
        np.array([1]), np.array([5e4]), np.array([33.0]), np.array([7.0])
    )

    assert (range_m[0], azimuth_deg[0], time_s[0]) == (5e4, 33.0, 7.0)


def test_a_radar_that_does_not_apply_it_is_reported_and_its_bias_stays_published() -> None:
    scene, registration = scene_and_registration()

    run(scene, registration, obedient=False)

    assert registration.alarms() == ["radar1 does not apply the registration it is sent"]
    assert abs(registration.estimates()[0][1, 0] - scene.radars[0].range_m) < 12.0
    assert abs(registration.estimates()[0][1, 1] - scene.radars[0].azimuth_deg) < 0.012
