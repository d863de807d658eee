"""Settings refuse what cannot work, by the key as the configuration file spells it."""

from __future__ import annotations

from typing import Any

import pytest

from aeroskein.errors import SettingsError, UnknownSensorError
from aeroskein.settings import (
    AssociationSettings,
    EngineSettings,
    FusionSettings,
    PatentSettings,
    RegistrationSettings,
    SensorSettings,
    TrackSettings,
)

RADAR: dict[str, Any] = {"id": "radar1", "kind": "ssr", "lat_deg": 48.0, "lon_deg": 11.0, "height_m": 400.0}
ADSB = SensorSettings(id="adsb", kind="adsb")


def refused(make: Any, **values: Any) -> str:
    with pytest.raises(SettingsError) as caught:
        make(**values)
    return caught.value.key


def test_every_section_has_defaults_that_work():
    settings = EngineSettings(sensors=(ADSB, SensorSettings(**RADAR)))

    assert (settings.fusion.mode, settings.fusion.element_s) == ("information", 4.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lat_deg", 90.1), ("lat_deg", float("nan")), ("lat_deg", None), ("lon_deg", -180.1), ("lon_deg", None),
        ("height_m", None), ("height_m", float("inf")), ("height_m", 30_000.0), ("range_bias_m", float("nan")),
        ("range_bias_m", 1e6), ("azimuth_bias_deg", 181.0), ("time_bias_s", 61.0), ("range_gain", -1.0),
        ("range_max_m", 0.0), ("range_sigma_m", 0.0), ("azimuth_sigma_deg", -1.0), ("altitude_sigma_m", float("inf")),
        ("time_bias_sigma_s", 0.0), ("time_sigma_s", -0.1), ("period_s", 0.0), ("position_sigma_m", 0.0),
        ("velocity_sigma_mps", float("nan")),
    ],
)  # fmt: skip
def test_impossible_value_of_a_sensor_is_refused_by_its_id_and_name(name, value):
    assert refused(SensorSettings, **(RADAR | {name: value})) == f"sensors.radar1.{name}"


@pytest.mark.parametrize("sensor_id", ["", "A", "a b", "a/b", "ü", "x" * 33])
def test_sensor_id_that_cannot_stand_in_a_key_is_refused(sensor_id):
    assert refused(SensorSettings, id=sensor_id, kind="adsb") == "sensors.id"


@pytest.mark.parametrize("kind", ["adsb", "wam"])
def test_only_radars_need_a_site(kind):
    assert not SensorSettings(id="x", kind=kind).is_radar


@pytest.mark.parametrize(("kind", "sigma_s"), [("adsb", 0.2), ("wam", 0.05), ("ssr", 0.01), ("psr", 0.01)])
def test_jitter_of_the_time_stamp_is_that_of_its_kind_unless_set(kind, sigma_s):
    values = RADAR | {"kind": kind}

    assert SensorSettings(**values).effective_time_sigma_s == sigma_s
    assert SensorSettings(**values, time_sigma_s=0.0).effective_time_sigma_s == 0.0


@pytest.mark.parametrize(
    ("make", "values", "key"),
    [
        (FusionSettings, {"element_s": 0.4}, "fusion.element_s"),
        (FusionSettings, {"element_s": float("nan")}, "fusion.element_s"),
        (FusionSettings, {"lookahead": 6}, "fusion.lookahead"),
        (FusionSettings, {"lookahead": -1}, "fusion.lookahead"),
        (FusionSettings, {"watermark_s": 10.1}, "fusion.watermark_s"),
        (FusionSettings, {"max_age_s": 0.0}, "fusion.max_age_s"),
        (FusionSettings, {"max_future_s": float("inf")}, "fusion.max_future_s"),
        (PatentSettings, {"half_width_m": 0.0}, "patent.half_width_m"),
        (TrackSettings, {"confirm_reports": 0}, "tracks.confirm_reports"),
        (TrackSettings, {"capacity": 0}, "tracks.capacity"),
        (TrackSettings, {"terminate_s": 0.0}, "tracks.terminate_s"),
        (TrackSettings, {"coast_min_s": -1.0}, "tracks.coast_min_s"),
        (RegistrationSettings, {"feedback_gain": 0.0}, "registration.feedback_gain"),
        (RegistrationSettings, {"feedback_gain": 1.1}, "registration.feedback_gain"),
        (AssociationSettings, {"coarse_gate_m": 0.0}, "association.coarse_gate_m"),
        (AssociationSettings, {"pairwise": ()}, "association.pairwise"),
        (AssociationSettings, {"pairwise": ((1.0,) * 4,) * 3}, "association.pairwise"),
        (AssociationSettings, {"pairwise": ((1.0,) * 3,) * 4}, "association.pairwise"),
        (AssociationSettings, {"pairwise": ((-1.0,) * 4,) * 4}, "association.pairwise"),
        (AssociationSettings, {"pairwise": ((2.0,) * 4,) * 4}, "association.pairwise"),
    ],
)
def test_impossible_value_is_refused_by_its_key(make, values, key):
    assert refused(make, **values) == key


def test_matrix_rounded_to_two_digits_is_still_reciprocal():
    rows = ((1.0, 4.0, 3.0, 5.0), (0.25, 1.0, 0.5, 2.0), (0.33, 2.0, 1.0, 2.0), (0.2, 0.5, 0.5, 1.0))

    assert AssociationSettings(pairwise=rows).pairwise == rows


def test_no_sensors_and_the_same_sensor_twice_are_refused():
    assert refused(EngineSettings, sensors=()) == "sensors"
    assert refused(EngineSettings, sensors=(ADSB, ADSB)) == "sensors.id"


def test_sensor_is_found_by_its_id_and_an_unknown_one_is_an_error():
    settings = EngineSettings(sensors=(ADSB, SensorSettings(**RADAR)))

    assert settings.sensor_index("radar1") == 1
    with pytest.raises(UnknownSensorError, match="no sensor 'radar9'"):
        settings.sensor_index("radar9")
